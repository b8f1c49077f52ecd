"""Two sets of modes and responses, at two values of a parameter: what each says, and whether they are of one structure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.constraints import describe_row
from strainsight.fem.mass_product import has_mass, mass_product
from strainsight.foreign.given_motion import GivenMotion
from strainsight.foreign.of_results import (
    DIGITS,
    Forces,
    Results,
    forces_on_rows,
    said,
)
from strainsight.foreign.results_checks import (
    check_modes,
    check_responses,
    check_rows,
    mass_normalised,
    unresolved_rows,
)
from strainsight.mesh.model import Mesh

KEY = "mesh.results.second"


@dataclass(frozen=True)
class Change:
    """The parameter, whose regions are those of the second set, and its values [SI] in the first and the second one."""

    parameter: Parameter
    first: float
    second: float

    def share(self, theta: float) -> float:
        """(θ − θ₀)/(θ₁ − θ₀)."""
        return (theta - self.first) / (self.second - self.first)


@dataclass(frozen=True)
class Observed:
    """One set: motions U (3n + 3r, m + s) of unit energy, forces X U that hold them (the same shape), λ (m,) [rad²/s²], ω in Hz,
    rounding and sentences."""

    motion: np.ndarray
    force: np.ndarray
    lam: np.ndarray
    frequency: np.ndarray
    rounding: float
    notes: tuple[str, ...]


def check_values(change: Change) -> None:
    """Raises UserError for one value of both sets."""
    if abs(change.second / change.first - 1) < 1e-6:
        raise UserError(
            f"both sets were made with {change.parameter.name} = {change.first:g}: they do not say what it changes",
            key=f"{KEY}.at",
            remedy="make the second set with another value, 20 % to 50 % away",
        )


def check_supports(mesh: Mesh, given: tuple[GivenMotion, GivenMotion]) -> None:
    """A row that no motion of one set moves, no motion of the other does. Raises UserError."""
    held = [~own.field.any(axis=1) & own.known for own in given]
    other = np.flatnonzero((held[0] != held[1]) & given[0].known & given[1].known)
    if other.size:
        which = "first" if held[0][other[0]] else "second"
        raise UserError(
            f"the {which} set holds {describe_row(mesh, given[0].constraint, int(other[0]))} ({other.size} such motions), the "
            "other does not",
            key=KEY,
            remedy="make both sets with the same supports",
        )


def observed(
    mesh: Mesh, given: GivenMotion, results: Results, forces: Forces | None, names: tuple[str, ...], key: str
) -> Observed:
    """One set with what our own mass of the mesh says of it, each motion scaled to unit energy:

        X U = [M Φ Λ, f]

    names: of all loads; key: of the set, for errors. Raises UserError without a mass of all nodes, and for what `results_model`
    refuses of modes and responses.
    """
    m = len(results.frequency)
    check_modes(results.frequency, results.where)
    check_rows(mesh, given)
    if not has_mass(mesh) or unresolved_rows(mesh, given, mesh.nodes_of_elements).size:
        raise UserError(
            "two sets are put together by the mass of the mesh, and a region has no density or a node no motion",
            key=key,
            remedy="give mesh.materials with densities, and results of all nodes",
        )
    weighed = mass_product(mesh, given.constraint.reference_rows, given.field)
    norm = np.einsum("ij,ij->j", given.field[:, :m], weighed[:, :m])
    _, notes = mass_normalised(results.modal_mass, norm)
    Phi, M_Phi = given.field[:, :m] / np.sqrt(norm), weighed[:, :m] / np.sqrt(norm)
    lam = (2 * np.pi * results.frequency) ** 2
    z, f = given.field[:, :0], given.field[:, :0]
    if forces is not None:
        z, f = given.field[:, m:], forces_on_rows(mesh, given, forces)[:, results.load]
        of_loads = tuple(names[i] for i in results.load)
        found, work = (Phi, z, lam), (z.T @ f, Phi.T @ f)
        beside = (weighed[:, m:], np.ones(m))
        notes += check_responses(of_loads, results.where[m:], found, work, beside, results.rounding)
        notes += said(names, results, 0, False, 0.0)
    scale = 1 / np.sqrt(np.concatenate([lam, np.einsum("ij,ij->j", z, f)]))
    motion, force = np.hstack([Phi, z]) * scale, np.hstack([M_Phi * lam, f]) * scale
    return Observed(motion, force, lam, results.frequency, results.rounding, tuple(notes))


def asymmetry(own: Observed) -> float:
    """How far UᵀXU, of unit diagonal, is from symmetric: what is known of X by the forces is not better. That of a lumped mass,
    or of a response with few digits, is not zero."""
    X = own.motion.T @ own.force
    return float(np.abs(X - X.T).max())


def check_frequencies(change: Change, first: Observed, second: Observed, stiff: bool) -> None:
    """λ₁/λ₀ of every mode lies between 1 and θ₁/θ₀, θ₀/θ₁ of a density, and not all are 1 (Courant and Fischer)."""
    count, ratio = min(len(first.lam), len(second.lam)), change.second / change.first
    moved = second.lam[:count] / first.lam[:count]
    low, high = sorted((1.0, ratio if stiff else 1 / ratio))
    slack = 1e-6 + DIGITS * max(first.rounding, second.rounding)
    wrong = np.flatnonzero((moved < low * (1 - slack)) | (moved > high * (1 + slack)))
    name = change.parameter.name
    values = f"{name} from {change.first:g} to {change.second:g}"
    if wrong.size:
        i = int(wrong[0])
        raise UserError(
            f"mode {i + 1} goes from {first.frequency[i]:.6g} to {second.frequency[i]:.6g} Hz: {values} can only move it by a "
            f"factor of {np.sqrt(low):.4g} to {np.sqrt(high):.4g}",
            key=KEY,
            remedy="change nothing but this parameter between the sets, write as many modes of both from the lowest on, and "
            "check the two values (mesh.results.at, mesh.results.second.at)",
        )
    if np.abs(moved - 1).max() < slack:
        raise UserError(
            f"the second set has the frequencies of the first: {values} has moved none of {count}",
            key=KEY,
            remedy="give the file that was made with the other value",
        )

"""What a part of the stiffness or mass adds, from modes and responses that another program found at two values of it.

With U₀ = [Φ₀, z₀] at θ₀ and U₁ = [Φ₁, z₁] at θ₁, and what our own mass M and the loads f say of them,

    A U₀ = [M Φ₀Λ₀, f],     B U₁ = [M Φ₁Λ₁, f],     K(θ) = A + (θ − θ₀)/(θ₁ − θ₀) D,     D = B − A,

of A, B and D on U = [U₀, U₁] the blocks U₀ᵀAU₀, U₁ᵀBU₁ and N = U₀ᵀDU₁ = U₀ᵀBU₁ − U₀ᵀAU₁ are known, and both sets are reproduced
whatever U₀ᵀDU₀ and U₁ᵀDU₁ are: two sets do not say these. But D is the strain energy of the region alone,
which is c₁K̃₁ + c₂K̃₂ of an isotropic material, K̃ the stiffness of our own elements with unit modulus and two Poisson ratios: N
gives c by least squares, and what is left of it, S = N − U₀ᵀK̃U₁, enters by the motion of the region, U₁ ≈ U₀a and U₀ ≈ U₁b there:

    U₁ᵀDU₁ = U₁ᵀK̃U₁ + (aᵀS + Sᵀa)/2,     U₀ᵀDU₀ = U₀ᵀK̃U₀ + (Sb + bᵀSᵀ)/2

Of a density D is that of our own mass, and A is known on all of U.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator, Parameter, of_stiffness
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.constraints import Constraint, describe_row
from strainsight.fem.mass import has_mass, mass_product
from strainsight.fem.model import FiniteElementModel, FullModel
from strainsight.foreign.of_results import (
    DIGITS,
    Forces,
    GivenMotion,
    Results,
    as_operator,
    as_sparse,
    check_responses,
    forces_on_rows,
    independent,
    normalise_results,
    said,
    unresolved_rows,
)
from strainsight.mesh.model import Material, Mesh, Region
from strainsight.mesh.properties import with_value

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
    if not has_mass(mesh) or unresolved_rows(mesh, given, mesh.nodes_of_elements).size:
        raise UserError(
            "two sets are put together by the mass of the mesh, and a region has no density or a node no motion",
            key=key,
            remedy="give mesh.materials with densities, and results of all nodes",
        )
    modes = normalise_results(mesh, given, results, by_mesh=True)
    assert modes.weighed is not None
    notes, z, f = [*modes.notes], modes.response[:, :0], modes.response[:, :0]
    if forces is not None:
        z, f = modes.response, forces_on_rows(mesh, given, forces)[:, results.load]
        notes += check_responses(modes, f, results, names) + said(names, results, 0, False, 0.0)
    scale = 1 / np.sqrt(np.concatenate([modes.lam, np.einsum("ij,ij->j", z, f)]))
    motion, force = np.hstack([modes.shape, z]) * scale, np.hstack([modes.weighed[0] * modes.lam, f]) * scale
    return Observed(motion, force, modes.lam, results.frequency, results.rounding, tuple(notes))


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


POISSON = (0.0, 0.3)
"""Of two isotropic materials, of which every other is a combination."""
LEAST = 1e-8
"""Energy of a motion beside the others, of unit energy, below which what the sets say of it is rounding."""
OF_STRAIN = 100.0
"""Energy beside the others, in roundings of the files, that a motion needs for its strain to be more than their rounding."""
FEW_DIGITS = 1e-6
"""Rounding of text of six digits, and more."""
APART = 1e-10
"""Share of the largest energy in the region below which a motion there is rounding."""
FORM, NOTED = 0.1, 0.01
"""Share of what changes between the sets that is not of the form of the region: more is refused, or named."""
REPRODUCED = 1e-3
"""Frequencies of the model may differ by as much from those of the results."""
BEYOND = 0.1
"""Share of its bound by which the stiffness of the region may be beyond it, as the sets are not exact."""


def model_of_two(
    mesh: Mesh,
    given: tuple[GivenMotion, GivenMotion],
    results: tuple[Results, Results],
    forces: Forces | None,
    names: tuple[str, ...],
    scaled: Mapping[str, tuple[str, float]],
    change: Change,
) -> FullModel:
    """K and M of the coordinates (Φ₀, r₀, what U₁ has beside these), affine in the parameter of the change.

    Arguments as of `results_model`, of two sets; scaled: what other parameters the rest is proportional to. Raises UserError for
    what `results_model` refuses of either set; without a mass; for the same value twice, sets with different supports,
    frequencies that move as this parameter cannot move them, regions of other elements than isotropic solids, a change that is
    not of the form of the regions, and a model that does not have the modes of both sets.
    """
    own = change.parameter
    check_values(change)
    check_supports(mesh, given)
    stiff = of_stiffness(own.property)
    meshes = [
        mesh if stiff else with_value(mesh, "density", own.regions, value) for value in (change.first, change.second)
    ]
    first, second = (
        observed(each, moved, found, forces, names, key)
        for each, moved, found, key in zip(meshes, given, results, ("mesh.results", KEY), strict=True)
    )
    check_frequencies(change, first, second, stiff)
    U, k = np.hstack([first.motion, second.motion]), first.motion.shape[1]
    rows = given[0].constraint.reference_rows
    M0 = U.T @ mass_product(meshes[0], rows, U)
    across = (first.force.T @ second.motion, first.motion.T @ second.force)
    A00, A11 = first.motion.T @ first.force, second.motion.T @ second.force
    notes: list[str] = []
    if stiff:
        D, notes = _change_of_stiffness(mesh, own, U, k, across[1] - across[0])
        A11 = A11 - D[k:, k:]
        X0, X1 = _whole(A00, across[0], A11), D / (change.second - change.first)
    else:
        X0, X1 = M0, (U.T @ mass_product(meshes[1], rows, U) - M0) / (change.second - change.first)
        A = _whole(A00, 0.5 * (across[0] + across[1]), A11)
    A = X0 if stiff else A
    rounding = max(first.rounding, second.rounding)
    exact = max(OF_STRAIN * rounding, asymmetry(first), asymmetry(second))
    C = _coordinates(A, len(first.lam), k, max(LEAST, exact))
    A, M0, X0, X1 = (_symmetric(C.T @ X @ C) for X in (A, M0, X0, X1))
    if stiff:
        X1 = _within(X1, A, change.first)
    _check_reproduced(change, (first, second), A, M0, X1, stiff)
    affine = AffineOperator(sparse.csr_array(X0 - change.first * X1), {own.name: sparse.csr_array(X1)})
    stiffness = affine if stiff else as_operator(A, scaled.get("stiffness"))
    mass = as_operator(M0, scaled.get("mass")) if stiff else affine
    if rounding >= FEW_DIGITS:
        notes.append(
            f"the files have digits to {rounding:.0e}: what {own.name} changes is a difference of both, and σ may be off by "
            "1e-3; binary files do better"
        )
    constraint = Constraint(as_sparse(U @ C), rows, np.zeros(0, dtype=np.int64))
    model = FiniteElementModel(mesh, constraint, stiffness, mass)
    return FullModel(model, notes=(*first.notes, *second.notes, *notes), modes=len(first.lam), alike=False)


def _change_of_stiffness(
    mesh: Mesh, own: Parameter, U: np.ndarray, k: int, N: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """D on U, of which N = U₀ᵀDU₁ is known, and a sentence on how much of N is not of the form of the regions."""
    forms = [U.T @ _product(X, U) for X in _forms(mesh, own)]
    c = np.linalg.lstsq(np.stack([X[:k, k:].ravel() for X in forms], axis=1), N.ravel(), rcond=1e-10)[0]
    form = np.asarray(sum(value * X for value, X in zip(c, forms, strict=True)))
    S = N - form[:k, k:]
    off = float(np.linalg.norm(S) / np.linalg.norm(N))
    if off > FORM:
        raise UserError(
            f"{off:.0%} of what differs between the sets is not of the form of an isotropic stiffness of "
            f"{', '.join(str(mesh.regions[r]) for r in own.regions)}",
            key=KEY,
            remedy="change nothing but this parameter between the sets, in these regions; of an anisotropic material, or where "
            "more than this changes, give the deck itself, or mesh.matrices",
        )
    energy = _symmetric(np.asarray(sum(forms)))
    a = _pseudo_inverse(energy[:k, :k]) @ energy[:k, k:]
    b = _pseudo_inverse(energy[k:, k:]) @ energy[k:, :k]
    D = _whole(form[:k, :k] + _symmetric(S @ b), N, form[k:, k:] + _symmetric(a.T @ S))
    if off <= NOTED:
        return D, []
    return D, [
        f"{off:.1%} of what {own.name} changes is not of the form of our elements: between the two values frequencies are off by "
        "about a hundredth of that"
    ]


def _forms(mesh: Mesh, own: Parameter) -> list[sparse.csr_array]:
    """Stiffness (3n, 3n) [m] of the solids of each region, of unit modulus and both Poisson ratios."""
    found = []
    for number in own.regions:
        solid = [block for block in mesh.blocks if np.any(block.region == number)]
        thin = any(np.any(block.region == number) for block in mesh.thin)
        other = thin or mesh.anisotropic_of(number) is not None or number in mesh.composites
        if not solid or other:
            raise UserError(
                f"{mesh.regions[number]} is not of isotropic solids alone: two sets of results do not say what it adds",
                key=f"parameters.{own.name}.region",
                remedy="free a property of solids of an isotropic material, or give the deck itself, or mesh.matrices",
            )
        blocks = tuple(
            replace(block, ids=block.ids[here], nodes=block.nodes[here], region=block.region[here])
            for block in solid
            for here in [block.region == number]
        )
        region = {number: Region(number, mesh.regions[number].name, 1)}
        part = Mesh(mesh.node_ids, mesh.position, blocks, regions=region)
        of_ratios = (replace(part, materials={1: Material(1, 1.0, ratio, 0.0)}) for ratio in POISSON)
        found += [assemble_stiffness(own) for own in of_ratios]
    return found


def _product(X: sparse.csr_array, U: np.ndarray) -> np.ndarray:
    """X U, rows beyond the translations zero."""
    found = np.zeros_like(U)
    found[: X.shape[0]] = X @ U[: X.shape[0]]
    return found


def _pseudo_inverse(X: np.ndarray) -> np.ndarray:
    strength, V = np.linalg.eigh(X)
    kept = strength > APART * strength[-1]
    return np.asarray((V[:, kept] / strength[kept]) @ V[:, kept].T)


def _coordinates(A: np.ndarray, m: int, k: int, least: float) -> np.ndarray:
    """C (columns of U → coordinates): Φ₀ of unit mass, then what is left of z₀, then of U₁, orthogonal in A and of unit energy;
    what has less than `least` of its energy left is dropped."""
    size = len(A)
    C = np.eye(size)[:, :m]
    for group in (slice(m, k), slice(k, size)):
        X = np.eye(size)[:, group]
        X = X - C @ np.linalg.solve(C.T @ A @ C, C.T @ A @ X)
        Y, energy = independent(np.diag(np.diag(A)[group]), X.T @ A @ X, least)
        C = np.hstack([C, X @ Y / np.sqrt(energy)])
    return C


def _within(X1: np.ndarray, A: np.ndarray, first: float) -> np.ndarray:
    """0 ≤ θ₀X₁ ≤ A, as the region and the rest of the structure have stiffness, to `BEYOND`: what is further beyond, of motions
    that hardly stand out of the others, is set to that, so that K is positive definite from θ₀/11 to 11 θ₀."""
    share, V = eigh(first * X1, A)
    return np.asarray(_symmetric((A @ V * np.clip(share, -BEYOND, 1 + BEYOND)) @ (A @ V).T) / first)


def _check_reproduced(
    change: Change, sets: tuple[Observed, Observed], A: np.ndarray, M: np.ndarray, X1: np.ndarray, stiff: bool
) -> None:
    """The lowest modes at either value are those of the set."""
    for number, own in zip(("first", "second"), sets, strict=True):
        step = 0.0 if number == "first" else change.second - change.first
        K, mass = (A + step * X1, M) if stiff else (A, M + step * X1)
        found = np.sqrt(eigh(K, mass, eigvals_only=True)[: len(own.lam)]) / (2 * np.pi)
        off = np.abs(found / own.frequency - 1)
        worst = int(np.argmax(off))
        if not off[worst] < REPRODUCED:
            raise UserError(
                f"the model of both sets has mode {worst + 1} of the {number} one at {found[worst]:.6g} Hz, the file at "
                f"{own.frequency[worst]:.6g} Hz",
                key=KEY,
                remedy="give both sets the mesh, the densities and the loads that they were made with, and all modes from the "
                "lowest on in both",
            )


def _whole(X00: np.ndarray, X01: np.ndarray, X11: np.ndarray) -> np.ndarray:
    return np.block([[_symmetric(X00), X01], [X01.T, _symmetric(X11)]])


def _symmetric(X: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (X + X.T))

"""A model in the coordinates of modes and static responses that another program found, without its stiffness and mass.

With K φᵢ = ωᵢ² M φᵢ, ΦᵀMΦ = I and K zⱼ = fⱼ, in z = Φ q + r p with the residuals rⱼ = zⱼ − Φ Λ⁻¹Φᵀfⱼ,

    K = diag(Λ, R),   M = diag(I, rᵀM r),   R = zᵀf − (Φᵀf)ᵀΛ⁻¹(Φᵀf)

is known but for the mass of the residuals: ΦᵀM r = 0 and ΦᵀK r = 0. Source: MacNeal, A hybrid method of component mode synthesis
(1971); Craig and Kurdila, Fundamentals of Structural Dynamics, 17.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import Constraint
from strainsight.fem.mass_product import has_mass, mass_product
from strainsight.fem.model import FiniteElementModel, FullModel
from strainsight.foreign.given_motion import GivenMotion
from strainsight.foreign.results_checks import (
    check_modes,
    check_responses,
    check_rows,
    mass_normalised,
    unresolved_rows,
)
from strainsight.mesh.model import Mesh

ABOVE = 10.0
"""Where nothing says how heavy a residual is, it has so many times the frequency of the highest mode: quasi-static."""
DIGITS = 4.0
"""Roundings of the file that the energy of a residual may be off by, beside that of its response."""
LEAST = 1e-20
"""Energy of a residual beside that of its response that is rounding of double precision: 1e-10 of the motion."""

Forces = Callable[[FiniteElementModel], np.ndarray]
"""A model → Tᵀe (n_free, n_u) of unit loads on its free motions, as `input_shape`."""


@dataclass(frozen=True)
class Results:
    """What files say of m modes and s static responses to loads, in SI units; their motion is a `GivenMotion`.

    frequency (m,) [Hz] ascending; load (s,): which of the loads, by its place among them, a static response is the answer to, per
    unit of it; modal_mass (m,) [kg m²]: ΦᵀMΦ of the shapes where it is known, else None; rounding: largest relative error of a
    number; where (m + s,): file and step of each.
    """

    frequency: np.ndarray
    load: np.ndarray
    modal_mass: np.ndarray | None
    rounding: float
    where: tuple[str, ...]


def results_model(
    mesh: Mesh,
    given: GivenMotion,
    results: Results,
    forces: Forces | None,
    names: tuple[str, ...],
    scaled: Mapping[str, tuple[str, float]],
) -> FullModel:
    """K and M of the coordinates (Φ, r), and z = [Φ, r] q on the rows of the mesh.

    given: motion of the modes [m, rad] and of the responses [m/N, rad/N]; forces: the loads, called `names`; None: modes alone;
    scaled: "stiffness" or "mass" → the parameter that it is proportional to and the parameter's value [SI] that the results were
    made with.
    The mass of residuals is the consistent mass of the mesh where all its nodes are in the results and all its regions have a
    density; else K = (10 ω_max)² M for them. A residual whose energy is not above the rounding of its file adds no coordinate.
    Raises UserError for modes that are rigid or have no known mass, for rows that the surface or a load needs and the results
    lack, and for a response that is not that of its load.
    """
    m = len(results.frequency)
    check_modes(results.frequency, results.where)
    check_rows(mesh, given)
    weighed = _weighed(mesh, given)
    own = None if weighed is None else np.einsum("ij,ij->j", given.field[:, :m], weighed[:, :m])
    norm, notes = mass_normalised(results.modal_mass, own)
    Phi, lam = given.field[:, :m] / np.sqrt(norm), (2 * np.pi * results.frequency) ** 2
    found = Residuals(np.zeros((len(Phi), 0)), np.zeros(0), np.zeros((0, 0)))
    if forces is not None:
        e = forces_on_rows(mesh, given, forces)
        found, more = _residuals(results, given.field[:, m:], (Phi, lam), e, names, weighed, norm)
        notes += more
    K = np.diag(np.concatenate([lam, found.stiffness]))
    M = np.eye(len(K))
    M[m:, m:] = found.mass
    T = as_sparse(np.hstack([Phi, found.field]))
    constraint = Constraint(T, given.constraint.reference_rows, np.zeros(0, dtype=np.int64))
    stiffness, mass = (as_operator(X, scaled.get(kind)) for kind, X in (("stiffness", K), ("mass", M)))
    return FullModel(FiniteElementModel(mesh, constraint, stiffness, mass), notes=tuple(notes), modes=m)


@dataclass(frozen=True)
class Residuals:
    """field r (3n + 3r, k), orthogonal to the modes in M and K and to each other in K; stiffness (k,) and mass (k, k) of them."""

    field: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray


def _weighed(mesh: Mesh, given: GivenMotion) -> np.ndarray | None:
    """M of the field, where the mesh has densities and every node of its elements a motion."""
    if not has_mass(mesh) or unresolved_rows(mesh, given, mesh.nodes_of_elements).size:
        return None
    return mass_product(mesh, given.constraint.reference_rows, given.field)


def _residuals(
    results: Results,
    z: np.ndarray,
    modes: tuple[np.ndarray, np.ndarray],
    e: np.ndarray,
    names: tuple[str, ...],
    weighed: np.ndarray | None,
    norm: np.ndarray,
) -> tuple[Residuals, list[str]]:
    """r Y of r = z − Φ Λ⁻¹Φᵀf, YᵀR Y diagonal, of responses of unit energy; z (3n + 3r, s); modes: Φ and λ; e (3n + 3r, n_u) unit
    loads of these names; weighed: M of the field as its file has it; norm (m,): ΦᵀMΦ of its modes. And sentences on them."""
    (Phi, lam), m = modes, len(norm)
    f = e[:, results.load]
    G, P = z.T @ f, Phi.T @ f
    of_loads = tuple(names[i] for i in results.load)
    beside = None if weighed is None else (weighed[:, m:], np.einsum("ij,ij->j", Phi, weighed[:, :m]) / np.sqrt(norm))
    notes = check_responses(of_loads, results.where[m:], (Phi, z, lam), (G, P), beside, results.rounding)
    share = P / lam[:, None]
    Y, R = independent(G, G - P.T @ share, max(LEAST, DIGITS * results.rounding))
    field = (z - Phi @ share) @ Y
    if weighed is None:
        mass = np.diag(R / (ABOVE**2 * lam[-1]))
    else:
        mass = field.T @ ((weighed[:, m:] - weighed[:, :m] / np.sqrt(norm) @ share) @ Y)
    notes += said(names, results, len(f.T) - len(R), weighed is None, ABOVE * results.frequency[-1])
    return Residuals(field, R, 0.5 * (mass + mass.T)), notes


def forces_on_rows(mesh: Mesh, given: GivenMotion, forces: Forces) -> np.ndarray:
    """e (3n + 3r, n_u) of unit loads. Raises UserError where one acts on a row that the results lack."""
    moves = ~given.known | given.field.any(axis=1)
    T = sparse.csr_array(sparse.diags_array(moves.astype(float)))
    T.eliminate_zeros()  # a row that is held moves by nothing, for whatever looks at T
    nothing = AffineOperator(sparse.csr_array((len(moves),) * 2), {})
    constraint = Constraint(T, given.constraint.reference_rows, np.arange(len(moves)))
    e = forces(FiniteElementModel(mesh, constraint, nothing, nothing))
    check_rows(mesh, given, np.flatnonzero(e.any(axis=1)))
    return e


def independent(G: np.ndarray, R: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Y (s, k) with YᵀRY = diag, and that diagonal (k,), of responses scaled to unit energy G; what is below `least` is left
    out: it depends on the modes and the others."""
    if not len(R):
        return np.zeros((0, 0)), np.zeros(0)
    scale = 1 / np.sqrt(np.diag(G))
    energy, U = np.linalg.eigh(0.5 * (R + R.T) * np.outer(scale, scale))
    kept = energy > least
    return scale[:, None] * U[:, kept], energy[kept]


def said(names: tuple[str, ...], results: Results, dropped: int, quasi_static: bool, above: float) -> list[str]:
    notes = []
    without = [name for i, name in enumerate(names) if i not in results.load]
    if without:
        notes.append(
            f"no static response to {', '.join(without)}: what the {len(results.frequency)} modes do not carry of such a load "
            "is missing in its strain"
        )
    if dropped:
        notes.append(
            f"{dropped} of {len(results.load)} static responses hold nothing beside the modes and the others, to "
            f"the {results.rounding:.0e} of the digits of their file"
        )
    if quasi_static and len(results.load) > dropped:
        notes.append(
            f"the mesh does not say how heavy the static residuals are: they follow their loads as one of {above:.4g} Hz would, "
            f"{ABOVE:g} times the highest mode"
        )
    return notes


def as_sparse(X: np.ndarray) -> sparse.csr_array:
    """X (n, k) without its zeros; as csr_array(X) with a third of its memory."""
    n, k = X.shape
    index = sparse.get_index_dtype(maxval=n * k)
    found = sparse.csr_array(
        (X.ravel(), np.tile(np.arange(k, dtype=index), n), np.arange(0, n * k + 1, k, dtype=index)), shape=(n, k)
    )
    found.eliminate_zeros()
    return found


def as_operator(X: np.ndarray, by: tuple[str, float] | None) -> AffineOperator:
    """X(θ) = X θ/θ₀."""
    if by is None:
        return AffineOperator(sparse.csr_array(X), {})
    return AffineOperator(sparse.csr_array(X.shape), {by[0]: sparse.csr_array(X / by[1])})

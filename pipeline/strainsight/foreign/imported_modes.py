"""Reduced model in the coordinates of modes and static responses from another program, without its stiffness and mass.

With K φᵢ = ωᵢ² M φᵢ, ΦᵀMΦ = I and K zⱼ = fⱼ, in z = Φ q + r p with the residuals rⱼ = zⱼ − Φ Λ⁻¹Φᵀfⱼ,

    K = diag(Λ, R),   M = diag(I, rᵀM r),   R = zᵀf − (Φᵀf)ᵀΛ⁻¹(Φᵀf)

is known except for the mass of the residuals: ΦᵀM r = 0 and ΦᵀK r = 0. Source: MacNeal, A hybrid method of component
mode synthesis (1971); Craig and Kurdila, Fundamentals of Structural Dynamics, 17."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import Constraint, constraint_transform, describe_row
from strainsight.fem.equations import turning_nodes
from strainsight.fem.mass import has_mass, mass_product
from strainsight.fem.model import FiniteElementModel, FullModel
from strainsight.foreign.results.response import check_modes, normalising_mass
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh

LOOSE = 1e-10
"""Eigenvalue of the normal equations with unit columns below which the data do not determine the motion of a reference node."""


@dataclass(frozen=True)
class ImportedMotion:
    """constraint: ties of the mesh without supports; field (3n + 3r, k) on the rows of its z, zero where `known` (3n
    + 3r,) is False."""

    constraint: Constraint
    field: np.ndarray
    known: np.ndarray


def extend_motion(mesh: Mesh, motion: np.ndarray) -> ImportedMotion:
    """Motions (k, n, 3 or 6) of the nodes, NaN if missing → rows of z.

        z = data at the nodes with data,     z = T z_free elsewhere,     z_free by least squares of T z_free = data

    Thus the reference node of a rigid element moves with its nodes, that of an averaging element is their mean, and
    nodes on faces of shells move with the face. Rows without data are not known. Supports of the mesh are ignored:
    rows without motion in the results are fixed. Raises the errors of `constraint_transform`."""
    n = len(mesh.position)
    constraint = constraint_transform(replace(mesh, fixed=mesh.fixed[:0]), rotations=turning_nodes(mesh))
    T = constraint.transform
    z = np.full((T.shape[0], len(motion)), np.nan)
    z[: 3 * n] = motion[:, :, :3].reshape(len(motion), 3 * n).T
    if motion.shape[2] == 6 and constraint.reference_rows:
        nodes = np.array(list(constraint.reference_rows), dtype=np.int64)
        z[constraint.rotations(nodes).ravel()] = motion[:, nodes, 3:].reshape(len(motion), -1).T
    known = np.isfinite(z).all(axis=1)
    z[~known] = 0.0
    free, determined = _free_motions(constraint, z, known)
    rows = np.flatnonzero(~known)
    undetermined = abs(T[rows]) @ (~determined).astype(float) > 0
    rows = rows[(np.diff(T[rows].indptr) > 0) & ~undetermined]
    z[rows] = T[rows] @ free
    known[rows] = True
    return ImportedMotion(constraint, z, known)


def _free_motions(constraint: Constraint, z: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z_free (n_free, k), and which (n_free,) of its rows the known rows of z determine."""
    T, Q = constraint.transform, constraint.turn
    local, is_known = (z, known) if Q is None else (Q.T @ z, abs(Q).T @ (~known).astype(float) == 0)
    free, determined = local[constraint.free_rows].copy(), is_known[constraint.free_rows].copy()
    free[~determined] = 0.0
    data = T[np.flatnonzero(known)]
    unknown = np.flatnonzero(~determined)
    unknown = unknown[np.diff(data[:, unknown].tocsc().indptr) > 0]
    if not unknown.size:
        return free, determined
    A = sparse.csr_array(data[:, unknown])
    touched = np.flatnonzero(np.diff(A.indptr) > 0)
    A, left = A[touched], z[known][touched] - data[touched] @ free
    scale = 1 / np.sqrt(np.asarray(A.multiply(A).sum(axis=0)).ravel())
    A = sparse.csr_array(A @ sparse.diags_array(scale))
    strength, U = np.linalg.eigh((A.T @ A).toarray())
    significant = strength > LOOSE
    free[unknown] = scale[:, None] * (
        U[:, significant] @ ((U[:, significant].T @ (A.T @ left)) / strength[significant, None])
    )
    determined[unknown] = np.linalg.norm(U[:, ~significant], axis=1) < np.sqrt(LOOSE)
    return free, determined


ELSEWHERE = 1e-4
"""Largest distance of a node from its position in the results, relative to the mesh size."""
SHARES = 0.05
"""Largest deviation of the modal shares of a response from those of its load, relative to the response."""
SYMMETRIC = 0.01
"""Largest |z_iᵀf_j − z_jᵀf_i| relative to √(z_iᵀf_i z_jᵀf_j)."""
FOLLOWS, FACTOR = 0.9, 1.5
"""A response with cos² above FOLLOWS to the modal response of its load must have the same size within FACTOR."""

AS_LOADED = (
    "check that nodes and direction of this load are those of the load step in the results, and that `magnitude` is the load "
    "in that step [N, N m, Pa]. Check mesh.length_unit, and that the modes and this step have the same supports"
)


def check_rows(mesh: Mesh, imported: ImportedMotion, rows: np.ndarray | None = None) -> None:
    """Raise UserError if the results lack one of these rows of z, by default those of surface nodes."""
    if rows is None:
        lacking, what = unresolved_rows(mesh, imported, mesh.nodes_of_elements), "surface node"
        if lacking.size:  # inside it does not matter
            facets = exterior_facets(mesh).nodes
            lacking = unresolved_rows(mesh, imported, np.unique(facets[facets >= 0]))
    else:
        lacking, what = rows[~imported.known[rows]], "loaded node"
    if lacking.size:
        n = len(mesh.position)
        nodes = np.unique(mesh.node_ids[np.minimum(lacking, 3 * n - 1) // 3])
        turned = ", rotations are missing" if mesh.thin and imported.known[: 3 * n].any() else ""
        raise UserError(
            f"the results do not contain {describe_row(mesh, imported.constraint, int(lacking[0]))} ({what}{turned}); "
            f"results are missing at {len(nodes)} of {mesh.own_nodes} nodes of the mesh",
            key="mesh.results",
            remedy="use the mesh of the results, and export displacements of all nodes, with rotations for shells and beams",
        )


def check_positions(mesh: Mesh, rows: np.ndarray, position: np.ndarray, rounding: float, where: str) -> None:
    """Raise UserError if nodes of the mesh (rows, k) have other positions in the result file, (k, 3) [m]; NaN: not in the file.

    Nodes that follow a relation are not checked: a *TIE moves them onto its surface (ADJUST) in the results.
    rounding: largest relative error of a number of the file."""
    size = float(np.linalg.norm(np.ptp(mesh.position, axis=0)))
    distance = np.linalg.norm(position - mesh.position[rows], axis=1)
    far = distance > ELSEWHERE * size + 2.0 * rounding * abs(mesh.position).max()
    far &= ~np.isin(rows, [relation.follower[0] for relation in mesh.relations])
    if far.any():
        worst = int(np.argmax(np.where(far, distance, 0.0)))
        at, results_position = (
            ", ".join(f"{x:.6g}" for x in point) for point in (mesh.position[rows[worst]], position[worst])
        )
        raise UserError(
            f"{int(far.sum())} of {len(rows)} nodes do not have the same position in mesh and results: node "
            f"{mesh.node_ids[rows[worst]]} is at ({at}) m in the mesh, but at ({results_position}) m in the results",
            where=where,
            remedy="use the mesh of the results, with the same position and node numbers; mesh.length_unit applies to both files",
        )


def unresolved_rows(mesh: Mesh, imported: ImportedMotion, nodes: np.ndarray) -> np.ndarray:
    """Rows of the translations of nodes, and of the rotations of nodes of shells and beams, that the results do not determine."""
    rows = (3 * nodes[:, None] + np.arange(3)).ravel()
    if (turning := np.intersect1d(nodes, mesh.turning)).size:
        rows = np.concatenate([rows, imported.constraint.rotations(turning).ravel()])
    return rows[~imported.known[rows]]


def check_responses(modes: NormalisedResults, f: np.ndarray, results: Results, names: tuple[str, ...]) -> list[str]:
    """Check that each response z_j is K⁻¹f_j of its load, with relations that do not need K:

        z_iᵀf_j = z_jᵀf_i,   z_jᵀf_j ≥ Σ (φᵢᵀf_j)²/ωᵢ²,   φᵢᵀM z_j = φᵢᵀf_j/ωᵢ²

    f (rows, s) loads of the responses; names: of all loads. If the mass is unknown, z is compared with Φ Λ⁻¹Φᵀf.
    Raises UserError; returns warnings."""
    Phi, z, lam = modes.shape, modes.response, modes.lam
    G, P = z.T @ f, Phi.T @ f
    names, where = tuple(names[i] for i in results.load), results.where[len(lam) :]
    notes: list[str] = []
    s = len(names)
    energy = np.diag(G)
    for j in range(s):
        modal = float(np.sum(P[:, j] ** 2 / lam))
        if not energy[j] > 0 or modal > (1 + SHARES) * energy[j]:
            raise UserError(
                f"the work of this load on its static response is {energy[j]:.5g} J, less than its work on the modal part "
                f"of this response, {modal:.5g} J",
                key=f"mesh.results.loads.{names[j]}",
                where=where[j],
                remedy=AS_LOADED,
            )
    for i in range(s):
        for j in range(i):
            off = abs(G[i, j] - G[j, i]) / np.sqrt(energy[i] * energy[j])
            message = (
                f"the static displacement at load {names[j]} due to load {names[i]} is {G[i, j]:.5g} m/N, but the one at load "
                f"{names[i]} due to load {names[j]} is {G[j, i]:.5g} m/N"
            )
            if off > SYMMETRIC:
                raise UserError(
                    f"{message}. Both values must be equal (reciprocity), so the loads of the config "
                    "differ from those of the results",
                    key=f"mesh.results.loads.{names[i]}",
                    where=where[i],
                    remedy=AS_LOADED,
                )
            if off > max(1e-6, 10 * results.rounding):
                notes.append(f"{message} (relative difference {off:.1e}); the mean is used")
    for j in range(s):
        share = P[:, j] / lam
        if modes.weighed is not None:
            M_Phi, M_z = modes.weighed
            projected = Phi.T @ M_z[:, j] / np.einsum("ij,ij->j", Phi, M_Phi)
            off = float(np.sqrt(np.sum(lam * (projected - share) ** 2) / energy[j]))
            wrong = off > SHARES
        else:
            along = Phi @ share
            projected = share * (along @ z[:, j]) / max(along @ along, np.finfo(float).tiny)
            follows = (along @ z[:, j]) ** 2 > FOLLOWS * (along @ along) * (z[:, j] @ z[:, j])
            factor = float(projected @ share / max(share @ share, np.finfo(float).tiny))
            wrong, off = bool(follows and not 1 / FACTOR < factor < FACTOR), abs(factor - 1)
        if wrong:
            i = int(np.argmax(lam * np.maximum(share**2, projected**2)))
            raise UserError(
                f"the static response contains mode {i + 1} with the amplitude {projected[i]:.5g}, but this load excites "
                f"this mode with the amplitude {share[i]:.5g} (relative difference {off:.2g})",
                key=f"mesh.results.loads.{names[j]}",
                where=where[j],
                remedy=AS_LOADED,
            )
    return notes


ABOVE = 10.0
"""Frequency of residuals of unknown mass relative to the highest mode: quasi-static."""
DIGITS = 4.0
"""Error of the residual energy in rounding errors of the file, relative to the response."""
LEAST = 1e-20
"""Energy of a residual, relative to its response, that is rounding error of double precision: 1e-10 of the motion."""

Forces = Callable[[FiniteElementModel], np.ndarray]
"""A model → Tᵀe (n_free, n_u) of unit loads on its free motions, as `input_shape`."""


@dataclass(frozen=True)
class Results:
    """Data of m modes and s static responses to loads, in SI units; their motion is a `ImportedMotion`.

    frequency (m,) [Hz] ascending; load (s,): index of the load of each static response, per unit of it; modal_mass (m,) [kg m²]:
    ΦᵀMΦ of the shapes, None if unknown; rounding: largest relative error of a number; where (m + s,): file and step of each."""

    frequency: np.ndarray
    load: np.ndarray
    modal_mass: np.ndarray | None
    rounding: float
    where: tuple[str, ...]


def results_model(
    mesh: Mesh,
    imported: ImportedMotion,
    results: Results,
    forces: Forces | None,
    names: tuple[str, ...],
    scaled: Mapping[str, tuple[str, float]],
) -> FullModel:
    """K and M of the coordinates (Φ, r), and z = [Φ, r] q on the rows of the mesh.

    imported: motion of the modes [m, rad] and of the responses [m/N, rad/N]; forces: the loads, called `names`; None: only
    modes; scaled: "stiffness" or "mass" → its parameter and the value [SI] of this parameter in the results. The mass of
    residuals is the consistent mass of the mesh if all its nodes have results and all its regions a density; else K = (10
    ω_max)² M for them. A residual with an energy below the rounding error of its file adds no coordinate. Raises UserError for
    rigid modes, unknown modal mass, missing rows of the surface or of a load, and a response that does not belong to its load.
    """
    modes, m = normalise_results(mesh, imported, results), len(results.frequency)
    residuals, notes = Residuals(modes.shape[:, :0], np.zeros(0), np.zeros((0, 0))), list(modes.notes)
    if forces is not None:
        residuals, more = _residuals(modes, results, forces_on_rows(mesh, imported, forces), names)
        notes += more
    K = np.diag(np.concatenate([modes.lam, residuals.stiffness]))
    M = np.eye(len(K))
    M[m:, m:] = residuals.mass
    T = as_sparse(np.hstack([modes.shape, residuals.field]))
    constraint = Constraint(T, imported.constraint.reference_rows, np.zeros(0, dtype=np.int64))
    stiffness, mass = (as_operator(X, scaled.get(kind)) for kind, X in (("stiffness", K), ("mass", M)))
    return FullModel(FiniteElementModel(mesh, constraint, stiffness, mass), notes=tuple(notes), modes=m)


@dataclass(frozen=True)
class Residuals:
    """field r (3n + 3r, k), orthogonal to the modes in M and K and to each other in K; their stiffness (k,) and mass (k, k)."""

    field: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray


@dataclass(frozen=True)
class NormalisedResults:
    """shape Φ (3n + 3r, m) of unit mass, λ (m,) [rad²/s²], response z (3n + 3r, s); weighed: M Φ and M z, None if
    the mesh mass is unknown; notes on the mass."""

    shape: np.ndarray
    lam: np.ndarray
    response: np.ndarray
    weighed: tuple[np.ndarray, np.ndarray] | None
    notes: list[str]


def normalise_results(
    mesh: Mesh, imported: ImportedMotion, results: Results, by_mesh: bool = False
) -> NormalisedResults:
    """Normalise the modes by the modal mass of the file, else, or with `by_mesh`, by that of the mesh, which
    requires densities and motions of all nodes. Raises UserError for rigid modes, unknown modal mass, and missing rows."""
    m = len(results.frequency)
    check_modes(results.frequency, results.where)
    check_rows(mesh, imported)
    weighed = mesh_mass = None
    if has_mass(mesh) and not unresolved_rows(mesh, imported, mesh.nodes_of_elements).size:
        weighed = mass_product(mesh, imported.constraint.reference_rows, imported.field)
        mesh_mass = np.einsum("ij,ij->j", imported.field[:, :m], weighed[:, :m])
    norm, notes = normalising_mass(results.modal_mass, mesh_mass)
    root = np.sqrt(mesh_mass if by_mesh and mesh_mass is not None else norm)
    products = None if weighed is None else (weighed[:, :m] / root, weighed[:, m:])
    shape, lam = imported.field[:, :m] / root, (2 * np.pi * results.frequency) ** 2
    return NormalisedResults(shape, lam, imported.field[:, m:], products, notes)


def _residuals(
    modes: NormalisedResults, results: Results, e: np.ndarray, names: tuple[str, ...]
) -> tuple[Residuals, list[str]]:
    """Residuals r Y of r = z − Φ Λ⁻¹Φᵀf, YᵀR Y diagonal, of responses of unit energy, and notes; e (3n + 3r, n_u)
    unit loads of these names."""
    f, z = e[:, results.load], modes.response
    notes = check_responses(modes, f, results, names)
    G, P = z.T @ f, modes.shape.T @ f
    share = P / modes.lam[:, None]
    Y, R = independent_directions(G, G - P.T @ share, max(LEAST, DIGITS * results.rounding))
    field = (z - modes.shape @ share) @ Y
    if modes.weighed is None:
        mass = np.diag(R / (ABOVE**2 * modes.lam[-1]))
    else:
        mass = field.T @ ((modes.weighed[1] - modes.weighed[0] @ share) @ Y)
    notes += describe_responses(names, results, len(f.T) - len(R), modes.weighed is None, ABOVE * results.frequency[-1])
    return Residuals(field, R, 0.5 * (mass + mass.T)), notes


def forces_on_rows(mesh: Mesh, imported: ImportedMotion, forces: Forces) -> np.ndarray:
    """e (3n + 3r, n_u) of unit loads. Raises UserError if a load acts on a row without results."""
    moves = ~imported.known | imported.field.any(axis=1)
    T = sparse.csr_array(sparse.diags_array(moves.astype(float)))
    T.eliminate_zeros()  # a fixed row has no entries, for users of T
    nothing = AffineOperator(sparse.csr_array((len(moves),) * 2), {})
    constraint = Constraint(T, imported.constraint.reference_rows, np.arange(len(moves)))
    e = forces(FiniteElementModel(mesh, constraint, nothing, nothing))
    check_rows(mesh, imported, np.flatnonzero(e.any(axis=1)))
    return e


def independent_directions(G: np.ndarray, R: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Y (s, k) with YᵀRY = diag, and its diagonal (k,), of responses scaled to unit energy G; directions below
    `least` are dropped as dependent."""
    if not len(R):
        return np.zeros((0, 0)), np.zeros(0)
    scale = 1 / np.sqrt(np.diag(G))
    energy, U = np.linalg.eigh(0.5 * (R + R.T) * np.outer(scale, scale))
    significant = energy > least
    return scale[:, None] * U[:, significant], energy[significant]


def describe_responses(
    names: tuple[str, ...], results: Results, dropped: int, quasi_static: bool, above: float
) -> list[str]:
    notes = []
    if without := [name for i, name in enumerate(names) if i not in results.load]:
        notes.append(
            f"the results have no static response to {', '.join(without)}. The strain under such a load lacks the part that "
            f"modes 1 to {len(results.frequency)} do not represent"
        )
    if dropped:
        notes.append(
            f"{dropped} of {len(results.load)} static responses are omitted: they are linear combinations of the modes and the "
            f"other responses, within the relative precision {results.rounding:.0e} of the file"
        )
    if quasi_static and len(results.load) > dropped:
        notes.append(
            "the results define no mass for the static residuals (static responses minus their modal part). These "
            f"follow the loads quasi-statically: their frequency is set to {above:.4g} Hz, {ABOVE:g} times the highest natural "
            "frequency"
        )
    return notes


def as_sparse(X: np.ndarray) -> sparse.csr_array:
    """X (n, k) without its zeros; like csr_array(X), but with a third of the memory."""
    n, k = X.shape
    index = sparse.get_index_dtype(maxval=n * k)
    matrix = sparse.csr_array(
        (X.ravel(), np.tile(np.arange(k, dtype=index), n), np.arange(0, n * k + 1, k, dtype=index)), shape=(n, k)
    )
    matrix.eliminate_zeros()
    return matrix


def as_operator(X: np.ndarray, by: tuple[str, float] | None) -> AffineOperator:
    """X(θ) = X θ/θ₀."""
    if by is None:
        return AffineOperator(sparse.csr_array(X), {})
    return AffineOperator(sparse.csr_array(X.shape), {by[0]: sparse.csr_array(X / by[1])})

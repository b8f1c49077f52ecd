"""A model in the coordinates of modes and static responses that another program found, without its stiffness and mass.

With K φᵢ = ωᵢ² M φᵢ, ΦᵀMΦ = I and K zⱼ = fⱼ, in z = Φ q + r p with the residuals rⱼ = zⱼ − Φ Λ⁻¹Φᵀfⱼ,

    K = diag(Λ, R),   M = diag(I, rᵀM r),   R = zᵀf − (Φᵀf)ᵀΛ⁻¹(Φᵀf)

is known but for the mass of the residuals: ΦᵀM r = 0 and ΦᵀK r = 0. Source: MacNeal, A hybrid method of component mode synthesis
(1971); Craig and Kurdila, Fundamentals of Structural Dynamics, 17.
"""

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
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh

LOOSE = 1e-10
"""Eigenvalue of the normal equations of unit columns below which the motions do not say how a reference node moves."""


@dataclass(frozen=True)
class GivenMotion:
    """constraint: ties of the mesh, no supports; field (3n + 3r, k) on the rows of its z, zero where known (3n + 3r,) says no."""

    constraint: Constraint
    field: np.ndarray
    known: np.ndarray


def given_motion(mesh: Mesh, motion: np.ndarray) -> GivenMotion:
    """Motions (k, n, 3 or 6) of the nodes, NaN of those without → rows of z.

        z = data at the nodes that have some,     z = T z_free elsewhere,     z_free by least squares of T z_free = data

    so that the reference node of a rigid element, which results of solids lack, moves as the nodes that it leads, that of an
    averaging element as their mean, and what lies on faces of shells with their nodes. A row that follows from no data is not
    known. Supports of the mesh do not count: what does not move in the results is held. Raises the errors of
    `constraint_transform`.
    """
    n = len(mesh.position)
    loose = replace(mesh, fixed=np.zeros((0, 2), dtype=np.int64))
    constraint = constraint_transform(loose, rotations=turning_nodes(mesh))
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
    reached = np.diff(T[rows].indptr) > 0
    open_ = abs(T[rows]) @ (~determined).astype(float) > 0
    rows = rows[reached & ~open_]
    z[rows] = T[rows] @ free
    known[rows] = True
    return GivenMotion(constraint, z, known)


def _free_motions(constraint: Constraint, z: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z_free (n_free, k), and which (n_free,) of them the known rows of z determine."""
    T, Q = constraint.transform, constraint.turn
    own, there = (z, known) if Q is None else (Q.T @ z, abs(Q).T @ (~known).astype(float) == 0)
    free, determined = own[constraint.free_rows].copy(), there[constraint.free_rows].copy()
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
    kept = strength > LOOSE
    free[unknown] = scale[:, None] * (U[:, kept] @ ((U[:, kept].T @ (A.T @ left)) / strength[kept, None]))
    determined[unknown] = np.linalg.norm(U[:, ~kept], axis=1) < np.sqrt(LOOSE)
    return free, determined


RIGID = 1e-4
"""Of the highest frequency: a mode below is the rigid motion of a structure that nothing holds, to rounding."""
ELSEWHERE = 1e-4
"""Of the size of the mesh: a node that is farther from where the results have it is another one."""
UNIT = 0.02
"""ΦᵀMΦ of modes that are normalised to unit mass may differ so much from one: by how a program integrates or lumps mass."""
OFF = 0.1
"""ΦᵀMΦ by the mesh and by the file that differ by more are of two models."""
SHARES = 0.05
"""How far, beside its whole, a response may hold other shares of the modes than its load gives them."""
SYMMETRIC = 0.01
"""Largest |z_iᵀf_j − z_jᵀf_i| beside √(z_iᵀf_i z_jᵀf_j)."""
FOLLOWS, FACTOR = 0.9, 1.5
"""A response that runs along what its load makes of the modes, cos² above the first, is as large but for the second."""

AS_LOADED = (
    "check that the load is the one of that step, in its direction and on its nodes; that `applied` is its size there in the "
    "unit of the load [N, N m, Pa]; the units of the mesh; and that modes and step have the same supports"
)


def check_modes(frequency: np.ndarray, where: tuple[str, ...]) -> None:
    """Raise UserError unless every mode (m,) [Hz] has stiffness."""
    rigid = np.flatnonzero(~(frequency > RIGID * frequency.max(initial=0.0)))
    if rigid.size:
        raise UserError(
            f"a mode of {frequency[rigid[0]]:.4g} Hz ({rigid.size} below {RIGID:g} of the highest, {frequency.max():.4g} Hz): "
            "the structure is free, or not stable",
            where=where[int(rigid[0])],
            remedy="hold it in the other program as in the test, or hang it on soft springs there, and write modes and responses "
            "again",
        )


def check_rows(mesh: Mesh, given: GivenMotion, rows: np.ndarray | None = None) -> None:
    """Raise UserError where the results lack one of these rows of z, by default those of the nodes of the surface."""
    if rows is None:
        lacking, what = unresolved_rows(mesh, given, mesh.nodes_of_elements), "which is on the surface"
        if lacking.size:  # inside it does not matter
            facets = exterior_facets(mesh).nodes
            lacking = unresolved_rows(mesh, given, np.unique(facets[facets >= 0]))
    else:
        lacking, what = rows[~given.known[rows]], "on which a load acts"
    if lacking.size:
        n = len(mesh.position)
        nodes = np.unique(mesh.node_ids[np.minimum(lacking, 3 * n - 1) // 3])
        turned = " (no rotations)" if mesh.thin and given.known[: 3 * n].any() else ""
        raise UserError(
            f"the results lack {describe_row(mesh, given.constraint, int(lacking[0]))}, {what}{turned}: of {len(nodes)} of the "
            f"{mesh.own_nodes} nodes of the mesh a motion is missing",
            key="mesh.results",
            remedy="give the mesh that the results are of, and write displacements of all nodes; of shells and beams rotations "
            "too",
        )


def check_positions(mesh: Mesh, rows: np.ndarray, position: np.ndarray, rounding: float, where: str) -> None:
    """Raise UserError where nodes of the mesh (rows, k) are elsewhere in the file of results, (k, 3) [m]; NaN: not stated.

    Nodes whose motion follows by a relation do not count: a *TIE moves them onto its surface (ADJUST), where results have them.
    rounding: largest relative error of a number of the file.
    """
    size = float(np.linalg.norm(np.ptp(mesh.position, axis=0)))
    distance = np.linalg.norm(position - mesh.position[rows], axis=1)
    far = distance > ELSEWHERE * size + 2.0 * rounding * abs(mesh.position).max()
    far &= ~np.isin(rows, [own.follower[0] for own in mesh.relations])
    if far.any():
        worst = int(np.argmax(np.where(far, distance, 0.0)))
        at, there = (", ".join(f"{x:.6g}" for x in own) for own in (mesh.position[rows[worst]], position[worst]))
        raise UserError(
            f"{int(far.sum())} of {len(rows)} nodes are elsewhere in the results: node {mesh.node_ids[rows[worst]]} of the mesh "
            f"is at ({at}) m, there at ({there}) m",
            where=where,
            remedy="give the mesh that the results are of, in its place and with its numbers; mesh.length_unit is that of both "
            "files",
        )


def unresolved_rows(mesh: Mesh, given: GivenMotion, nodes: np.ndarray) -> np.ndarray:
    """Rows of the translations of nodes, and of the rotations of those of shells and beams, that no result determines."""
    rows = (3 * nodes[:, None] + np.arange(3)).ravel()
    turning = np.intersect1d(nodes, mesh.turning)
    if turning.size:
        rows = np.concatenate([rows, given.constraint.rotations(turning).ravel()])
    return rows[~given.known[rows]]


def mass_normalised(stated: np.ndarray | None, own: np.ndarray | None) -> tuple[np.ndarray, list[str]]:
    """ΦᵀMΦ (m,) [kg m²] by which the shapes are normalised, and a sentence on where it is from.

    stated: by the file or the config; own: by the mesh. Raises UserError where neither is there, or they contradict each other.
    """
    if stated is None and own is None:
        raise UserError(
            "the file does not say how its modes are normalised, and the mesh has no density by which to find out",
            key="mesh.results.modal_mass",
            remedy="state modal_mass: unit where ΦᵀMΦ = 1 in the units of the file (MASS in Nastran, always in CalculiX); or "
            "give mesh.materials with densities, and results of all nodes",
        )
    if stated is None:
        assert own is not None
        return own, [f"modes are normalised by the densities of the mesh; ΦᵀMΦ of the first was {own[0]:.4g} kg"]
    if own is None:
        return stated, []
    off = own / stated
    worst = int(np.argmax(np.abs(np.log(off))))
    if abs(off[worst] - 1) > OFF:
        raise UserError(
            f"by the densities of the mesh the modal mass of mode {worst + 1} is {off[worst]:.4g} times that of the results",
            key="mesh.results",
            remedy="give the densities and point masses that the results were made with, and the units of the file; or leave the "
            "densities out; modes that are not of unit mass: modal_mass: mesh",
        )
    if abs(off[worst] - 1) > UNIT:
        return stated, [
            f"by the densities of the mesh the modal mass of mode {worst + 1} is {off[worst]:.4g} times that of the results, "
            "whose own is taken"
        ]
    return stated, []


def check_responses(modes: NormalisedResults, f: np.ndarray, results: Results, names: tuple[str, ...]) -> list[str]:
    """Whether each response z_j is K⁻¹f_j of its load, of what is known without K:

        z_iᵀf_j = z_jᵀf_i,   z_jᵀf_j ≥ Σ (φᵢᵀf_j)²/ωᵢ²,   φᵢᵀM z_j = φᵢᵀf_j/ωᵢ²

    f (rows, s) the loads of the responses; names: of all loads. Where the mass is not known, z is held against Φ Λ⁻¹Φᵀf. Raises
    UserError; returns sentences for a warning.
    """
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
                f"under this load its response does a work of {energy[j]:.5g} J, and the modes alone take {modal:.5g} J of it",
                key=f"mesh.results.loads.{names[j]}",
                where=where[j],
                remedy=AS_LOADED,
            )
    for i in range(s):
        for j in range(i):
            off = abs(G[i, j] - G[j, i]) / np.sqrt(energy[i] * energy[j])
            said = f"{names[j]} moves along the response to {names[i]} by {G[i, j]:.5g} m/N, {names[i]} along that to {names[j]}"
            if off > SYMMETRIC:
                raise UserError(
                    f"{said} by {G[j, i]:.5g} m/N: these are not the loads of the results, for which both are one number",
                    key=f"mesh.results.loads.{names[i]}",
                    where=where[i],
                    remedy=AS_LOADED,
                )
            if off > max(1e-6, 10 * results.rounding):
                notes.append(f"{said} by {G[j, i]:.5g} m/N, off by {off:.1e} of their sizes; the mean is taken")
    for j in range(s):
        share = P[:, j] / lam
        if modes.weighed is not None:
            M_Phi, M_z = modes.weighed
            held = Phi.T @ M_z[:, j] / np.einsum("ij,ij->j", Phi, M_Phi)
            off = float(np.sqrt(np.sum(lam * (held - share) ** 2) / energy[j]))
            wrong = off > SHARES
        else:
            along = Phi @ share
            held = share * (along @ z[:, j]) / max(along @ along, np.finfo(float).tiny)
            follows = (along @ z[:, j]) ** 2 > FOLLOWS * (along @ along) * (z[:, j] @ z[:, j])
            factor = float(held @ share / max(share @ share, np.finfo(float).tiny))
            wrong, off = bool(follows and not 1 / FACTOR < factor < FACTOR), abs(factor - 1)
        if wrong:
            i = int(np.argmax(lam * np.maximum(share**2, held**2)))
            raise UserError(
                f"the response holds {held[i]:.5g} of mode {i + 1}, this load gives it {share[i]:.5g}: off by {off:.2g} of the "
                "whole",
                key=f"mesh.results.loads.{names[j]}",
                where=where[j],
                remedy=AS_LOADED,
            )
    return notes


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
    modes, m = normalise_results(mesh, given, results), len(results.frequency)
    found, notes = Residuals(modes.shape[:, :0], np.zeros(0), np.zeros((0, 0))), list(modes.notes)
    if forces is not None:
        found, more = _residuals(modes, results, forces_on_rows(mesh, given, forces), names)
        notes += more
    K = np.diag(np.concatenate([modes.lam, found.stiffness]))
    M = np.eye(len(K))
    M[m:, m:] = found.mass
    T = as_sparse(np.hstack([modes.shape, found.field]))
    constraint = Constraint(T, given.constraint.reference_rows, np.zeros(0, dtype=np.int64))
    stiffness, mass = (as_operator(X, scaled.get(kind)) for kind, X in (("stiffness", K), ("mass", M)))
    return FullModel(FiniteElementModel(mesh, constraint, stiffness, mass), notes=tuple(notes), modes=m)


@dataclass(frozen=True)
class Residuals:
    """field r (3n + 3r, k), orthogonal to the modes in M and K and to each other in K; stiffness (k,) and mass (k, k) of them."""

    field: np.ndarray
    stiffness: np.ndarray
    mass: np.ndarray


@dataclass(frozen=True)
class NormalisedResults:
    """shape Φ (3n + 3r, m) of unit mass, λ (m,) [rad²/s²], response z (3n + 3r, s); weighed: M Φ and M z, None where the mass of
    the mesh is not known; sentences on the mass."""

    shape: np.ndarray
    lam: np.ndarray
    response: np.ndarray
    weighed: tuple[np.ndarray, np.ndarray] | None
    notes: list[str]


def normalise_results(mesh: Mesh, given: GivenMotion, results: Results, by_mesh: bool = False) -> NormalisedResults:
    """Modes by the modal mass of their file, else, or `by_mesh`, by that of the mesh, which is known where it has densities and
    every node of its elements a motion. Raises UserError for modes that are rigid or of no known mass, and missing rows."""
    m = len(results.frequency)
    check_modes(results.frequency, results.where)
    check_rows(mesh, given)
    weighed = own = None
    if has_mass(mesh) and not unresolved_rows(mesh, given, mesh.nodes_of_elements).size:
        weighed = mass_product(mesh, given.constraint.reference_rows, given.field)
        own = np.einsum("ij,ij->j", given.field[:, :m], weighed[:, :m])
    norm, notes = mass_normalised(results.modal_mass, own)
    root = np.sqrt(own if by_mesh and own is not None else norm)
    products = None if weighed is None else (weighed[:, :m] / root, weighed[:, m:])
    lam = (2 * np.pi * results.frequency) ** 2
    return NormalisedResults(given.field[:, :m] / root, lam, given.field[:, m:], products, notes)


def _residuals(
    modes: NormalisedResults, results: Results, e: np.ndarray, names: tuple[str, ...]
) -> tuple[Residuals, list[str]]:
    """r Y of r = z − Φ Λ⁻¹Φᵀf, YᵀR Y diagonal, of responses of unit energy; e (3n + 3r, n_u) unit loads of these names. And
    sentences on them."""
    f, z = e[:, results.load], modes.response
    notes = check_responses(modes, f, results, names)
    G, P = z.T @ f, modes.shape.T @ f
    share = P / modes.lam[:, None]
    Y, R = independent(G, G - P.T @ share, max(LEAST, DIGITS * results.rounding))
    field = (z - modes.shape @ share) @ Y
    if modes.weighed is None:
        mass = np.diag(R / (ABOVE**2 * modes.lam[-1]))
    else:
        mass = field.T @ ((modes.weighed[1] - modes.weighed[0] @ share) @ Y)
    notes += said(names, results, len(f.T) - len(R), modes.weighed is None, ABOVE * results.frequency[-1])
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

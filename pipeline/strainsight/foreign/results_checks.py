"""Whether modes and static responses of another program belong to the mesh, and to the loads that a config names with them."""

from __future__ import annotations

import numpy as np

from strainsight.errors import UserError
from strainsight.fem.constraints import describe_row
from strainsight.foreign.given_motion import GivenMotion
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh

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


def check_responses(
    names: tuple[str, ...],
    where: tuple[str, ...],
    found: tuple[np.ndarray, np.ndarray, np.ndarray],
    work: tuple[np.ndarray, np.ndarray],
    weighed: tuple[np.ndarray, np.ndarray] | None,
    rounding: float,
) -> list[str]:
    """Whether each response z_j is K⁻¹f_j of its load, of what is known without K:

        z_iᵀf_j = z_jᵀf_i,   z_jᵀf_j ≥ Σ (φᵢᵀf_j)²/ωᵢ²,   φᵢᵀM z_j = φᵢᵀf_j/ωᵢ²

    names (s,) of the loads; found: Φ (rows, m), z (rows, s), λ (m,); work: zᵀf (s, s), Φᵀf (m, s); weighed: M z (rows, s) and
    ΦᵀMΦ (m,), None where the mass is not known: z is then held against Φ Λ⁻¹Φᵀf. Raises UserError; returns sentences for a
    warning.
    """
    (Phi, z, lam), (G, P) = found, work
    notes, s = [], len(names)
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
            if off > max(1e-6, 10 * rounding):
                notes.append(f"{said} by {G[j, i]:.5g} m/N, off by {off:.1e} of their sizes; the mean is taken")
    for j in range(s):
        share = P[:, j] / lam
        if weighed is not None:
            Mz, norm = weighed
            held = Phi.T @ Mz[:, j] / norm
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

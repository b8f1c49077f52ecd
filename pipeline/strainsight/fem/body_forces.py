"""Weight and the inertia of a rotation, as forces on nodes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from strainsight.errors import UserError
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.thin import thin_mass
from strainsight.fem.ties import references, turned_by_name
from strainsight.fem.turning import followers
from strainsight.mesh.forces import BodyForce, NodalForces
from strainsight.mesh.model import FloatArray, Mesh


def body_forces(mesh: Mesh, body: BodyForce) -> NodalForces:
    """f_a = Σ_b m_ab a(x_b) on the nodes of solids, m_ab = ∫ ρ N_a N_b dV, as a(x) is linear in x: the same work as ∫ ρ a dV; of
    shells and beams M a, forces and moments.

        a = g + (ω × (x − c)) × ω,     of a point mass m a and r × m a − ω × Jω on the rotations of its node

    r offset of the centre of the mass, J its inertia; of a mass matrix the inertia of its momentum P and H, turned with the body:

        force = m_uu g − ω × P,   moment = m_θu g − ω × H − v × P,   (P, H) = M (v, ω),   v = ω × (x − c)

    where the node has no rotations, all of the mass is at the node.
    Raises UserError where a region has no material, and so no density.
    """
    lacking = [region for region in mesh.regions.values() if mesh.density_of(region.id) is None]
    if lacking:
        raise UserError(f"{lacking[0]} has no density, and a load acts on its mass", remedy="state mesh.materials")
    force, moment = np.zeros_like(mesh.position), np.zeros_like(mesh.position)
    a, regions = body.factor * acceleration(body, mesh.position), set()
    for part, m in element_mass_parts(mesh):
        own = np.ones(len(part.ids), bool) if body.elements is None else np.isin(part.ids, body.elements)
        i, j = np.triu_indices(part.nodes.shape[1])
        m, nodes = m[own], part.nodes[own]
        np.add.at(force, nodes[:, i], m[:, :, None] * a[nodes[:, j]])
        off = i != j
        np.add.at(force, nodes[:, j[off]], m[:, off, None] * a[nodes[:, i[off]]])
        regions |= set(np.unique(part.region[own]).tolist())
    if mesh.thin:
        M, named = thin_mass(mesh, body.elements)
        own = mesh.thin_nodes
        f = (M @ np.hstack([a[own], np.zeros((len(own), 3))]).ravel()).reshape(-1, 6)
        force[own] += f[:, :3]
        moment[own] += f[:, 3:]
        regions |= set(named)
    turning = (
        references(mesh)
        | turned_by_name(mesh)
        | followers(mesh)
        | {*mesh.turning.tolist(), *mesh.turned_by_springs.tolist()}
    )
    for point in mesh.point_masses:
        if body.elements is not None and point.id not in body.elements:
            continue
        if point.matrix is not None:
            pull, twist = _on_matrix(point.matrix, body, mesh.position[point.node], turns=point.node in turning)
            force[point.node] += pull
            moment[point.node] += twist
            continue
        arm = point.offset if point.node in turning else np.zeros(3)
        pull = body.factor * point.mass * acceleration(body, mesh.position[point.node] + arm)
        force[point.node] += pull
        if point.node in turning:
            spin = -np.cross(body.rotation, np.asarray(point.inertia) @ body.rotation)
            moment[point.node] += np.cross(arm, pull) + body.factor * spin
    nodes = np.flatnonzero(force.any(axis=1) | moment.any(axis=1))
    return NodalForces(nodes, force[nodes], moment[nodes] if moment.any() else None, regions=tuple(sorted(regions)))


def _on_matrix(M: FloatArray, body: BodyForce, x: np.ndarray, *, turns: bool) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment (3,) on the node at x of a mass matrix; only of its translations where the node has no rotations.

    Source: Lamb, Hydrodynamics, §124: a solid with another mass along each axis.
    """
    if not turns:
        M = M * np.outer(np.repeat([1, 0], 3), np.repeat([1, 0], 3))
    v, omega = np.cross(body.rotation, x - body.centre), body.rotation
    P, H = np.split(M @ np.concatenate([v, omega]), 2)
    force = M[:3, :3] @ body.acceleration - np.cross(omega, P)
    moment = M[3:, :3] @ body.acceleration - np.cross(omega, H) - np.cross(v, P)
    return body.factor * force, body.factor * moment * turns


def acceleration(body: BodyForce, x: np.ndarray) -> np.ndarray:
    """a = g + (ω × (x − c)) × ω at points x (..., 3) [m/s²], without its factor."""
    return np.asarray(body.acceleration + np.cross(np.cross(body.rotation, x - body.centre), body.rotation))


def odd_gravity(mesh: Mesh, loads: Collection[str] | None = None) -> list[str]:
    """A sentence for every load of the file whose acceleration is that of gravity in another unit of length; as it is stated,
    without the factor by which loads are combined, and not in cm: 9.81 times 100 is 100 g. loads: names of those that count."""
    found = []
    for name, load in mesh.loads.items():
        for body in load.body if loads is None or name in loads else ():
            size = float(np.linalg.norm(body.acceleration))
            for unit, factor in ELSEWHERE.items():
                if abs(size * factor / 9.81 - 1) < 0.01:
                    found.append(
                        f"load {name} pulls with {size:.4g} m/s²: gravity is 9.81 m/s², and the deck seems to state it in "
                        f"{unit}/s², beside another mesh.length_unit"
                    )
    return found


ELSEWHERE = {"m": 1e3, "mm": 1e-3, "in": 0.0254}
"""Unit in which an acceleration seems to be meant → what makes g of it: 9.81 in a deck in mm, 9810 in one in m."""


def with_body_forces(mesh: Mesh) -> Mesh:
    """The mesh with the body forces of its loads among their forces: as its densities are now."""
    loads = {}
    for name, load in mesh.loads.items():
        parts = [replace(load, body=()), *(body_forces(mesh, body) for body in load.body)]
        loads[name] = _sum(parts) if load.body else load
    return replace(mesh, loads=loads)


def _sum(parts: list[NodalForces]) -> NodalForces:
    nodes, place = np.unique(np.concatenate([part.nodes for part in parts]), return_inverse=True)
    force, moment, start = np.zeros((len(nodes), 3)), np.zeros((len(nodes), 3)), 0
    for part in parts:
        own = place[start : start + len(part.nodes)]
        np.add.at(force, own, part.force)
        if part.moment is not None:
            np.add.at(moment, own, part.moment)
        start += len(part.nodes)
    regions = tuple(sorted({number for part in parts for number in part.regions}))
    return NodalForces(nodes, force, moment if moment.any() else None, regions=regions)

"""What of a model leads to no ground, and what resists a rigid motion though it leads to none; masses that outweigh it."""

from __future__ import annotations

import numpy as np

from strainsight.errors import StrainsightError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.grounded import grounded
from strainsight.fem.mass import mass_properties
from strainsight.fem.support import rigid_body_motions
from strainsight.fem.turning import turning_nodes
from strainsight.mesh.model import Mesh

HEAVY = 100.0
"""Times the mass of the elements that point masses may have together without a question."""
STEEL = 7850.0
"""[kg/m³] A mass that is no larger than the structure where it is a ball of steel may well hang on it."""
SHOWN = 3
"""Springs and relations that are named."""


def free_motions(mesh: Mesh) -> tuple[str, ...]:
    """Rigid motions that supports and ties leave, in words; raises the errors of `rigid_body_motions`."""
    return rigid_body_motions(mesh, constraint_transform(mesh, rotations=turning_nodes(mesh)))


def loose_warnings(mesh: Mesh) -> tuple[str, ...]:
    """A sentence where a structure that is held somewhere can move all the same, as `modes` would refuse it."""
    if not mesh.elements or not (mesh.held.size or mesh.springs or mesh.relations):
        return ()
    try:
        motions = free_motions(mesh)
    except StrainsightError as error:
        return (f"{error.what}: {error.remedy}" if error.remedy else error.what,)
    if not motions:
        return ()
    more = f" and {len(motions) - 8} more" if len(motions) > 8 else ""
    return (
        f"the structure can move freely: {', '.join(motions[:8])}{more}; add supports or ties that hold these motions "
        "(mesh.supports, mesh.ties), or let it be free (mesh.free)",
    )


def grounding_warnings(mesh: Mesh) -> tuple[str, ...]:
    """A sentence on springs and relations that a rigid motion of the whole stretches."""
    found = grounded(mesh)
    if not found:
        return ()
    named = "; ".join(f"{own.name} ({own.motion}, nodes {own.apart:.3g} m apart)" for own in found[:SHOWN])
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return (
        f"springs or relations between nodes resist a rigid motion of the whole, as a support would: {named}{more}; let "
        "their ends coincide, or let them act along the line between these",
    )


def heavy_points(mesh: Mesh) -> tuple[str, ...]:
    """A sentence where point masses outweigh the elements, and as steel would be larger than the whole structure, as by another
    unit of mass: a ball of mass m is 2 (3m/4πρ)^⅓ across."""
    points = sum(point.mass for point in mesh.point_masses)
    if points <= 0 or any(mesh.density_of(number) is None for number in mesh.regions):
        return ()
    own = mass_properties(mesh)[0] - points
    ball = 2 * float(np.cbrt(3 * points / (4 * np.pi * STEEL)))
    long = float(np.linalg.norm(np.ptp(mesh.position[mesh.nodes_of_elements], axis=0)))
    if own <= 0 or points <= HEAVY * own or ball <= long:
        return ()
    return (
        f"point masses of {points:.4g} kg outweigh the elements, {own:.4g} kg, {points / own:.3g} times, and as "
        f"a ball of steel they would be {ball:.3g} m across beside a structure of {long:.3g} m: their unit is that of the deck, "
        "mesh.mass_unit; a base that is moved by way of a large mass may stand",
    )

"""How far gauges stay from edges, supports and loads: as stated, or as their carrier asks where that leaves a choice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from strainsight.config.gauge_types import gauge_type
from strainsight.config.placement import PlacementConfig
from strainsight.errors import InfeasibleError
from strainsight.fem.couple import nodes_at
from strainsight.mesh.additions import node_indices
from strainsight.mesh.facets import Facets, exterior_facets, facet_key
from strainsight.mesh.model import Mesh
from strainsight.records.training import CARRIER, STATED, Clearance, Training
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.clearance import carrier_clearance, crowded, half_diagonal, obstacles, room_for
from strainsight.sensors.curvature import sides, tight
from strainsight.sensors.zones import on_surface

CHOICE = 50
"""Places that the default has to leave: with fewer it would be the clearance that places the gauges. It does not depend on how
many these are, so that another `place.keep` leaves the screening as it is."""
STEPS = (1.0, 0.5, 0.25)
"""Of the carrier's clearance: what is tried on a part that is too small for it, before there is none."""


def clearance_of(config: PlacementConfig, mesh: Mesh, training: Training) -> tuple[Clearance | None, np.ndarray]:
    """The clearance that is kept, None where none was to be, and which gauges (gauges,) are too near to something for it.

    Only strain gauges that are still to be bonded on the mesh keep one: where the others are is not ours to choose, and a sensor
    of motion reads no strain. A default that does not leave `CHOICE` places, so far apart as screening asks, is halved, halved
    again, then left out.
    Raises InfeasibleError where a stated one leaves no place.
    """
    pool, stated = training.candidates, config.gauges.clearance
    first, blocked = pool.first, np.zeros(pool.gauges, dtype=bool)
    own = np.flatnonzero((pool.quantity[first] == STRAIN) & ~pool.bonded[first])
    if stated == "none" or training.given is not None or not len(own):
        return None, blocked
    facets, part = exterior_facets(mesh), pool.take(first[own])
    points, places = part.position, part.grids.position
    around = obstacles(mesh, facets, loaded_nodes(config, mesh, facets))
    if names := [zone for zone in config.gauges.exclude if isinstance(zone, str)]:
        on = np.any([on_surface(mesh, facets, name) for name in names], axis=0)
        around["faces"] = sides(mesh.position, facets, on)
    kind = gauge_type(config.gauges)
    lying: dict[str, np.ndarray] = {}
    if kind is not None and kind.bend_radius > 0:
        bends = tight(mesh.position, facets, kind.bend_radius)
        around["bends"], lying["bends"] = sides(mesh.position, facets, bends), _lies_on(part, facets, bends)

    def nearer(distance: float) -> dict[str, np.ndarray]:
        """Which of them are too near to each obstacle, or on it; a bridge with any of its arms."""
        near = {name: part.any_grid(mask) for name, mask in crowded(places, around, distance).items()}
        return {name: mask | lying.get(name, False) for name, mask in near.items()}

    if stated is not None:
        wanted = float(stated)
        near = nearer(wanted)
        blocked[own] = _any(near)
        if blocked[own].all():
            raise InfeasibleError(
                f"none of {len(points)} candidates is {1e3 * wanted:.3g} mm from every {_listed(around)}",
                key="gauges.clearance",
                remedy="state a smaller one, or none; zones of gauges.exclude leave out what has to be",
            )
        return Clearance(distance=wanted, wanted=wanted, rule=STATED, near=_counts(near)), blocked
    wanted = (
        carrier_clearance(config.gauges.grid_length)
        if kind is None
        else half_diagonal(kind.carrier_length, kind.carrier_width)
    )
    for step in STEPS:
        near = nearer(step * wanted)
        if room_for(points[~_any(near)], config.screen.minimum_spacing, CHOICE):
            blocked[own] = _any(near)
            return Clearance(distance=step * wanted, wanted=wanted, rule=CARRIER, near=_counts(near)), blocked
    return Clearance(distance=0.0, wanted=wanted, rule=CARRIER, near={}), blocked


def bent_gauges(config: PlacementConfig, mesh: Mesh, training: Training) -> np.ndarray:
    """Which strain gauges (gauges,) lie on a facet that bends tighter than their type may be bent, bonded ones too; none without
    a type.

    Raises InfeasibleError where all candidates do.
    """
    pool, kind = training.candidates, gauge_type(config.gauges)
    bent = np.zeros(pool.gauges, dtype=bool)
    own = np.flatnonzero(pool.quantity[pool.first] == STRAIN)
    if kind is None or kind.bend_radius == 0 or training.given is not None or not len(own):
        return bent
    facets, part = exterior_facets(mesh), pool.take(pool.first[own])
    bent[own] = _lies_on(part, facets, tight(mesh.position, facets, kind.bend_radius))
    free = own[~pool.bonded[pool.first[own]]]
    if len(free) and bent[free].all():
        raise InfeasibleError(
            f"the surface bends tighter than the {1e3 * kind.bend_radius:g} mm to which {config.gauges.type} may be bent at all "
            f"{len(free)} candidates",
            key="gauges.type",
            remedy="choose a smaller type, or another surface (gauges.surface, gauges.include)",
        )
    return bent


def bent_warning(config: PlacementConfig, training: Training, bent: np.ndarray) -> str:
    """Which bonded gauges lie on a surface that bends too tightly for their type, by `bent_gauges`; empty where none does."""
    pool, kind = training.candidates, gauge_type(config.gauges)
    there = np.flatnonzero(bent & pool.bonded[pool.first])
    if kind is None or not len(there):
        return ""
    names = ", ".join(training.name[i] or f"fixed {i + 1}" for i in there)
    return (
        f"Bonded already where the surface bends tighter than the {1e3 * kind.bend_radius:g} mm of {config.gauges.type}: "
        f"{names}. Check that the carrier holds there, or state gauges.type as of the gauges that are bonded."
    )


def _lies_on(part: Candidates, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Which gauges (gauges,) lie on the chosen facets (f,), a bridge with any of its arms."""
    grids = part.grids
    return part.any_grid(np.isin(facet_key(grids.element, grids.facet), facets.key[chosen]))


OF_THEM = {"faces": "face of gauges.exclude", "bends": "bend too tight for gauges.type"}
"""In words, of one; others without their s."""


def _listed(names: Iterable[str]) -> str:
    *others, last = (OF_THEM.get(name, name.removesuffix("s")) for name in names)
    return f"{', '.join(others)} and {last}"


def _any(near: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.asarray(np.any(list(near.values()), axis=0))


def _counts(near: Mapping[str, np.ndarray]) -> dict[str, int]:
    return {name: int(np.count_nonzero(mask)) for name, mask in near.items()}


def loaded_nodes(config: PlacementConfig, mesh: Mesh, facets: Facets) -> np.ndarray:
    """Nodes (l,) (indices) of the surface on which loads of the config act, of a moment on a node those that exert its couple. A
    load that acts inside the body too, as weight does, has no place to stay clear of, nor has one that is spread over shells."""
    outside, solid = (np.zeros(len(mesh.position), dtype=bool) for _ in range(2))
    outside[facets.nodes[facets.nodes >= 0]] = True
    for block in mesh.blocks:
        solid[block.nodes] = True
    found = np.zeros(len(mesh.position), dtype=bool)
    for load in config.loads.values():
        own = np.zeros(len(mesh.position), dtype=bool)
        if load.deck_load is not None:
            forces = mesh.loads[load.deck_load]
            turned = False if forces.moment is None else forces.moment.any(axis=1)
            own[forces.nodes[forces.force.any(axis=1) | turned]] = True
        elif load.set is not None:
            own[node_indices(mesh, load.set)] = True
        elif load.node is not None:
            own[mesh.node_ids == load.node] = True
            if load.moment is not None:
                # on a node of solids it is a couple of forces on those of its elements, some of which may be inside
                found[nodes_at(mesh, int(np.flatnonzero(own)[0]))] |= bool(np.any(own & solid))
        if not np.any(own & solid & ~outside):
            for nodes in (shell.nodes for shell in mesh.shells):
                own[nodes[own[nodes].all(axis=1)]] = False
            found |= mesh.above(own) & outside
    return np.flatnonzero(found & outside)


def clearance_in_words(found: Clearance, taken: int) -> str:
    """The clearance, whose rule it is, and how many candidates it took."""
    if found.distance == 0:
        return "no clearance from edges, supports and loads"
    near = ", ".join(f"{count} to {name}" for name, count in found.near.items() if count)
    how = {STATED: "", CARRIER: ", half the diagonal of a carrier"}[found.rule]
    if found.distance < found.wanted:
        how = f", reduced from {1e3 * found.wanted:.3g} mm"
    return f"clearance {1e3 * found.distance:.3g} mm{how}, {taken} nearer{near and f': {near}'}"


def clearance_warning(found: Clearance) -> str:
    """What a reader has to know of a default that the part is too small for; empty where it is kept."""
    if found.distance == found.wanted:
        return ""
    kept = f"{1e3 * found.distance:.3g} mm is kept" if found.distance else "none is kept"
    return (
        f"A clearance of {1e3 * found.wanted:.3g} mm from edges, supports and loads, half the diagonal of a gauge's carrier, "
        f"leaves fewer than {CHOICE} places here: {kept}. Mesh more finely, or state gauges.clearance (a length, or "
        "none) for the gauge that you have."
    )

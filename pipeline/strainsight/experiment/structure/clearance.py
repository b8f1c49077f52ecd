"""Checks of gauge positions: clearance, curvature, strain gradient, access, and hot spots of the mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.config.gauge_types import gauge_type
from strainsight.config.placement import PlacementConfig
from strainsight.errors import InfeasibleError
from strainsight.experiment.recorded import named_regions
from strainsight.experiment.structure.mesh import held_below
from strainsight.experiment.structure.structure import Structure
from strainsight.fem.affine import of_stiffness
from strainsight.fem.loads import nodes_at
from strainsight.mesh.additions import node_indices, region_ids
from strainsight.mesh.facets import Facets, facet_key
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import with_value
from strainsight.records.placed import AtGauges, HotSpots
from strainsight.records.training import CARRIER, STATED, Clearance
from strainsight.runner.output import Table
from strainsight.sensors.access import HAND, room
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.edges import carrier_clearance, crowded, half_diagonal, obstacles, sides, spaced, tight
from strainsight.sensors.hot_spots import hot_spots
from strainsight.sensors.installation import sensitivity_rows
from strainsight.sensors.strain_operator import installation_axes
from strainsight.sensors.zones import on_surface

FEWEST, CHOICE = 20, 50
"""The default clearance has to leave half of the locations, at least FEWEST; CHOICE are always enough. Independent of
`place.keep`, so that screening is, too."""
STEPS = (1.0, 0.5, 0.25)
"""Fractions of the default clearance that are tried in turn on small parts."""


def clearance_of(structure: Structure, excluded: np.ndarray) -> tuple[Clearance | None, np.ndarray]:
    """Clearance in force (None if disabled), and which gauges (gauges,) violate it.

    It applies to strain gauges on the mesh that are not bonded yet and not excluded (gauges,) for another reason. The default is
    halved twice, then dropped, until it leaves enough locations at the minimum spacing of screening (`CHOICE`). Raises
    InfeasibleError if a configured clearance leaves none."""
    config, mesh, pool, setting = structure.config, structure.mesh, structure.pool, structure.config.gauges.clearance
    first, blocked = pool.first, np.zeros(pool.gauges, dtype=bool)
    free = np.flatnonzero((pool.quantity[first] == STRAIN) & ~pool.bonded[first] & ~excluded)
    if setting == "none" or structure.training.strain_operator is not None or not len(free):
        return None, blocked
    facets, part = structure.skin.facets, pool.take(first[free])
    points, places = part.position, part.grids.position
    around = obstacles(mesh, facets, loaded_nodes(config, mesh, facets))
    if names := [zone for zone in config.gauges.exclude if isinstance(zone, str)]:
        on = np.any([on_surface(mesh, facets, name) for name in names], axis=0)
        around["faces"] = sides(mesh.position, facets, on)
    kind = gauge_type(config.gauges)
    lying: dict[str, np.ndarray] = {}
    if kind is not None and kind.bend_radius > 0:
        bends = tight(mesh.position, facets, kind.bend_radius)
        around["bends"], lying["bends"] = sides(mesh.position, facets, bends), lies_on(part, facets, bends)

    def nearer(distance: float) -> dict[str, np.ndarray]:
        """Which gauges are too near to each obstacle, a bridge with any of its arms."""
        near = {name: part.any_grid(mask) for name, mask in crowded(places, around, distance).items()}
        return {name: mask | lying.get(name, False) for name, mask in near.items()}

    rule = CARRIER if setting is None else STATED
    if setting is not None:
        wanted = float(setting)
    elif kind is None:
        wanted = carrier_clearance(config.gauges.grid_length)
    else:
        wanted = half_diagonal(kind.carrier_length, kind.carrier_width)
    spacing = config.screen.minimum_spacing
    needed = max(FEWEST, len(spaced(points, spacing, 2 * CHOICE)) // 2) if rule == CARRIER else 1
    for step in STEPS if rule == CARRIER else (1.0,):
        near = nearer(step * wanted)
        close = np.any(list(near.values()), axis=0)
        if len(spaced(points[~close], spacing, needed)) == needed:
            blocked[free] = close
            counts = {name: int(np.count_nonzero(mask)) for name, mask in near.items()}
            return Clearance(distance=step * wanted, wanted=wanted, rule=rule, near=counts, needed=needed), blocked
    if rule == CARRIER:
        return Clearance(distance=0.0, wanted=wanted, rule=rule, near={}, needed=needed), blocked
    *others, last = (OBSTACLE_NAMES.get(name, name.removesuffix("s")) for name in around)
    raise InfeasibleError(
        f"none of {len(points)} candidates is at least {1e3 * wanted:.3g} mm from every {', '.join(others)} and {last}",
        key="gauges.clearance",
        remedy="Reduce gauges.clearance, or set gauges.clearance: none and exclude critical areas by gauges.exclude.",
    )


def bent_gauges(structure: Structure) -> np.ndarray:
    """Which strain gauges (gauges,), bonded ones too, lie on a facet with a radius below the bend radius of their type.

    Raises InfeasibleError if all candidates do."""
    gauges, mesh, pool = structure.config.gauges, structure.mesh, structure.pool
    kind = gauge_type(gauges)
    bent = np.zeros(pool.gauges, dtype=bool)
    straining = np.flatnonzero(pool.quantity[pool.first] == STRAIN)
    if kind is None or kind.bend_radius == 0 or structure.training.strain_operator is not None or not len(straining):
        return bent
    facets, part = structure.skin.facets, pool.take(pool.first[straining])
    bent[straining] = lies_on(part, facets, tight(mesh.position, facets, kind.bend_radius))
    free = straining[~pool.bonded[pool.first[straining]]]
    if len(free) and bent[free].all():
        raise InfeasibleError(
            f"at all {len(free)} candidates the surface radius is below the minimum bend radius of gauge type {gauges.type}, "
            f"{1e3 * kind.bend_radius:g} mm",
            key="gauges.type",
            remedy="Choose a gauge type with a smaller bend radius, or another surface (gauges.surface, gauges.include).",
        )
    return bent


def bent_warning(structure: Structure, bent: np.ndarray) -> str:
    """Warning about bonded gauges on a surface too curved for their type (`bent_gauges`), empty without any."""
    pool, gauges = structure.pool, structure.config.gauges
    kind = gauge_type(gauges)
    bonded = np.flatnonzero(bent & pool.bonded[pool.first])
    if kind is None or not len(bonded):
        return ""
    names = ", ".join(structure.training.name[i] or f"fixed {i + 1}" for i in bonded)
    return (
        f"At {names} the surface radius is below the minimum bend radius of gauge type {gauges.type}, "
        f"{1e3 * kind.bend_radius:g} mm. Check the adhesion of the carrier, or set gauges.type to the bonded type."
    )


def lies_on(part: Candidates, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Which gauges (gauges,) lie on the chosen facets (f,), a bridge with any of its arms."""
    grids = part.grids
    return part.any_grid(np.isin(facet_key(grids.element, grids.facet), facets.key[chosen]))


OBSTACLE_NAMES = {"faces": "face of gauges.exclude", "bends": "surface with a radius too small for gauges.type"}
"""Obstacles in the singular; others without their s."""


def loaded_nodes(config: PlacementConfig, mesh: Mesh, facets: Facets, pressures: bool = True) -> np.ndarray:
    """Indices (l,) of surface nodes on which loads of the config act, for a nodal moment those that carry its couple.

    Loads that also act inside the body, as weight, loads distributed over shells, and optionally pressures are omitted."""
    outside, solid = (np.zeros(len(mesh.position), dtype=bool) for _ in range(2))
    outside[facets.nodes[facets.nodes >= 0]] = True
    for block in mesh.blocks:
        solid[block.nodes] = True
    loaded = np.zeros(len(mesh.position), dtype=bool)
    for load in config.loads.values():
        acted_on = np.zeros(len(mesh.position), dtype=bool)
        if load.pressure and not pressures:
            continue
        if load.deck_load is not None:
            forces = mesh.loads[load.deck_load]
            turned = False if forces.moment is None else forces.moment.any(axis=1)
            acted_on[forces.nodes[forces.force.any(axis=1) | turned]] = True
        elif load.set is not None:
            acted_on[node_indices(mesh, load.set)] = True
        elif load.node is not None:
            acted_on[mesh.node_ids == load.node] = True
            if load.moment is not None:
                # a moment on a node of solids is a couple of forces on nodes of its elements, some of them inside
                loaded[nodes_at(mesh, int(np.flatnonzero(acted_on)[0]))] |= bool(np.any(acted_on & solid))
        if not np.any(acted_on & solid & ~outside):
            for nodes in (shell.nodes for shell in mesh.shells):
                acted_on[nodes[acted_on[nodes].all(axis=1)]] = False
            loaded |= mesh.above(acted_on) & outside
    return np.flatnonzero(loaded & outside)


def clearance_in_words(clearance: Clearance, total: int) -> str:
    """Describe the clearance, its origin and how many candidates violate it."""
    if clearance.distance == 0:
        return "no clearance from edges, supports and loads"
    near = ", ".join(f"{count} to {name}" for name, count in clearance.near.items() if count)
    how = {STATED: "", CARRIER: " (half the carrier diagonal)"}[clearance.rule]
    if clearance.distance < clearance.wanted:
        how = f" (reduced from {1e3 * clearance.wanted:.3g} mm)"
    return (
        f"clearance {1e3 * clearance.distance:.3g} mm{how}, {total} candidates closer than that{near and f': {near}'}"
    )


def clearance_warning(clearance: Clearance) -> str:
    """Warning that the default clearance was reduced, else empty."""
    if clearance.distance == clearance.wanted:
        return ""
    used = f"{1e3 * clearance.distance:.3g} mm is used" if clearance.distance else "no clearance is used"
    return (
        f"The default clearance of {1e3 * clearance.wanted:.3g} mm from edges, supports and loads (half the carrier diagonal) "
        f"leaves fewer than {clearance.needed} locations, so {used}. Refine the mesh, or set gauges.clearance for your gauge "
        "type: a length [m] or none."
    )


IN_PLACE, OVER_GRID = 0.05, 0.2
"""Allowed change of a reading by one σ of position, and of strain over the grid length. On smooth parts 2 mm change 1 to 1.5 %;
a linear gradient over the grid causes no error."""
STEP = 0.001
"""σ [m] for strain slopes if the position has no tolerance."""


def at_gauges(structure: Structure, gauges: np.ndarray) -> AtGauges | None:
    """Strain gradients and access at gauges (k,) along the training simulation; None for gauges without a surface.

    With the slopes s₁, s₂ of a grid's strain along e₁ and e₂, its strain ε and time t:

        in place      √(σ² Σ (rms_t s₁² + rms_t s₂²)) / rms_t ε        for a gauge that is not bonded yet
        over grid     L rms_t (d₁ s₁ + d₂ s₂) / rms_t ε                d its direction, L its length

    For a bridge the sum is over its arms, and the largest arm counts over the grid. For a rosette the channel with the largest
    change counts; rms ε is that of the largest channel. NaN for sensors of motion."""
    pool, mesh = structure.pool, structure.mesh
    if structure.training.strain_operator is not None or not mesh.has_surface:
        return None
    part, skin = pool.take(pool.channels(gauges)), structure.skin
    in_place, over_grid = _steep(structure, part)
    grids = part.grids
    owner = part.gauge[part.channel_of_grid]
    height = np.full(part.gauges, np.inf)
    np.minimum.at(height, owner[grids.first], room(skin, grids, HAND))
    lies_on = [""] * part.gauges
    for gauge, words in zip(owner, held_below(mesh, skin.facets, grids), strict=True):
        lies_on[gauge] = lies_on[gauge] or words
    return AtGauges(
        in_place=in_place,
        over_grid=over_grid,
        room=height,
        lies_on=tuple(lies_on),
        in_place_limit=IN_PLACE,
        over_grid_limit=OVER_GRID,
        room_limit=HAND,
    )


def _steep(structure: Structure, part: Candidates) -> tuple[np.ndarray, np.ndarray]:
    """Change in place and over the grid (gauges,) of every gauge."""
    grids, C, std = part.grids, structure.training.moment, float(structure.tolerances.position)
    slopes = sensitivity_rows(
        structure.mesh.position, part, structure.reduced.basis, std or STEP, facets=structure.skin
    )
    e1, e2 = (axis[grids.gauge] for axis in installation_axes(grids))
    d1, d2 = (np.sum(grids.direction * e, axis=1)[:, None] for e in (e1, e2))

    def square(rows: np.ndarray) -> np.ndarray:
        # rounding errors may be negative
        return np.asarray(np.maximum(np.einsum("mi,ij,mj->m", rows, C, rows, optimize=True), 0.0))

    moved = std**2 * (square(slopes.along) + square(slopes.across)) * ~grids.bonded
    ends = grids.length * np.sqrt(square(d1 * slopes.along + d2 * slopes.across))
    size = np.zeros(part.gauges)
    np.maximum.at(size, part.gauge, np.sqrt(square(part.read(slopes.gain))))
    in_place, over_grid = np.zeros(part.gauges), np.zeros(part.gauges)
    np.maximum.at(in_place, part.gauge, np.sqrt(part.added(moved)))
    np.maximum.at(over_grid, part.gauge[part.channel_of_grid], ends)
    known = (part.quantity[part.first] == STRAIN) & (size > 0)
    share = np.where(known, 1 / np.where(size > 0, size, 1.0), np.nan)
    return in_place * share, over_grid * share


def notes_at_gauges(sites: AtGauges | None, count: int) -> tuple[str, ...]:
    """Note for each of `count` gauges in a list, empty without one."""
    if sites is None:
        return ("",) * count
    return tuple("; ".join(filter(None, (sites.steep_in_words(i), sites.access_in_words(i)))) for i in range(count))


def advice_at_gauges(sites: AtGauges | None, labels: Sequence[str], bonded: Sequence[bool]) -> Iterator[str]:
    """Sentences on gauges in a steep gradient, and on groups of gauges whose access has to be checked."""
    if sites is None:
        return
    groups: dict[str, list[str]] = {}
    for i, label in enumerate(labels):
        if words := sites.steep_in_words(i):
            remedy = (
                ""
                if bonded[i]
                else ". Use a positioning template (jig), a shorter measuring grid or another location for this gauge"
            )
            yield f"{label}: {words}{remedy}."
        if not bonded[i]:
            for words in sites.access(i):
                groups.setdefault(words, []).append(label)
    for words, those in groups.items():
        yield (
            f"{', '.join(those)}: {words}. Check that the position can be reached by hand, or exclude it (gauges.exclude)."
        )


def type_in_words(config: PlacementConfig) -> str:
    """Describe the gauge type and the values taken from it; empty without a type."""
    kind = gauge_type(config.gauges)
    if kind is None:
        return ""
    values = [f"{what} {value}" for what, value, where in _rows(config) if where == config.gauges.type]
    source = f" ({kind.source})" * bool(kind.source)
    return f"gauges {config.gauges.type}{source}: {', '.join(values)}"


def type_table(config: PlacementConfig) -> tuple[Table, ...]:
    """Table of gauge properties and their origin (type or config key); empty without a type."""
    if gauge_type(config.gauges) is None:
        return ()
    return (Table(f"gauges {config.gauges.type}", ("property", "value", "source"), tuple(_rows(config))),)


def _rows(config: PlacementConfig) -> list[tuple[str, str, str]]:
    """Property, value and origin; a key equal to the value of the type counts as the type's."""
    gauges, named_type = config.gauges, gauge_type(config.gauges)
    assert named_type is not None
    assert gauges.type is not None
    kind = gauges.type

    def of(value: float | None, typed: float, key: str) -> str:
        return kind if value == typed else key

    limit = "none" if gauges.range is None else f"{1e6 * gauges.range:.6g} µm/m"
    spacing = config.screen.minimum_spacing
    return [
        ("grid", _mm(gauges.grid_length), of(gauges.grid_length, named_type.grid_length, "gauges.grid_length")),
        ("carrier", f"{1e3 * named_type.carrier_length:.4g} × {_mm(named_type.carrier_width)}", kind),
        ("spacing", _mm(spacing), of(spacing, named_type.spacing, "screen.minimum_spacing")),
        ("range", limit, of(gauges.range, named_type.range, "gauges.range")),
        ("bend radius", _mm(named_type.bend_radius), kind),
        ("resistance", f"{named_type.resistance:.4g} Ω", kind),
        ("gauge factor", f"{named_type.gauge_factor:.4g} ± {100 * named_type.gauge_factor_tolerance:.2g} %", kind),
    ]


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"


SHARE = 0.05
"""Allowed change of a reading: more than three times the installation error by default tolerances (1 to 1.5 % on smooth
parts). A larger σ of the gain is allowed instead."""
MOST = 20
"""Largest number of gauges that are tested, the most important ones of larger layouts."""


def tested_hot_spots(structure: Structure, gauges: np.ndarray) -> HotSpots | None:
    """Hot-spot test of gauges (k,) on solids at the guess along the training simulation, NaN for others; None without solids."""
    config, mesh, reduced, pool = structure.config, structure.mesh, structure.reduced, structure.pool
    if (
        structure.training.strain_operator is not None
        or reduced.matrices is not None
        or reduced.results is not None
        or not mesh.blocks
    ):
        return None
    solid = np.isin(pool.element[pool.first[gauges]], np.concatenate([block.ids for block in mesh.blocks]))
    which = np.flatnonzero(solid)[:MOST]
    test = hot_spots(
        at_guess(structure),
        pool.take(pool.channels(gauges[which])),
        reduced.basis,
        structure.training.moment,
        loaded_nodes(config, mesh, structure.skin.facets),
        _pressed_nodes(config, mesh),
    )
    refined, spread = np.full((2, len(gauges)), np.nan)
    refined[which], spread[which] = test.change, test.spread
    return HotSpots(refined=refined, spread=spread, share=max(SHARE, float(structure.tolerances.gain)))


def _pressed_nodes(config: PlacementConfig, mesh: Mesh) -> np.ndarray:
    """Indices of nodes of loaded faces and of loads of the deck; facets with only such nodes carry a traction."""
    pressed = np.zeros(len(mesh.position), dtype=bool)
    for load in config.loads.values():
        if load.deck_load is not None:
            pressed[mesh.loads[load.deck_load].nodes] = True
        elif load.set in mesh.faces:
            pressed[np.isin(mesh.node_ids, mesh.node_sets[str(load.set)])] = True
    return np.flatnonzero(pressed)


def at_guess(structure: Structure) -> Mesh:
    """Mesh with the moduli of the training simulation, without springs."""
    mesh, reference = structure.mesh, structure.reduced.model.reference
    for name, entry in structure.config.parameters.items():
        if of_stiffness(entry.property):
            regions, value = region_ids(mesh, named_regions(entry.region)), reference[name]
            mesh = with_value(mesh, entry.property, regions, value, entry.material)
    return mesh


def hot_spot_advice(test: HotSpots | None, labels: Sequence[str], bonded: Sequence[bool]) -> Iterator[str]:
    """Sentences on groups of gauges at hot spots, and on gauges that were not tested."""
    if test is None:
        return
    groups: dict[tuple[str, str], list[str]] = {}
    for i in np.flatnonzero(test.hot).tolist():
        how = []
        if abs(test.refined[i]) > test.share:
            how.append(f"the strain changes by {_percent(test.refined[i])} if the mesh is refined")
        if abs(test.spread[i]) > test.share:
            how.append(
                f"the strain changes by {_percent(test.spread[i])} if nearby nodal forces are distributed over facets"
            )
        remedy = (
            "Refine the mesh there, and model the real fillet or contact"
            if bonded[i]
            else "Exclude this location (gauges.exclude, or a larger gauges.clearance), or refine the mesh there"
        )
        groups.setdefault((" and ".join(how), remedy), []).append(labels[i])
    for (how_much, remedy), those in groups.items():
        yield f"Hot spot below {', '.join(those)}, because {how_much}. {remedy}."
    unknown = [label for label, value in zip(labels, test.refined, strict=True) if np.isnan(value)]
    if unknown:
        yield f"Not tested for hot spots: {', '.join(unknown)}."


def hot_spot_table(test: HotSpots, labels: Sequence[str]) -> Table:
    """Table of the hot-spot test."""
    rows = tuple(
        (label, _percent(refined), _percent(spread) if spread else "", "hot spot" if hot else "")
        for label, refined, spread, hot in zip(labels, test.refined, test.spread, test.hot, strict=True)
    )
    columns = ("gauge", "strain change with a refined mesh", "strain change with distributed nodal forces", "result")
    return Table(f"hot spots: strain changes by more than {100 * test.share:.2g} %", columns, rows)


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:+.1f} %" if abs(share) < 0.1 else f"{100 * share:+.0f} %"

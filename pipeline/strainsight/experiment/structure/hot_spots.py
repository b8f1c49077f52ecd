"""The gauges of a layout whose strain is that of the mesh or of a load at a node, and not that of the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.experiment.recorded import named_regions
from strainsight.experiment.structure.clearance import loaded_nodes
from strainsight.fem.affine import of_stiffness
from strainsight.mesh.additions import region_ids
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import with_value
from strainsight.records.placed import HotSpots
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.runner.output import Table
from strainsight.sensors.hot_spots import hot_spots

SHARE = 0.05
"""Of a reading: what a change is allowed. Errors of installation by the default tolerances are 1 to 1.5 % of a reading on smooth
parts: a strain that is 5 % off is beyond three times what the σ of a layout allows for."""
MOST = 20
"""Gauges that are tested: of larger layouts the most missed."""


def tested_hot_spots(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, training: Training, gauges: np.ndarray
) -> HotSpots | None:
    """The test of gauges on solids by their numbers (k,), at the guess and along the training run, NaN of others; None where the
    model is not that of a mesh of solids."""
    if training.given is not None or reduced.matrices is not None or reduced.results is not None or not mesh.blocks:
        return None
    pool = training.candidates
    solid = np.isin(pool.element[pool.first[gauges]], np.concatenate([block.ids for block in mesh.blocks]))
    which = np.flatnonzero(solid)[:MOST]
    tested = gauges[which]
    found = hot_spots(
        at_guess(config, mesh, reduced),
        training.candidates.take(training.candidates.channels(tested)),
        reduced.basis,
        training.moment,
        loaded_nodes(config, mesh, exterior_facets(mesh)),
        _pressed_nodes(config, mesh),
    )
    refined, spread = np.full((2, len(gauges)), np.nan)
    refined[which], spread[which] = found.change, found.spread
    return HotSpots(refined=refined, spread=spread, share=share_of(config))


def _pressed_nodes(config: PlacementConfig, mesh: Mesh) -> np.ndarray:
    """Nodes (indices) of the faces that loads act on, and those of loads of the deck: facets that have such nodes alone carry a
    traction. Of a set that is no face the nodes have equal parts."""
    found = np.zeros(len(mesh.position), dtype=bool)
    for load in config.loads.values():
        if load.deck_load is not None:
            found[mesh.loads[load.deck_load].nodes] = True
        elif load.set in mesh.faces:
            found[np.isin(mesh.node_ids, mesh.node_sets[str(load.set)])] = True
    return np.flatnonzero(found)


def share_of(config: PlacementConfig) -> float:
    """`SHARE`, or σ of the gain where it is larger: so much of a reading σ covers anyway."""
    return max(SHARE, float(tolerances_of(config.tolerances).gain))


def at_guess(config: PlacementConfig, mesh: Mesh, reduced: Reduced) -> Mesh:
    """The mesh with the moduli at which training was simulated; springs are outside its elements, and not asked for."""
    for name, entry in config.parameters.items():
        if of_stiffness(entry.property):
            regions, value = region_ids(mesh, named_regions(entry.region)), reduced.model.reference[name]
            mesh = with_value(mesh, entry.property, regions, value, entry.material)
    return mesh


def hot_spot_advice(test: HotSpots | None, labels: Sequence[str], bonded: Sequence[bool]) -> Iterator[str]:
    """A sentence for the gauges at hot spots of one kind, and one where some were not tested."""
    if test is None:
        return
    alike: dict[tuple[str, str], list[str]] = {}
    for i in np.flatnonzero(test.hot).tolist():
        how = []
        if abs(test.refined[i]) > test.share:
            how.append(f"by {_percent(test.refined[i])} when the mesh around it is refined")
        if abs(test.spread[i]) > test.share:
            how.append(f"by {_percent(test.spread[i])} when forces on nodes beside it are spread over the facets there")
        remedy = (
            "mesh more finely there, with the fillet or the contact as it is"
            if bonded[i]
            else "move {it} (a larger gauges.clearance, gauges.exclude) or mesh more finely there"
        )
        alike.setdefault((" and ".join(how), remedy), []).append(labels[i])
    for (how_much, remedy), own in alike.items():
        sit, its, it = ("sits at a hot spot", "its", "it") if len(own) == 1 else ("sit at hot spots", "their", "them")
        yield f"{', '.join(own)} {sit}: {its} strain changes {how_much}; {remedy.format(it=it)}."
    unknown = [label for label, value in zip(labels, test.refined, strict=True) if np.isnan(value)]
    if unknown:
        yield f"Not tested for hot spots: {', '.join(unknown)}."


def hot_spot_table(test: HotSpots, labels: Sequence[str]) -> Table:
    """The test of every gauge as it is printed."""
    rows = tuple(
        (label, _percent(refined), _percent(spread) if spread else "", "hot spot" if hot else "")
        for label, refined, spread, hot in zip(labels, test.refined, test.spread, test.hot, strict=True)
    )
    columns = ("strain of", "mesh around it refined", "forces on nodes spread", "")
    return Table(f"hot spots: change by more than {100 * test.share:.2g} %", columns, rows)


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:+.1f} %" if abs(share) < 0.1 else f"{100 * share:+.0f} %"

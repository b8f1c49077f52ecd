"""The structure, the layout and the loads as the page draws them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from strainsight.config.gauges import Gauges
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.workshop import Workshop, foil_at
from strainsight.experiment.structure.candidates import listed_gauges as gauges_of
from strainsight.experiment.structure.clearance import notes_at_gauges
from strainsight.fem.nodal_forces import pressure
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Arm, Gauge, LoadArrow, PictureLayout
from strainsight.records.placed import HotSpots, Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.runner.artefact import Artefact


def layout_of_page(mesh: Mesh, up: Mapping[str, Artefact], loads: Mapping[str, Any]) -> PictureLayout:
    placed = read(Placed, up["place"])
    candidates, layout = read(Training, up["train"]).candidates, listed_gauges(up)
    notes, row = notes_at_gauges(placed.at_gauges, len(layout.labels)), placed.final.gauge
    nodes = candidates.nodes[candidates.first[placed.final.number]]
    gauges = tuple(
        replace(
            gauge,
            without={name: float(values[i]) for name, values in placed.without.items()},
            nodes=tuple(int(mesh.node_ids[n]) for n in nodes[i] if n >= 0),
            peak=float(layout.peak[i]),
            most=float(layout.most[i]) if gauge.arms else None,
            range=None if np.isnan(layout.range[i]) else float(layout.range[i]),
            mirror=next((layout.labels[j] for j in np.flatnonzero(row == row[i]) if j != i), ""),
            notes=notes[i],
            **_hot_spot(placed.hot_spots, i),
        )
        for i, gauge in enumerate(_marked(layout))
    )
    pool = placed.pool.gauges
    at = candidates.position[candidates.first[pool[pool >= 0]]]
    return replace(bare(mesh, loads), pool=at, gauges=gauges, loose=_known_to_matrices(mesh, up))


def measured(layout: PictureLayout, shop: Workshop, gauges: Gauges) -> PictureLayout:
    """The layout in the axes of the workshop, its gauges with their distances to edges and the size of their foils.

    gauges: the section of the config, which may name a type."""
    pairs = np.stack([shop.edges.distance, shop.edges.angle], axis=2)
    marks = []
    for i, gauge in enumerate(layout.gauges):
        lines = shop.listed.lines_of(i)
        edges = pairs[lines][: max(len(gauge.arms), 1)]
        if gauge.unit == "strain" and gauge.facet:
            foil = foil_at(gauges, shop, lines[0])
            gauge = replace(gauge, foil=(foil.length, foil.width))
        marks.append(replace(gauge, edges=edges) if np.isfinite(edges).any() else gauge)
    return replace(layout, gauges=tuple(marks), frame=shop.frame)


def bare(mesh: Mesh, loads: Mapping[str, Any]) -> PictureLayout:
    """The structure with its loads and clamped nodes, no gauge."""
    faces = exterior_facets(mesh).nodes if mesh.has_surface else np.full((0, 8), -1)
    arrows = [(name, *_point_and_direction(mesh, entry), bool(entry.known)) for name, entry in loads.items()]
    nodes = [b.nodes[(b.on_sides < 0).all(axis=(1, 2))] if len(b.on_sides) else b.nodes for b in mesh.beams]
    # straight lines between the nodes of beams, through the one in the middle where they have three
    bars = [n[:, ends] for n in nodes for ends in (((0, 2), (2, 1)) if n.shape[1] == 3 else ((0, 1),))]
    nothing = np.empty((0, 3))
    return PictureLayout(
        mesh.position,
        faces,
        nothing,
        (),
        tuple(LoadArrow(*arrow) for arrow in arrows if arrow[2].any()),
        mesh.position[mesh.held],
        nothing if mesh.has_surface else loose_nodes(mesh),
        np.concatenate([np.zeros((0, 2), dtype=np.int64), *bars]),
    )


def layout_of_test(
    mesh: Mesh, up: Mapping[str, Artefact], loads: Mapping[str, Any], labels: Sequence[str], channels: np.ndarray
) -> tuple[PictureLayout, tuple[int, ...]]:
    """The structure with the gauges that a test used, and which of them each channel belongs to.

    labels of the channels, and channels (m,): their rows of train.h5. A gauge is called by the shortest of its channels'
    labels, without the number of a grid."""
    training, screened = read(Training, up["train"]), read(Screened, up["screen"])
    owner = training.candidates.gauge[channels]
    numbers = list(dict.fromkeys(owner.tolist()))
    marks = tuple(map(numbers.index, owner.tolist()))
    gauges = []
    for i, gauge in enumerate(_marked(gauges_of(np.array(numbers, dtype=np.int64), training, screened))):
        label = min((label for label, mark in zip(labels, marks, strict=True) if mark == i), key=len)
        several = len(gauge.directions) > 1
        gauges.append(replace(gauge, label=re.sub(r"\.\d+$", "", label) if several else label))
    return replace(bare(mesh, loads), gauges=tuple(gauges), loose=_known_to_matrices(mesh, up)), marks


def _known_to_matrices(mesh: Mesh, up: Mapping[str, Artefact]) -> np.ndarray:
    """Loose nodes of a model that came as matrices, none of any other."""
    return np.empty((0, 3)) if read(Reduced, up["rom"]).matrices is None else loose_nodes(mesh)


def _marked(layout: GaugeList) -> Iterator[Gauge]:
    """Where the gauges of a list sit, and what they are."""
    grids = layout.grids
    for i, label in enumerate(layout.labels):
        lines, bridge = layout.lines_of(i), layout.kind[i] == "bridge"
        first = lines[0]
        yield Gauge(
            label=label,
            element=int(grids.element[first]),
            facet=int(grids.facet[first]),
            position=grids.position[first],
            direction=grids.direction[first],
            normal=grids.normal[first],
            angle=float(grids.angle[first]),
            kind=layout.kind[i],
            directions=grids.direction[lines[: 1 if bridge else None]],
            bonded=bool(layout.bonded[i]),
            unit=layout.unit[i],
            arms=tuple(
                Arm(
                    grids.position[k],
                    grids.direction[k],
                    grids.normal[k],
                    int(layout.signs[k]),
                    int(grids.element[k]),
                    int(grids.facet[k]),
                )
                for k in lines[: None if bridge else 0]
            ),
        )


def _hot_spot(spots: HotSpots | None, i: int) -> dict[str, Any]:
    """Of gauge i the test for hot spots, as far as it was made."""
    if spots is None or np.isnan(spots.refined[i]):
        return {}
    return {"refined": float(spots.refined[i]), "spread": float(spots.spread[i]), "hot": bool(spots.hot[i])}


def listed_gauges(up: Mapping[str, Artefact]) -> GaugeList:
    training, screened = read(Training, up["train"]), read(Screened, up["screen"])
    return gauges_of(read(Placed, up["place"]).final.number, training, screened)


def loose_nodes(mesh: Mesh) -> np.ndarray:
    """Nodes that no solid or shell has (l, 3) [m]: of beams, and of what only matrices know."""
    alone = np.ones(len(mesh.position), dtype=bool)
    for nodes in mesh.connectivity[: len(mesh.blocks) + len(mesh.shells)]:
        alone[nodes] = False
    alone[mesh.arms[:, 0]] = False
    return mesh.position[alone]


def _point_and_direction(mesh: Mesh, entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Where a load is drawn and along what, a moment along its axis, a rotation and what balances itself along nothing: one of
    the deck at the mean of its nodes, weighted by their forces."""
    if entry.gravity is not None or entry.rotation is not None:
        return mesh.position.mean(axis=0), np.array(entry.gravity or np.zeros(3), float)
    if entry.deck_load is not None or entry.pressure:
        forces = mesh.loads[entry.deck_load] if entry.deck_load is not None else pressure(mesh, entry.set)
        position, size, total = (
            mesh.position[forces.nodes],
            np.linalg.norm(forces.force, axis=1),
            forces.force.sum(axis=0),
        )
        if np.linalg.norm(total) <= 1e-6 * size.sum():
            return position.mean(axis=0), np.zeros(3)
        return position.mean(axis=0) if entry.pressure else size @ position / size.sum(), total
    direction = np.array(entry.direction or entry.moment or entry.bearing, float)
    if entry.node is not None:
        return mesh.position[mesh.node_index(int(entry.node))], direction
    return mesh.position[np.isin(mesh.node_ids, mesh.node_sets[entry.set])].mean(axis=0), direction

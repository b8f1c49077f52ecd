"""The structure, the layout and the loads as the page draws them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from strainsight.config.gauges import Typed
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.workshop import Workshop, foil_at
from strainsight.experiment.structure.candidates import listed_gauges as gauges_of
from strainsight.experiment.structure.clearance import notes_at_gauges
from strainsight.fem.nodal_forces import pressure
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Arm, Gauge, Layout, Load
from strainsight.records.placed import HotSpots, Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.runner.artefact import Artefact


def layout_of_page(mesh: Mesh, up: Mapping[str, Artefact], loads: Mapping[str, Any]) -> Layout:
    place, own = up["place"], read(Placed, up["place"])
    candidates = read(Training, up["train"]).candidates
    # place.h5 has them relative to amplitude and guess, the page shows everything relative to the truth.
    without = {name: values * placed_scale(name, place) / placed_size(name, up) for name, values in own.without.items()}
    listed = listed_gauges(up)
    notes = notes_at_gauges(own.at_gauges, len(listed.labels))
    row = own.final.gauge
    mirror = [next((listed.labels[j] for j in np.flatnonzero(row == row[i]) if j != i), "") for i in range(len(row))]
    nodes = candidates.nodes[candidates.first[own.final.number]]
    gauges = tuple(
        replace(
            _marked(listed, i),
            without={name: float(values[i]) for name, values in without.items()},
            nodes=tuple(int(mesh.node_ids[n]) for n in nodes[i] if n >= 0),
            peak=float(listed.peak[i]),
            most=float(listed.most[i]) if listed.arms[i] is not None else None,
            range=None if np.isnan(listed.range[i]) else float(listed.range[i]),
            mirror=mirror[i],
            notes=notes[i],
            **_tested(own.hot_spots, i),
        )
        for i in range(len(listed.labels))
    )
    pool = own.pool.gauges
    return replace(
        bare(mesh, loads),
        pool=candidates.position[candidates.first[pool[pool >= 0]]],
        gauges=gauges,
        loose=_known_to_matrices(mesh, up),
    )


def measured(layout: Layout, shop: Workshop, gauges: Typed) -> Layout:
    """The layout in the axes of the workshop, its gauges with their distances to edges and the size of their foils.

    gauges: the section of the config, which may name a type.
    """
    pairs = np.stack([shop.edges.distance, shop.edges.angle], axis=2)
    found = []
    for i, gauge in enumerate(layout.gauges):
        lines = shop.lines_of(i)
        own = pairs[lines][: max(len(gauge.arms), 1)]
        if gauge.unit == "strain" and gauge.facet:
            foil = foil_at(gauges, shop, lines[0])
            gauge = replace(gauge, foil=(foil.length, foil.width))
        found.append(replace(gauge, edges=own) if np.isfinite(own).any() else gauge)
    return replace(layout, gauges=tuple(found), frame=shop.frame)


def bare(mesh: Mesh, loads: Mapping[str, Any]) -> Layout:
    """The structure with its loads and clamped nodes, no gauge."""
    faces = exterior_facets(mesh).nodes if mesh.has_surface else np.full((0, 8), -1)
    fixed = mesh.position[mesh.held]
    arrows = [(name, _point_and_direction(mesh, entry), bool(entry.known)) for name, entry in loads.items()]
    loose = np.empty((0, 3)) if mesh.has_surface else loose_nodes(mesh)
    bars = [b.nodes[(b.on_sides < 0).all(axis=(1, 2))] if len(b.on_sides) else b.nodes for b in mesh.beams]
    return Layout(
        mesh.position,
        faces,
        np.empty((0, 3)),
        (),
        tuple(Load(name, *drawn, known) for name, drawn, known in arrows if drawn[1].any()),
        fixed,
        loose,
        np.concatenate(
            [np.zeros((0, 2), dtype=np.int64), *(nodes[:, ends] for nodes in bars for ends in _pieces(nodes))]
        ),
    )


def _pieces(nodes: np.ndarray) -> tuple[list[int], ...]:
    """Between which nodes of beams (n, k) straight lines are drawn."""
    return ([0, 2], [2, 1]) if nodes.shape[1] == 3 else ([0, 1],)


def layout_of_test(
    mesh: Mesh, up: Mapping[str, Artefact], loads: Mapping[str, Any], labels: Sequence[str], channels: np.ndarray
) -> tuple[Layout, tuple[int, ...]]:
    """The structure with the gauges that a test used, and which of them each channel belongs to.

    labels of the channels, and channels (m,): their rows of train.h5. A gauge is called by the shortest of its channels'
    labels, without the number of a grid.
    """
    training, screened = read(Training, up["train"]), read(Screened, up["screen"])
    owner = training.candidates.gauge[channels]
    numbers, first = np.unique(owner, return_index=True)
    numbers = numbers[np.argsort(first)]
    marks = tuple(int(np.flatnonzero(numbers == number)[0]) for number in owner)
    listed = gauges_of(numbers, training, screened)
    gauges = []
    for i in range(len(numbers)):
        label = min((label for label, mark in zip(labels, marks, strict=True) if mark == i), key=len)
        several = len(listed.angles[i]) > 1
        gauges.append(replace(_marked(listed, i), label=re.sub(r"\.\d+$", "", label) if several else label))
    return replace(bare(mesh, loads), gauges=tuple(gauges), loose=_known_to_matrices(mesh, up)), marks


def _known_to_matrices(mesh: Mesh, up: Mapping[str, Artefact]) -> np.ndarray:
    """Loose nodes of a model that came as matrices, none of any other."""
    return np.empty((0, 3)) if read(Reduced, up["rom"]).matrices is None else loose_nodes(mesh)


def _marked(listed: GaugeList, i: int) -> Gauge:
    """Where gauge i of a list sits, and what it is."""
    return Gauge(
        label=listed.labels[i],
        element=int(listed.element[i]),
        facet=int(listed.facet[i]),
        position=listed.position[i],
        direction=listed.directions[i][0],
        normal=listed.normal[i],
        angle=float(listed.angles[i][0]),
        kind=listed.kind[i],
        directions=listed.directions[i],
        bonded=bool(listed.bonded[i]),
        unit=listed.unit[i],
        arms=_arms(listed, i),
    )


def _arms(listed: GaugeList, i: int) -> tuple[Arm, ...]:
    arms = listed.arms[i]
    if arms is None:
        return ()
    g = arms.grid
    return tuple(
        Arm(g.position[k], g.direction[k], g.normal[k], int(sign), int(g.element[k]), int(g.facet[k]))
        for k, sign in enumerate(arms.sign)
    )


def _tested(found: HotSpots | None, i: int) -> dict[str, Any]:
    """Of gauge i the test for hot spots, as far as it was made."""
    if found is None or np.isnan(found.refined[i]):
        return {}
    return {"refined": float(found.refined[i]), "spread": float(found.spread[i]), "hot": bool(found.hot[i])}


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
    if entry.deck_load is not None:
        forces = mesh.loads[entry.deck_load]
        size, total = np.linalg.norm(forces.force, axis=1), forces.force.sum(axis=0)
        if np.linalg.norm(total) <= 1e-9 * size.sum():
            return mesh.position[forces.nodes].mean(axis=0), np.zeros(3)
        return size @ mesh.position[forces.nodes] / size.sum(), total
    if entry.gravity is not None or entry.rotation is not None:
        return mesh.position.mean(axis=0), np.array(entry.gravity or np.zeros(3), float)
    if entry.pressure:
        own = pressure(mesh, entry.set)
        total = own.force.sum(axis=0)
        balanced = np.linalg.norm(total) < 1e-6 * np.abs(own.force).sum()
        return mesh.position[own.nodes].mean(axis=0), np.zeros(3) if balanced else total
    direction = np.array(entry.direction or entry.moment or entry.bearing, float)
    if entry.node is not None:
        return mesh.position[mesh.node_index(int(entry.node))], direction
    members = mesh.node_sets[entry.set]
    return mesh.position[np.isin(mesh.node_ids, members)].mean(axis=0), direction


def placed_scale(name: str, place: Artefact) -> float:
    """What place.h5 has an unknown relative to: a parameter's guess, an input's amplitude."""
    return float(place.attributes(f"/expected_std/{name}")["scale"])


def placed_size(name: str, up: Mapping[str, Artefact]) -> float:
    """What the page shows expected σ relative to, as everything of the unknown: to its truth, or before it was validated to its
    scale at placement; with load cases to its scale in the worst one, of which there is no truth."""
    if "validate" not in up or read(Placed, up["place"]).by_case is not None:
        return placed_scale(name, up["place"])
    return float(up["validate"].summary[f"scale.{name}"])

"""Views of a flexible body of a bench: its mesh, modes, candidates, gauges, stress in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import UserError, did_you_mean
from strainsight.experiment.bench.bench import unit_vector
from strainsight.experiment.bench.reduction import flexible
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Gauge, Layout
from strainsight.pages.view.viewed import DOTS, Panel, View
from strainsight.records.bench_placed import PLACED, BenchLayout, BenchPlaced
from strainsight.records.bodies import ReducedBodies, ReducedBody
from strainsight.records.mesh import Meshes
from strainsight.records.record import read
from strainsight.runner.artefact import Artefact
from strainsight.stages.pages.page_layout import bare
from strainsight.stages.view.surface import modes_view, surface_view


def body_of(config: BenchConfig, asked: str | None) -> str:
    """The flexible body to show: the one asked for, else that of the field, of the placement, or the first.

    Raises UserError where there is none, or none of that name.
    """
    bodies = list(flexible(config))
    if not bodies:
        raise UserError("no body of this bench is flexible", remedy="there is no mesh to show: see report.html")
    if asked is not None and asked not in bodies:
        names = ", ".join(bodies)
        raise UserError(
            f"--body {asked}: this bench has no flexible body of that name",
            remedy=did_you_mean(asked, bodies, f"flexible bodies are {names}"),
        )
    wanted = [asked, *(section.body for section in (config.field, config.place) if section is not None), bodies[0]]
    return next(name for name in wanted if name is not None)


def bench_view(config: BenchConfig, what: str, body: str, up: Mapping[str, Artefact], at: float | None) -> View:
    """What is asked for of the body, from the artefacts that `offers` names; at [s]: the instant of a field."""
    mesh = read(Meshes, up["import"]).bodies[body]
    title = f"{config.name}: {body}"
    layout = bare(mesh, {})
    if what == "mesh":
        elements = sum(len(block.nodes) for block in mesh.elements)
        return View(f"{title}, {elements} elements, {mesh.own_nodes} nodes", layout)
    if what == "modes":
        return _modes(title, layout, mesh, read(ReducedBodies, up["reduce"]).bodies[body])
    if what == "candidates":
        return _candidates(title, layout, read(BenchPlaced, up["place"]))
    layout = replace(layout, gauges=_gauges(config, body, mesh, up))
    if what in ("field", "strain"):
        assert config.field is not None
        how = "as simulated" if config.field.of == "simulate" else "as estimated"
        return surface_view(f"{title}, {how}", up["field"], layout, at, strain=what == "strain")
    return View(f"{title}, {len(layout.gauges)} gauges", layout)


def _modes(title: str, layout: Layout, mesh: Mesh, part: ReducedBody) -> View:
    """The modes with the interfaces held: the first coordinates that move no interface node."""
    still = ~np.any([np.any(rows, axis=0) for rows in part.interface.values()], axis=0)
    frequency = part.frequency
    own = np.flatnonzero(still)[: len(frequency)]
    shapes = np.moveaxis(part.basis[:, own].reshape(len(mesh.position), 3, -1), 2, 0)
    captions = [f"mode {i}, {f:.4g} Hz" for i, f in enumerate(frequency, start=1)]
    bodies = replace(layout, fixed=np.empty((0, 3)))
    return modes_view(f"{title}, interfaces held", bodies, shapes, captions, "kg^-1/2")


def _candidates(title: str, layout: Layout, place: BenchPlaced) -> View:
    """The pool by the step in which each was removed; what stayed has the last colour, what never entered is grey."""
    position, pool, removed = place.candidates.position, place.pool.candidate, place.elimination.removed
    step = np.full(len(pool), len(removed) + 1.0)
    step[removed] = np.arange(1, len(removed) + 1)
    outside = np.delete(position, pool, axis=0)
    order = np.argsort(step, kind="stable")
    return View(
        f"{title}, {len(position)} candidates, {len(pool)} of them in the pool",
        replace(layout, pool=outside),
        (Panel(values=step[order]),),
        "removed in step",
        "–",
        DOTS,
        position[pool][order],
    )


def _gauges(config: BenchConfig, body: str, mesh: Mesh, up: Mapping[str, Artefact]) -> tuple[Gauge, ...]:
    """The gauges of every strain sensor on the body, named as config and pages name them; without a sensor, the placed ones."""
    places: list[tuple[str, np.ndarray, np.ndarray]] = []
    for name, entry in config.sensors.items():
        if entry.type != "strain" or entry.body != body:
            continue
        if entry.layout is not None:
            given = _gauges_of(read(BenchPlaced, up["place"]).layout(entry.layout))
        else:
            given = [(np.array(g.position, dtype=float), unit_vector(g.direction)) for g in entry.gauges]
        places += [(f"{name} {i}", x, d) for i, (x, d) in enumerate(given, start=1)]
    if not places and "place" in up:
        given = _gauges_of(read(BenchPlaced, up["place"]).layout(PLACED))
        places = [(f"G{i}", x, d) for i, (x, d) in enumerate(given, start=1)]
    if not places:
        return ()
    normal = _normals(mesh, np.array([x for _, x, _ in places]))
    return tuple(Gauge(label, 0, 0, x, d, n, 0.0) for (label, x, d), n in zip(places, normal, strict=True))


def _gauges_of(layout: BenchLayout) -> list[tuple[np.ndarray, np.ndarray]]:
    return list(zip(layout.position[layout.bonded], layout.direction[layout.bonded], strict=True))


def _normals(mesh: Mesh, position: np.ndarray) -> np.ndarray:
    """The outward normal (k, 3) of the facet whose middle is nearest to each place: enough to draw an arrow on it."""
    from scipy.spatial import cKDTree

    corner = mesh.position[exterior_facets(mesh).nodes[:, :3]]
    own = cKDTree(corner.mean(axis=1)).query(position)[1]
    a, b, c = np.moveaxis(corner[own], 1, 0)
    n = np.cross(b - a, c - a)
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))

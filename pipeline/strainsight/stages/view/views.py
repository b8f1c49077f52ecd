"""Views of a run, the stages they need, and their construction from the artefacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ArtefactError, UserError, did_you_mean
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Gauge, PictureLayout
from strainsight.pages.view.viewing import DOTS, Panel, View
from strainsight.records.bench import ReducedBodies, ReducedBody
from strainsight.records.bench_placed import PLACED, BenchPlaced
from strainsight.records.estimated import estimated_in
from strainsight.records.mesh import Meshes, mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.records.validated import Validated
from strainsight.runner.artefact import Artefact, missing_stages
from strainsight.sensors.candidates import STRAIN
from strainsight.sensors.surface import unit_vector
from strainsight.stages.pages.page_layout import bare, layout_of_page
from strainsight.stages.view.surface import (
    MICRO,
    NOTHING,
    mesh_view,
    modes_view,
    moment_view,
    strain_view,
    strains_of,
    surface_view,
)


def body_of(config: BenchConfig, body_name: str | None) -> str:
    """The flexible body to show: the named one, otherwise that of the field, of the placement, or the first.
    Raises UserError if the bench has no such body."""
    bodies = list(config.flexible)
    if not bodies:
        raise UserError(
            "this bench has no flexible body, and therefore no mesh to show", remedy="open report.html instead"
        )
    if body_name is not None and body_name not in bodies:
        names = ", ".join(bodies)
        raise UserError(
            f"--body {body_name}: unknown flexible body",
            remedy=did_you_mean(body_name, bodies, f"use one of the flexible bodies {names}"),
        )
    wanted = [body_name, *(section.body for section in (config.field, config.place) if section is not None), bodies[0]]
    return next(name for name in wanted if name is not None)


def bench_view(config: BenchConfig, what: str, body: str, up: Mapping[str, Artefact], at: float | None) -> View:
    """A view of the body, from the artefacts listed in `offers`; at [s]: instant of a field."""
    mesh = read(Meshes, up["import"]).bodies[body]
    title = f"{config.name}: {body}"
    layout = bare(mesh, {})
    if what == "mesh":
        return mesh_view(f"{title},", layout, mesh)
    if what == "modes":
        return _modes(title, layout, mesh, read(ReducedBodies, up["reduce"]).bodies[body])
    if what == "candidates":
        return _candidates(title, layout, read(BenchPlaced, up["place"]))
    layout = replace(layout, gauges=_gauges(config, body, mesh, up))
    if what in ("field", "strain"):
        assert config.field is not None
        how = "simulated motion" if config.field.of == "simulate" else "estimated motion"
        return surface_view(f"{title}, {how}", up["field"], layout, at, strain=what == "strain")
    return View(f"{title}, {len(layout.gauges)} gauges", layout)


def _modes(title: str, layout: PictureLayout, mesh: Mesh, part: ReducedBody) -> View:
    """The modes with the interfaces held: the first coordinates that move no interface node."""
    still = ~np.any([np.any(rows, axis=0) for rows in part.interface.values()], axis=0)
    fixed = np.flatnonzero(still)[: len(part.frequency)]
    shapes = np.moveaxis(part.basis[:, fixed].reshape(len(mesh.position), 3, -1), 2, 0)
    return modes_view(f"{title}, fixed-interface modes", layout, shapes, part.frequency)


def _candidates(title: str, layout: PictureLayout, place: BenchPlaced) -> View:
    """The pool by the step in which each was removed; what stayed has the last colour, what never entered is grey."""
    position, pool, removed = place.candidates.position, place.pool.candidate, place.elimination.removed
    step = np.full(len(pool), len(removed) + 1.0)
    step[removed] = np.arange(1, len(removed) + 1)
    outside = replace(layout, pool=np.delete(position, pool, axis=0))
    title = f"{title}, {len(position)} candidates, {len(pool)} after screening"
    return _dotted(title, outside, position[pool], step, "elimination step of each gauge (highest: selected)", "–")


def _dotted(
    title: str,
    layout: PictureLayout,
    position: np.ndarray,
    values: np.ndarray,
    quantity: str,
    unit: str,
    panel: str = "",
) -> View:
    """Dots (d, 3) [m] coloured by values (d,), those of the largest size drawn last."""
    order = np.argsort(np.abs(values), kind="stable")
    return View(title, layout, (Panel(panel, values[order]),), quantity, unit, DOTS, position[order])


def _gauges(config: BenchConfig, body: str, mesh: Mesh, up: Mapping[str, Artefact]) -> tuple[Gauge, ...]:
    """The gauges of every strain sensor on the body, named as config and pages name them; without a sensor, the placed ones."""
    places: list[tuple[str, np.ndarray, np.ndarray]] = []
    for name, entry in config.sensors.items():
        if entry.type != "strain" or entry.body != body:
            continue
        if entry.layout is not None:
            gauges = _bonded(up, entry.layout)
        else:
            gauges = [
                (np.array(g.position, dtype=float), unit_vector(g.direction, "the direction")) for g in entry.gauges
            ]
        places += [(f"{name} {i}", x, d) for i, (x, d) in enumerate(gauges, start=1)]
    if not places and "place" in up:
        places = [(f"G{i}", x, d) for i, (x, d) in enumerate(_bonded(up, PLACED), start=1)]
    if not places:
        return ()
    from scipy.spatial import cKDTree

    # the normal of the facet whose middle is nearest: enough to draw an arrow on it
    corner = mesh.position[exterior_facets(mesh).nodes[:, :3]]
    nearest = cKDTree(corner.mean(axis=1)).query(np.array([x for _, x, _ in places]))[1]
    a, b, c = np.moveaxis(corner[nearest], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return tuple(Gauge(label, 0, 0, x, d, n, 0.0) for (label, x, d), n in zip(places, normal, strict=True))


def _bonded(up: Mapping[str, Artefact], which: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Position and direction of the gauges on the body in a layout of place.h5."""
    layout = read(BenchPlaced, up["place"]).layout(which)
    return list(zip(layout.position[layout.bonded], layout.direction[layout.bonded], strict=True))


def placement_view(
    config: PlacementConfig, what: str, up: Mapping[str, Artefact], at: float | None, record: str | None = None
) -> View:
    """A view of a placement, from the artefacts listed in `offers`; at [s]: instant of a field; record: of a test with several,
    None for the first."""
    name, mesh = str(config.name), mesh_from(up["import"])
    if what == "modes":
        frequency = read(Reduced, up["rom"]).frequency
        shapes = up["rom"]["/VTKHDF/PointData/mode"].reshape(-1, len(mesh.position), 3)[: len(frequency)]
        return modes_view(f"{name}: mode shapes at the initial parameter values", bare(mesh, {}), shapes, frequency)
    if what == "candidates":
        return _placement_candidates(name, bare(mesh, config.loads), up["train"])
    if what == "strain":
        gauges = layout_of_page(mesh, up, config.loads) if "place" in up else bare(mesh, config.loads)
        return strain_view(name, replace(gauges, pool=NOTHING), strains_of(config, mesh, up))
    if what == "mesh":
        return mesh_view(f"{name}:", bare(mesh, config.loads), mesh)
    layout = layout_of_page(mesh, up, config.loads)
    title = f"{name}: {len(layout.gauges)} of {len(layout.pool)} candidates"
    if what == "layout":
        return View(title, layout)
    if "estimate" in up:
        return _tested(name, layout, up["estimate"], at, record)
    return _strain(f"{name}: estimate from the simulated test", layout, up)


def _tested(name: str, layout: PictureLayout, estimate: Artefact, at: float | None, record: str | None) -> View:
    """Surface field over time if available, otherwise at the instant of the largest reading. Raises UserError without one, and
    for an unknown record."""
    records = estimated_in(estimate)
    names = [one for one in records if one]
    shown = next(iter(records)) if record is None else record
    if record is not None and record not in names:
        raise UserError(
            f"--record {record}: the test has {'no record with that name' if names else 'only one record'}",
            where=str(estimate.path),
            remedy=did_you_mean(record, names, f"use one of the records {', '.join(names)}")
            if names
            else "omit --record",
        )
    estimated, of_record = records[shown], f", record {shown} of {', '.join(names)}" * bool(shown)
    title = f"{name}: estimate from the test {estimated.source.file}{of_record}"
    if "/VTKHDF/Steps" in estimate:
        return surface_view(title, estimate, layout, at)
    then = estimated.moment
    if then is None:
        raise UserError(
            "the estimate has no surface stress, because no surface of the mesh has a material",
            where=str(estimate.path),
            remedy="use --what layout, or --of validation",
        )
    when = f"t = {then.time:.4g} s (largest reading, {then.label})"
    return moment_view(title, layout, then.von_mises.astype(float), then.displacement.astype(float), when)


def _placement_candidates(name: str, layout: PictureLayout, train: Artefact) -> View:
    training = read(Training, train)
    candidates, grids = training.candidates, training.candidates.grids
    # Of bridges every arm. Of a gauge with several channels, or several gauges at a place, the strongest is drawn last.
    strains = np.flatnonzero(grids.quantity == STRAIN)
    rms = training.rms[candidates.channel_of_grid[strains]]
    others = candidates.first[candidates.quantity[candidates.first] != STRAIN]
    title, layout = f"{name}: {candidates.gauges} candidates", replace(layout, pool=candidates.position[others])
    return _dotted(
        title,
        layout,
        grids.position[strains],
        rms * MICRO,
        "RMS strain in the training simulation (stage train)",
        "µm/m",
    )


def _strain(title: str, layout: PictureLayout, up: Mapping[str, Artefact]) -> View:
    field, candidates = read(Validated, up["validate"]).field, read(Training, up["train"]).candidates
    grids, strain = candidates.grids, field.strain[candidates.channel_of_grid]
    known = np.flatnonzero(np.isfinite(strain) & (grids.quantity == STRAIN))
    layout, when = replace(layout, pool=NOTHING), f"t = {field.instant:.4g} s (largest simulated strain)"
    quantity = "estimated strain of every candidate"
    return _dotted(title, layout, grids.position[known], strain[known] * MICRO, quantity, "µm/m", when)


WHAT = ("mesh", "modes", "strain", "candidates", "layout", "field")
FURTHEST = ("layout", "mesh")
"""Default views: the first available one is shown."""


@dataclass(frozen=True)
class Offers:
    """stages: what → stages whose artefacts it is read from, in order; absent: what → why this config has none of it; gauges:
    stages that have to have run for gauges to be drawn on the strain of a placement."""

    stages: Mapping[str, tuple[str, ...]]
    absent: Mapping[str, str]
    gauges: tuple[str, ...] = ()


TEST, VALIDATION = "test", "validation"
"""Sources of the field of a placement."""
STAGE = {TEST: "estimate", VALIDATION: "validate"}


def offers_of(
    config: PlacementConfig | BenchConfig, names: Sequence[str], body: str = "", of: str = VALIDATION
) -> Offers:
    """Views of a placement or bench with these stages; body: flexible body of a bench; of: source of a placement field."""
    stages: dict[str, tuple[str, ...]] = {"mesh": ("import",), "modes": ("import", "rom")}
    if isinstance(config, PlacementConfig):
        layout = ("import", "rom", "train", "screen", "place")
        stages |= {"strain": ("import", "rom", "train"), "candidates": ("import", "train"), "layout": layout}
        return Offers(stages | {"field": (*layout, STAGE[of])}, {}, layout)
    strains = [s for s in config.sensors.values() if s.type == "strain" and s.body == body]
    placed_here = "place" in names and config.place is not None and config.place.body == body
    placed = ("place",) * (placed_here or any(sensor.layout for sensor in strains))
    stages["modes"] = ("import", "reduce")
    absent = {
        "candidates": f"add a section `place` with `body: {body}`",
        "layout": f"add a strain sensor or a section `place` with `body: {body}`",
        "field": (no_field := f"add a section `field` with `body: {body}`"),
        "strain": no_field,
    }
    if placed_here:
        stages["candidates"] = ("import", "place")
    if strains or placed:
        stages["layout"] = ("import", *placed)
    if "field" in names and config.field is not None and config.field.body == body:
        stages["field"] = stages["strain"] = ("import", *placed, "field")
    return Offers(stages, {what: why for what, why in absent.items() if what not in stages})


def chosen(offers: Offers, folder: Path, view: str | None, config_file: str) -> str:
    """The requested view, otherwise the layout, otherwise the mesh.
    Raises UserError for a view that this config does not have, or that is not computed yet, with the command to run."""
    if view is not None:
        if view not in offers.stages:
            can = ", ".join(what for what in WHAT if what in offers.stages)
            raise UserError(
                f"this run has no view '{view}'",
                where=config_file,
                remedy=f"{offers.absent[view]}; available views: {can}",
            )
        if missing := missing_stages(folder, offers.stages[view]):
            raise UserError(
                f"the view '{view}' is not available yet: {folder / missing[0]}.h5 is missing",
                where=config_file,
                remedy=f"first run: strainsight {missing[-1]} {config_file}",
            )
        return view
    ready = [what for what in FURTHEST if what in offers.stages and not missing_stages(folder, offers.stages[what])]
    if not ready:
        raise UserError(
            f"no results to show yet in {folder}",
            where=config_file,
            remedy=f"first run: strainsight import {config_file} (the mesh), or strainsight run {config_file}",
        )
    return ready[0]


def opened(stages: Sequence[str], folder: Path) -> dict[str, Artefact]:
    """The artefacts of these stages, verified. Raises ArtefactError for one that is damaged."""
    artefacts = {stage: Artefact(folder / f"{stage}.h5") for stage in stages}
    for stage, artefact in artefacts.items():
        if artefact.header.stage != stage:
            raise ArtefactError(
                f"the file is the result of the stage '{artefact.header.stage}', not of the stage '{stage}'",
                where=str(artefact.path),
                remedy=f"run the stage again: strainsight {stage} CONFIG --force",
            )
    return artefacts


def view_of(
    config: PlacementConfig | BenchConfig,
    stages: Sequence[str],
    folder: Path,
    config_file: str,
    what: str | None = None,
    at: float | None = None,
    body: str | None = None,
    of: str | None = None,
    record: str | None = None,
) -> tuple[View, tuple[str, ...]]:
    """The view, and the stages that it was read from.

    config, stages: of a placement or a bench; folder: of its results; what: one of `WHAT`, None: the layout where there is one,
    else the mesh, and a field where `at`, `of` or `record` is given; at [s]: instant of a field in time; body: of a bench; of:
    "test" or "validation", whose field, None: the test's where there is one; record: of a test of several, None: the first.
    Raises UserError for what the run does not have or has not computed yet."""
    if body is not None and not isinstance(config, BenchConfig):
        raise UserError(f"--body {body}: a placement has a single body", where=config_file, remedy="omit --body")
    if of is not None and (isinstance(config, BenchConfig) or what not in (None, "field")):
        remedy = "omit --of" if isinstance(config, BenchConfig) else "use --what field"
        raise UserError(f"--of {of} applies only to the view `field` of a placement", where=config_file, remedy=remedy)
    shown = body_of(config, body) if isinstance(config, BenchConfig) else ""
    available = VALIDATION if missing_stages(folder, [STAGE[TEST]]) else TEST
    offers = offers_of(config, stages, shown, of or available)
    # Whoever names an instant, a record or a source means the field.
    named = any(option is not None for option in (at, of, record))
    picked = chosen(offers, folder, "field" if what is None and named else what, config_file)
    read = offers.stages[picked]
    if picked == "strain" and offers.gauges and not missing_stages(folder, offers.gauges):
        read = offers.gauges
    up = opened(read, folder)
    if at is not None and not (picked in ("field", "strain") and "/VTKHDF/Steps" in up[read[-1]]):
        remedy = "omit --at, or use --what field" if picked != "field" else "omit --at: the field has one instant only"
        remedy += "; set `estimate.field` for a field over time" * (read[-1] == STAGE[TEST])
        raise UserError(f"--at {at:g}: the view '{picked}' does not depend on time", where=config_file, remedy=remedy)
    if record is not None and (isinstance(config, BenchConfig) or picked != "field" or read[-1] != STAGE[TEST]):
        raise UserError(
            f"--record {record}: the view '{picked}' does not depend on a record",
            where=config_file,
            remedy="omit --record, or, for the test of a placement, use --what field --of test",
        )
    if isinstance(config, BenchConfig):
        return bench_view(config, picked, shown, up, at), read
    return placement_view(config, picked, up, at, record), read

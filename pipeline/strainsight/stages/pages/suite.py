"""Everything that the page of a suite shows, gathered from the artefacts of its runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from strainsight import __version__
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.report.placement.data import Layout, Unknown
from strainsight.report.suite.data import SuiteReport, SuiteRun
from strainsight.stages.pages.page import warnings_of
from strainsight.stages.pages.page_layout import layout_of_page, placed_scale, size
from strainsight.stages.pages.page_numbers import cases_of, history_of, repeats_of, trend_of, unknown_of
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.stage import Context

PAGE = "report"
"""The stage of a run that writes its own page, report.html."""


def suite_report(context: Context) -> SuiteReport:
    """The page's content, run by run."""
    runs, provenance = [], {"strainsight": __version__}
    for i, entry in enumerate(context.config.runs):
        context.progress(f"reading {entry.name}", 0.6 * i / len(context.config.runs))
        up = _artefacts(context.files, i)
        runs.append(_run(entry, up))
        # The digest and not the key, which changes with inputs that made no difference.
        provenance[f"{entry.name}, {entry.reached}"] = up[entry.reached].digest[:16]
    return SuiteReport(context.name, str(context.config.title), tuple(runs), provenance)


def _artefacts(files: Mapping[str, Path], i: int) -> dict[str, Artefact]:
    start = f"runs.{i}.artefacts."
    return {key.removeprefix(start): Artefact(path) for key, path in files.items() if key.startswith(start)}


def _run(entry: Any, up: Mapping[str, Artefact]) -> SuiteRun:
    names = list(entry.unknowns)
    mesh = mesh_from(up["import"])
    validate, place = up.get("validate"), up.get("place")
    layout = layout_of_page(mesh, up, entry.loads) if place else None
    return SuiteRun(
        name=entry.name,
        label=entry.label,
        note=entry.note,
        page=f"../{entry.name}/report.html" if PAGE in up else None,
        reached=entry.reached,
        unknowns=tuple(_unknown(name, entry.unknowns[name], up) for name in names),
        gauges=len(layout.gauges) if layout else None,
        pool=int(place.summary["pool"]) if place else None,
        trend=trend_of(place) if place else None,
        layout=layout,
        expected_std={n: float(place[f"/expected_std/{n}"]) / size(n, up) for n in names} if place else {},
        histories=tuple(history_of(name, validate) for name in names) if validate else (),
        repeats=repeats_of(names, validate) if validate else (),
        cases=cases_of(up["observe"]) if "observe" in up else (),
        frequencies=tuple(read(Reduced, up["rom"]).frequency.tolist()) if "rom" in up else (),
        truth_description=str(validate.summary["description"]) if validate else "",
        pairs=nearest(layout) if layout else (),
        warnings=warnings_of(up, names, mesh),
    )


def _unknown(name: str, entry: Any, up: Mapping[str, Artefact]) -> Unknown:
    if "validate" in up:
        return unknown_of(name, entry.kind, up)
    guess, expected = _guess(name, entry, up), None
    if "place" in up:
        guess = placed_scale(name, up["place"])
        expected = float(up["place"][f"/expected_std/{name}"]) / guess
    return Unknown(name=name, unit=entry.unit, kind=entry.kind, guess=guess, expected_std=expected)


def _guess(name: str, entry: Any, up: Mapping[str, Artefact]) -> float:
    """Before anything is placed: a parameter's reference, an input's largest training load; NaN before that is known."""
    if entry.kind == "parameter":
        return read(Reduced, up["rom"]).model.reference.get(name, float("nan")) if "rom" in up else float("nan")
    if "train" not in up:
        return float("nan")
    loads = read(Reduced, up["rom"]).model.inputs
    return float(np.abs(read(Training, up["train"]).load[:, loads.index(name)]).max())


def nearest(layout: Layout) -> tuple[tuple[str, str, float], ...]:
    """Every gauge with its nearest other one and the distance between them [m]."""
    found = []
    for gauge in layout.gauges:
        others = [
            (float(np.linalg.norm(gauge.position - other.position)), other.label)
            for other in layout.gauges
            if other is not gauge
        ]
        if others:
            distance, label = min(others)
            found.append((gauge.label, label, distance))
    return tuple(found)

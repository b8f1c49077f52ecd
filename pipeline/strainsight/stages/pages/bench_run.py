"""One run of a bench as its pages show it, read from its artefacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.report.bench.data import (
    BearingMotion,
    BenchEstimate,
    BenchMotion,
    BenchPlacement,
    BenchSensor,
    BenchUnknown,
)
from strainsight.report.placement.data import History
from strainsight.workflow.artefact import Artefact

RELATIVE = (("x", "m"), ("y", "m"), ("z", "m"), ("tilt y", "rad"), ("tilt z", "rad"))
WARNINGS = "warnings"
"""Title of the table in which a stage warns."""
PLACED = "place"


def estimate_of(artefact: Artefact) -> BenchEstimate:
    """Everything that a page shows of estimate.h5."""
    time = artefact["/time"]
    return BenchEstimate(
        time=time,
        unknowns=(
            *(_input(artefact, name, time) for name in _groups(artefact, "/inputs")),
            *(_parameter(artefact, name, time) for name in _groups(artefact, "/parameters")),
        ),
        sensors=tuple(_compared(artefact, name, time[1:]) for name in _groups(artefact, "/sensors")),
        nis=artefact["/nis"],
        violation=artefact["/violation"],
        numbers=artefact.summary,
    )


def motion_of(artefact: Artefact) -> BenchMotion:
    """Everything that a page shows of simulate.h5."""
    time = artefact["/time"]
    inputs = artefact.children("/inputs") if "/inputs" in artefact else {}
    sensors = artefact.children("/sensors") if "/sensors" in artefact else {}
    return BenchMotion(
        time=time,
        inputs={name: (_unit(artefact, f"/inputs/{name}"), values) for name, values in inputs.items()},
        sensors=tuple(
            BenchSensor(name, time, values, None, *_components(_unit(artefact, f"/sensors/{name}"), values.shape[1]))
            for name, values in sensors.items()
        ),
        bearings=tuple(
            BearingMotion(name, *(artefact[f"/bearings/{name}/{key}"] for key in ("displacement", "load", "pressure")))
            for name in _groups(artefact, "/bearings")
        ),
        numbers=artefact.summary,
    )


def placement_of(artefact: Artefact) -> BenchPlacement:
    """Everything that a page shows of place.h5 of a bench."""
    names = [str(name) for name in artefact["/inputs"]]
    layouts = _groups(artefact, "/layouts")
    std = {layout: artefact[f"/layouts/{layout}/std"] for layout in layouts}
    drawn = [std[layout] for layout in layouts if layout != PLACED]
    trace = artefact["/elimination/trace"]
    pool = len(artefact["/pool/candidate"])
    return BenchPlacement(
        position=artefact[f"/layouts/{PLACED}/position"],
        direction=artefact[f"/layouts/{PLACED}/direction"],
        expected={name: float(std[PLACED][i]) for i, name in enumerate(names)},
        random={name: np.array([values[i] for values in drawn]) for i, name in enumerate(names)},
        count=pool - np.arange(len(trace)),
        trace=trace,
        numbers=artefact.summary,
    )


def warnings_in(artefacts: Mapping[str, Artefact]) -> tuple[str, ...]:
    """What the stages warned of, each said once."""
    said = [
        row[0]
        for artefact in artefacts.values()
        for table in artefact.tables
        if table.title == WARNINGS
        for row in table.rows
    ]
    return tuple(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in dict.fromkeys(said))


def _input(artefact: Artefact, name: str, time: np.ndarray) -> BenchUnknown:
    place = f"/inputs/{name}"
    history = History(
        name,
        _unit(artefact, f"{place}/estimate"),
        time,
        _maybe(artefact, f"{place}/true"),
        artefact[f"{place}/estimate"],
        artefact[f"{place}/std"],
    )
    return BenchUnknown(
        "input", history, _maybe(artefact, f"/runs{place}/error"), None, _maybe(artefact, f"{place}/there")
    )


def _parameter(artefact: Artefact, name: str, time: np.ndarray) -> BenchUnknown:
    place = f"/parameters/{name}"
    true = _maybe(artefact, f"{place}/true")
    history = History(
        name,
        _unit(artefact, f"{place}/estimate"),
        time,
        None if true is None else np.full(len(time), float(true)),
        artefact[f"{place}/estimate"],
        artefact[f"{place}/std"],
    )
    errors = _maybe(artefact, f"/runs{place}/error")
    if errors is None and true is not None and (ends := _maybe(artefact, f"/runs{place}/estimate")) is not None:
        errors = ends - float(true)
    return BenchUnknown("parameter", history, errors, _maybe(artefact, f"/runs{place}/std"))


def _compared(artefact: Artefact, name: str, time: np.ndarray) -> BenchSensor:
    place = f"/sensors/{name}"
    expected, measured, used = (_maybe(artefact, f"{place}/{key}") for key in ("expected", "measured", "used"))
    assert expected is not None
    components = _components(_unit(artefact, f"{place}/expected"), expected.shape[1])
    nothing = np.full_like(expected, np.nan)
    given = used is None or bool(used)
    return BenchSensor(name, time, nothing if measured is None else measured, expected, *components, given)


def _components(unit: str, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the components of a sensor are called, and their units."""
    if unit == "m or rad" and count == len(RELATIVE):
        return tuple(name for name, _ in RELATIVE), tuple(own for _, own in RELATIVE)
    if unit == "strain":
        return tuple(f"gauge {i}" for i in range(1, count + 1)), (unit,) * count
    names = tuple("xyz") if count == len("xyz") else tuple(str(i) for i in range(1, count + 1))
    return names, ("–" if unit == "1" else unit,) * count


def _groups(artefact: Artefact, place: str) -> tuple[str, ...]:
    return artefact.groups(place) if place in artefact else ()


def _maybe(artefact: Artefact, path: str) -> np.ndarray | None:
    if path not in artefact:
        return None
    return artefact[path]


def _unit(artefact: Artefact, path: str) -> str:
    return str(artefact.attributes(path)["units"])

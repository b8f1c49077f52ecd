"""suite: one page and one table about several runs; everything in them is read from the runs' artefacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from typing import Any

import numpy as np

from strainsight.cases.structure.trial import PARAMETER_UNITS
from strainsight.errors import StrainsightError
from strainsight.report.picture.scene import pack, render_all
from strainsight.report.suite.data import SuiteReport
from strainsight.report.suite.figures import suite_figures
from strainsight.report.suite.page import suite_page
from strainsight.stages.pages.suite import suite_report
from strainsight.stages.pages.suite_numbers import suite_datasets, suite_tables
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage

DRAWN = ("node", "set", "direction", "deck_load", "known")
"""What the picture shows of a load."""


def config_of_run(data: Mapping[str, Any], label: str, note: str, stages: Sequence[str]) -> dict[str, Any]:
    """What the stage is told of a run: its checked config `data`, and the stages that it was brought through."""
    loads, parameters = data["loads"], data["parameters"]
    return {
        "name": data["name"],
        "label": label,
        "note": note,
        "reached": stages[-1],
        "artefacts": {stage: f"{data['name']}/{stage}.h5" for stage in stages},
        "loads": {name: {key: load[key] for key in DRAWN} for name, load in loads.items()},
        "unknowns": {
            name: {"kind": "input", "unit": "N"}
            if name in loads
            else {"kind": "parameter", "unit": PARAMETER_UNITS[parameters[name]["property"]]}
            for name in data["place"]["estimate"]
        },
    }


def run(context: Context) -> Output:
    """Gather what the page shows and write it as one self-contained file."""
    report = suite_report(context)
    context.progress("pictures and figures", 0.4)
    with ThreadPoolExecutor(1) as pool:  # the pictures are another process's work
        waiting = pool.submit(_scenes, report)
        drawings = suite_figures(report)
        scenes, problem = waiting.result()
    page = suite_page(report, drawings, scenes).encode()
    validated = sum(1 for run in report.runs if run.histories)
    many = len(report.runs)
    said = f"{many} run{'s' * (many != 1)}, {validated} estimated; report.html, {len(page) / 1024:.0f} KiB"
    return Output(
        datasets=suite_datasets(report),
        summary={
            "pictures": len(scenes),
            "runs": len(report.runs),
            "validated": validated,
        },
        message=said + (f"; no 3D pictures: {problem}" if problem else ""),
        tables=suite_tables(report),
        files={"report.html": page},
    )


def _scenes(report: SuiteReport) -> tuple[dict[str, bytes], str]:
    """Run → its picture, and why there are none; runs with the same layout share one."""
    layouts = {run.name: run.layout for run in report.runs if run.layout is not None}
    looks = {name: _look(pack(layout)) for name, layout in layouts.items()}
    different = {looks[name]: layout for name, layout in layouts.items()}
    if not different:
        return {}, ""
    try:
        pictures = dict(zip(different, render_all(list(different.values())), strict=True))
    except StrainsightError as error:
        return {}, f"{error.what}: {error.remedy}"
    return {name: pictures[look] for name, look in looks.items()}, ""


def _look(packed: Mapping[str, np.ndarray]) -> str:
    digest = sha256()
    for name, array in packed.items():
        digest.update(f"{name}{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


SUITE = Stage(
    "suite",
    version=6,
    reads=("name", "title", "runs"),
    upstream=(),
    files=("runs.*.artefacts.*",),
    run=run,
)

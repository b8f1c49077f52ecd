"""The figures of a run as files are those of its page, with numbers of its artefacts."""

from __future__ import annotations

import csv
import io
from html import escape

import numpy as np
import pytest

from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.figures import figures_of
from strainsight.stages.report import REPORT

from .conftest import ROOT, SHORT, job_of


@pytest.mark.slow
def test_figures_of_a_placement_are_those_of_its_page(artefacts, config, results):
    job = job_of(config, results, *SHORT)
    files = figures_of(job.model, (REPORT,), job.folder, "own.yaml").files
    page = (job.folder / "report.html").read_text(encoding="utf-8")
    with io.StringIO(files["figures.csv"].decode()) as index:
        captions = [row["caption"] for row in csv.DictReader(index)]
    assert sum(name.endswith(".svg") for name in files) == len(captions) > 5
    assert all(escape(caption) in page for caption in captions)
    trend = list(csv.reader(io.StringIO(files["trend.csv"].decode())))
    column = trend[0].index("tr(W P): metric tr(W P) [–]")
    drawn = [float(row[column]) for row in trend[1:]]
    np.testing.assert_allclose(drawn, artefacts["place"]["/elimination/trace"], rtol=1e-8)


def test_figures_of_a_bench_have_the_loads_of_its_artefact(bench):
    job = job_of(ROOT / "configs" / "bench-full.yaml", bench["simulate"].path.parents[1], "simulate.duration=1.0")
    files = figures_of(job.model, bench_stages(job.config)[-1:], job.folder, "own.yaml").files
    assert sum(name.endswith(".svg") for name in files) == bench["report"].summary["figures"]
    rows = list(csv.DictReader(io.StringIO(files["loads.csv"].decode())))
    simulated = bench["simulate"]
    at = np.searchsorted(simulated["/time"], float(rows[3]["time [s]"]) - 1e-9)
    np.testing.assert_allclose(float(rows[3]["Fx: load [kN]"]), simulated["/inputs/Fx"][at] / 1e3, rtol=1e-8)

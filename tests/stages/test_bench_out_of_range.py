"""A modulus of a bench that leaves the range in which its reduced body is good: said first, and no σ anywhere."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from strainsight.rom import craig_bampton
from strainsight.runner.artefact import Artefact
from strainsight.stages.bench import report
from strainsight.stages.bench.pipeline import bench_stages

from ..edges.beam import BENCH_CONFIG, E, bricks, config_of
from ..shared import once
from .conftest import finished, job_of

HALVES = bricks((4, 1, 1)).replace("CHEXA,3,1,", "CHEXA,3,2,").replace("CHEXA,4,1,", "CHEXA,4,2,")
FREE = {
    "bodies.beam.moduli": {"E": {"region": 2, "value": E}},
    "estimate.inputs": {"down": {"std": 100.0, "increment": 20.0}},
    "estimate.parameters": {"E": {"guess": 1.1 * E, "std": 0.2 * E}},
    "estimate.hold_out": "each",
    "estimate.runs": 2,
    "forces.weight": {"type": "gravity", "acceleration": [0.0, -98.1, 0.0]},
    "sensors.gauges": {
        "type": "strain",
        "body": "beam",
        "gauges": [{"position": [x, 0.05, 0.08], "direction": [1, 0, 0]} for x in (0.2, 0.45, 0.7)],
    },
}


@pytest.fixture(scope="module", params=[craig_bampton.FACTOR, 1 + 1e-9], ids=["within", "beyond"])
def done(request):
    """Whether the range is too narrow, and stage → artefact, the page with them where it is."""
    narrow = request.param < 1.1
    deck = HALVES.replace("PSOLID,1,1", "PSOLID,1,1\nPSOLID,2,1")
    config = yaml.safe_dump(config_of({k: v for k, v in BENCH_CONFIG.items() if k != "place"}, FREE))

    def make(folder):
        (folder / "beam.bdf").write_text(deck, encoding="ascii")
        (folder / "own.yaml").write_text(config, encoding="utf-8")
        job = job_of(folder / "own.yaml", folder / "results")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(craig_bampton, "FACTOR", request.param)
            patch.setattr(report, "_pictures", lambda *_: ([], ""))
            finished(job, [stage for stage in bench_stages(job.config) if narrow or stage.name != "report"])

    folder = once("range", f"{request.param}\n{deck}\n{config}", make)
    return narrow, {path.stem: Artefact(path) for path in (folder / "results" / "edge").glob("*.h5")}


def test_the_range_stands_in_the_artefact_about_the_value_of_the_bench(done):
    narrow, found = done
    low, high = found["reduce"]["/bodies/beam/reach/E"]
    assert E / 2 <= low < E < high <= 2 * E
    assert narrow == (high < 1.001 * E)


def test_beyond_it_every_sigma_is_withheld_and_within_it_none_is(done):
    narrow, found = done
    estimate = found["estimate"]
    std = {path for path in estimate.paths() if path.endswith("std") and "/sensors/" not in path}
    assert {"/inputs/down/std", "/parameters/E/std"} <= std
    assert all(np.isnan(estimate[path]).all() == narrow for path in std)
    claimed = [key for key in estimate.summary if key.split(".")[0] in ("std", "claim", "claim_ratio", "identified")]
    assert bool(claimed) != narrow
    assert ("withheld" in estimate.summary) == narrow
    assert np.isfinite(estimate["/parameters/E/estimate"]).all()


def test_console_and_page_begin_with_it(done):
    narrow, found = done
    estimate = found["estimate"]
    said = str(estimate.summary.get("withheld", ""))
    assert said.startswith("σ is withheld: E was estimated as") == narrow
    assert (estimate.summary["verdict.E"] == "outside the range of the reduced model") == narrow
    assert (estimate.summary["verdict.down"] == "σ is withheld") == narrow
    if not narrow:
        return
    page = (found["report"].path.parent / "report.html").read_text(encoding="utf-8")
    assert "E: outside the range of the reduced model" in page
    assert "but the stage `reduce` built the reduced model for" in page
    assert "✕ σ is withheld" in page
    assert "σ claimed by the filter" not in page

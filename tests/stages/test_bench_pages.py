"""The pages of benches, of one run and of a suite, from artefacts made by hand: their numbers, escaped texts, errors."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.report.bench.data import BenchRun
from strainsight.stages.bench.report import report_stage
from strainsight.stages.pages.suite import statements_of
from strainsight.stages.suite import SUITE
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.plan import Job
from strainsight.workflow.runner import run
from strainsight.workflow.slices import Slice
from strainsight.workflow.stage import Context

from .bench_artefacts import estimated, simulated
from .test_artefacts import assert_summary_is_listed

CLAIM = {
    "stage": "estimate", "times": 1.0, "against": None, "against_number": None, "above": None, "below": None, "equals": None,
    "unit": "", "why": "",
}  # fmt: skip


def entry_of(name: str, stages, **more):
    entry = {"name": name, "label": name, "note": "", "study": "", "group": "", "at": None, "reached": stages[-1]}
    return entry | {"artefacts": {stage: f"{name}/{stage}.h5" for stage in stages}} | more


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    for i, error in enumerate((1e-3, 1e-2)):
        simulated(folder / f"h{i}")
        estimated(folder / f"h{i}", error=error, seed=i)
    estimated(folder / "down", there=0.25, truth=False, parameter=False)
    estimated(folder / "lost", lost=1, parameter=False)
    simulated(folder / "still")
    return folder


BOTH = ("simulate", "estimate")
RUNS = [
    entry_of("h0", BOTH, study="Steps", group="own", at=0.1),
    entry_of("h1", BOTH, study="Steps", group="own", at=1.0),
    entry_of("down", ("estimate",), study="Scale"),
    entry_of("lost", ("estimate",)),
    entry_of("still", ("simulate",)),
]


STUDY = {"name": "Steps", "note": "", "over": "estimate.time_step", "numbers": []}


def made(results, claims=(), studies=(), name="all"):
    config = {"name": name, "title": "All", "runs": RUNS, "studies": list(studies), "comparisons": []}
    measures = [{"key": f"claims.{i}"} | own for i, own in enumerate(claims)]
    config["claims"] = [{"text": own["text"], "why": own.get("why", ""), "measure": own} for own in measures]
    job = Job(config, results, results, lambda key: f"suite.yaml at {key}")
    return list(run((SUITE,), job))[-1].artefact


@pytest.fixture(scope="module")
def suite(results):
    claims = [
        CLAIM | {"text": "Slopes are one.", "runs": [0, 1], "number": ["slope.Fz"], "above": 0.995, "below": 1.005},
        CLAIM | {"text": "Ten times worse.", "runs": [1], "number": ["error.Fz"], "against": 0, "above": 11.0},
        CLAIM | {"text": "In per cent.", "runs": [1], "number": ["error.Fz"], "times": 100.0, "above": 0.9, "below": 1.1},
        CLAIM | {"text": "All starts agree.", "runs": [0, 1], "number": ["identified.ball"], "equals": True},
        CLAIM | {"text": "A lost filter knows.", "runs": [3], "number": ["error.ball"], "below": 1.0},
        CLAIM | {"text": "Constraints hold.", "runs": [4], "stage": "simulate", "number": ["violation"], "below": 1e-13},
    ]  # fmt: skip
    return made(results, claims, [STUDY])


def test_claims_are_measured_in_the_artefacts(suite):
    assert suite["/claim/verdict"].tolist() == [
        "confirmed", "contradicted", "confirmed", "confirmed", "no number", "confirmed",
    ]  # fmt: skip
    np.testing.assert_allclose(suite["/number/value"], [1.001, 1.001, 10.0, 1.0, 1.0, 1.0, np.nan, 2e-16], rtol=1e-12)
    assert suite["/number/run"].tolist() == [0, 1, 1, 1, 0, 1, 3, 4]
    assert_summary_is_listed(suite, "suite.h5")
    assert (suite.summary["claims"], suite.summary["confirmed"], suite.summary["contradicted"]) == (6, 4, 1)


def test_numbers_that_there_are_once_a_seed_are_divided_seed_by_seed():
    claim = SimpleNamespace(
        text="t", runs=[0, 1], number=["error.F", "nis"], stage="estimate", times=100.0, against=0, against_number=None,
        above=None, below=1.0, equals=None, unit="", why="because",
    )  # fmt: skip
    runs = [
        BenchRun("a", "a", numbers={"estimate": {"nis": 2.0}}, seeds={"error.F": np.array([1.0, 2.0, 4.0])}),
        BenchRun("b", "b", numbers={"estimate": {"nis": 3.0}}, seeds={"error.F": np.array([2.0, 2.0, 2.0])}),
    ]
    claim.key = "claims.0"
    (statement,) = statements_of([SimpleNamespace(text=claim.text, why=claim.why, measure=claim)], runs)
    assert statement.seeds == {
        (0, "error.F"): [100.0] * 3, (0, "nis"): [100.0], (1, "error.F"): [200.0, 100.0, 50.0], (1, "nis"): [150.0],
    }  # fmt: skip
    assert statement.why == "because"


def test_the_numbers_are_those_of_the_runs(suite, results):
    assert suite["/run/name"].tolist() == ["h0", "h1", "down", "lost", "still"]
    assert suite["/run/at"][:2].tolist() == [0.1, 1.0]
    assert suite["/unknown/name"].tolist() == ["Fz", "ball", "Fz", "ball", "Fz", "Fz"]
    error = [Artefact(results / name / "estimate.h5").summary["error.Fz"] for name in ("h0", "h1")]
    np.testing.assert_array_equal(suite["/unknown/error"][[0, 2]], error)
    assert np.isnan(suite["/unknown/error"][4])
    assert suite["/unknown/ratio_slope"][4] == 0.25


@pytest.mark.parametrize(
    ("claim", "numbers", "key", "what", "remedy"),
    [
        ({"number": ["slope.Fx"]}, [], "claims.0.number", "no number 'slope.Fx' in the stage 'estimate' of 'h0'", "slope.Fz"),
        ({"number": ["identified.ball"]}, [], "claims.0", "is true or false", "equals"),
        ({"against": 1, "against_number": "error.Fq"}, [], "claims.0.against_number",
         "no number 'error.Fq' in the stage 'estimate' of 'h1'", "error.Fz"),
        ({}, ["slope.Fz", "slpoe.Fz"], "studies.0.numbers", "no run of the study 'Steps' has a number 'slpoe",
         "did you mean slope.Fz?"),
    ],
)  # fmt: skip
def test_a_number_that_no_run_has_is_refused_at_its_place(results, claim, numbers, key, what, remedy):
    claim = CLAIM | {"text": "t", "runs": [0], "number": ["slope.Fz"], "below": 3.0} | claim
    with pytest.raises(ConfigError, match=re.escape(what)) as caught:
        made(results, [claim], [STUDY | {"numbers": numbers}], name="wrong")
    assert caught.value.where == f"suite.yaml at {key}"
    assert remedy in caught.value.remedy


def test_the_page_of_one_run_shows_its_estimate_and_motion(tmp_path):
    simulated(tmp_path / "one")
    estimated(tmp_path / "one", there=0.2)
    stage = report_stage(["modes of bodies", "simulate", "estimate"])
    assert stage.upstream == ("simulate", "estimate")
    upstream = {name: Artefact(tmp_path / "one" / f"{name}.h5") for name in stage.upstream}
    config = Slice({"name": "one", "seed": 3, "bodies": {}, "sensors": {}}, "report")
    output = stage.run(Context(config, upstream, {}, lambda doing, share: None))
    page = output.files["report.html"].decode()
    words = " ".join(re.sub(r"<[^>]*>", " ", page).split()).replace("\N{NO-BREAK SPACE}", " ")
    for text in (
        "9 channels tell Fz to 1.0 % at a claimed σ of 1.0 %",
        "Force on each of the 12 balls of bearing by the estimate at 1.5 s",
        "at most 40 kN ± 300 N",
        "at most 2 GPa ± 10 MPa",
        "with ±2 claimed standard deviations, and smoothed (green)",
    ):
        assert text in words
    assert "A noise of 0 is &lt;floored&gt;." in page
    assert "<floored>" not in page
    assert output.summary["warnings"] == 1
    assert page.count("<figure") == output.summary["figures"]

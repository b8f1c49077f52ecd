"""What a suite states of numbers of benches, and numbers that no run has."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.pages.bench.data import BenchPageRun
from strainsight.stages import suite
from strainsight.stages.suite import statements_of

CLAIM = {
    "key": "claims.0", "stage": "estimate", "times": 1.0, "against": None, "against_number": None, "above": None, "below": None,
    "equals": None, "unit": "",
}  # fmt: skip
RUNS = [
    BenchPageRun(
        "h0", "h0", numbers={"estimate": {"slope.F": 1.001, "error.F": 1e-3, "same.d": True}, "simulate": {"off": 2e-16}}
    ),
    BenchPageRun("h1", "h1", numbers={"estimate": {"slope.F": 1.001, "error.F": 1e-2, "same.d": True}}),
    BenchPageRun("lost", "lost", numbers={"estimate": {"lost": 1}}),
]


def statement(claim, all_runs=RUNS):
    measure = SimpleNamespace(**(CLAIM | claim))
    (result,) = statements_of([SimpleNamespace(text="t", why="because", measure=measure)], all_runs)
    return result


@pytest.mark.parametrize(
    ("claim", "verdict", "values"),
    [
        ({"runs": [0, 1], "number": ["slope.F"], "above": 0.995, "below": 1.005}, "confirmed", [1.001, 1.001]),
        ({"runs": [1], "number": ["error.F"], "against": 0, "above": 11.0}, "contradicted", [10.0]),
        ({"runs": [1], "number": ["error.F"], "times": 100.0, "above": 0.9, "below": 1.1}, "confirmed", [1.0]),
        ({"runs": [0, 1], "number": ["same.d"], "equals": True}, "confirmed", [1.0, 1.0]),
        ({"runs": [2], "number": ["error.d"], "below": 1.0}, "no number", [np.nan]),
        ({"runs": [0], "stage": "simulate", "number": ["off"], "below": 1e-13}, "confirmed", [2e-16]),
    ],
)
def test_claims_are_measured_in_the_numbers_of_the_runs(claim, verdict, values):
    result = statement(claim)
    assert result.result == verdict
    np.testing.assert_allclose([value for _, _, value in result.numbers], values, rtol=1e-12)


def test_numbers_that_there_are_once_a_seed_are_divided_seed_by_seed():
    runs = [
        BenchPageRun("a", "a", numbers={"estimate": {"nis": 2.0}}, seeds={"error.F": np.array([1.0, 2.0, 4.0])}),
        BenchPageRun("b", "b", numbers={"estimate": {"nis": 3.0}}, seeds={"error.F": np.array([2.0, 2.0, 2.0])}),
    ]
    claim = {"runs": [0, 1], "number": ["error.F", "nis"], "times": 100.0, "against": 0, "below": 1.0}
    result = statement(claim, runs)
    assert result.seeds == {
        (0, "error.F"): [100.0] * 3, (0, "nis"): [100.0], (1, "error.F"): [200.0, 100.0, 50.0], (1, "nis"): [150.0],
    }  # fmt: skip
    assert result.why == "because"


@pytest.mark.parametrize(
    ("claim", "key", "what", "remedy"),
    [
        ({"number": ["slope.Fx"]}, "claims.0.number",
         "result 'slope.Fx' not found in the stage 'estimate' of run 'h0'", "slope.F"),
        ({"number": ["same.d"]}, "claims.0", "is true or false", "equals"),
        ({"number": ["slope.F"], "against": 1, "against_number": "error.Fq"}, "claims.0.against_number",
         "result 'error.Fq' not found in the stage 'estimate' of run 'h1'", "error.F"),
    ],
)  # fmt: skip
def test_a_claim_on_a_number_that_a_run_does_not_have_is_refused(claim, key, what, remedy):
    with pytest.raises(ConfigError, match=re.escape(what)) as caught:
        statement({"runs": [0], "below": 3.0} | claim)
    assert caught.value.key == key
    assert remedy in caught.value.remedy


def test_a_number_to_draw_that_no_run_of_the_study_has_is_refused():
    run = BenchPageRun("h0", "h0", study="Steps", numbers={"estimate": {"slope.F": 1.0}})
    study = SimpleNamespace(name="Steps", note="", over="h", numbers=["slope.F", "slpoe.F"])
    with pytest.raises(ConfigError, match="no run of the study 'Steps' has a result 'slpoe") as caught:
        suite._studies([study], [run])
    assert caught.value.key == "studies.0.numbers"
    assert caught.value.remedy == "did you mean slope.F?"

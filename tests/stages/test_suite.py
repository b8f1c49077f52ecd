"""The stage of a suite: the numbers of its runs as they are in their artefacts, in a file that is documented whole."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of
from strainsight.pages.placement.data import Repeats, Unknown
from strainsight.pages.suite.data import PlacementRun, Suite
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages import suite as suite_stage
from strainsight.stages.pages.suite_entries import suite_config
from strainsight.stages.suite import SUITE, numbers_of, suite_tables

from ..shared import ROOT, script

DOC = ROOT / "docs" / "artefacts.md"


LASTS = ("import", "place", "report")


@pytest.fixture(scope="module")
def given(config, artefacts, tmp_path_factory):
    """What the stage is given of the same run, as far as it got three times, and of a claim on it."""
    path = tmp_path_factory.mktemp("suite") / "suite.yaml"
    runs = "".join(f"  - {{config: {config}, name: to-{last}, label: <{last}>}}\n" for last in LASTS)
    claims = "claims: [{text: E is known., run: to-report, number: error.E, below: 0.5}]\n"
    path.write_text(f"kind: suite\nname: all\ntitle: All & more\nruns:\n{runs}{claims}", encoding="utf-8")
    suite, names = load_config(path), list(artefacts)
    given = suite_config(suite, runs_of(suite), [names[: names.index(last) + 1] for last in LASTS])
    own = load_config(config).data["name"]
    for entry in given["runs"]:
        entry["artefacts"] = {stage: f"{own}/{stage}.h5" for stage in entry["artefacts"]}
    return given


@pytest.fixture(scope="module")
def suite(given, results, artefacts):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite_stage, "render_all", lambda layouts: [b"png"] * len(layouts))
        return list(run((SUITE,), Job(given, results, results)))[-1].artefact


def test_the_numbers_are_those_of_the_runs(suite, artefacts):
    place, validate = artefacts["place"], artefacts["validate"]
    assert suite["/run/reached"].tolist() == ["import", "place", "report"]
    np.testing.assert_array_equal(suite["/run/metric_final"], [np.nan, *[place.summary["trace_final"]] * 2])
    np.testing.assert_array_equal(suite["/run/gap"], [np.nan, *[place.summary["gap"]] * 2])
    np.testing.assert_array_equal(suite["/unknown/error"], [np.nan, np.nan, validate.summary["error.E"]])
    np.testing.assert_array_equal(suite["/unknown/smoothed"], [np.nan, np.nan, validate.summary["smoothed.E"]])
    expected = float(place["/expected_std/E"])
    scale = float(place.attributes("/expected_std/E")["scale"])
    np.testing.assert_allclose(suite["/unknown/expected"], [np.nan, expected / scale, expected / scale])
    assert suite["/unknown/repeats_worst"][2] == np.abs(validate["/repeats/error/E"]).max()
    assert suite["/case/condition"].tolist() == artefacts["observe"]["/condition"].T.ravel().tolist() * 2
    assert suite["/claim/verdict"].tolist() == ["confirmed"]
    assert suite["/number/value"].tolist() == [validate.summary["error.E"]]
    assert suite["/number/run"].tolist() == [2]


def test_the_page_and_the_table_say_the_same_of_a_diverged_repeat():
    run = PlacementRun(
        "a", "a", reached="validate", unknowns=(
            Unknown("E", "Pa", "parameter", 2e11, 2.1e11, 2.1e11, 0.001, 0.001,
                    repeats=Repeats(np.array([0.001, np.nan, -0.002]), np.full(3, 0.001), True)),
        ),
    )  # fmt: skip
    report = Suite("s", "s", (run,))
    unknowns = numbers_of(report).unknowns
    assert unknowns.repeats_worst.tolist() == [np.inf]
    assert unknowns.verdict == ("diverged",)
    (table,) = suite_tables(report)
    assert table.rows[0][-2:] == ("RMS error 0.16 %, 1 of 3 runs diverged", "diverged")


def test_every_dataset_and_every_scalar_is_listed(suite):
    text = DOC.read_text(encoding="utf-8").split("## suite.h5\n")[1].split("\n## ")[0]
    assert "{include} artefacts/suite.txt" in text
    table = script("docs/artefact_reference.py").tables()["suite.txt"]
    listed = dict(re.findall(r"^\| `([^`]+)` \| [^|]+ \| ([^|]+) \|", table, flags=re.MULTILINE))
    assert {path: unit.strip() for path, unit in listed.items()} == {
        path: suite.attributes(path)["units"] for path in suite.paths()
    }
    assert all(suite[path].ndim == 1 for path in suite.paths())
    assert set(re.findall(r"`([^`]+)`", text.split("Summary:")[1])) == set(suite.summary)

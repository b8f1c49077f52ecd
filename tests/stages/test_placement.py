"""The pipeline as a whole: what runs, what does not, and that the artefacts fit together."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest

from strainsight.experiment.structure import candidates
from strainsight.runner.plan import plan
from strainsight.stages.placement import PLACEMENT

from .conftest import COARSE, ROOT, SHORT, UNSTUDIED, finished, job_of


def test_a_changed_keep_reruns_place_and_what_follows_and_says_why(artefacts, config, results):
    statuses = {s.stage: s for s in plan(PLACEMENT, job_of(config, results, *COARSE, "place.keep=6"))}
    assert [name for name, s in statuses.items() if s.status == "will run"] == ["place", "validate", "report"]
    assert "place.keep 4 → 6" in statuses["place"].reason


def test_zones_of_the_config_leave_gauges_out(artefacts, config, results, tmp_path):
    """The pool's axis is x: all sides of the beam but its ends; one zone of every kind, against the words of each."""
    shutil.copytree(results, tmp_path / "results")
    zones = (
        "gauges.exclude=[{box: [[0, -1, -1], [0.1, 1, 1]]}, {cylinder: {point: [1, 0, 0], axis: [0, 0, 1], radius: 0.2}}, "
        "{normal_cone: {axis: [0, 1, 0], angle: 5}}, {near_edges: 0.02}]"
    )
    done = finished(job_of(config, tmp_path / "results", *COARSE, zones), PLACEMENT[:4])
    every, left = artefacts["train"], done["train"][2]
    x, n = every["/gauges/position"], every["/gauges/normal"]
    keep = (x[:, 0] > 0.1) & (np.hypot(x[:, 0] - 1, x[:, 1]) >= 0.2) & (np.abs(n[:, 1]) < 0.5)
    keep &= (np.minimum(0.125 - np.abs(x[:, 1]), 2.0 - x[:, 0]) >= 0.02) & (x[:, 0] >= 0.02)
    np.testing.assert_array_equal(left["/gauges/position"], x[keep])
    assert 0 < keep.sum() < len(x)


def test_readings_are_sized_some_channels_at_a_time(artefacts, config, results, tmp_path, monkeypatch):
    """Of 144 channels in 211 instants, three at a time."""
    shutil.copytree(results, tmp_path / "results")
    monkeypatch.setattr(candidates, "NUMBERS_AT_A_TIME", 3 * 211 + 1)
    stages = [stage for stage in PLACEMENT if stage.name in ("import", "modes", "rom", "train")]
    found = finished(job_of(config, tmp_path / "results", *COARSE, "train.duration=0.21"), stages)["train"][2]
    strain = found["/coordinate"] @ found["/gauges/row"].T
    assert strain.shape == (211, 144)
    np.testing.assert_allclose(found["/rms"], np.sqrt(np.mean(strain**2, axis=0)), rtol=1e-12)
    np.testing.assert_allclose(found["/peak"], np.abs(strain).max(axis=0), rtol=1e-12)


def test_influence_matrix_is_that_of_a_beam(artefacts):
    """A tip load of a cantilever: ε = F (L − x) z / E I on its top and bottom, at the guess of E."""
    place, train = artefacts["place"], artefacts["train"]
    at = train["/gauges/position"][place["/selected/final/number"]]
    E, inertia = 1.89e11, 0.25 * 0.19**3 / 12
    assert [str(name) for name in place["/influence/load"]] == ["tip"]
    strain = place["/influence/reading"][:, 0]
    np.testing.assert_allclose(np.abs(strain), (2 - at[:, 0]) * np.abs(at[:, 2]) / (E * inertia), rtol=0.05)
    ratio = train["/rms"][place["/selected/final/number"]] / artefacts["screen"]["/noise_std"][place["/selected/final/number"]]
    np.testing.assert_allclose(place["/influence/signal_to_noise"], ratio)
    assert "/influence/condition" not in place


TWO_LOADS = (
    "loads.side={node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 31.0, amplitude: 200}}",
    *("place.estimate=[E, side]", "validate.initial_std={E: 0.1, side: 0.5}", "place.keep=2"),
    *("screen.by=strength", "screen.minimum_spacing=0"),
)


@pytest.mark.slow
def test_a_pool_of_few_is_extended_by_the_candidates_that_improve_the_layout(config, results, tmp_path):
    """The strongest readings are those of `tip`. From them the search reaches the proven best pair of all candidates."""
    shutil.copytree(results, tmp_path / "results")

    def placed(*changes):
        job = job_of(config, tmp_path / "results", *COARSE, *TWO_LOADS, *changes)
        return finished(job, PLACEMENT[:7])["place"][2].summary

    best = placed("screen.keep=all", "place.prove=60")
    alone, extended = placed("screen.keep=6"), placed("screen.keep=6", "place.search=all")
    assert best["proven"]
    assert best["lower_bound"] * (1 - 1e-9) <= extended["trace_final"] <= best["trace_final"] * (1 + 1e-4)
    assert extended["lower_bound"] <= best["trace_final"]
    assert extended["bounded"] == best["pool"] > extended["pool"] > alone["pool"]
    assert extended["beyond"] == 0
    assert extended["std.side"] < 0.985 * alone["std.side"]


def test_the_list_of_gauges_reports_what_the_artefacts_say(artefacts):
    place, train = artefacts["place"], artefacts["train"]
    lines = list(csv.DictReader((place.path.parent / "gauges.csv").read_text().splitlines()))
    rows = place["/pool/candidate"][place["/selected/final/gauge"]]
    assert [line["gauge"] for line in lines] == ["G1", "G2", "G3", "G4"]
    assert [int(line["element"]) for line in lines] == train["/gauges/element"][rows].tolist()
    for key in ("position", "normal", "direction"):
        written = [[float(line[f"{key}_{axis}"]) for axis in "xyz"] for line in lines]
        np.testing.assert_allclose(written, train[f"/gauges/{key}"][rows], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose([float(line["std_E_without"]) for line in lines], place["/without/E"], rtol=1e-8)
    assert {"workshop.csv", "workshop.unv", "sheet-G1.svg"} <= {path.name for path in artefacts["report"].path.parent.iterdir()}


@pytest.mark.slow
def test_the_order_of_loads_and_unknowns_in_the_file_changes_nothing(tmp_path):
    """Two loads, exchanged, and the unknowns listed the other way round: the same estimate, each trace under its own name."""
    text = (ROOT / "configs" / "cantilever-youngs-modulus.yaml").read_text().replace("../meshes", str(ROOT / "meshes"))
    tip = next(line for line in text.splitlines() if line.startswith("  tip:"))
    side = "  side: {node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 31.0, amplitude: 2.0e+3}}"
    text = text.replace("initial_std: {E: 0.1}", "initial_std: {E: 0.1, side: 0.5}")
    found = []
    for lines, estimate in (((tip, side), "[E, side]"), ((side, tip), "[side, E]")):
        path = tmp_path / f"own{len(found)}.yaml"
        path.write_text(text.replace(tip, "\n".join(lines)).replace("estimate: [E]", f"estimate: {estimate}"))
        done = finished(job_of(path, tmp_path / f"results{len(found)}", *SHORT, *UNSTUDIED, "screen.keep=24"), PLACEMENT[:-1])
        found.append({stage: artefact for stage, (_, _, artefact) in done.items()})
    assert [str(name) for name in found[1]["place"]["/elimination/unknowns"]] == ["side", "E"]
    for name in ("E", "side"):
        one, other = (own["validate"].summary[f"estimate.{name}"] for own in found)
        assert other == pytest.approx(one, rel=1e-6)

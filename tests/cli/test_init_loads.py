"""`init` finds the loads of a deck, takes several of them, and chooses its defaults by their frequencies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.config.template_loads import STATIC
from strainsight.experiment.structure.reduction import INERTIA_NOTED
from strainsight_cli.main import app

from ..init_parts import PARTS


@pytest.fixture
def strainsight(tmp_path, monkeypatch):
    """Run a command in a folder with the decks of the parts."""
    monkeypatch.chdir(tmp_path)
    for name, deck in PARTS.items():
        Path(f"{name}.bdf").write_text(deck(), encoding="ascii")

    def call(*words, code=0, answers=None):
        done = CliRunner().invoke(app, [*words], input=answers)
        assert done.exit_code == code, done.output + done.stderr
        return done.output + done.stderr

    return call


def config(part):
    return load_config(f"{part}.yaml").model


def first_frequency(strainsight, part):
    return float(re.search(r"^1 +([\d.]+)", strainsight("modes", f"{part}.yaml"), re.MULTILINE)[1])


def test_every_load_option_is_a_load(strainsight):
    options = ("--load", "FORCE-1", "--load", "LOAD-2", "--load", "9001", "--direction", "0 1 0")
    strainsight("init", "arm.bdf", "--estimate", "load", *options, "--amplitude", "4e3", "--amplitude", "2", "--amplitude", "50")
    made = config("arm")
    assert list(made.loads) == ["FORCE-1", "LOAD-2", "force"]
    assert [load.signal.amplitude for load in made.loads.values()] == [4000, 2, 50]
    assert [load.direction for load in made.loads.values()] == [None, None, (0, 1, 0)]
    assert (made.loads["LOAD-2"].factor, made.loads["force"].node) == (True, 9001)
    assert made.place.estimate == ("FORCE-1", "LOAD-2", "force")
    assert made.validation.initial_std == {"FORCE-1": 1, "LOAD-2": 1, "force": 1}
    assert made.place.keep == 4


def test_there_is_one_gauge_more_than_unknowns(strainsight):
    names = [word for i in range(5) for word in ("--load", f"node {i + 1}")]
    strainsight("init", "portal.bdf", "--estimate", "load", *names, "--direction", "0 1 0", "--amplitude", "1")
    assert (list(config("portal").loads)[-1], config("portal").place.keep) == ("force-5", 6)


def test_loads_are_listed_with_size_direction_and_place(strainsight):
    """The values are those of the functions in tests/parts.py."""
    said = strainsight("init", "arm.bdf")
    for line in (
        r"FORCE-1 +5000 N along \(0, 0, -1\) at node 9001, \(1620, 60, 80\) mm",
        r"LOAD-2 +400 N m about \(1, 0, 0\) at node 9001, \(1620, 60, 80\) mm",
        r"LOAD-3 +gravity of 9.81 m/s² along \(0, 0, -1\), acts on the whole mass",
        r"size +1620 × 120 × 160 mm",
        r"supports +20 nodes, centre \(0, 60, 80\) mm",
        r"material 1 +E 210 GPa, ν 0.3, ρ 7850 kg/m³: PSOLID 1",
    ):
        assert re.search(line, said), said
    assert "choose those that act with --load" in said
    assert re.search(r"arm.yaml:\d+:\d+  loads.force.set: no value", said)
    assert "set SET1-5, centre (0, 0, 550) mm" in strainsight("init", "portal.bdf")
    assert list(config("portal").loads) == ["FORCE-3"]


@pytest.mark.parametrize(
    ("options", "remedy"),
    [
        (("--load", "FORCE-21"), r"did you mean FORCE-\d+\? Known names: FORCE-11 \(2000 N along \(1, 0, 0\) at node 9001"),
        (("--load", "deck_load FORCE-111"), r"did you mean FORCE-11\? Known names"),
        (("--load", "FORCE-11", "--direction", "1 0 0"), "remove --direction"),
        (("--load", "FORCE-11", "--load", "FORCE-12", "--load", "node 9001", "--frequency", "1", "--frequency", "2"), "once for"),
    ],
)
def test_unknown_names_and_superfluous_values_are_refused(strainsight, options, remedy):
    said = strainsight("init", "bore.bdf", *options, code=2)
    assert re.search(remedy, said), said
    assert not Path("bore.yaml").exists()


@pytest.mark.parametrize(("share", "model"), [(0.099, "static"), (0.101, "dynamic")])
def test_loads_below_a_tenth_of_the_first_frequency_are_static(strainsight, share, model):
    strainsight("init", "arm.bdf", "--load", "FORCE-1")
    first = first_frequency(strainsight, "arm")
    strainsight("init", "arm.bdf", "--force", "--load", "FORCE-1", "--frequency", f"0.5, {share * first:.4f}")
    train, signal = config("arm").train, config("arm").loads["FORCE-1"].signal
    assert (train.model, signal.type, signal.lowest) == (model, "multisine", 0.5)
    assert pytest.approx(INERTIA_NOTED) == STATIC**2  # the share of inertia (f/f1)² from which `train` warns
    reason = f"{share:.2g} of the first natural frequency, {first:.4g} Hz (limit: 0.1)"
    assert f"  model: {model} " in (text := Path("arm.yaml").read_text(encoding="utf-8"))
    assert reason in text


@pytest.mark.parametrize("frequency", ["0.013", "1", "3", "20", "37.3", "450", "0.5 20", "2, 2000"])
def test_duration_and_step_resolve_the_frequencies(strainsight, frequency):
    strainsight("init", "bore.bdf", "--load", "FORCE-11", "--frequency", frequency)
    low, high = (float(x) for x in (re.split(r"[ ,]+", frequency) * 2)[:2])
    made = config("bore")
    for section in (made.train, made.validation):
        assert 40 <= 1 / (high * section.time_step) <= 250
        assert 5 <= low * section.duration <= 22
        steps = section.duration / section.time_step
        assert steps == pytest.approx(round(steps), abs=1e-6)


def test_load_without_frequency_is_slow_and_reported(strainsight):
    strainsight("init", "portal.bdf")
    first = first_frequency(strainsight, "portal")
    assert config("portal").loads["FORCE-3"].signal.frequency <= first / 20
    assert config("portal").train.model == "static"
    assert "# ← assumed: a slow load; [Hz], [N]" in Path("portal.yaml").read_text(encoding="utf-8")


def test_unknown_load_has_the_bandwidth_of_its_signal_and_gauges_have_half_a_microstrain(strainsight):
    strainsight("init", "arm.bdf", "--estimate", "load", "--load", "FORCE-1", "--frequency", "0.5 3")
    noise = config("arm").loads["FORCE-1"].process_noise
    assert (noise.model, noise.frequency) == ("matern", 3.0)
    assert config("arm").gauges.noise_std.value == 0.5e-6
    strainsight("init", "arm.bdf", "--force", "--load", "FORCE-1", "--frequency", "0.5 3")
    assert config("arm").loads["FORCE-1"].process_noise.frequency is None


def test_interactive_asks_for_loads_until_a_blank_line(strainsight):
    """Load 2 in the list with its size of the deck at 3 Hz, then a node; no third load."""
    answers = "2\n\n3\nnode 9001\n0 1 0\n250\n\n\ny\n"
    said = strainsight("init", "bore.bdf", "-i", answers=answers)
    assert "load 3 (number" in said
    assert re.search(r"2 +deck_load FORCE-12 +3000 N along \(0, -1, 0\) at node 9001, \(0, 0, 10\) mm", said)
    assert re.search(r"FORCE-11 +2000 N.*natural frequencies: [\d.]+, [\d.]+, [\d.]+ Hz.*load 1 \(number", said, re.DOTALL)
    loads = config("bore").loads
    assert list(loads) == ["FORCE-12", "force"]
    assert (loads["FORCE-12"].signal.frequency, loads["FORCE-12"].signal.amplitude) == (3, 3000)
    assert (loads["force"].direction, loads["force"].signal.frequency, loads["force"].known) == ((0, 1, 0), 1, False)


def test_natural_frequencies_are_those_of_modes(strainsight):
    said = strainsight("init", "bore.bdf", "--load", "FORCE-11")
    printed = [float(x) for x in re.search(r"natural frequencies: ([\d., ]+) Hz", said)[1].split(",")]
    assert printed[0] == pytest.approx(first_frequency(strainsight, "bore"), rel=1e-3)
    lines = Path("portal.bdf").read_text(encoding="ascii").splitlines()
    Path("loose.bdf").write_text("\n".join(line for line in lines if not line.startswith("SPC")), encoding="ascii")
    said = strainsight("init", "loose.bdf")
    assert "natural frequencies: not computed, the section `mesh` has blank lines" in said


def sigma(strainsight, name, *overrides):
    words = [word for override in overrides for word in ("--set", override)]
    said = strainsight("place", "arm.yaml", "--set", f"name={name}", "--set", "screen.keep=20", *words)
    return float(re.search(r"FORCE-1 ± ([\d.]+) %", said)[1])


def test_sigma_of_a_slow_load_is_that_of_a_static_model_by_hand(strainsight):
    """By hand: quasi-static, ten periods, 50 steps in each, a load of limited bandwidth. The dynamic model of 1 s with 0.5 ms,
    whatever the load, has several times its σ."""
    strainsight("init", "arm.bdf", "--estimate", "load", "--load", "FORCE-1")
    hand = ("train={model: static, duration: 10.0, time_step: 0.02}",)
    old = ("train={duration: 1.0, time_step: 5.0e-4}", "loads.FORCE-1.process_noise={}")
    written = sigma(strainsight, "written")
    assert written == pytest.approx(sigma(strainsight, "hand", *hand), rel=0.1)
    assert sigma(strainsight, "old", *old) > 3 * written


RUNS = {
    "bore": ("--estimate", "load", "--load", "FORCE-11", "--load", "FORCE-12"),
    "portal": ("--estimate", "load"),
    "arm": ("--load", "FORCE-1"),
}


@pytest.mark.slow
@pytest.mark.parametrize("part", RUNS)
def test_written_config_runs_without_an_edit_and_its_channels_fit_the_simulated_test(strainsight, part):
    """After the run, the section `estimate` needs its comment signs removed only."""
    strainsight("init", f"{part}.bdf", *RUNS[part])
    assert "report    done" in strainsight("run", f"{part}.yaml")
    path = Path(f"{part}.yaml")
    path.write_text(re.sub(r"^#(estimate:|  )", r"\1", path.read_text(encoding="utf-8"), flags=re.MULTILINE), encoding="utf-8")
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["estimate"]["as_placed"] is True
    strainsight("estimate", f"{part}.yaml", "--measurements", f"results/{part}/measured.csv", "--accept")


def test_sigma_of_slow_loads_on_a_stiff_part_does_not_depend_on_their_frequency(strainsight):
    """The samples per period and their noise are the same at 0.1 Hz and 50 Hz; the part vibrates at 2 kHz."""
    placed = []
    for frequency in ("0.1", "50"):
        load = ("--estimate", "load", "--load", "FORCE-12", "--frequency", frequency)
        strainsight("init", "bore.bdf", "--force", *load)
        said = strainsight("place", "bore.yaml", "--set", f"name=bore{frequency[0]}", "--set", "screen.keep=15")
        placed.append(float(re.search(r"FORCE-12 ± ([\d.]+) %", said)[1]))
    assert placed[0] == pytest.approx(placed[1], rel=0.02)


def test_large_model_gets_a_dynamic_model_with_the_limit_for_static(strainsight, monkeypatch):
    monkeypatch.setattr("strainsight_cli.init.FEW_NODES", 500)
    said = strainsight("init", "arm.bdf", "--load", "FORCE-1", "--frequency", "2")
    assert "natural frequencies: not computed, the model has more than 500 nodes" in said
    assert config("arm").train.model == "dynamic"
    assert "use static if the first natural frequency is above 20 Hz" in Path("arm.yaml").read_text(encoding="utf-8")


def test_loads_on_two_faces_have_two_names(strainsight):
    faces = ("--load", "0.75, 0.06, 0.16", "--load", "1.62, 0.06, 0.06")
    strainsight("init", "arm.bdf", *faces, "--direction", "0 0 -1", "--direction", "1 0 0", "--amplitude", "100")
    made = config("arm")
    assert {name: face.near for name, face in made.mesh.faces.items()} == {
        "loaded": (0.75, 0.06, 0.16),
        "loaded-2": (1.62, 0.06, 0.06),
    }
    assert [(name, load.set, load.direction[2]) for name, load in made.loads.items()] == [
        ("force", "loaded", -1),
        ("force-2", "loaded-2", 0),
    ]


@pytest.mark.parametrize(("find", "pool"), [("modulus", 100), ("load", "all")])
def test_all_candidates_of_a_small_surface_are_kept(strainsight, find, pool):
    """The arm has 394 facets, between twice the pools of 100 and 300 candidates."""
    strainsight("init", "arm.bdf", "--estimate", find, "--load", "FORCE-1")
    assert config("arm").screen.keep == pool

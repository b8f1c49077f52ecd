"""Unknowns of a bench that no sensor separates, and loads that its step does not follow: refused by name, unless allowed."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import BENCH, write_project

GAUGES = (
    "[{position: [0.1, 0.0, 0.01], direction: [1, 0, 0]}, {position: [0.1, 0.01, 0.0], direction: [1, 0, 0]}, "
    "{position: [0.6, 0.0, 0.01], direction: [1, 0, 0]}]"
)
AGAIN = "{type: force, frame: tip, direction: [0, 2, 0], signal: {type: sine, frequency: 1.0, amplitude: 10.0}}"
RIG = (
    BENCH[: BENCH.index("place:\n")]
    .replace("{type: strain, body: beam, layout: place}", f"{{type: strain, body: beam, gauges: {GAUGES}}}")
    .replace("sensors:", f"  again: {AGAIN}\nsensors:", 1)
)
BOTH = "--set=estimate.inputs={side: {std: 100.0, increment: 20.0}, again: {std: 100.0, increment: 20.0}}"


def run(folder, *words):
    done = CliRunner().invoke(app, ["estimate", str(folder / "bench.yaml"), "--results", str(folder / "results"), *words])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("indistinct")
    write_project(folder)
    (folder / "bench.yaml").write_text(RIG)
    return folder


def test_two_loads_on_one_line_of_action_are_refused_by_name_and_may_be_allowed(rig):
    code, said = run(rig, BOTH)
    assert code == 2
    assert "the sensors cannot tell side and again together: fix one of them, or make one known" in said
    assert "estimate.allow_unobservable: true" in said
    code, said = run(rig, BOTH, "--set=estimate.allow_unobservable=true")
    assert code == 0
    assert "what is given of each rests on its first σ alone" in said


@pytest.mark.parametrize("model", ["matern", "oscillator", "integrated_random_walk"])
def test_a_model_of_one_of_them_does_not_separate_them(rig, model):
    inputs = f"{{side: {{std: 100.0, model: {model}}}, again: {{std: 100.0, increment: 20.0}}}}"
    code, said = run(rig, f"--set=estimate.inputs={inputs}")
    assert code == 2
    assert "side and again together" in said


def test_a_step_of_implicit_euler_that_its_loads_outrun_is_refused_unless_allowed_or_made_up_for(rig):
    thesis = ["--set=simulate.method=thesis", "--set=forces.side.signal.frequency=20.0"]
    code, said = run(rig, *thesis)
    assert code == 2
    assert "follows loads up to" in said
    assert "estimate.allow_unfollowed: true" in said
    code, said = run(rig, *thesis, "--set=estimate.allow_unfollowed=true")
    assert code == 0
    assert "σ does not allow for that" in said
    assert run(rig, *thesis, "--set=estimate.method.step_error=estimated")[0] == 0
    assert run(rig, *thesis, "--set=estimate.truth.model=own")[0] == 0


def test_input_models_of_a_structure_serve_a_bench(rig):
    """Sines, from their own frequency and amplitude: smooth models follow them better than the walk that has none of that."""
    walk = "{side: {std: 100.0, increment: 60.0}, down: {std: 100.0, increment: 40.0}}"
    smooth = "{side: {std: 100.0, model: MODEL}, down: {std: 100.0, model: MODEL}}"
    errors = {}
    for model in ("random_walk", "integrated_random_walk", "matern", "oscillator"):
        code, said = run(rig, f"--set=estimate.inputs={walk if model == 'random_walk' else smooth.replace('MODEL', model)}",
                         "--set=estimate.sensors.gauges.noise=1.0e-6")  # fmt: skip
        assert code == 0, said
        found = Artefact(rig / "results" / "bench" / "estimate.h5").summary
        errors[model] = found["std.side"]
    assert max(errors["integrated_random_walk"], errors["matern"], errors["oscillator"]) < errors["random_walk"]


@pytest.mark.parametrize(
    ("inputs", "says"),
    [
        ("{side: {std: 100.0, model: matern, increment: 1.0}}", "increment is of a random walk, and the model is matern"),
        ("{side: {std: 100.0, model: walk}}", "random_walk"),
    ],
)
def test_contradictory_models_are_refused(rig, inputs, says):
    code, said = run(rig, f"--set=estimate.inputs={inputs}")
    assert code == 2
    assert says in said

"""Readings of a bench from a file: of another run, or by another integrator, with noise and offsets."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.experiment.bench.bench import bench_of, start_of
from strainsight.experiment.bench.sensors import sensors_of
from strainsight.multibody.accelerations import balance
from strainsight.records.bench import ReducedBodies
from strainsight.records.mesh import Meshes
from strainsight.records.record import read
from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..models import ended
from ..robustness.small import BENCH, write_project

GAUGES = "[{position: [0.1, 0.0, 0.01], direction: [1, 0, 0]}, {position: [0.1, 0.01, 0.0], direction: [1, 0, 0]}]"
RIG = (
    BENCH[: BENCH.index("place:\n")]
    .replace("{type: strain, body: beam, layout: place}", f"{{type: strain, body: beam, gauges: {GAUGES}}}")
    .replace("simulate:", "  tip: {type: motion, frame: tip}\nsimulate:")
)
BESIDE = "bench-records"
CHANNELS = {
    "gauges": [{"channel": "upper", "unit": "um/m"}, {"channel": "side", "unit": "m/m"}],
    "tip": [None, {"channel": "y", "unit": "mm"}, {"channel": "z", "unit": "mm"}],
}


def measured(sensors=("gauges",), **changes):
    """The setting that takes the file."""
    stated = {"file": "test.csv", "time": {"channel": "t", "unit": "ms"}, "channels": {n: CHANNELS[n] for n in sensors}}
    return f"estimate.measured={json.dumps({**stated, **changes})}"


@pytest.fixture(scope="module")
def simulated():
    return ended("simulate", RIG, beside=BESIDE).artefact("simulate")


@pytest.fixture(scope="module")
def table(simulated):
    """What its sensors read, in the units of a data logger: time, two strains, two displacements."""
    strain, tip = simulated["/sensors/gauges"], simulated["/sensors/tip"]
    return np.column_stack([1e3 * simulated["/time"], 1e6 * strain[:, 0], strain[:, 1], 1e3 * tip[:, 1:]])


@pytest.fixture(scope="module")
def run(table):
    def of(*changes):
        lines = ["t,upper [um/m],side,y,z", *(",".join(f"{x:.15g}" for x in row) for row in table)]
        return ended("estimate", RIG, *changes, files={"test.csv": "\n".join(lines) + "\n"}, beside=BESIDE)

    return of


def histories(end):
    assert end.code == 0, end.text
    estimate = end.artefact("estimate")
    return {name: estimate[f"/inputs/{name}/estimate"] for name in ("side", "down")}, estimate


def test_a_file_gives_the_loads_that_the_run_gives_it_was_written_from(run, simulated):
    other = json.dumps({"from": str(simulated.path)})
    by_run, _ = histories(run(f"estimate.measured={other}", "estimate.truth.noise=false"))
    end = run(measured())
    by_file, found = histories(end)
    for name in by_run:
        np.testing.assert_allclose(by_file[name], by_run[name], rtol=1e-6, atol=1e-6)
    assert "measurements of the file test.csv" in end.text
    assert "side RMS" in end.text
    assert found.summary["rms.down"] == pytest.approx(np.sqrt(np.mean(by_file["down"][3:] ** 2)), rel=1e-6)


def test_samples_are_taken_as_they_are(run, simulated):
    _, found = histories(run(measured(("gauges", "tip")), "estimate.sensors.tip={noise: 1.0e-6}"))
    np.testing.assert_allclose(found["/sensors/gauges/measured"], simulated["/sensors/gauges"][1:], rtol=1e-12, atol=1e-18)
    tip = found["/sensors/tip/measured"]
    assert np.isnan(tip[:, 0]).all()
    np.testing.assert_allclose(tip[:, 1:], simulated["/sensors/tip"][1:, 1:], rtol=1e-12, atol=1e-15)
    assert found.summary["mismatch.tip"] < 0.01


ALONG = [CHANNELS["tip"][1] | {"channel": "y"}, None, CHANNELS["tip"][2]]
"""The side load moves the component that nobody measured."""


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ([measured(channels={"gauges": CHANNELS["gauges"][:1]})], "length is 1, but the number of sensor components is 2"),
        ([measured(channels={"gauges": [CHANNELS["gauges"][0], None]})],
         "the number of sensor components, 1, is smaller than the number of unknown loads, 2"),
        ([measured(channels={"gauges": [CHANNELS["tip"][1], CHANNELS["gauges"][1]]})], "of the sensor gauges measures strain"),
        ([measured(), "estimate.duration=0.3", "simulate.duration=0.3"], "the measurement file ends after 0.2 s"),
        ([measured(), "estimate.runs=3"], "with the measurements of a test, only one run is possible"),
        ([measured(), "estimate.time_step=0.004"], "estimate.measured"),
        ([measured(channels={"tip": ALONG}), "estimate.sensors={tip: {noise: 1.0e-6}}"], "side: no sensor measures this unknown"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(run, settings, says):
    end = run(*settings)
    assert end.code == 2, end.text
    assert says in end.text
    assert "estimate." in end.text


ARM_BENCH = """
kind: bench
name: bench
bodies:
  beam: {type: flexible, mesh: {file: beam.bdf}, modes: 4, damping: {type: modal, ratio: 0.01}}
  arm: {type: rigid, mass: 20.0, centre: [0.4, 0, 0], inertia: {xx: 0.5, yy: 5.0, zz: 5.0}, pose: {origin: [1.0, 0.05, 0.04]}}
frames:
  tip: {body: beam, node: 1000}
  root: {body: arm}
  end: {body: arm, pose: {origin: [0.8, 0, 0]}}
joints:
  hinge: {type: revolute, frames: [tip, root], axis: y}
forces:
  weight: {type: gravity}
  spring: {type: torsion, frames: [tip, root], stiffness: 8.0e+3, damping: 20.0, axis: y}
  side: {type: force, frame: end, direction: [0, 1, 0], signal: {type: constant, value: 0.0}}
  down: {type: force, frame: end, direction: [0, 0, 1], signal: {type: constant, value: 0.0}}
sensors:
  gauges:
    type: strain
    body: beam
    gauges:
      - {position: [0.1, 0.05, 0.08], direction: [1, 0, 0]}
      - {position: [0.1, 0.1, 0.04], direction: [1, 0, 0]}
      - {position: [0.6, 0.05, 0.08], direction: [1, 0, 0]}
    zeroed: true
  end: {type: motion, frame: end}
simulate: {duration: 0.8, time_step: 0.01}
estimate:
  sensors: {gauges: {noise: 1.0e-7}, end: {noise: 2.0e-5}}
  inputs:
    side: {guess: 0.0, std: 1.0, model: matern, amplitude: 300.0, frequency: 1.0}
    down: {guess: 0.0, std: 1.0, model: matern, amplitude: 200.0, frequency: 1.0}
"""
REST, FINE, DURATION = 0.2, 1e-3, 0.8
"""[s] at rest, over which the logger is zeroed; of the loads' steps."""


def parts(folder):
    """The config, the bench and its sensors."""
    found = Artefact(folder / "results" / "bench" / "reduce.h5"), Artefact(folder / "results" / "bench" / "import.h5")
    reduced, meshes = read(ReducedBodies, found[0]).bodies, read(Meshes, found[1]).bodies
    config = load_config(folder / "bench.yaml").model
    own = bench_of(config, reduced, meshes)
    return config, own, sensors_of(own)


def by_radau(folder, loads, time):
    """Readings (k, m) at time (k,) of M v̇ + c + f = Bᵀλ, B v̇ + Ḃv = 0 by the implicit method of fifth order, from rest."""
    _, own, sensors = parts(folder)
    system = own.system
    n, m = system.size, system.constrained

    def rate(t, x):
        at = balance(system, x[:n], x[n:], loads(t), own.theta)
        KKT = np.block([[at.mass, -at.B.T], [at.B, np.zeros((m, m))]])
        return np.concatenate([x[n:], np.linalg.solve(KKT, np.concatenate([-at.load, -at.B_rate @ x[n:]]))[:n]])

    start = np.concatenate(start_of(own, loads(0.0)))
    x = solve_ivp(rate, (0, time[-1]), start, "Radau", rtol=1e-6, atol=1e-9, t_eval=time, max_step=5e-3).y.T
    return np.array([sensors.readings.read(own[:n], own[n:])[0] for own in x])


def drawn(seed):
    """Both loads [N], none while the logger is zeroed, then Matérn processes of ν = 3/2 and 1 Hz that begin at zero."""
    rng, quiet = np.random.default_rng(seed), round(REST / FINE)
    turning = 2 * np.pi / np.sqrt(2**0.5 - 1)
    A = turning * np.array([[0.0, 1.0], [-1.0, -2.0]])
    state, found = np.vstack([np.zeros(2), rng.normal(size=2)]), [np.zeros(2)] * quiet
    for _ in range(round(DURATION / FINE) + 1 - quiet):
        found.append(state[0])
        state = state + FINE * A @ state + np.vstack([np.zeros(2), np.sqrt(4 * turning * FINE) * rng.normal(size=2)])
    values = np.array(found) * np.array([300.0, 200.0])
    return lambda t: np.array([np.interp(t, FINE * np.arange(len(values)), own) for own in values.T])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("outside")
    write_project(folder)
    (folder / "bench.yaml").write_text(ARM_BENCH)
    return folder


def command(folder, *words):
    done = CliRunner().invoke(app, [words[0], str(folder / "bench.yaml"), "--results", str(folder / "results"), *words[1:]])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


def logged(zero):
    channels = {
        "gauges": [{"channel": f"SG{i}", "unit": "um/m", "zero": zero} for i in range(3)],
        "end": [{"channel": axis, "unit": "mm"} for axis in "xyz"],
    }
    return f"--set=estimate.measured={json.dumps({'file': 'test.csv', 'time': {'channel': 't'}, 'channels': channels})}"


@pytest.mark.slow
def test_error_of_loads_is_what_sigma_reports_of_a_record_from_elsewhere(folder):
    """Loads that move within the filter's step of 10 ms; gauges off by 40, −25 and 60 µm/m, zeroed over 0.2 s at rest."""
    code, said = command(folder, "reduce")
    assert code == 0, said
    rng, time = np.random.default_rng(5), 0.01 * np.arange(round(DURATION / 0.01) + 1)
    loads = drawn(0)
    y = by_radau(folder, loads, time) * np.array([1e6] * 3 + [1e3] * 3)
    y += rng.normal(size=y.shape) * np.array([0.1] * 3 + [0.02] * 3) + np.array([40.0, -25.0, 60.0, 0, 0, 0])
    rows = [",".join(f"{value:.9g}" for value in (t, *row)) for t, row in zip(time, y, strict=True)]
    (folder / "test.csv").write_text("\n".join(["t,SG0,SG1,SG2,x,y,z", *rows]) + "\n")
    code, said = command(folder, "estimate", logged([0.0, REST]))
    assert code == 0, said
    found = Artefact(folder / "results" / "bench" / "estimate.h5")
    true = np.array([loads(t) for t in time]).T
    scores = [
        (found[f"/inputs/{name}/estimate"] - history) / found[f"/inputs/{name}/std"]
        for name, history in zip(("side", "down"), true, strict=True)
    ]
    late = round(REST / 0.01) + 10
    ratio = np.sqrt(np.mean(np.square(scores)[:, late:]))
    assert 0.7 < ratio < 1.3, np.sqrt(np.mean(np.square(scores)[:, late:], axis=1))

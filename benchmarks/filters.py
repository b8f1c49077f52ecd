"""Grid, sigma-point and extended filter where a parameter is hardly seen.

`python -m benchmarks.filters [draws [draws of the grid filter]]`

The coarse hub under 10 kN along x, 20 Hz, ramped up in 0.2 s; four placed gauges, 1 % noise, 0.5 s. Every draw has E and ρ of its
own from a prior of 10 %, and its motion and samples from the filter's own model, so that nothing but the filter can be wrong. A
table says, for every filter and unknown, RMS error, RMS σ, RMS of error over σ, the share within 2σ, and the time of a
draw. Numbers but the times do not depend on the machine.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.estimation.truth import draw_truth

from strainsight import api
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord
from strainsight.experiment.structure.problem import filter_model, initial_covariance, problem_of
from strainsight.experiment.structure.structure import Structure

ROOT = Path(__file__).resolve().parent.parent
DURATION, RAMP, HERTZ, AMPLITUDE = 0.5, 0.2, 20.0, 1e4

Setting = tuple[FilterModel, np.ndarray, np.ndarray]
Found = tuple[np.ndarray, np.ndarray]


def setting(folder: Path) -> Setting:
    """The filter's model with constant parameters, P₀ and the known load (T, HOLD, 1) [N]."""
    t = np.linspace(0.0, DURATION, round(DURATION / 2.5e-4) + 1)
    load = AMPLITUDE * np.minimum(t / RAMP, 1.0) * np.sin(2 * np.pi * HERTZ * t)
    file = folder / "ramp.csv"
    np.savetxt(file, np.column_stack([t, load]), delimiter=",", header="time,x", comments="")
    signal = f"loads.x.signal={{type: csv, file: {file}, time_column: time, value_column: x}}"
    case = api.load(ROOT / "configs/hub/hub-youngs-modulus-density.yaml", [signal, "train.settle=none"])
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    gauges = api.place(case, mesh, reduced, training, screened).gauges
    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    channels = problem.channels.of(gauges)
    model = filter_model(problem, channels[channels >= 0], problem.h)
    P = initial_covariance(problem, dict.fromkeys(problem.unknowns.names, 0.1), moving=False)
    return model, P, problem.u[:, :, problem.columns(problem.known)]


def drifting(model: FilterModel) -> FilterModel:
    """With parameters that drift by 5 % in a second."""
    Q = model.Q.copy()
    at = range(model.parameter_states.start, model.size)
    Q[at, at] = 0.05**2
    return replace(model, Q=Q)


def run_grid_filter(model: FilterModel, P: np.ndarray, known: np.ndarray, y: np.ndarray) -> Found:
    runs = [
        filter_on_grid(GridRecord(model, np.zeros(model.size), P, known, y[:, b], none_considered(model))).run
        for b in range(y.shape[1])
    ]
    mean, std = (np.stack([getattr(run, key)[-1, 0] for run in runs]) for key in ("mean", "std"))
    return mean[:, model.parameter_states], std[:, model.parameter_states]


def by(model: FilterModel, P: np.ndarray, known: np.ndarray, y: np.ndarray, *, points: bool = False) -> Found:
    run = run_filter(model, np.zeros(model.size), P, known, y, by_points=points)
    states = model.parameter_states
    return run.mean[-1][:, states], run.std[-1][:, states]


def main(words: list[str]) -> None:
    draws = int(words[0]) if words else 200
    fewer = int(words[1]) if words[1:] else draws
    with tempfile.TemporaryDirectory() as folder:
        model, P, known = setting(Path(folder))
    truth, y = draw_truth(model, np.zeros(model.size), P, known, range(draws))
    true = truth[-1][:, model.parameter_states]
    filters = {
        "sigma-point, constant": lambda: by(model, P, known, y, points=True),
        "extended, constant": lambda: by(model, P, known, y),
        "extended, δ = 0.05/√s": lambda: by(drifting(model), P, known, y),
        "grid": lambda: run_grid_filter(model, P, known, y[:, :fewer]),
    }
    print("| filter | unknown | RMS error | RMS σ | ratio | within 2σ | ms a draw |\n|---|---|---|---|---|---|---|")
    for name, run in filters.items():
        start = time.perf_counter()
        mean, std = run()
        took = 1e3 * (time.perf_counter() - start) / len(mean)
        for i, unknown in enumerate(model.unknowns.parameters):
            error, claim = mean[:, i] - true[: len(mean), i], std[:, i]
            rms, sigma = (100 * np.sqrt(np.mean(own**2)) for own in (error, claim))
            within = 100 * np.mean(np.abs(error) < 2 * claim)
            ratio = np.sqrt(np.mean((error / claim) ** 2))
            print(
                f"| {name} | {unknown} | {rms:.3g} % | {sigma:.3g} % | {ratio:.2f} | {within:.1f} % | {took:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])

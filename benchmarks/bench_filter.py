"""Cost of a filter step on a bench beside that of its simulation: `python -m benchmarks.bench_filter [--quick]`.

The bench of configs/bench-full.yaml through the stages `import` and `reduce` (a bearing of 112 balls), from its equilibrium
under the loads of its file: once simulated, then filtered from readings of its four gauges and of the five displacements of its
bearing, three loads unknown. One-shot is the extended Kalman filter whose state is put back on the constraints; iterated has
the step inside the update; both carry a factor of the covariance. The same with the ball diameter unknown under known loads,
from a guess 1 % too large. All in one process, one BLAS thread, in turns; shortest of some runs each. Errors are those of the
loads, over their largest value, on the filter's own step without noise ("all": the filter makes up for what the step leaves out,
of which such a truth has nothing, so that this is its error);
noise that the filter is told: 1e-11 of strain, m, rad. Times are those of the processor.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import cProfile
import pstats
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from benchmarks.full_bench import full_bench, loads_of_file

from strainsight.estimation.filter import filter_runs
from strainsight.multibody.initial import static_equilibrium
from strainsight.multibody.inverse.loads import walks
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import parameter_coordinates, start_covariance, white_force
from strainsight.multibody.simulate import simulate

NOISE = 1e-11


def in_turns(work: dict[str, Callable[[], Any]], repeat: int) -> tuple[dict[str, float], dict[str, Any]]:
    """Shortest of some times [s] of each, taken in turns so that a busy spell of the machine meets all, and what came of it."""
    times: dict[str, float] = dict.fromkeys(work, np.inf)
    found = {}
    for _ in range(repeat):
        for name, one in work.items():
            begin = time.process_time()
            found[name] = one()
            times[name] = min(times[name], time.process_time() - begin)
    return times, found


def measure(h: float, steps: int, free: tuple[str, ...], profile: bool) -> None:
    full = full_bench(free={"pitch-bearing": free} if free else None)
    bench, sensors = full.bench, full.sensors
    system, theta, n = bench.system, bench.theta, bench.system.size
    time, stated = loads_of_file(system.inputs)
    instants = np.minimum(h * np.arange(steps + 1), time[-1])
    u = np.column_stack([np.interp(instants, time, own) for own in stated.T])
    q = full.at_rest(u[0])
    v = np.zeros(n)
    truth = simulate(system, q, v, u, h, theta)
    y = np.array([sensors.read(*now)[0] for now in zip(truth.q[1:], truth.v[1:], strict=True)])

    inputs = np.arange(0 if free else len(system.inputs))
    values = {"pitch-bearing": bench.bearings["pitch-bearing"].parameters}
    coordinates = parameter_coordinates(system.parameters, [f"pitch-bearing.{name}" for name in free], theta, values)
    guess = theta * (1.01 if free else 1.0)
    start, _ = static_equilibrium(system, q, u[0], guess)
    increment = np.abs(np.diff(u, axis=0)).max(axis=0)[inputs]
    channels = len(sensors.channels)
    model = AugmentedStep(
        system, sensors, np.zeros(channels), "second_order", u, inputs, walks(increment, h), coordinates,
        white_force(system, 0.0), np.zeros(len(free)), np.full(channels, NOISE**2), rest=True,
    )  # fmt: skip
    std_xi = np.sqrt(np.diag(coordinates.covariance(guess, 0.01 * guess[coordinates.free])))
    P = model.spread(start_covariance(system, start, u[0], guess, coordinates, inputs, increment, std_xi))
    x = model.pack(start, v, u[0, inputs], guess)
    exact = replace(model, corrected=True)
    ways: dict[str, dict[str, Any]] = {
        "one-shot": {"form": "square_root", "project": model.projected},
        "iterated": {"form": "square_root", "iterations": 8, "through_step": True, "project": model.projected},
    }
    work: dict[str, Callable[[], Any]] = {"simulation": lambda: simulate(system, q, v, u, h, theta)}
    for way, how in ways.items():
        for own, name in ((model, way), (exact, f"{way}, all")):
            filter_runs(own, x, P, y[:3], **how)
            work[name] = partial(filter_runs, own, x, P, y, **how)
    times, found = in_turns(work, 5)
    name = "ball diameter" if free else "three loads"
    print(
        f"\n{name}, {steps} steps of {1e3 * h:g} ms: {n} coordinates, {system.constrained} constraints, {model.size} states"
    )
    print(f"  {'simulation':15s} {1e6 * times['simulation'] / steps:6.0f} µs a step")
    for way in [name for name in work if name != "simulation"]:
        mean = found[way].mean[:, 0]
        worst = max(model.violation(own[None], k)[0] for k, own in enumerate(mean))
        if free:
            last = coordinates.theta(mean[-1, model.xi])[0]
            told = f"error {abs(last[0] / theta[0] - 1):.1e} after {steps} steps"
        else:
            off = np.abs(mean[1:, model.u] - u[1:]) / np.abs(u).max(axis=0)
            told = "errors " + ", ".join(f"{worst:.1e}" for worst in off.max(axis=0))
        print(
            f"  {way:15s} {1e6 * times[way] / steps:6.0f} µs a step, {times[way] / times['simulation']:5.1f} times the"
            f" simulation; {told}; off the constraints by {worst:.0e}",
            flush=True,
        )
        if profile:
            watch = cProfile.Profile()
            watch.runcall(work[way])
            pstats.Stats(watch).sort_stats("tottime").print_stats(22)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a quarter of the steps")
    parser.add_argument("--profile", action="store_true", help="where the time goes")
    given = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    for free in ((), ("ball_diameter",)):
        for h in (0.02, 0.1):
            measure(h, 50 if given.quick else 200, free, given.profile)


if __name__ == "__main__":
    main()

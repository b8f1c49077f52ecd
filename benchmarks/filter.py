"""Cost of the filter: `python -m benchmarks.filter [--quick]`.

A steel cantilever of 11 modes with four strain gauges and an unknown tip load, 23 states. 100 runs of 10 000 steps in one
batch, beside the loop that a user of filterpy writes (predict and update run by run, step by step) in the same process, on
the same numbers; filterpy's loop is timed on a tenth of the runs and multiplied, which is said. Then the share of a 1 kHz
stream that one sample costs, one run at a time: with the covariance at rest, with one sample in a hundred missing, in
square-root form, through blocks of 100 ms that go on from one another, and with Young's modulus as a further unknown. Then
10⁶ steps in which the covariance never comes to rest. One BLAS thread: the matrices are small. Machines differ and are
shared: read the load beside the times.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import resource
import time
from collections.abc import Callable

import numpy as np

from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import DrivenModel
from strainsight.estimation.smoother import smooth
from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import process_intensity
from strainsight.rom.model import Damping, ReducedModel

E0, RHO, LENGTH, WIDTH, HEIGHT, MODES = 2.1e11, 7850.0, 2.0, 0.2, 0.195, 11
NOISE, STEP = 1e-6, 1e-3


def cantilever(*parameters: str, step: float = STEP) -> FilterModel:
    """Bending modes of a clamped-free beam, by their closed form; gauges on the upper face."""
    root = (np.arange(1, MODES + 1) - 0.5) * np.pi
    for _ in range(20):
        root -= (np.cos(root) + 1 / np.cosh(root)) / (-np.sin(root) - np.tanh(root) / np.cosh(root))
    beta, mass = root / LENGTH, RHO * WIDTH * HEIGHT * LENGTH
    rest = (np.sin(root) - np.cos(root) - np.exp(-root)) / (np.sinh(root) + np.sin(root))
    s = np.outer((0.05, 0.3, 0.9, 1.5), beta)
    curvature = beta**2 * (np.exp(-s) + np.cos(s) - (1 - rest) * np.sin(s) + rest * np.sinh(s))
    lam = E0 * WIDTH * HEIGHT**3 / 12 * beta**4 / (mass / LENGTH)
    zero = np.zeros((MODES, MODES))
    model = ReducedModel(
        mass=AffineOperator(zero, {"rho": np.eye(MODES) / RHO}),
        stiffness=AffineOperator(zero, {"E": np.diag(lam) / E0}),
        input_shape=(2.0 * (-1.0) ** np.arange(MODES) / np.sqrt(mass))[:, None],
        inputs=("tip",),
        reference={"E": E0, "rho": RHO},
        damping=Damping(ratio=0.01),
    )
    unknowns = Unknowns(("tip",), parameters, {"tip": 1e4}, {"E": E0, "rho": RHO})
    Q = process_intensity(MODES, unknowns, {"tip": 20.0}, {"E": 0.05}, velocity=0.1)
    rows = -0.5 * HEIGHT * curvature / np.sqrt(mass)
    H = np.hstack([rows, np.zeros((4, len(Q) - MODES))])
    return FilterModel(model, unknowns, (), dict(model.reference), H, Q, np.full(4, NOISE**2 * step), step)


def prior(model: FilterModel) -> np.ndarray:
    """At rest, the load known to 1e4 N and a modulus to 1 %."""
    return np.diag([0.0] * (2 * MODES) + [1.0] + [1e-4] * (model.size - 2 * MODES - 1))


def seconds(work: Callable[[], object], repeat: int = 3) -> float:
    """Shortest of some times."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def by_filterpy(model: FilterModel, measured: np.ndarray) -> np.ndarray:
    """Last states (runs, n*) of the loop that a user of filterpy writes, for measured (steps, runs, m)."""
    from filterpy.kalman import KalmanFilter

    A = DrivenModel(model, np.zeros((len(measured), 3, 0))).step(np.zeros((1, model.size)), 0)[1][0]
    ends = np.empty((measured.shape[1], model.size))
    for b in range(len(ends)):
        other = KalmanFilter(model.size, 4)
        other.F, other.H, other.Q, other.R = A, model.H, model.process, np.diag(model.noise)
        other.P = prior(model)
        for sample in measured[:, b]:
            other.predict()
            other.update(sample)
        ends[b] = other.x[:, 0]
    return ends


def against_filterpy(runs: int, steps: int) -> None:
    """The batch and the loop, and that both found the same."""
    model = cantilever()
    measured = NOISE * np.random.default_rng(0).standard_normal((steps, runs, 4))
    nothing = np.zeros((steps, 3, 0))
    own = seconds(lambda: run_filter(model, np.zeros(model.size), prior(model), nothing, measured))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(
        f"{runs} runs × {steps} steps, {model.size} states: {own:.2f} s, {1e6 * own / steps:.0f} µs a step of the batch,"
    )
    print(f"  peak memory {memory:.2f} GiB")
    restless = measured.copy()
    restless[::50] = np.nan
    again = seconds(lambda: run_filter(model, np.zeros(model.size), prior(model), nothing, restless), 1)
    print(f"  with every 50th sample missing in all runs: {again:.2f} s")
    share = max(runs // 10, 1)
    ends: list[np.ndarray] = []
    peer = seconds(lambda: ends.append(by_filterpy(model, measured[:, :share])), 1) * runs / share
    run = run_filter(model, np.zeros(model.size), prior(model), nothing, measured[:, :share])
    off = np.abs((ends[0] - run.mean[-1]) / run.std[-1]).max()
    print(f"  filterpy: {peer:.1f} s ({share} runs timed, × {runs / share:.0f}): {peer / own:.0f} times as long;")
    print(f"  last states differ by {off:.0e} of their deviation")


def stream(steps: int) -> None:
    """One run at a time at 1 kHz: real time over computing time."""
    model, rng = cantilever(), np.random.default_rng(1)
    measured, nothing = NOISE * rng.standard_normal((steps, 4)), np.zeros((steps, 3, 0))
    dropped = np.where(rng.random(measured.shape) < 0.01, np.nan, measured)
    mean, P0 = np.zeros(model.size), prior(model)

    def in_blocks() -> None:
        x, P = mean, P0
        for first in range(0, steps, 100):
            part = slice(first, first + 100)
            run = run_filter(model, x, P, nothing[part], dropped[part])
            x, P = run.mean[-1], run.last

    modulus = cantilever("E")
    cases: dict[str, Callable[[], object]] = {
        "covariance at rest": lambda: run_filter(model, mean, P0, nothing, measured),
        "one sample in a hundred missing": lambda: run_filter(model, mean, P0, nothing, dropped),
        "the same, square root": lambda: run_filter(model, mean, P0, nothing, dropped, form="square_root"),
        "the same, in blocks of 100 ms": in_blocks,
        "Young's modulus unknown too": lambda: run_filter(modulus, np.zeros(24), prior(modulus), nothing, measured),
        "filter and smoother": lambda: smooth(model, run_filter(model, mean, P0, nothing, dropped, keep="all")),
    }
    for name, work in cases.items():
        took = seconds(work, 2)
        print(f"1 kHz stream, {name}: {1e6 * took / steps:.0f} µs a sample, {steps * STEP / took:.1f} times real time")


def endless(steps: int, form: str) -> None:
    """Symmetry and least eigenvalue (in units of the deviations) over many steps, a sample missing now and then."""
    model, rng, block = cantilever(step=5e-4), np.random.default_rng(2), 10_000
    mean, P = np.zeros(model.size), prior(model)
    least, start = np.inf, time.perf_counter()
    symmetric = True
    for _ in range(steps // block):
        measured = NOISE * rng.standard_normal((block, 4))
        measured[rng.random(measured.shape) < 0.01] = np.nan
        run = run_filter(model, mean, P, np.zeros((block, 3, 0)), measured, form=form)  # type: ignore[arg-type]
        mean, P = run.mean[-1], run.last
        symmetric &= np.array_equal(P[0], P[0].T)
        d = np.sqrt(np.diagonal(P[0]))
        least = min(least, np.linalg.eigvalsh(P[0] / np.outer(d, d)).min())
    took = time.perf_counter() - start
    print(
        f"{steps:.0e} steps, {form}: {took:.0f} s, {'symmetric' if symmetric else 'NOT symmetric'},"
        f" least eigenvalue {least:.1e} of the correlation matrix"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the steps")
    quick = parser.parse_args().quick
    steps = 1000 if quick else 10_000
    print(f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    against_filterpy(100, steps)
    stream(steps)
    for form in ("joseph", "square_root"):
        endless(100 * steps, form)


if __name__ == "__main__":
    main()

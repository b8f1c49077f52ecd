"""Does σ hold on a bench that another integrator moved? `python -m benchmarks.bench_sigma [full] [seeds] [kind …]`

The small bench of the tests, 20 drawn truths of 1 s each: loads that are random walks or Matérn processes, drawn every
millisecond, or sums of 24 sines below 0.6 Hz; motion by the explicit method of eighth order of Dormand and Prince with a step of
1 ms on M v̇ + c + f = Bᵀλ, B v̇ + Ḃv = 0, which shares equations with the product and no step. Loads and noise of each seed are its
own. Printed is the RMS of error over σ of all three loads after a quarter of the record, with the largest and the smallest of the
seeds, and of a modulus that is estimated with them how often the truth is within 2σ.

With `full` it is the bench of configs/bench/modulus.yaml: a hub of 98 943 unknowns with ten modes, a bearing of 112 balls, the
loads at 15 m on the blade; its quick modes want an implicit method, Radau's of fifth order with a step of 1 ms.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from benchmarks.full_bench import full_bench as full_bench_of
from scipy.integrate._ivp.rk import DOP853, rk_step
from scipy.linalg import expm
from tests.multibody.inverse.benches import Bench, bench

from strainsight.estimation.filter import filter_runs
from strainsight.loads.input_models import InputModel, Matern, RandomWalk, input_intensity, rate_matrix
from strainsight.multibody.accelerations import balance
from strainsight.multibody.inverse.loads import load_process
from strainsight.multibody.simulate import simulate_radau

FINE, DURATION = 1e-3, 1.0
SIZE = np.array([2e4, 1e4, 1.5e4])
"""[N] of each load: σ of a walk after a second, and of the others at any instant."""
SMOOTH = Matern(0.5, 2.5)
OF_MORE = 1e-7
"""Noise of strain from which the other ways are tried, too."""
GUESSED = 0.05
"""σ of the modulus at the start [-], by which its guess is drawn off the truth."""


FULL = Path(__file__).parents[1] / "configs" / "bench" / "modulus.yaml"
"""The full bench, whose hub's modulus is a parameter."""


def full_bench() -> Bench:
    """As that of the tests: four gauges, five displacements, three loads."""
    full = full_bench_of(FULL)
    own = full.bench
    return Bench(own.system, full.sensors, own.bearings["pitch-bearing"], full.at_rest(np.zeros(3)), own.theta)


def quick_motion(b: Bench, u: np.ndarray) -> np.ndarray:
    """As `motion`, by Radau's method."""
    found = simulate_radau(b.system, b.q, np.zeros_like(b.q), u, FINE, b.theta)
    return np.array([b.sensors.read(q, v)[0] for q, v in zip(found.q[1:], found.v[1:], strict=True)])


def drawn(kind: str, seed: int) -> np.ndarray:
    """Loads (N + 1, 3) every FINE, zero at the start [N]."""
    rng, count = np.random.default_rng((seed, len(kind))), round(DURATION / FINE)
    if kind == "walk":
        return np.concatenate([np.zeros((1, 3)), np.cumsum(rng.normal(size=(count, 3)) * SIZE * FINE**0.5, axis=0)])
    if kind == "sines":
        turning, phase = 2 * np.pi * rng.uniform(0.05, 0.6, (24, 3)), rng.uniform(0, 2 * np.pi, (24, 3))
        t = FINE * np.arange(count + 1)[:, None, None]
        return (np.sin(turning * t + phase) - np.sin(phase)).sum(axis=1) * SIZE / 12**0.5
    # a Matérn process from zero: ζ₁ = 0, the others as they are then
    A = rate_matrix(SMOOTH)
    k = len(A)
    Q = input_intensity(SMOOTH, 0.0)
    times = (np.arange(200) + 0.5) * FINE / 200
    gathered = sum(expm(A * t) @ Q @ expm(A * t).T for t in times) * FINE / 200
    across, factor = expm(A * FINE), np.linalg.cholesky(gathered + 1e-24 * np.eye(k))
    stationary = sum(expm(A * t) @ Q @ expm(A * t).T for t in np.arange(0, 6, 2e-3)) * 2e-3
    given = stationary[1:, 1:] - np.outer(stationary[1:, 0], stationary[0, 1:]) / stationary[0, 0]
    state = np.concatenate([np.zeros((1, 3)), np.linalg.cholesky(given) @ rng.normal(size=(k - 1, 3))])
    found = [state[0]]
    for _ in range(count):
        state = across @ state + factor @ rng.normal(size=(k, 3))
        found.append(state[0])
    return np.array(found) * SIZE


def motion(b: Bench, u: np.ndarray) -> np.ndarray:
    """Readings (N, m) every FINE under loads u (N + 1, 3), straight between, from rest at no load."""
    n, m = b.system.size, b.system.constrained
    x, found = np.concatenate([b.q, np.zeros(n)]), []
    stages, KKT, right = np.empty((DOP853.n_stages + 1, 2 * n)), np.zeros((n + m, n + m)), np.empty(n + m)

    def rate(t: float, x: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        load = first + (last - first) * t / FINE
        at = balance(b.system, x[:n], x[n:], load, b.theta)
        KKT[:n, :n], KKT[:n, n:], KKT[n:, :n] = at.mass, -at.B.T, at.B
        right[:n], right[n:] = -at.load, -at.B_rate @ x[n:]
        return np.concatenate([x[n:], np.linalg.solve(KKT, right)[:n]])

    for first, last in pairwise(u):
        now = partial(rate, first=first, last=last)
        x, _ = rk_step(now, 0.0, x, now(0.0, x), FINE, DOP853.A, DOP853.B, DOP853.C, stages)
        found.append(b.sensors.read(x[:n], x[n:])[0])
    return np.array(found)


def estimated(
    b: Bench,
    u: np.ndarray,
    y: np.ndarray,
    every: int,
    noise: tuple[float, float],
    model: InputModel,
    corrected: bool = True,
    modulus: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Error over σ of loads (T, seeds, 3), and of ln E at the end (seeds,), from fine loads u and readings y (seeds, N, …)."""
    h, seeds = every * FINE, len(u)
    u, y = (np.swapaxes(whole[:, every - 1 :: every], 0, 1) for whole in (u, y))
    walks = isinstance(model, RandomWalk)
    rng = np.random.default_rng(every)
    moving = load_process([model] * 3, SIZE, SIZE * h**0.5 if walks else np.zeros(3), h)
    filtered = b.model(
        h, len(y), loads=moving, noise=noise, white=0.0, corrected=corrected, free=("E",) if modulus else ()
    )
    starts = []
    for _ in range(seeds):
        theta = b.theta * np.exp(GUESSED * rng.normal(size=len(b.theta)) * modulus)
        starts.append(b.start(filtered, std_u=1e-3, std_xi=GUESSED, theta=theta))
    x, P = (np.stack(parts) for parts in zip(*starts, strict=True))
    noisy = y + np.repeat(noise, (4, 5)) * rng.normal(size=y.shape)
    run = filter_runs(
        filtered, x, P, noisy, form="square_root", iterations=10, through_step=True,
        project=filtered.projected if corrected else None, refuse=False,
    )  # fmt: skip
    scores = (run.mean[1:, :, filtered.u] - u) / run.std[1:, :, filtered.u]
    off = np.zeros(seeds)
    if modulus:
        at = filtered.xi.start
        off = (run.mean[-1, :, at] - filtered.coordinates.xi(b.theta)[0]) / run.std[-1, :, at]
    return scores[len(scores) // 4 :], off


def shown(name: str, scores: np.ndarray) -> str:
    each = np.sqrt(np.mean(scores**2, axis=(0, 2)))
    return f"{name:58s} {np.sqrt(np.mean(scores**2)):5.2f}  ({each.min():.2f} to {each.max():.2f})"


def main(seeds: int, kinds: list[str], full: bool) -> None:
    plain, elastic = (full_bench(),) * 2 if full else (bench(), bench(modulus=True))
    moved = quick_motion if full else motion
    for kind in kinds:
        start = time.process_time()
        u = np.array([drawn(kind, seed) for seed in range(seeds)])
        y = np.array([moved(plain, own) for own in u])
        u = u[:, 1:]
        print(f"{kind}: {seeds} truths in {time.process_time() - start:.0f} s")
        for noise in ((1e-8, 1e-7), (1e-7, 1e-6)):
            for every in (10, 20, 50):
                where = f"{noise[0]:g}, {every} ms"
                right: InputModel = RandomWalk() if kind == "walk" else SMOOTH
                print(shown(f"  {where}, stated as it is", estimated(plain, u, y, every, noise, right)[0]), flush=True)
                if noise[0] < OF_MORE:
                    continue
                scores, off = estimated(elastic, u, y, every, noise, right, modulus=True)
                inside, size = np.sum(np.abs(off) < 2), np.sqrt(np.mean(off**2))
                print(
                    shown(f"  {where}, with the modulus", scores),
                    f" it is within 2σ in {inside}, RMS {size:.2f}",
                    flush=True,
                )
                if full:
                    continue
                other = estimated(plain, u, y, every, noise, RandomWalk(), corrected=kind != "walk")[0]
                how = "the step taken for true" if kind == "walk" else "stated as a walk"
                print(shown(f"  {where}, {how}", other), flush=True)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "full"]
    count = int(words.pop(0)) if words and words[0].isdigit() else 20
    main(count, words or ["walk", "matern", "sines"], "full" in sys.argv)

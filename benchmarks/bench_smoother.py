"""Does σ of smoothed loads hold on a bench? `python -m benchmarks.bench_smoother [seeds] [own|other …]`

The small bench of the tests. own: truths of 40 steps drawn from the filter's own model, loads known to 10 kN at the start; all
instants but the start count. other: those of `bench_sigma.py`, motion by an explicit method of eighth order, loads drawn every
millisecond; after a quarter of the record. Printed is the RMS of error over σ of all three loads, with the smallest and the
largest of the seeds, the same of the filter, and the RMS error over that of the filter.
"""

from __future__ import annotations

import sys

import numpy as np
from benchmarks.bench_sigma import FINE, SIZE, SMOOTH, drawn, motion
from tests.multibody.inverse.benches import bench

from strainsight.estimation.filter import filter_runs
from strainsight.estimation.smoother import smooth_first
from strainsight.experiment.bench.inverse.truth import sample as drawn_truth
from strainsight.loads.input_models import InputModel, Matern, RandomWalk
from strainsight.multibody.inverse.loads import load_process
from strainsight.multibody.inverse.model import AugmentedStep

STEPS = 40


def errors(
    model: AugmentedStep, x: np.ndarray, P: np.ndarray, y: np.ndarray, true: np.ndarray, late: int
) -> np.ndarray:
    """Error and σ, smoothed and filtered (4, T', 3), from instant `late` on, of true loads (T + 1, 3)."""
    run = filter_runs(
        model, x, P, y, "first", form="square_root", iterations=20, through_step=True,
        project=model.projected if model.corrected else None,
    )  # fmt: skip
    found, u = smooth_first(model, run), model.u
    whole = [found.mean[:, 0, u] - true, found.std[:, 0, u], run.mean[:, 0, u] - true, run.std[:, 0, u]]
    return np.stack(whole)[:, late:]


def own(noise: float, h: float, corrected: bool, load: Matern | None, modulus: bool, seeds: int) -> np.ndarray:
    """(seeds, 4, T, 3) of drawn truths; load None: a walk of 3 kN a step."""
    b, rows = bench(modulus=modulus, preload=2e-4 if modulus else 1e-5), []
    for seed in range(seeds):
        more = {} if load is None else {"loads": load_process([load] * 3, SIZE, np.zeros(3), h)}
        free = ("E",) if modulus else ()
        model = b.model(h, STEPS, load=3e3, noise=(noise, noise), white=1e-3, corrected=corrected, free=free, **more)
        x, P = b.start(model, std_u=1e4, spread=1e-3, std_xi=0.05 if modulus else 0.0)
        real = drawn_truth(model, x[None], P[None], np.zeros((STEPS + 1, 3)), 1, seed)
        rng = np.random.default_rng((seed, 77))
        y = real.readings + np.sqrt(model.R) * rng.normal(size=real.readings.shape)
        rows.append(errors(model, x, P, y, real.inputs[:, 0], 1))
    return np.array(rows)


def other(u: np.ndarray, y: np.ndarray, every: int, noise: float, load: InputModel) -> np.ndarray:
    """(seeds, 4, T, 3) of fine loads u and readings y (seeds, N, …)."""
    b, h, rng, rows = bench(), every * FINE, np.random.default_rng(every), []
    u, y = (np.swapaxes(whole[:, every - 1 :: every], 0, 1) for whole in (u, y))
    noisy = y + noise * rng.normal(size=y.shape)
    walks = isinstance(load, RandomWalk)
    moving = load_process([load] * 3, SIZE, SIZE * h**0.5 if walks else np.zeros(3), h)
    for seed in range(u.shape[1]):
        model = b.model(h, len(y), loads=moving, noise=(noise, noise), white=0.0, corrected=True)
        true = np.concatenate([np.zeros((1, 3)), u[:, seed]])
        x, P = b.start(model, std_u=1e-3)
        rows.append(errors(model, x, P, noisy[:, seed], true, 1 + len(y) // 4))
    return np.array(rows)


def show(name: str, found: np.ndarray) -> None:
    """found (seeds, 4, T, 3)."""
    off, std, filtered, claimed = np.swapaxes(found, 0, 1)
    each = np.sqrt(np.mean((off / std) ** 2, axis=(1, 2)))
    rms = [np.sqrt(np.mean(own**2)) for own in (off / std, filtered / claimed, off, filtered)]
    print(
        f"{name:44s} {rms[0]:.2f} ({each.min():.2f} to {each.max():.2f}), filter {rms[1]:.2f}; error {rms[2] / rms[3]:.2f}",
        flush=True,
    )


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    kinds = sys.argv[2:] or ["own", "other"]
    if "own" in kinds:
        for noise, h, corrected, smooth, modulus in (
            (1e-8, 0.02, False, None, False), (1e-8, 0.02, True, None, False), (1e-7, 0.05, False, None, False),
            (1e-7, 0.05, True, None, False), (1e-10, 0.02, True, None, False), (1e-8, 0.02, True, SMOOTH, False),
            (1e-8, 0.02, True, None, True), (1e-8, 0.02, False, None, True),
        ):  # fmt: skip
            stated = "Matérn" if smooth else "walk"
            step = "corrected" if corrected else "own step"
            name = f"{stated}{', E' * modulus}, {step}, {noise:g}, {1e3 * h:g} ms"
            show(name, own(noise, h, corrected, smooth, modulus, seeds))
    if "other" in kinds:
        b = bench()
        kinds_of_loads: tuple[tuple[str, list[InputModel]], ...] = (
            ("walk", [RandomWalk()]), ("matern", [SMOOTH]), ("sines", [RandomWalk(), SMOOTH]),
        )  # fmt: skip
        for kind, loads in kinds_of_loads:
            u = np.array([drawn(kind, seed) for seed in range(seeds)])
            y = np.array([motion(b, own) for own in u])
            for load in loads:
                for every in (20, 50):
                    for noise in (*([1e-9] if kind == "walk" else []), 1e-8, 1e-7):
                        stated = "walk" if isinstance(load, RandomWalk) else "Matérn"
                        show(f"{kind} as {stated}, {noise:g}, {every} ms", other(u, y, every, noise, load))


if __name__ == "__main__":
    main()

"""Cost of the bearing: `python -m benchmarks.bearing [--quick]`.

A pitch bearing of 128 balls of 60 mm on 2.3 m: load, tangent and slopes in the six parameters at one displacement, beside
the same equilibrium written in plain numpy, vectorised over the balls, in the same process on the same numbers, both held
against each other. Then random displacements between nothing touches and 30 mm, a trial parameter vector (new Hertz
constants), and the equilibrium under a load. Machines differ and are shared: read the load beside the times.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from strainsight.multibody.bearing.element import bearing_load, displacement
from strainsight.multibody.bearing.geometry import Bearing


def pitch_bearing(balls: int = 128, **more: float) -> Bearing:
    r = 0.53 * 0.06
    return Bearing(balls, 2.3, np.radians(45), 0.06, r, r, r, r, **more)  # type: ignore[arg-type]


def plain_numpy(bearing: Bearing, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and tangent by Newton on all balls at once; halved where the energy of a ball would rise."""
    table, R = bearing.contacts.table, bearing.pitch_diameter / 2
    phi = bearing.first_ball + 2 * np.pi * np.arange(bearing.balls) / bearing.balls
    c, s, zero, one = np.cos(phi), np.sin(phi), np.zeros(bearing.balls), np.ones(bearing.balls)
    T = np.zeros((bearing.balls, 4, 2, 5))
    for k in range(2):
        x, arm = table[k, 0], R + table[k, 1]
        T[:, k] = np.stack([[one, zero, zero, arm * s, -arm * c], [zero, c, s, -x * s, x * c]]).transpose(2, 0, 1)
    centre = table[:, :2] + T @ q
    L, K = table[:, 2], table[:, 3]

    def energy(p: np.ndarray) -> np.ndarray:
        return 0.4 * np.maximum(np.linalg.norm(centre - p[:, None], axis=2) - L, 0) ** 2.5 @ K

    def contacts(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arm = centre - p[:, None]
        d = np.linalg.norm(arm, axis=2)
        delta = np.maximum(d - L, 0)
        n, Q = arm / d[..., None], K * delta**1.5
        nn = n[..., :, None] * n[..., None, :]
        H = (1.5 * K * np.sqrt(delta))[..., None, None] * nn + (Q / d)[..., None, None] * (np.eye(2) - nn)
        return Q[..., None] * n, H

    p = 0.5 * (centre[:, 0] + centre[:, 3])
    for _ in range(100):
        f, H = contacts(p)
        g = f.sum(axis=1)
        if np.abs(g).max() < 1e-9 * np.abs(f).max():
            break
        step = np.linalg.solve(H.sum(axis=1) + 1e-6 * np.eye(2), g[..., None])[..., 0]
        before, factor = energy(p), np.ones(bearing.balls)
        for _ in range(30):
            rises = energy(p + factor[:, None] * step) > before * (1 + 1e-12)
            if not rises.any():
                break
            factor[rises] *= 0.5
        p = p + factor[:, None] * step
    f, H = contacts(p)
    HT = H @ T
    S, total = HT.sum(axis=1), H.sum(axis=1) + 1e-6 * np.eye(2)
    tangent = np.einsum("bkim,bkin->mn", T, HT) - np.einsum("bim,bin->mn", S, np.linalg.solve(total, S))
    return np.einsum("bkim,bki->m", T, f), tangent


def microseconds(work: Callable[[], object], repeat: int) -> tuple[float, float]:
    """Shortest and median of some times."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(1e6 * (time.perf_counter() - start))
    return min(times), float(np.median(times))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the repetitions")
    repeat = 200 if parser.parse_args().quick else 2000
    print(f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors; shortest and median of {repeat}")
    q = np.array([1e-4, 2e-5, -3e-5, 1e-4, -5e-5])
    states = {
        "loaded and tilted": pitch_bearing(preload=0.0),
        "preloaded by 20 µm": pitch_bearing(preload=2e-5),
        "preloaded by 100 µm, all contacts": pitch_bearing(preload=1e-4),
    }
    start = time.perf_counter()
    bearing_load(states["loaded and tilted"], q)
    print(f"first call, compiled or read from the cache: {time.perf_counter() - start:.2f} s")
    for name, bearing in states.items():
        tangent = microseconds(partial(bearing_load, bearing, q, slopes=False), repeat)
        slopes = microseconds(partial(bearing_load, bearing, q), repeat)
        plain = microseconds(partial(plain_numpy, bearing, q), max(repeat // 20, 5))
        load, (force, stiff) = bearing_load(bearing, q), plain_numpy(bearing, q)
        apart = max(
            np.abs(force - load.force).max() / np.abs(force).max(),
            np.abs(stiff - load.tangent).max() / np.abs(stiff).max(),
        )
        print(
            f"128 balls, {name}: with tangent {tangent[0]:.0f} ({tangent[1]:.0f}) µs, with slopes too {slopes[0]:.0f}"
            f" ({slopes[1]:.0f}) µs; plain numpy {plain[0]:.0f} µs, {plain[0] / tangent[0]:.0f} times as long, {apart:.0e} apart"
        )
    rng = np.random.default_rng(0)
    bearing = states["preloaded by 20 µm"]
    random = [10 ** rng.uniform(-9, -1.5) * rng.standard_normal(5) for _ in range(repeat)]
    for preload in (2e-5, -1e-3):
        there = pitch_bearing(preload=preload)
        took = [microseconds(partial(bearing_load, there, x), 3)[0] for x in random]
        print(
            f"{repeat} random displacements, preload {1e6 * preload:.0f} µm: median {np.median(took):.0f} µs,"
            f" longest {max(took):.0f} µs"
        )
    theta = bearing.parameters
    trial = microseconds(lambda: bearing_load(bearing.with_parameters(theta), q), repeat)
    print(f"trial parameters and load: {trial[0]:.0f} ({trial[1]:.0f}) µs")
    F = np.array([5e4, 1.4e5, 3e4, 3e5, 1.5e6])
    rest = microseconds(lambda: displacement(bearing, F), max(repeat // 20, 5))
    print(f"equilibrium under a blade's weight, from the centred ring: {rest[0] / 1e3:.1f} ({rest[1] / 1e3:.1f}) ms")


if __name__ == "__main__":
    main()

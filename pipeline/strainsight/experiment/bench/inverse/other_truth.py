"""Truths of a bench by another integrator, and what sensors read there."""

from __future__ import annotations

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.estimate import BenchTruth
from strainsight.errors import blame
from strainsight.experiment.bench.bench import Bench, bench_of
from strainsight.experiment.bench.inverse.truth import Reality
from strainsight.experiment.bench.loads import loads_of
from strainsight.experiment.bench.sensors import instants_of, read_in_time
from strainsight.experiment.bench.start import start_of
from strainsight.experiment.resources import Resources
from strainsight.mesh.model import Mesh
from strainsight.multibody.radau import simulate_radau
from strainsight.multibody.sensors import Readings
from strainsight.records.bench_truth import BenchTruths
from strainsight.records.bodies import ReducedBody

BEGIN = 3
"""Last word of the seed by which instants of the histories are drawn."""


def truths_of(
    config: BenchConfig,
    truth: BenchTruth,
    duration: float,
    reduced: dict[str, ReducedBody],
    meshes: dict[str, Mesh],
    using: Resources,
) -> BenchTruths:
    """Histories r = 0, 1, … of u_r(t) = u(τ_r + t) + u(0) − u(τ_r), τ₀ = 0 and τ_r drawn evenly from [0, `within`]: all begin in
    the same state under the same loads."""
    bench = bench_of(config, reduced, meshes)
    h, steps = truth.step, round(duration / truth.step)
    begin = np.zeros(truth.histories)
    begin[1:] = np.random.default_rng((config.seed, BEGIN)).uniform(0.0, truth.within, truth.histories - 1)
    # on the instants of the step, so that what is straight between samples is so in every step
    begin = h * np.round(begin / h)
    time, loads = h * np.arange(steps + 1), loads_of(config, bench, using.files)
    q, v = np.empty((2, steps + 1, truth.histories, bench.system.size))
    u = np.empty((steps + 1, truth.histories, bench.system.drives.width))
    first = loads(time[:1])[0]
    with blame("estimate.truth"):
        q0, v0 = start_of(bench, config.simulate, first)
        for r, instant in enumerate(begin):
            own = loads(instant + time)
            u[:, r] = own + (first - own[0])

            def tell(k: int, r: int = r) -> None:
                if k % 50 == 0:
                    using.progress("truth", (r + k / steps) / len(begin))

            found = simulate_radau(bench.system, q0, v0, u[:, r], h, bench.theta, tell)
            q[:, r], v[:, r] = found.q, found.v
    inputs = {name: u[:, :, i] for i, name in enumerate(bench.system.inputs)}
    return BenchTruths(time=time, begin=begin, q=q, v=v, inputs=inputs)


def reality_of(
    there: BenchTruths, bench: Bench, sensors: Readings, zeroed: np.ndarray, h: float, steps: int, runs: int
) -> Reality:
    """The first histories, one a run where there are several, at 0, h, … of the filter; zeroed (channels,)."""
    every = round(h / (there.time[1] - there.time[0]))
    rows, count = slice(0, every * steps + 1, every), min(there.q.shape[1], runs)
    q, v = there.q[rows, :count], there.v[rows, :count]
    inputs = np.stack([there.inputs[name][rows, :count] for name in bench.system.inputs], axis=2)
    second, runs_read = np.zeros((len(q), 0)), []  # no joint is driven
    for r in range(count):
        at = q[:, r], v[:, r], inputs[:, r]
        instants = instants_of(bench.system, *at, bench.theta, second) if sensors.accelerometers else []
        runs_read.append(read_in_time(bench.system, sensors, *at, instants))
    read = np.stack(runs_read, axis=1)
    read = read - np.where(zeroed, read[0], 0.0)
    return Reality(inputs, np.tile(bench.theta, (count, 1)), read[1:])

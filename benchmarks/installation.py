"""Do layouts that avoid errors of installation know more? `python -m benchmarks.installation [draws] [case …]`.

The layout for exact gauges (`place.installation: ignore`) beside the one that avoids errors of installation (`avoid`), both
without a clearance, beside that of a real gauge with its clearance and spacing (`gauges.type: 3/350`), and beside the layout
that the first defaults of `init` made (for exact gauges along x, from the strongest hundred places): the real RMS error of
every unknown over draws of a truth `perturbed`, and what place expected of the first two. Errors, not times; the time of the
placement, with over without, is measured beside.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pool
from time import perf_counter

import numpy as np
from benchmarks.sigma import CASES, ROOT, Drawn, none, one

from strainsight import api
from strainsight.experiment.structure.considered import tolerated
from strainsight.experiment.structure.placement import StructurePlacement
from strainsight.experiment.structure.problem import problem_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.trial import trial_of
from strainsight.experiment.structure.truth import truth_of
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced

BARE = "gauges.clearance=none"
REAL = ["gauges.type=3/350", "screen.minimum_spacing=0.0107"]
FIRST = [
    "place.installation=ignore",
    BARE,
    "screen={keep: 100, by: strength}",
    "gauges.surface=all",
    "gauges.direction={type: axis, axis: [1, 0, 0], angles: [0]}",
    "gauges.exclude=[{normal_cone: {axis: [1, 0, 0], angle: 10}}]",
]
WAYS = (["place.installation=ignore", BARE], ["place.installation=avoid", BARE], REAL, FIRST)


@dataclass(frozen=True)
class Tried:
    """A layout, the time [s] that it took, and what came of every draw."""

    placed: StructurePlacement
    time: float
    drawn: list[Drawn]


def tried(config: str, draws: int, pool: object) -> list[Tried]:
    """The layouts of a config, each on truths that are drawn alike."""
    loaded = [api.load(ROOT / "configs" / config, ["validate.truth.model=perturbed", *own]) for own in WAYS]
    mesh = api.mesh(loaded[0])
    reduced = api.reduce(loaded[0], mesh)
    _on(loaded[0], mesh, reduced, 0, pool)  # compiles what is compiled once
    return [_on(case, mesh, reduced, draws, pool) for case in loaded]


def _on(case: api.Case, mesh: Mesh, reduced: Reduced, draws: int, pool: object) -> Tried:
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    start = perf_counter()
    placed = api.place(case, mesh, reduced, training, screened)
    took = perf_counter() - start
    truth = truth_of(structure, None, problem, case)
    own = tolerated(structure, problem.channels.of(placed.gauges))
    trial = trial_of(case.config, problem, truth, own, placed.gauges)
    assert trial.again is not None
    readings = [(trial.again(r), r) for r in range(1, draws + 1)]
    sent = partial(one, replace(trial, truth=replace(truth, motion=none, again=None), again=None))
    return Tried(placed, took, pool.map(sent, readings, chunksize=4))  # type: ignore[attr-defined]


def main(words: Sequence[str]) -> None:
    draws = int(words[0]) if words else 400
    print(
        "| case | unknown | error, exact | error, avoiding | lower by | expected | time | error, 3/350 | lower by "
        "| error, first defaults | 3/350 lower by |\n|---|---|---|---|---|---|---|---|---|---|---|"
    )
    with Pool(2) as pool:
        for case in words[1:] or list(CASES):
            exact, avoiding, real, first = tried(CASES[case], draws, pool)
            for i, name in enumerate(exact.placed.task.unknowns.names):
                rms = [
                    100 * np.sqrt(np.mean([own.error[i] ** 2 for own in way.drawn]))
                    for way in (exact, avoiding, real, first)
                ]
                expected = exact.placed.expected.std[name] / avoiding.placed.expected.std[name]
                print(
                    f"| {case} | {name} | {rms[0]:.3g} % | {rms[1]:.3g} % | {rms[0] / rms[1]:.2f} | {expected:.2f} "
                    f"| {avoiding.time / exact.time:.2f} | {rms[2]:.3g} % | {rms[0] / rms[2]:.2f} "
                    f"| {rms[3]:.3g} % | {rms[3] / rms[2]:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1:])

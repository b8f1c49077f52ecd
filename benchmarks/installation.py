"""Do layouts that avoid errors of installation know more? `python benchmarks/installation.py [draws] [case …]`.

The layout for exact gauges (`place.installation: ignore`) beside the one that avoids errors of installation (`avoid`), on the
same draws of a truth `rich`: the real RMS error of every unknown on both, and what place expected of them. Errors, not times; the
time of the placement, with over without, is measured beside.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pool
from time import perf_counter

import numpy as np
from sigma import CASES, ROOT, Drawn, none, one

from strainsight import api
from strainsight.cases.structure.nuisances import tolerated
from strainsight.cases.structure.placement import Placement
from strainsight.cases.structure.problem import problem_of
from strainsight.cases.structure.trial import trial_of
from strainsight.cases.structure.truth import truth_of

WAYS = ("ignore", "avoid")


@dataclass(frozen=True)
class Tried:
    """A layout, the time [s] that it took, and what came of every draw."""

    placed: Placement
    time: float
    drawn: list[Drawn]


def tried(config: str, draws: int, pool: object) -> tuple[Tried, Tried]:
    """Both layouts of a config, on one truth."""
    common = ["validate.truth.model=rich", "gauges.clearance=none"]
    settings = [[f"place.installation={way}", *common] for way in WAYS]
    plain, avoiding = (api.load(ROOT / "configs" / config, own) for own in settings)
    mesh = api.mesh(plain)
    reduced = api.reduce(plain, mesh)
    training = api.train(plain, mesh, reduced)
    screened = api.screen(plain, mesh, training)
    problem = problem_of(plain.config, plain.files, reduced, training, screened)
    truth = truth_of(plain.config, mesh, None, reduced, training, problem, plain)
    light = replace(truth, motion=none, again=None)

    def on(case: api.Case) -> Tried:
        start = perf_counter()
        placed = api.place(case, mesh, reduced, training, screened)
        took = perf_counter() - start
        own = tolerated(case.config, mesh, reduced, training, problem.channels.of(placed.gauges))
        trial = trial_of(case.config, problem, truth, own, placed.gauges)
        assert trial.again is not None
        readings = [(trial.again(r), r) for r in range(1, draws + 1)]
        sent = partial(one, replace(trial, truth=light, again=None))
        return Tried(placed, took, pool.map(sent, readings, chunksize=4))  # type: ignore[attr-defined]

    api.place(plain, mesh, reduced, training, screened)  # compiles what is compiled once
    return on(plain), on(avoiding)


def main(words: Sequence[str]) -> None:
    draws = int(words[0]) if words else 400
    print(
        "| case | unknown | error, exact | error, avoiding | lower by | expected | time |\n|---|---|---|---|---|---|---|"
    )
    with Pool(2) as pool:
        for case in words[1:] or list(CASES):
            both = tried(CASES[case], draws, pool)
            for i, name in enumerate(both[0].placed.task.unknowns.names):
                rms = [100 * np.sqrt(np.mean([own.error[i] ** 2 for own in way.drawn])) for way in both]
                expected = both[0].placed.expected.std[name] / both[1].placed.expected.std[name]
                print(
                    f"| {case} | {name} | {rms[0]:.3g} % | {rms[1]:.3g} % | {rms[0] / rms[1]:.2f} | {expected:.2f} "
                    f"| {both[1].time / both[0].time:.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1:])

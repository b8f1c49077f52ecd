"""Is the layout of a config from `init` as good as the best of 20 random spreads? `python -m benchmarks.spreads [part …]`.

`strainsight init` gets a deck and the names of its loads, nothing else. A spread has as many gauges as the layout, drawn from all
candidates that screening allows, under the limits of the config (spacing). σ is the expected σ of `place`, with tolerances: of
the layout, the smallest of all spreads for each load, and that of the spread with the smallest criterion of the placement.
Numbers are errors, not times: they do not depend on the machine.
"""

from __future__ import annotations

import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.parts import PARTS, deck
from tests import init_parts

from strainsight import api
from strainsight.experiment.layout.task import layout_limits
from strainsight.experiment.structure.considered import tolerated
from strainsight.experiment.structure.expectation import expectation
from strainsight.experiment.structure.pool import pool_of, prices
from strainsight.experiment.structure.problem import problem_of
from strainsight.experiment.structure.structure import Structure
from strainsight.placement.baselines import random_sets
from strainsight.placement.score import score
from strainsight.sensors.screening import KEPT, NEAR, WEAK

SPREADS = 20
Deck = tuple[Callable[[], str], tuple[str, ...]]
"""Text of a deck, and the names of the loads that act."""


def _loaded(name: str) -> str:
    part = PARTS[name]()
    return deck(part, f"FORCE,1,{part.node},,1000.,{','.join(f'{x}.' for x in part.direction)}")


DECKS: dict[str, Deck] = {
    "yoke": (lambda: _loaded("yoke"), ("FORCE-1",)),
    "tube portal": (lambda: _loaded("portal"), ("FORCE-1",)),
    "jib": (lambda: _loaded("jib"), ("FORCE-1",)),
    "bore": (init_parts.bore_block, ("FORCE-11", "FORCE-12")),
    "plate portal": (init_parts.portal, ("FORCE-3",)),
    "arm": (init_parts.crane_arm, ("FORCE-1", "LOAD-2")),
}


@dataclass(frozen=True)
class Comparison:
    """Expected σ of a load relative to its RMS: of the layout, of the spread that is best for it, and of the spread with the
    smallest criterion."""

    load: str
    layout: float
    best: float
    least_criterion: float


def compared(name: str, folder: Path, seed: int = 1) -> Iterator[Comparison]:
    """Every load of a deck, from `init` in a folder."""
    write, loads = DECKS[name]
    (folder / "part.bdf").write_text(write(), encoding="ascii")
    words = [word for load in loads for word in ("--load", load)]
    init = [str(Path(sys.executable).parent / "strainsight"), "init", "part.bdf", "--estimate", "load", *words]
    done = subprocess.run(init, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr or done.stdout)
    case = api.load(folder / "part.yaml")
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    placed = api.place(case, mesh, reduced, training, screened)

    structure = Structure(case.config, case.files, mesh, reduced, training)
    problem, task = problem_of(structure, screened), placed.task
    allowed = np.flatnonzero(np.isin(screened.reason, (KEPT, WEAK, NEAR)))
    pool = pool_of(allowed, problem.channels, structure.pool, None)
    price = prices(case.config, pool, structure.pool)
    limits = layout_limits(case.config.place, pool, mesh, structure.pool, price)
    sets = random_sets(len(allowed), len(placed.gauges), SPREADS, seed, limits.allows)
    tolerances = tolerated(structure, pool.channels[sets])
    std = [expectation(problem, allowed[spread], tolerances, failures=False).std for spread in sets]
    every = task.under(task.pools if task.whole is None else task.whole.pools)
    least = int(np.argmin([score(every, spread, task.aggregate) for spread in sets]))
    for load in loads:
        of_spreads = [each[load] for each in std]
        yield Comparison(load, placed.expected.std[load], min(of_spreads), of_spreads[least])


def main(words: Sequence[str]) -> None:
    parser = ArgumentParser(description="Expected σ of layouts from init beside that of random spreads.")
    parser.add_argument("parts", nargs="*", default=[*DECKS], choices=[*DECKS, [*DECKS]])
    parser.add_argument("--seed", type=int, default=1, help="of the spreads")
    given = parser.parse_args(words)
    print(f"| part | load | σ of the layout | best of {SPREADS} | ratio | spread of least criterion | ratio |")
    print("|---|---|---|---|---|---|---|")
    for name in given.parts:
        with TemporaryDirectory() as folder:
            for found in compared(name, Path(folder), given.seed):
                spreads = (f"{100 * std:.3g} % | {found.layout / std:.2f}" for std in (found.best, found.least_criterion))
                print(f"| {name} | {found.load} | {100 * found.layout:.3g} % | {' | '.join(spreads)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

"""The placement on a structure: the training run linearised, its gauges as a pool, and what the layout is to know (5.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.augmentation.linearisation import linearise
from strainsight.augmentation.measurement import measurement_rows
from strainsight.augmentation.observability import Observability, observability
from strainsight.cases.layout.placement import Placed, placed
from strainsight.cases.layout.pool import PoolRows, layout_limits
from strainsight.cases.layout.task import Readings, Task, Unknowns
from strainsight.cases.resources import Resources
from strainsight.cases.structure.channels import largest_of_quantity, listed_gauges
from strainsight.cases.structure.expectation import alike_gauges, expectation
from strainsight.cases.structure.hot_spots import hot_spot_advice, tested_hot_spots
from strainsight.cases.structure.installation_noise import installation_intensity
from strainsight.cases.structure.nuisances import not_held_in_words, tolerated
from strainsight.cases.structure.pool import pool_of, prices
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.scenarios import placed_instants, scenarios_of
from strainsight.cases.structure.start import ringing_in_words
from strainsight.config.placement import Place, PlacementConfig
from strainsight.errors import blame
from strainsight.mesh.model import Mesh
from strainsight.placement.scenario import Scenario, solve_pool, solved
from strainsight.records.placed import HotSpots
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.rom.model import modal_basis
from strainsight.signals.histories import instant_values

COHERENCE = 0.01
"""Over the length of the training run: how long errors of installation are correlated in the white noise that stands for them. A
constant error weighs as white noise of its variance over all that is averaged: the record for a parameter, less for a load. Where
such errors are larger than the noise of a gauge, its size hardly changes the layout."""


@dataclass(frozen=True)
class Placement(Placed):
    """All that a placement has found, with the problem that it is of; σ is relative to the scale of an unknown.

    condition: whether the pool can tell the unknowns; hot_spots: whether the strain at its gauges is that of the part, None where
    the model is not that of a mesh.
    """

    problem: Problem
    condition: Observability
    hot_spots: HotSpots | None


def placement_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    problem: Problem,
    training: Training,
    screened: Screened,
    using: Resources,
) -> Placement:
    """Linearise along the training run, eliminate, exchange, certify, and say what the layout is expected to know.

    Raises InfeasibleError where no layout within the limits detects every unknown.
    """
    settings, candidates, unknowns = config.place, training.candidates, problem.unknowns
    pool = pool_of(screened.kept, problem.channels, candidates, settings.symmetry)
    price = prices(config, pool, candidates)
    with blame("place.keep"):
        limits = layout_limits(settings, pool, mesh, candidates, price)
    ranges = {name: entry.range for name, entry in config.parameters.items()}

    # of one second, of which every other coherence is a multiple
    installation = installation_intensity(config, mesh, reduced, training, problem, pool.channels, 1.0)

    def scenarios(channels: np.ndarray, coherence: float) -> tuple[Scenario, ...]:
        noise = coherence * installation if coherence else None
        return scenarios_of(problem, channels, settings, ranges, config.seed, noise)

    def task(coherence: float) -> Task:
        with blame("place.estimate"):
            pools = using.sweep(solved, scenarios(pool.channels, coherence), unknowns.state_names)
        return Task(
            Unknowns(
                unknowns.names,
                unknowns.state_names,
                np.asarray(unknowns.position(problem.model)),
                unknowns.scale,
                np.ones(len(unknowns.names)),
            ),
            tuple(pools),
            candidates,
            pool,
            price,
            limits,
            settings,
            _readings(problem, pool.channels),
            config.seed,
            settings.aggregate,
            settings.weights,
            coherence=coherence,
        )

    avoided = settings.installation == "avoid" and not problem.printed and bool(installation.any())
    found = placed(
        [task(share * config.train.duration) for share in ((0.0, COHERENCE) if avoided else (0.0,))],
        lambda gauges: expectation(
            problem, gauges, tolerated(config, mesh, reduced, training, problem.channels.of(gauges))
        ),
        lambda gauges: listed_gauges(gauges, training, screened),
        using.progress,
        alike=lambda gauges: alike_gauges(problem, gauges),
        alone=lambda gauges, coherence: [solve_pool(own) for own in scenarios(problem.channels.of(gauges), coherence)],
    )
    using.progress("hot spots", 0.9)
    hot = tested_hot_spots(config, mesh, reduced, training, found.gauges)
    first = _ringing(problem, settings, config.seed), *not_held_in_words(config, reduced, training)
    listed = found.listed
    spots = hot_spot_advice(hot, listed.labels, listed.bonded.tolist())
    found = replace(found, advice=(*filter(None, first), *spots, *found.advice))
    solved_first = found.task.pools[0]
    condition = _observability(problem, training, solved_first.scenario.scaled(1 / solved_first.scale), pool)
    return Placement(**vars(found), problem=problem, condition=condition, hot_spots=hot)


def _readings(problem: Problem, channels: np.ndarray) -> Readings:
    """Rows per reduced coordinate, of accelerometers at the guess; channels (pool, c): rows of train.h5, −1 for none."""
    p, there = problem, channels >= 0
    F = linearise(p.model, p.unknowns, p.model.reference, p.x[:1], instant_values(p.u)[:1])[0]
    every = measurement_rows(p.channels.rows, p.channels.quantity, F)[:, : p.model.size]
    rows = np.where(there[..., None], every[channels], 0.0)
    return Readings(rows, p.channels.noise_std[channels] ** 2, np.cov(p.x[:, : p.model.size], rowvar=False))


def _ringing(problem: Problem, settings: Place, seed: int) -> str:
    """What to know of instants at which a start from rest still rings; without a parameter the instant does not matter."""
    p = problem
    if not p.unknowns.parameters:
        return ""
    instants = placed_instants(p, p.model.reference, p.x, settings, seed)
    return ringing_in_words(p.settle, p.loading, p.model, instants)


def _observability(problem: Problem, training: Training, scenario: Scenario, pool: PoolRows) -> Observability:
    """Of x* as it is, not in the coordinates of a solved pool."""
    p, n = problem, problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    there = pool.channels >= 0
    used = pool.channels[there]
    H = scenario.H[there] if scenario.H.ndim == 3 else scenario.H
    return observability(
        scenario.F,
        H / largest_of_quantity(training.reading[:, used], p.channels.quantity[used])[:, None],
        names=p.unknowns.state_names,
        frequency=frequency,
        state_amplitude=amplitude,
        largest_strain=1.0,
        raw_scale=p.unknowns.state_scale,
        raw_rows=H,
    )

"""Placement on a structure: linearised training simulation, pool of gauges, optimised layout, and its output (5.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain

import numpy as np

from strainsight.config.layout import LayoutSettings
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, blame
from strainsight.experiment.layout.advice import Expectation, budget_table
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.layout.placement import Placement, Subject, place
from strainsight.experiment.layout.task import (
    LoadCases,
    PoolReadings,
    PoolRows,
    Task,
    UnknownStates,
    Whole,
    layout_limits,
)
from strainsight.experiment.structure.candidates import (
    largest_of_quantity,
    listed_gauges,
    of_channels,
)
from strainsight.experiment.structure.clearance import (
    advice_at_gauges,
    at_gauges,
    hot_spot_advice,
    hot_spot_table,
    notes_at_gauges,
    tested_hot_spots,
)
from strainsight.experiment.structure.considered import not_held_in_words, tolerated
from strainsight.experiment.structure.cost import of_pool_in_words
from strainsight.experiment.structure.expectation import (
    case_table,
    cases_in_words,
    cases_of,
    expectation,
    redundant_gauges,
    unresolved_gauges,
    worst_case,
)
from strainsight.experiment.structure.influence import (
    frequency_response_of,
    frequency_response_table,
    influence_of,
    influence_table,
)
from strainsight.experiment.structure.pool import pool_of, prices
from strainsight.experiment.structure.problem import (
    Problem,
    load_dependence_text,
    placed_instants,
    problem_of,
    scenarios_of,
)
from strainsight.experiment.structure.references import unknown_units
from strainsight.experiment.structure.screening import COHERENCE, avoids_errors
from strainsight.experiment.structure.slow_load import slow_load_advice
from strainsight.experiment.structure.start import ringing_in_words
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.tolerated_masses import sensor_masses_in_words
from strainsight.experiment.system import Resources
from strainsight.loads.histories import instant_values
from strainsight.loads.linearisation import linearise, measurement_rows
from strainsight.loads.observability import Observability, observability
from strainsight.mesh.model import Mesh
from strainsight.placement.limits import Limits
from strainsight.placement.scenario import Pool, Scenario, solve_named_pool, solve_pool
from strainsight.records.placed import (
    AtGauges,
    ByCase,
    FrequencyResponse,
    HotSpots,
    Influence,
    Placed,
    budget_of_shares,
)
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.rom.model import modal_basis
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.screening import KEPT, NEAR, WEAK


@dataclass(frozen=True)
class StructurePlacement(Placement):
    """Result of a placement on a structure; σ is relative to the scale of an unknown.

    condition: observability by the pool in the worst load case; influence: None for a free structure; frequency_response:
    None also for a quasi-static model; hot_spots: None without a solid mesh; at_gauges: strain gradient and access, None without
    a surface; by_case: None without load cases."""

    problem: Problem
    condition: Observability
    influence: Influence | None
    frequency_response: FrequencyResponse | None
    hot_spots: HotSpots | None
    at_gauges: AtGauges | None
    by_case: ByCase | None


def placement_of(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, training: Training, screened: Screened, using: Resources
) -> StructurePlacement:
    """Linearise along the training simulations, eliminate, exchange, certify, and predict σ of the layout.

    Raises InfeasibleError if no layout within the limits detects every unknown."""
    structure = Structure(config, using.files, mesh, reduced, training)
    subject = _OnStructure(structure, screened, using)
    model, unknowns = reduced.model, subject.problem.unknowns
    if costs := of_pool_in_words(config, len(subject.pool.gauges), 2 * model.size + len(unknowns.state_names)):
        using.notice(costs)
    placement = place(subject, using.progress)
    using.progress("hot spots", 0.9)
    gauges, listed = placement.gauges, placement.listed
    hot = tested_hot_spots(structure, gauges)
    sites = at_gauges(structure, gauges)
    by_case = None if placement.task.cases is None else cases_of(placement, subject.expectations(gauges))
    bonded = listed.bonded.tolist()
    advice = (
        *filter(None, (_ringing(problem, config) for problem in subject.problems)),
        *filter(
            None,
            (*not_held_in_words(structure), sensor_masses_in_words(structure, training.candidates.channels(gauges))),
        ),
        *unresolved_gauges(listed),
        *hot_spot_advice(hot, listed.labels, bonded),
        *advice_at_gauges(sites, listed.labels, bonded),
        *(() if by_case is None else cases_in_words(by_case, config.place.aggregate)),
        *placement.advice,
        *subject.slow_loads(gauges, placement.expected),
    )
    channels = structure.pool.channels(gauges)
    noted = replace(listed, notes=notes_at_gauges(sites, len(listed.labels)))
    return StructurePlacement(
        **vars(replace(placement, advice=advice, listed=noted)),
        problem=subject.problem,
        condition=_worst_observability(placement, subject),
        influence=influence_of(structure, screened, channels, placement.expected.reference),
        frequency_response=frequency_response_of(structure, listed, channels),
        hot_spots=hot,
        at_gauges=sites,
        by_case=by_case,
    )


SHARES = (0.0, COHERENCE, COHERENCE / 10)
"""Correlation times of the noise that replaces installation errors, relative to the training simulation: one layout for each."""
Every = tuple[tuple[Pool, ...], Limits]
"""Scenarios solved with all candidates, and the limits of a layout."""


@dataclass(frozen=True)
class _OnStructure(Subject):
    """Structure as subject of a placement."""

    structure: Structure
    screened: Screened
    using: Resources

    @property
    def config(self) -> PlacementConfig:
        return self.structure.config

    @cached_property
    def problem(self) -> Problem:
        """Problem under the configured loads."""
        return problem_of(self.structure, self.screened)

    @cached_property
    def problems(self) -> tuple[Problem, ...]:
        """One problem per load case, or that under the configured loads."""
        structure = self.structure
        return tuple(problem_of(structure, self.screened, run) if run.name else self.problem for run in structure.runs)

    @cached_property
    def pool(self) -> PoolRows:
        """Screened candidates."""
        return self._rows(self.screened.kept)

    @cached_property
    def every(self) -> PoolRows:
        """Screened candidates, and those that screening omitted as weaker or too near to these."""
        return self._rows(np.flatnonzero(np.isin(self.screened.reason, (KEPT, WEAK, NEAR))))

    def _rows(self, gauges: np.ndarray) -> PoolRows:
        return pool_of(gauges, self.problem.channels, self.structure.pool, self.config.place.symmetry)

    @blame("place.keep")
    def _limits(self, place: LayoutSettings, pool: PoolRows) -> Limits:
        """Limits of a layout."""
        price = prices(self.config, pool, self.structure.pool)
        return layout_limits(place, pool, self.structure.mesh, self.structure.pool, price)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates in training (n, n), the weighted mean over load cases."""
        moved = [np.cov(case.x[:, : case.model.size], rowvar=False) for case in self.problems]
        if len(moved) == 1:
            return moved[0]
        return np.asarray(np.average(moved, axis=0, weights=[case.run.weight for case in self.problems]))

    @cached_property
    def installation(self) -> np.ndarray:
        """Variance of installation errors that the placement avoids (cases, m) [unit²], else 0."""
        if not avoids_errors(self.config):
            return np.zeros((len(self.problems), len(self.screened.noise_std)))
        if self.screened.installation is None:
            raise ConfigError(
                "the results of `screen` do not include gauge installation errors, but place.installation needs them",
                key="place.installation",
                remedy="Run the stage `screen` again with this config.",
            )
        return self.screened.installation

    def tasks(self) -> list[Task]:
        shares = SHARES if self.installation.any() else SHARES[:1]
        return [self._task(self.pool, share, self._all_candidates(share)) for share in shares]

    def expectation(self, gauges: np.ndarray) -> Expectation:
        return worst_case(self.expectations(gauges), [problem.acts for problem in self.problems])

    def expectations(self, gauges: np.ndarray) -> list[Expectation]:
        """Expected σ in every load case."""
        tolerances = tolerated(self.structure, self.problem.channels.of(gauges))
        return [expectation(problem, gauges, tolerances) for problem in self.problems]

    def slow_loads(self, gauges: np.ndarray, expected: Expectation) -> tuple[str, ...]:
        """Advice on slower loads; none with load cases, or if the training simulation is static."""
        if self.problems[0].run.name or self.config.train.model == "static":
            return ()
        tolerances = tolerated(self.structure, self.problem.channels.of(gauges))
        return tuple(slow_load_advice(self.problem, tolerances, gauges, expected))

    def listed(self, gauges: np.ndarray) -> GaugeList:
        return listed_gauges(gauges, self.structure.training, self.screened)

    def redundant(self, gauges: np.ndarray) -> list[tuple[int, ...]]:
        return redundant_gauges(self.problem, gauges, self.covariance)

    def _single(self, gauges: np.ndarray, share: float) -> list[Pool]:
        """Pools with one row per gauge (k,), with installation errors as in `_scenarios`."""
        scenarios = self._scenarios(self.problem.channels.of(gauges), share)
        return [solve_pool(scenario) for scenario in chain(*scenarios)]

    def _scenarios(self, channels: np.ndarray, share: float) -> list[tuple[Scenario, ...]]:
        """Scenarios of every load case; share: correlation time of installation errors relative to its duration."""
        added = [
            share * problem.run.duration * v if share else None
            for problem, v in zip(self.problems, self.installation, strict=True)
        ]
        return [
            scenarios_of(problem, channels, self.config, more)
            for problem, more in zip(self.problems, added, strict=True)
        ]

    def _solved(self, scenarios: Sequence[Sequence[Scenario]]) -> tuple[Pool, ...]:
        with blame("place.estimate"):
            names = self.problem.unknowns.state_names
            return tuple(self.using.sweep(solve_named_pool, tuple(chain(*scenarios)), names))

    def _all_candidates(self, share: float) -> Every | None:
        """Scenarios solved with all candidates, and the limits without spacing, as a bound without spacing remains valid; None if
        the layout is of the pool."""
        place = self.config.place
        if place.search == "pool" or len(self.every.gauges) == len(self.pool.gauges):
            return None
        without_spacing = place.model_copy(update={"minimum_spacing": 0.0})
        return self._solved(self._scenarios(self.every.channels, share)), self._limits(without_spacing, self.every)

    def _task(self, pool: PoolRows, share: float, every: Every | None) -> Task:
        config, problem = self.config, self.problem
        unknowns, scenarios = problem.unknowns, self._scenarios(pool.channels, share)
        pools, whole = self._solved(scenarios), None
        if every is not None and len(pool.gauges) < len(self.every.gauges):
            rows = np.flatnonzero(np.isin(self.every.gauges[:, 0], pool.gauges[:, 0]))

            def task_with(rows: np.ndarray) -> Task:
                return self._task(self._rows(np.sort(self.every.gauges_of(rows))), share, every)

            whole = Whole(*every, rows, task_with)
        cases = self._cases([len(of_case) for of_case in scenarios])
        return Task(
            UnknownStates(
                unknowns.names,
                unknowns.state_names,
                np.asarray(unknowns.position(problem.model)) - len(pools[0].P),
                unknowns.scale if cases is None else cases.amplitude(),
                np.ones(len(unknowns.names)),
            ),
            pools,
            self.structure.pool,
            pool,
            prices(config, pool, self.structure.pool),
            self._limits(config.place, pool),
            config.place,
            self._readings(pool),
            config.seed,
            config.place.aggregate,
            config.place.weights,
            coherence=share * config.train.duration,
            cases=cases,
            whole=whole,
            single=partial(self._single, share=share),
        )

    def _cases(self, count: Sequence[int]) -> LoadCases | None:
        """Load cases with `count` scenarios each; None for the configured loads."""
        problems = self.problems
        if not problems[0].run.name:
            return None
        return LoadCases(
            tuple(problem.run.name for problem in problems),
            np.array([problem.run.weight for problem in problems]),
            np.repeat(np.arange(len(problems)), count),
            np.array([problem.acts for problem in problems]),
            np.array([problem.unknowns.scale for problem in problems]),
        )

    def _readings(self, pool: PoolRows) -> PoolReadings:
        """Pool rows per reduced coordinate, of accelerometers at the guess."""
        p, channels = self.problem, pool.channels
        F = linearise(p.model, p.unknowns, p.model.reference, p.x[:1], instant_values(p.u)[:1])[0]
        every = measurement_rows(p.channels.rows, p.channels.quantity, F)[:, : p.model.size]
        return PoolReadings(of_channels(every, channels), p.channels.noise_std[channels] ** 2, self.covariance)


def _ringing(problem: Problem, config: PlacementConfig) -> str:
    """Warning about instants in the initial transient; empty without parameters, as the instant then has no effect."""
    p, case = problem, problem.run.name
    if not p.unknowns.parameters:
        return ""
    instants = placed_instants(p, p.model.reference, p.x, config)
    words = ringing_in_words(p.run.settle, p.loading, p.model, instants)
    return f"Load case {case}: {words}" if case and words else words


def _worst_observability(placement: Placement, subject: _OnStructure) -> Observability:
    """Observability at the first instant of the load case with the largest condition number."""
    task = placement.task
    of = np.zeros(1, dtype=int) if task.cases is None else task.cases.of
    first = [task.pools[int(np.flatnonzero(of == case)[0])] for case in range(len(subject.problems))]
    every = [
        _observability(problem, pool.scenario.scaled(1 / pool.scale), subject.structure, task.pool)
        for problem, pool in zip(subject.problems, first, strict=True)
    ]
    return max(every, key=lambda case: case.condition)


def _observability(problem: Problem, scenario: Scenario, structure: Structure, pool: PoolRows) -> Observability:
    """Observability in unscaled coordinates x*."""
    p, n = problem, problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    exists = pool.channels >= 0
    used = pool.channels[exists]
    peak = structure.training.motion_in(p.run.name).peak[used]
    H = scenario.H[exists] if scenario.H.ndim == 3 else scenario.H
    return observability(
        scenario.F,
        H / largest_of_quantity(peak, p.channels.quantity[used])[:, None],
        names=p.unknowns.state_names,
        frequency=frequency,
        state_amplitude=amplitude,
        raw_scale=p.unknowns.state_scale,
        raw_rows=H,
    )


def placement_output(placement: StructurePlacement, mesh: Mesh, config: PlacementConfig) -> Output:
    """Output of a placement."""
    condition, by_case, hot = placement.condition, placement.by_case, placement.hot_spots
    expected, units = placement.expected, unknown_units(config)
    record = layout_record(
        Placed,
        placement,
        expected_std=expected.absolute,
        without=expected.without,
        budget=budget_of_shares(expected.budget),
        observability=condition,
        influence=placement.influence,
        frequency_response=placement.frequency_response,
        hot_spots=hot,
        at_gauges=placement.at_gauges,
        by_case=by_case,
    )
    rests, lost = load_dependence_text(placement.problem), condition.null_direction
    words = {"null_direction": lost, "rests_on_loads": rests}
    numbers: dict[str, Scalar] = {"condition": condition.condition} | {key: text for key, text in words.items() if text}
    tables: tuple[Table, ...] = (budget_table(expected.budget),)
    if by_case is not None:
        tables = (case_table(by_case, placement.task.criterion.symbol, units), *tables)
    if placement.influence is not None:
        tables += (influence_table(placement.influence, placement.listed),)
    if placement.frequency_response is not None:
        tables += (frequency_response_table(placement.frequency_response),)
    if hot is not None:
        numbers |= {"hot_spots": int(hot.hot.sum())}
        tables += (hot_spot_table(hot, placement.listed.labels),)
    attributes = {f"/expected_std/{name}": {"scale": size} for name, size in expected.reference.items()}
    length_unit = config.mesh.length_unit
    output = layout_output(placement, record, mesh, length_unit, numbers, attributes, units, tables)
    message = f"{output.message}, weakly observable: {lost}" if lost else output.message
    return replace(output, message=f"{message}; {rests}" if rests else message)

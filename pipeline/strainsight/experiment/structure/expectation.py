"""What a filter on a layout is expected to claim along the training run, with all gauges, without each; what that is made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.claim import covariance_recursion, predict_grid_std
from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.placement import Placement
from strainsight.experiment.structure.candidates import of_channels
from strainsight.experiment.structure.considered import Tolerated, build_considered, variances
from strainsight.experiment.structure.problem import SILENT, Problem, filter_model, initial_covariance, settled_under
from strainsight.ordering import first_of_largest
from strainsight.placement.score import redundant_groups, score
from strainsight.records.placed import ByCase
from strainsight.records.training import Screened, Training
from strainsight.runner.output import Table
from strainsight.sensors.candidates import STRAIN, UNITS


def expectation(problem: Problem, gauges: np.ndarray, tolerances: Tolerated) -> Expectation:
    """σ along the training run from a 100 % prior, tolerances included; its variance by source. Of a constant parameter that of
    the end, when all samples are in it; otherwise the RMS over the last half.

    gauges (k,) numbers; tolerances: those of their channels at least. A gauge that is left out has its noise raised until it
    says nothing.
    """
    channels = problem.channels.of(gauges)
    exists = channels >= 0
    flat, owner = channels[exists], np.nonzero(exists)[0]
    silent = np.where(owner == np.arange(-1, len(gauges))[:, None], SILENT, 1.0)
    model = filter_model(problem, flat, problem.h)
    model = replace(model, r=model.r * silent)
    start = initial_covariance(problem, dict.fromkeys(problem.unknowns.names, 1.0), problem.loading.moving)
    considered = build_considered(tolerances, model, flat)
    if problem.method == "bank":
        settled = settled_under(problem, problem.loading)
        claim = predict_grid_std(model, problem.x, problem.u, start, considered, settled)
    else:
        claim = covariance_recursion(model, problem.x, problem.u, start, considered)
    if not np.isfinite(claim.std).all():
        raise NumericalError(
            "the σ that the filter is to claim along the training run is not finite",
            key="train.time_step",
            remedy="the noises lie too far apart, or an unknown load is modelled as faster than the step: check both",
        )
    names = problem.unknowns.names
    variance, budget = variances(problem, claim)
    level = np.sqrt(variance)
    return Expectation(
        {name: float(level[0, i]) for i, name in enumerate(names)},
        {name: level[1:, i] for i, name in enumerate(names)},
        budget,
    )


def alike_gauges(problem: Problem, gauges: np.ndarray, covariance: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of gauges (k,), by their places in the list, that read the same quantity alike in the training run.

    Rows R L on coordinates that are uncorrelated and of unit size there, L Lᵀ = cov(q), the covariance (n, n).
    """
    values, V = np.linalg.eigh(covariance)
    L = V * np.sqrt(np.maximum(values, 0.0))
    channels = problem.channels.of(gauges)
    quantity = problem.channels.quantity[channels[:, 0]]
    groups = []
    for kind in np.unique(quantity):
        of_kind = np.flatnonzero(quantity == kind)
        rows = of_channels(problem.channels.rows, channels[of_kind])
        groups += [tuple(int(of_kind[i]) for i in group) for group in redundant_groups(rows @ L)]
    return sorted(groups)


def worst_case(cases: Sequence[Expectation], acts: Sequence[np.ndarray]) -> Expectation:
    """Of every unknown what is expected in the load case where σ, relative to its amplitude there, is largest; without a gauge
    the largest of any case. Only cases count in which the unknown acts; acts (u,) bool of each."""
    if len(cases) == 1:
        return cases[0]
    std, without, budget = {}, {}, {}
    for i, name in enumerate(cases[0].std):
        acting = [case for case, act in zip(cases, acts, strict=True) if act[i]]
        worst = acting[first_of_largest(np.array([case.std[name] for case in acting]))]
        std[name] = worst.std[name]
        without[name] = np.max([case.without[name] for case in acting], axis=0)
        budget[name] = worst.budget[name]
    return Expectation(std, without, budget)


def cases_of(placement: Placement, expected: Sequence[Expectation]) -> ByCase:
    """The load cases of a layout: weight, metric, expected σ; expected: one a case, of the layout."""
    task, cases = placement.task, placement.task.cases
    assert cases is not None
    names, every = task.unknowns.names, range(len(cases.names))
    metric = task.metrics[task.criterion.name]
    cost = [
        score(
            [task.pools[i].under(metric[case]) for i in np.flatnonzero(cases.of == case)],
            placement.final,
            task.aggregate,
        )
        for case in every
    ]
    std = np.array([[case_expectation.std[name] for name in names] for case_expectation in expected])
    return ByCase(
        name=cases.names,
        weight=cases.weight,
        scenario=cases.of,
        metric=np.array(cost),
        std={name: std[:, i] for i, name in enumerate(names)},
        acts={name: cases.acts[:, i] for i, name in enumerate(names)},
        scale={name: cases.scale[:, i] for i, name in enumerate(names)},
        worst={
            name: cases.names[first_of_largest(np.where(cases.acts[:, i], std[:, i], -np.inf))]
            for i, name in enumerate(names)
        },
    )


def case_table(cases: ByCase, symbol: str) -> Table:
    """Every load case with its weight, what the criterion is in it and what is expected of every unknown."""
    rows = tuple(
        (
            name,
            f"{cases.weight[i]:g}",
            f"{cases.metric[i]:.4g}",
            *(f"{100 * std[i]:.3g} %" if cases.acts[unknown][i] else "silent" for unknown, std in cases.std.items()),
        )
        for i, name in enumerate(cases.name)
    )
    columns = ("load case", "weight", symbol, *(f"expected σ({name})" for name in cases.std))
    return Table("load cases: σ relative to the amplitude in each", columns, rows)


def cases_in_words(cases: ByCase, aggregate: str) -> Iterator[str]:
    """In which load case every unknown is known least, and which one a worst-case layout is ruled by."""
    if len(cases.name) == 1:
        return
    least: dict[str, list[str]] = {}
    for unknown, case in cases.worst.items():
        least.setdefault(case, []).append(unknown)
    for case, unknowns in least.items():
        yield f"Of the load cases {case} is where {' and '.join(unknowns)} {'is' if len(unknowns) == 1 else 'are'} known least."
    if aggregate == "worst":
        yield f"The layout is ruled by the load case {cases.name[first_of_largest(cases.weight * cases.metric)]}."


RESOLVED = 1e-7
"""[strain] What an amplifier resolves, 0.1 µm/m: a rule of ours, for a bandwidth of some Hz to kHz."""
QUIETEST = 5e-8
"""[strain] Noise of one sample that hardly any channel stays below, 0.05 µm/m: half of that."""
LOUDER = "load the part harder, or check the unit of the load and the moduli"


def unresolved_candidates(training: Training) -> str:
    """Says that the largest training reading of every strain gauge is below `RESOLVED`; empty where some is not."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (largest := float(training.peak[straining].max())) >= RESOLVED:
        return ""
    return (
        f"The largest training reading of all gauges is {_size(largest)}: an amplifier resolves {_size(RESOLVED)}. "
        f"{LOUDER.capitalize()} (loads.*.signal, mesh.length_unit, mesh.mass_unit)."
    )


def quiet_noise(training: Training, screened: Screened) -> str:
    """Says that the noise of the strain gauges is below `QUIETEST`; empty where it is not."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (noise := float(screened.noise_std[straining].min())) >= QUIETEST:
        return ""
    return (
        f"The noise of the strain gauges is {_size(noise)} a sample, less than the {_size(QUIETEST)} that an amplifier has: σ is "
        "too small where it comes from noise. State that of yours, gauges.noise_std: {value: …} [strain]."
    )


def loud_noise(training: Training, screened: Screened) -> str:
    """Says that the noise of every sensor of a kind exceeds its largest training reading; empty where it does not."""
    loud = []
    for quantity in np.unique(training.candidates.quantity):
        alike = training.candidates.quantity == quantity
        noise, largest = float(screened.noise_std[alike].min()), float(training.peak[alike].max())
        if noise > largest:
            loud.append(f"{noise:.3g} {UNITS[quantity]}, with readings of at most {largest:.3g}")
    if not loud:
        return ""
    return (
        f"The noise of a sample exceeds every training reading: {'; '.join(loud)}. Check noise_std, which is in the unit of the "
        "reading (1 µm/m is 1e-6), and the loads."
    )


def unresolved_gauges(listed: GaugeList) -> Iterator[str]:
    """A sentence on the gauges of a layout whose largest training reading is below `RESOLVED`: that of their largest channel."""
    weak = [i for i in range(len(listed.labels)) if listed.unit[i] == UNITS[STRAIN] and listed.peak[i] < RESOLVED]
    if not weak:
        return
    those = ", ".join(f"{listed.labels[i]} ({_size(float(listed.peak[i]))})" for i in weak)
    others = "" if len(weak) == len(listed.labels) else ", or move them (gauges.include, gauges.exclude)"
    yield (
        f"Below the {_size(RESOLVED)} that an amplifier resolves is all that is read by {those} in training: {LOUDER}{others}."
    )


def _size(strain: float) -> str:
    return f"{1e6 * strain:.2g} µm/m" if np.isfinite(strain) else "nothing finite"

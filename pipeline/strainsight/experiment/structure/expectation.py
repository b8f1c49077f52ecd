"""Expected σ of a layout along the training simulation, with all gauges and without each, and its variance budget."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.claim import covariance_recursion, predict_grid_std
from strainsight.experiment.layout.advice import Expectation, sigma_text
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.placement import Placement
from strainsight.experiment.structure.budget import first_instant, variances
from strainsight.experiment.structure.candidates import of_channels
from strainsight.experiment.structure.considered import Tolerated, build_considered
from strainsight.experiment.structure.problem import SILENT, Problem, filter_model, initial_covariance, settled_under
from strainsight.experiment.structure.tolerated_masses import readings_of_mass
from strainsight.ordering import index_of_largest
from strainsight.placement.score import redundant_groups, score
from strainsight.records.placed import ByCase
from strainsight.records.training import Screened, Training
from strainsight.runner.output import Table
from strainsight.sensors.candidates import STRAIN, UNITS


def expectation(problem: Problem, gauges: np.ndarray, tolerances: Tolerated, failures: bool = True) -> Expectation:
    """σ along the training simulation from a 100 % prior, tolerances included, and its variance by source.

    For a constant parameter the final σ, else the RMS over the last half. gauges (k,): numbers; tolerances: at least of their
    channels; failures: whether σ without each gauge is wanted. The failure of a gauge is modelled by very large noise."""
    channels = problem.channels.of(gauges)
    exists = channels >= 0
    flat, owner = channels[exists], np.nonzero(exists)[0]
    silent = np.where(owner == np.arange(-1, len(gauges) if failures else 0)[:, None], SILENT, 1.0)
    plain = filter_model(problem, flat, problem.h)
    model = replace(plain, r=plain.r * silent)
    start = initial_covariance(problem, dict.fromkeys(problem.unknowns.names, 1.0), problem.loading.moving)
    considered, first = build_considered(tolerances, model, flat), first_instant(problem, len(problem.x))
    if problem.method == "grid":
        settled = settled_under(problem, problem.loading)
        by_mass = readings_of_mass(problem, plain, considered)
        claim = predict_grid_std(model, problem.x, problem.u, start, considered, settled, first, by_mass)
    else:
        claim = covariance_recursion(model, problem.x, problem.u, start, considered, first)
    if not np.isfinite(claim.std).all():
        raise NumericalError(
            "the predicted σ in the training simulation (stage `train`) is not finite",
            key="train.time_step",
            remedy="Check that the noise levels do not differ by many orders of magnitude, and that the time step resolves the "
            "load models (process_noise).",
        )
    names, reference = problem.unknowns.names, problem.reference
    variance, budget = variances(problem, claim)
    level = np.sqrt(variance) * (problem.unknowns.scale / reference)
    return Expectation(
        {name: float(level[0, i]) for i, name in enumerate(names)},
        {name: level[1:, i] for i, name in enumerate(names)},
        dict(zip(names, reference.tolist(), strict=True)),
        budget,
    )


def redundant_gauges(problem: Problem, gauges: np.ndarray, covariance: np.ndarray) -> list[tuple[int, ...]]:
    """Groups of redundant gauges (k,), by index: they read the same quantity equally in the training simulation.

    Compared are rows R L with L Lᵀ = cov(q), the covariance (n, n), so that coordinates are uncorrelated with unit variance."""
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
    """Expectation of every unknown in the load case with the largest relative σ; without a gauge, the maximum over all cases.

    acts (u,) bool: whether an unknown acts in a case; other cases do not count."""
    if len(cases) == 1:
        return cases[0]
    std, without, reference, budget = {}, {}, {}, {}
    for i, name in enumerate(cases[0].std):
        acting = [case for case, act in zip(cases, acts, strict=True) if act[i]]
        worst = acting[index_of_largest(np.array([case.std[name] for case in acting]))]
        std[name] = worst.std[name]
        without[name] = np.max([case.without[name] for case in acting], axis=0)
        reference[name], budget[name] = worst.reference[name], worst.budget[name]
    return Expectation(std, without, reference, budget)


def cases_of(placement: Placement, expected: Sequence[Expectation]) -> ByCase:
    """Weight, metric and expected σ of a layout in every load case; expected: one per case."""
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
        scale={name: np.array([case_expectation.reference[name] for case_expectation in expected]) for name in names},
        worst={
            name: cases.names[index_of_largest(np.where(cases.acts[:, i], std[:, i], -np.inf))]
            for i, name in enumerate(names)
        },
    )


def case_table(cases: ByCase, symbol: str, units: Mapping[str, str]) -> Table:
    """Table of load cases with weight, criterion and expected σ; units: of the unknowns."""
    rows = tuple(
        (
            name,
            f"{cases.weight[i]:g}",
            f"{cases.metric[i]:.4g}",
            *(
                sigma_text(std[i], cases.scale[unknown][i], units[unknown]) if cases.acts[unknown][i] else "inactive"
                for unknown, std in cases.std.items()
            ),
        )
        for i, name in enumerate(cases.name)
    )
    columns = ("load case", "weight", symbol, *(f"expected σ({name})" for name in cases.std))
    return Table(
        "load cases: σ of parameters relative to the guess, σ of loads relative to their RMS in the load case",
        columns,
        rows,
    )


def cases_in_words(cases: ByCase, aggregate: str) -> Iterator[str]:
    """Sentences on the load case with the largest σ of every unknown, and on the case that decides a worst-case layout."""
    if len(cases.name) == 1:
        return
    least: dict[str, list[str]] = {}
    for unknown, case in cases.worst.items():
        least.setdefault(case, []).append(unknown)
    for case, unknowns in least.items():
        yield f"σ of {' and '.join(unknowns)} is largest in load case {case}."
    if aggregate == "worst":
        decisive = cases.name[index_of_largest(cases.weight * cases.metric)]
        yield f"Load case {decisive} has the largest weighted criterion and determines the layout."


RESOLVED = 1e-7
"""Assumed resolution of an amplifier [strain], 0.1 µm/m, for a bandwidth of some Hz to kHz."""
QUIETEST = 5e-8
"""Smallest realistic noise of one sample [strain], 0.05 µm/m."""
LOUDER = "increase the loads, or check the units of loads and moduli"


def unresolved_candidates(training: Training) -> str:
    """Warning that the largest training reading of every strain gauge is below `RESOLVED`, else empty."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (largest := float(training.peak[straining].max())) >= RESOLVED:
        return ""
    return (
        f"The largest reading of all gauges in the training simulation (stage `train`) is {_size(largest)}, below the "
        f"amplifier resolution of {_size(RESOLVED)}. {LOUDER.capitalize()} (loads.*.signal, mesh.length_unit, mesh.mass_unit)."
    )


def quiet_noise(training: Training, screened: Screened) -> str:
    """Warning that the noise of the strain gauges is below `QUIETEST`, else empty."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (noise := float(screened.noise_std[straining].min())) >= QUIETEST:
        return ""
    return (
        f"The noise of the strain gauges is {_size(noise)} per sample, below the {_size(QUIETEST)} of a good amplifier, so σ is "
        "probably too small. Set gauges.noise_std.value [strain] to the noise of your amplifier."
    )


def loud_noise(training: Training, screened: Screened) -> str:
    """Warning that the noise of every sensor of a kind exceeds its largest training reading, else empty."""
    loud = []
    for quantity in np.unique(training.candidates.quantity):
        of_quantity = training.candidates.quantity == quantity
        noise, largest = float(screened.noise_std[of_quantity].min()), float(training.peak[of_quantity].max())
        if noise > largest:
            loud.append(f"noise {noise:.3g} {UNITS[quantity]}, largest reading {largest:.3g}")
    if not loud:
        return ""
    return (
        f"The noise of one sample exceeds every reading of the training simulation (stage `train`): {'; '.join(loud)}. Check the "
        "loads, and noise_std of these sensors: noise_std has the unit of the reading (1 µm/m is 1e-6)."
    )


def unresolved_gauges(listed: GaugeList) -> Iterator[str]:
    """Sentence on gauges of a layout whose largest training reading is below `RESOLVED`."""
    weak = [i for i in range(len(listed.labels)) if listed.unit[i] == UNITS[STRAIN] and listed.peak[i] < RESOLVED]
    if not weak:
        return
    those = ", ".join(f"{listed.labels[i]} ({_size(float(listed.peak[i]))})" for i in weak)
    others = "" if len(weak) == len(listed.labels) else ", or move these gauges (gauges.include, gauges.exclude)"
    remedy = f"{LOUDER.capitalize()}{others}"
    yield (
        f"The readings of {those} in the training simulation (stage `train`) are below the amplifier resolution of "
        f"{_size(RESOLVED)}. {remedy}."
    )


def _size(strain: float) -> str:
    return f"{1e6 * strain:.2g} µm/m" if np.isfinite(strain) else "not finite"

"""A parameter grid of linear filters over the parameters: exact Bayes for a model that is linear once its parameters are known.

    p(θ | y) ∝ p(θ) Πₖ p(yₖ | y₁ … yₖ₋₁, θ),     x̂ = Σ wᵢ x̂ᵢ,     P = Σ wᵢ (Pᵢ + (x̂ᵢ − x̂)(x̂ᵢ − x̂)ᵀ)

At fixed parameters the reduced model is linear, and the innovations of a Kalman filter give their likelihood, errors of
installation and damping integrated out. The extended filter, which linearises their product with the motion, is overconfident.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from strainsight.estimation.columns import columns_for, next_columns
from strainsight.estimation.grid_filter_points import (
    GridProblem,
    Passed,
    WeightedFilters,
    about_samples,
    entered,
    filtered_at,
    on,
    passed,
    refuse_lost,
)
from strainsight.estimation.mixture import C, Mixture, Weights
from strainsight.estimation.parallel_filters import KEPT
from strainsight.estimation.parameter_grid import (
    GridConstruction,
    ParameterGrid,
    build_first_grid,
    build_next_grid,
    one_point,
)
from strainsight.estimation.peak import best_points, density_of, peaks_of_problem
from strainsight.estimation.record import GridRecord
from strainsight.estimation.run import FilterRun, Keep

FEW = 3
"""Parameters that a lattice is for; of more there are columns."""
SHORTEST, SHARE = 8, 8
"""Fewest steps between two looks at the posterior, and the share of the steps so far, 1/SHARE, that is taken otherwise: it
narrows as the record grows."""
FOLLOWED = 10
"""Grids over the parameters of inconsistent measurements after which σ of the parameters is doubled."""
COARSE, REACH, TRIED, MOST_TRIED = 0.05, 3.0, 0.01, 80
"""Where resonances are looked for: share of a reading, RMS, that is believed, σ of a parameter to either side, step of its
logarithm, and most steps."""
AGAIN, STAY = 3, 0.2
"""Most times that a grid filter beside frequencies is done once more, and the change of a parameter, in σ, below which it
stays."""


@dataclass(frozen=True)
class GridRun:
    """What a grid filter found: at the end, and along the samples of a record.

    point (B, k) and weight (B,): the posterior of the parameters; nu (B, d) and left (B, d, d): mean and covariance of ν at each
    point, of frequencies beyond those that the centre asks for; about (d,): the ν about which readings are linear, centre (k,):
    the parameters, as of `ConsideredParameters`; laid: how often the lattice was; step (k,): its steps along every
    parameter, infinite of columns; run: as a filter's, of one run; its σ holds what the nuisances add.
    """

    point: np.ndarray
    weight: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    about: np.ndarray
    centre: np.ndarray | None
    laid: int
    step: np.ndarray
    run: FilterRun

    @property
    def posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (k,) and covariance (k, k) of the parameters."""
        mean = self.weight @ self.point
        off = self.point - mean
        return mean, (off * self.weight[:, None]).T @ off

    @property
    def nu_moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (d,) and covariance (d, d) of ν."""
        mean = self.weight @ self.nu
        off = self.nu - mean
        return mean, np.einsum("b,bdk->dk", self.weight, self.left) + (off * self.weight[:, None]).T @ off


def filter_on_grid(record: GridRecord, keep: Keep = "all") -> GridRun:
    """Posterior of the parameters, which are constant, and of all states along the samples.

    keep: "all" keeps the covariance of every instant, "parameters" nothing but these, in half the time.
    The lattice begins at the prior. It is laid anew about the posterior, and filtered again from the start, whenever that has
    narrowed or moved to its edge. Over more than FEW parameters there are `Columns` in place of it. Beside a damping, a frequency
    or free loads readings are linear about the ν that all samples speak for at the most likely parameters, and at their mean
    (`about_samples`). Raises NumericalError where a lattice would need more than MOST_POINTS points, where no columns follow the
    posterior, and where that leaves the guess by a factor of exp(LOST).
    """
    return filter_records([record], keep)[0]


def filter_records(
    records: Sequence[GridRecord],
    keep: Keep = "all",
    *,
    progress: Callable[[float], None] | None = None,
    birge_ratio: float = 1.0,
) -> tuple[GridRun, ...]:
    """Posterior of parameters that several records share: a run of each, the posterior at the end of all of them in every one.

        p(θ, ν | y) ∝ p(θ) p(ν) Πᵣ p(yᵣ | θ, ν)

    Parameters and ν are constants of all records (what is a record's own has columns of its own, `each_its_own`). Motion, loads
    and offsets begin in each as mean and covariance of the first one say, independent of the others: at a boundary their step
    has a transition of zero and the covariance of the prior. Records may differ in step and noise; unknowns, channels and ν are
    the same. progress: called with the share of the steps done.
    birge_ratio: as of `GridProblem`, above 1 of measurements that are inconsistent with the model. Their parameters move by many
    σ from sample to sample: the ratio is doubled after every FOLLOWED grids, which bounds their number.
    Other arguments as of `filter_on_grid`.
    """
    along = keep != "parameters"
    problem = GridProblem(tuple(records), keep, progress, True, along, birge_ratio)
    if problem.bilinear:
        problem = _centred(problem)
    ends = replace(problem, along=False)
    peaks = peaks_of_problem(ends) if problem.bilinear or 0 < len(problem.prior[0]) <= FEW else []
    held = np.array([peak.point for peak in peaks])
    if not problem.bilinear:
        return _covered(problem, held)
    before = max(peaks, key=lambda peak: peak.evidence).point
    here = filtered_at(ends, one_point(before), problem.first[-1])
    problem = replace(about_samples(ends, before, here.states.nu[0, 0] + here.models.about), along=problem.along)
    runs = _covered(problem, held)
    # what slopes in a frequency leave out at first, the parameters take for theirs
    for _ in range(AGAIN if problem.centre is not None else 1):
        mean, covariance = runs[0].posterior
        if problem.centre is not None and np.all(np.abs(mean - before) <= STAY * np.sqrt(np.diag(covariance))):
            break
        again = about_samples(problem, mean, runs[0].nu_moments[0])
        if again is problem:
            break
        problem, before, runs = again, mean, _covered(replace(again, progress=None), held)
    return runs


def _centred(problem: GridProblem) -> GridProblem:
    """With frequencies about those at the most likely of parameters that are tried one after the other, each with frequencies
    about its own: the resonances that the samples show. A lattice that narrows with the first samples may take the resonance of
    another mode for them. Readings are believed to COARSE of their RMS, as slopes in a frequency are no better."""
    if not problem.records[0].considered.frequency.any():
        return problem
    coarse = problem.map_considered(lambda each: replace(each, discrepancy=max(each.discrepancy, COARSE)))
    coarse, (centre, covariance) = replace(coarse, along=False), problem.prior
    for i, std in enumerate(np.sqrt(np.diag(covariance))):
        count = int(np.clip(2 * REACH * std / TRIED, 2, MOST_TRIED))
        points = centre + np.linspace(-REACH * std, REACH * std, count + 1)[:, None] * np.eye(len(centre))[i]
        centre = points[best_points(points, density_of(coarse), problem.first[-1])[0][0]]
    return problem.map_considered(partial(replace, centre=centre))


def _covered(problem: GridProblem, held: np.ndarray) -> tuple[GridRun, ...]:
    """A run of every record, by a lattice over few parameters, by columns over more.

    A lattice follows the posterior as the record grows, and few samples may have peaks far from those of all: between resonances,
    or beyond the prior. It keeps hold of the peaks (q, k) of the whole record from its second laying on."""
    if len(problem.model.unknowns.parameters) > FEW:
        return _filtered(problem, columns_for(problem, *problem.prior, 0), next_columns, at_end=True)
    first = build_first_grid(_construction(problem, held))
    return _filtered(problem, first, lambda problem, now: build_next_grid(_construction(problem, held), now))


def _construction(problem: GridProblem, held: np.ndarray) -> GridConstruction[WeightedFilters[ParameterGrid]]:
    at, refuse = partial(filtered_at, problem), partial(refuse_lost, problem)
    return GridConstruction(problem.prior, at, refuse, held=held)


def _filtered(
    problem: GridProblem,
    now: WeightedFilters[C],
    following: Callable[[GridProblem, WeightedFilters[C]], WeightedFilters[C]],
    at_end: bool = False,
) -> tuple[GridRun, ...]:
    """Through all samples, from points of the parameters laid at first, with those that follow; at_end: and once more at the
    end, where what they say is the better, the nearer they are."""
    steps, laid, mixtures = problem.first[-1], 1, [_mixture(problem, now)]
    while now.step < steps:
        if now.step == problem.first[now.record + 1]:
            now = entered(problem, now)
            mixtures.append(_mixture(problem, now))
        before = problem.first[now.record]
        rest = problem.first[now.record + 1] - now.step
        ahead = min(max(SHORTEST, now.step // SHARE), rest, max(1, KEPT // now.models.kept_a_step))
        constants = now.filters.nu[:, None].copy(), now.filters.left[:, None].copy()
        passage = passed(problem, now, ahead, keep=problem.along)
        after = (now.log_weight[:, None] + np.cumsum(passage.fit, axis=1)).T
        good = now.cover.holds(after)
        used = ahead if good.all() else int(np.argmin(good)) + 1
        span = slice(now.step - before, now.step - before + used)
        earlier = now.cover.weights(np.concatenate([now.log_weight[None], after[: used - 1]]))
        weights = now.cover.weights(after[:used])
        mixtures[-1].innovations(span, earlier, constants, passage.passage)
        mixtures[-1].log_likelihood += _likely(now, passage, earlier, weights, used)
        mixtures[-1].states(span, weights, passage.states.first(used), now.models)
        now = on(now, passage, used)
        if problem.progress is not None:
            problem.progress(now.step / steps)
        if not good.all() or (at_end and now.step == steps):
            if problem.birge_ratio > 1 and laid % FOLLOWED == 0:
                problem = replace(problem, birge_ratio=2 * problem.birge_ratio)
                now = replace(now, fit=now.fit / 4)
            now, laid = following(problem, now), laid + 1
            # the last of these steps, which the points before are no longer good for
            last = slice(now.step - before - 1, now.step - before)
            mixtures[-1].states(last, now.weights, now.states, now.models)
    states, about = now.states, now.models.about
    point, weight, nu, left = now.weights.sampled(states.nu[:, 0], states.left[:, 0])
    end = point, weight, nu + about, left, about, problem.centre, laid, now.cover.step
    return tuple(GridRun(*end, run=mixture.finished()) for mixture in mixtures)


def _likely(now: WeightedFilters[C], passage: Passed, before: Weights, after: Weights, steps: int) -> float:
    """ln p of these steps under the loads as stated: by the mass that the points lose; with a judge, whose weights are none of
    that density, by Σₜ ln Σᵢ wᵢ p(yₜ | y₁ … yₜ₋₁, θᵢ) with those before each step."""
    if now.judge is None:
        return float(after.log_mass[-1] - before.log_mass[0])
    with np.errstate(divide="ignore"):
        each = passage.passage.fit[:, :steps].T + np.log(before.positive)
    return float(np.logaddexp.reduce(each, axis=1).sum())


def _mixture(problem: GridProblem, now: WeightedFilters[C]) -> Mixture:
    """Of a record that begins."""
    first, record = problem.records[0], problem.records[now.record]
    mixture = Mixture(replace(record, mean=first.mean, covariance=first.covariance), problem.keep)
    if now.record or record.settled is not None:
        mixture.begin(now.weights, now.states, now.models, informed=now.record > 0)
    return mixture

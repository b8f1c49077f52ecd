"""Estimate of a record of a test: loads, parameters, channels and virtual gauges (1.53-1.60), and the hold-out test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import acceleration_rows, known_ends, theta_at
from strainsight.estimation.consistency import InnovationCheck, check_innovations
from strainsight.estimation.decision import Decision
from strainsight.estimation.model import surface_reading
from strainsight.estimation.smoother import Smoothed
from strainsight.estimation.update import output_std
from strainsight.experiment.hold_out import applied_factor
from strainsight.experiment.structure.considered import SOURCE
from strainsight.experiment.structure.consistency import ConsistencyResult, clock_in_words
from strainsight.experiment.structure.filtering import histories, posteriors_of
from strainsight.experiment.structure.problem import damping_dependence_text, load_dependence_text, scheme_in_words
from strainsight.experiment.structure.record_filter import (
    LONGEST_COMPARED,
    FilteredRecord,
    RecordFilter,
    budget_in,
    filter_together,
)
from strainsight.experiment.structure.surface import Skin, Virtual, moment_of, resultants_of, surface_grid
from strainsight.loads.histories import instant_values
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.estimated import ChannelOffsets, Damaged, Estimated, HoldOut, TestChannels, TestSource
from strainsight.records.placed import budget_of_shares
from strainsight.sensors.installation import COMMON_GAIN


@dataclass(frozen=True)
class Estimation:
    """Estimate of one record.

    estimated: histories, channels and strains; judgement: consistency with the model; decision: whether σ is reported, from all
    records; surface: fields in time, None if not configured."""

    estimated: Estimated
    judgement: ConsistencyResult
    decision: Decision
    surface: VtkHdf | None

    @cached_property
    def innovation_check(self) -> InnovationCheck:
        """Consistency check of the innovations."""
        return check_innovations(self.estimated.whitened)

    @property
    def innovations_in_words(self) -> str:
        """Result of the innovation check; empty for an inconsistent record, whose message states the innovations."""
        return self.innovation_check.text if self.judgement.trusted else ""


@dataclass(frozen=True)
class Common:
    """Data common to all records of a test; skin: None without a surface; tolerances, notes: sentences."""

    config: PlacementConfig
    decision: Decision
    skin: Skin | None
    virtual: Virtual | None
    tolerances: tuple[str, ...]
    notes: tuple[str, ...]


def estimation_of_record(
    common: Common,
    source: TestSource,
    record: RecordFilter,
    result: FilteredRecord,
    judgement: ConsistencyResult,
    hold_out: HoldOut | None,
    damage: Damaged | None,
) -> Estimation:
    """Collect the estimate of one record; damage: if the test is only this record."""
    config, skin, withheld = common.config, common.skin, common.decision.withheld
    problem, model, test = record.problem, record.model, record.test
    assert config.estimate is not None
    budget, no_budget = ({}, ()) if withheld else budget_in(record, result)
    if withheld:
        result = result.without_sigma()
    run, smoothed, factor = result.run, result.smoothed, applied_factor([hold_out])
    field = smoothed if factor == 1 else smoothed.with_sigma_times(factor)
    sampled = slice(test.every - 1, None, test.every)
    offsets = slice(model.size, model.size + len(record.biased))
    mean, std = (values[-1, 0, offsets] for values in (smoothed.mean, smoothed.std))
    estimated = Estimated(
        time=test.time[0] + run.time,
        **histories(model, run, smoothed),
        gauge=TestChannels(
            time=test.time[1:],
            label=test.labels,
            channel=test.channels,
            measured=test.values,
            estimated=run.gauge_mean[sampled, 0],
            std=run.gauge_std[sampled, 0],
            noise_std=record.noise_std,
        ),
        whitened=run.whitened[sampled, 0],
        bias=ChannelOffsets(channel=record.biased, mean=mean, std=std) if len(record.biased) else None,
        resultant=resultants_of(config.loads, problem.unknowns.inputs, model, smoothed),
        known=dict(zip(problem.known, instant_values(test.known).T, strict=False)),
        source=source,
        notes=_notes(common, record, no_budget),
        posterior={} if withheld or record.records > 1 else posteriors_of(problem, record.start, result.grid_run),
        trusted=judgement.trusted,
        check=judgement.check,
        virtual=None if common.virtual is None else common.virtual.smoothed(model, run, field),
        moment=None if skin is None else moment_of(skin, record, run, field),
        compared=result.compared,
        budget=budget_of_shares(budget),
        hold_out=hold_out,
        damage=damage,
    )
    of_surface = None if damage is None else damage.surface
    surface = None if skin is None else surface_grid(skin, model, field, config.estimate.field, of_surface)
    return Estimation(estimated, judgement, common.decision, surface)


def _notes(common: Common, record: RecordFilter, no_budget: Sequence[str]) -> tuple[str, ...]:
    """Notes on corrections of the measurements and on limits of the estimate."""
    config, problem, withheld = common.config, record.problem, common.decision.withheld
    others, comparable = "", problem.method == "grid" and problem.unknowns.parameters
    if withheld and config.filter.compare:
        others = "σ is withheld, so filters are not compared (filter.compare)"
    elif not withheld and record.long and config.filter.compare is None and comparable:
        others = f"filters are not compared, because the record has more than {LONGEST_COMPARED} steps (set filter.compare: true)"
    as_stated = config.estimate is not None and config.estimate.loads_follow_model
    notes = (
        *record.test.notes,
        clock_in_words(record.test, config.train.time_step),
        scheme_in_words(problem, record.test.h),
        *common.tolerances,
        "" if common.decision.message else load_dependence_text(problem),
        "" if as_stated else damping_dependence_text(problem),
        others,
        *no_budget,
        *common.notes,
    )
    return tuple(filter(None, notes))


@dataclass(frozen=True)
class FilteredGauges:
    """Hold-out `System` of a test: all channels of one gauge are left out together, in all records.

        ŷ = H x̂ˢ,     σ² = H Pˢ Hᵀ + R + Σₖ (Dₖ x̂ˢ + Eₖ w + oₖ)² + σ_b²

    x̂ˢ, Pˢ: smoothed from the other channels; H: with the column θ ∂H/∂θ q̂ of an estimated thickness; R: of one sample; D, E, o:
    installation errors; σ_b: of an unknown offset. undetectable_by: names the unknowns that channels (k,) of train.h5 cannot
    determine; withheld: whether σ is withheld (NaN)."""

    filters: Sequence[RecordFilter]
    undetectable_by: Callable[[np.ndarray], str]
    withheld: bool

    @property
    def labels(self) -> Sequence[str]:
        return self.filters[0].test.labels

    @property
    def available(self) -> np.ndarray:
        return np.ones(len(self.labels), dtype=bool)

    @property
    def parts(self) -> Sequence[np.ndarray]:
        first = self.filters[0]
        owner = first.problem.channels.gauge[first.test.channels]
        return [np.flatnonzero(owner == gauge) for gauge in np.unique(owner)]

    @property
    def measured(self) -> Sequence[np.ndarray]:
        return [record.test.values for record in self.filters]

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        rest = np.setdiff1d(np.arange(len(self.labels)), part)
        hidden = self.undetectable_by(self.filters[0].test.channels[rest]) if len(rest) else "any unknown"
        if hidden:
            return (), f"the other gauges cannot determine {hidden}"
        try:
            results = filter_together([record.of_channels(rest) for record in self.filters])
        except NumericalError as error:
            omitted = ", ".join(self.labels[i] for i in part)
            return (), f"the filter without {omitted} failed: {error.what}"
        smoothed = [(result.without_sigma() if self.withheld else result).smoothed for result in results]
        return [_predicted(record.of_channels(part), by) for record, by in zip(self.filters, smoothed, strict=True)], ""


def _predicted(record: RecordFilter, smoothed: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Predicted readings (T, c) of the channels, and their σ."""
    model, test, considered = record.model, record.test, record.considered
    states, sampled = model.parameter_states.start, slice(model.every, None, model.every)
    x = smoothed.mean[sampled, 0]
    assert smoothed.covariance is not None
    P = smoothed.covariance[sampled, 0, : model.size, : model.size]
    theta = theta_at(model, x[-1:, model.parameter_states])
    read = model.rows_at(theta).reshape(-1, model.size)
    H, fed = read[:, :states].copy(), np.zeros((len(test.channels), len(model.known_inputs)))
    slope = np.zeros((1, len(H), model.size - states))
    if model.change.terms:
        _, J = surface_reading(model, model.H[:, : model.model.size], model.change, x[:, : model.size])
        slope = J[..., model.parameter_states]
    if model.accelerometers is not None:
        moving = model.accelerometers
        on_states, on_known = acceleration_rows(model, theta, read[moving, : model.model.size])
        H[moving], fed[moving], slope[:, moving] = on_states[0], on_known[0], 0.0
    J = np.concatenate([np.broadcast_to(H, (len(slope), *H.shape)), slope], axis=-1)
    ends = known_ends(test.known, considered)[model.every - 1 :: model.every]
    installation = np.einsum("dmn,tn->tdm", considered.D, x[:, :states]) + np.einsum("dmp,tp->tdm", considered.E, ends)
    installation += considered.offset
    if model.unknowns.inputs:
        # an unknown load follows the gain that the other gauges share with these
        installation[:, np.array(considered.source) == SOURCE[COMMON_GAIN]] = 0.0
    loads = test.known.sum(axis=1)[model.every - 1 :: model.every]
    variance = output_std(J, P) ** 2 + model.noise + np.sum(installation**2, axis=1) + test.bias**2
    return x[:, :states] @ H.T + loads @ fed.T, np.sqrt(variance)

"""What the filter makes of a record of a test, what no gauge measured (1.53-1.60), and every gauge by the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import acceleration_rows, known_ends, theta_at
from strainsight.estimation.consistency import Tuning, Verdict, verdict
from strainsight.estimation.decision import Decision
from strainsight.estimation.model import surface_reading
from strainsight.estimation.smoother import Smoothed
from strainsight.estimation.update import output_std
from strainsight.experiment.structure.diagnosed import Judgement, clock_in_words
from strainsight.experiment.structure.filtered_test import (
    LONGEST_COMPARED,
    Filtered,
    Filtering,
    budget_in,
    filtered,
    filtered_together,
)
from strainsight.experiment.structure.filtering import histories, posteriors_of
from strainsight.experiment.structure.measured import RecordSettings
from strainsight.experiment.structure.nuisances import exact_frequencies_in_words
from strainsight.experiment.structure.problem import judged_as_stated_in_words, rests_on_loads_in_words, scheme_in_words
from strainsight.experiment.structure.references import unknown_units
from strainsight.experiment.structure.surface import Skin, Virtual, grid_of, moment_of, resultants_of, virtual_labels
from strainsight.loads.histories import instant_values
from strainsight.loads.input_models import Unknowns
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.estimated import Channels, Damaged, Estimated, HoldOut, Offsets, Source
from strainsight.records.placed import budget_of_shares
from strainsight.sensors.candidates import UNITS, units_in_words


@dataclass(frozen=True)
class Estimation:
    """What a record of a test says.

    unknowns; estimated: histories, channels and strains; units: of what it holds; channel_units: of every channel; judgement:
    whether the record is consistent with the model; decision: whether σ is given, by all records; labels of the virtual
    gauges; surface: its pictures in time, None where none are asked for.
    """

    unknowns: Unknowns
    estimated: Estimated
    units: Mapping[str, str]
    channel_units: tuple[str, ...]
    judgement: Judgement
    decision: Decision
    labels: tuple[str, ...]
    surface: VtkHdf | None

    @cached_property
    def verdict(self) -> Verdict:
        """On the innovations."""
        return verdict(self.estimated.whitened)

    @property
    def innovations_in_words(self) -> str:
        """The verdict on the innovations; empty where a fault is named, or where they are as claimed and the record is
        inconsistent with the model all the same."""
        inconsistent = self.verdict.consistent and not self.judgement.trusted
        return "" if inconsistent or self.estimated.check.candidate else self.verdict.text


@dataclass(frozen=True)
class Common:
    """What records of a test have in common: decision, undetectable and tuning as of a campaign; bare: why there are no strain
    and stress of the surface; not_held: tolerances that σ does not hold; virtual: gauges that are not there; damage: what
    its reader has to know."""

    decision: Decision
    undetectable: str
    bare: tuple[str, ...]
    tuning: Tuning | None
    not_held: tuple[str, ...]
    virtual: Virtual | None
    damage: tuple[str, ...]


def estimation_of_record(
    config: PlacementConfig,
    skin: Skin | None,
    record: RecordSettings,
    source: Source,
    given: Filtering,
    found: Filtered,
    judgement: Judgement,
    without: HoldOut | None,
    damage: Damaged | None,
    common: Common,
) -> Estimation:
    """Of one record, σ as claimed; without: every gauge by the others; damage: of a test that is this record."""
    settings, problem, test, withheld = record.settings, given.problem, given.test, common.decision.withheld
    budget, no_budget = ({}, ()) if withheld else budget_in(given, found)
    if withheld:
        found = found.without_sigma()
    model, run, smoothed = given.model, found.run, found.smoothed
    resultants = resultants_of(config.loads, problem.unknowns.inputs, model, smoothed)
    kinds = problem.channels.quantity[test.channels]
    sampled = slice(test.every - 1, None, test.every)
    offsets = slice(model.size, model.size + len(given.biased))
    mean, std = (values[-1, 0, offsets] for values in (smoothed.mean, smoothed.std))
    estimated = Estimated(
        time=test.time[0] + run.time,
        **histories(model, run, smoothed),
        gauge=Channels(
            time=test.time[1:],
            label=test.labels,
            channel=test.channels,
            measured=test.values,
            estimated=run.gauge_mean[sampled, 0],
            std=run.gauge_std[sampled, 0],
            noise_std=np.sqrt(model.noise.reshape(-1, len(test.labels)).mean(axis=0)),
        ),
        whitened=run.whitened[sampled, 0],
        bias=Offsets(channel=given.biased, mean=mean, std=std) if len(given.biased) else None,
        resultant={str(i): own for i, own in enumerate(resultants.values())},
        known=dict(zip(problem.known, instant_values(test.known).T, strict=False)),
        source=source,
        notes=_notes(config, given, judgement, common, no_budget),
        posterior={} if withheld or given.records > 1 else posteriors_of(problem, given.start, found.bank),
        trusted=judgement.trusted,
        check=judgement.check,
        virtual=None if common.virtual is None else common.virtual.smoothed(model, run, smoothed),
        moment=None if skin is None else moment_of(skin, given, run, smoothed),
        compared=found.compared,
        budget=budget_of_shares(budget),
        hold_out=without,
        damage=damage,
    )
    units = {name: load.unit for name, load in config.loads.items()} | unknown_units(config)
    units |= {"the channel": units_in_words(kinds), "the biased channel": units_in_words(kinds[given.biased])}
    return Estimation(
        problem.unknowns,
        estimated,
        units,
        tuple(UNITS[kind] for kind in kinds),
        judgement,
        common.decision,
        virtual_labels(settings.virtual),
        grid_of(settings, skin, given, smoothed, None if damage is None else damage.surface),
    )


def _notes(
    config: PlacementConfig, given: Filtering, judgement: Judgement, common: Common, no_budget: Sequence[str]
) -> tuple[str, ...]:
    """What a reader has to know of the estimate, sentence by sentence."""
    problem, test, tuning, withheld = given.problem, given.test, common.tuning, common.decision.withheld
    accepted = replace(common.decision, inconsistent=judgement.words).message
    others, comparable = "", problem.method == "bank" and problem.unknowns.parameters
    if withheld and config.filter.compare:
        others = "filter.compare: other filters are not compared where σ is withheld"
    elif not withheld and given.long and config.filter.compare is None and comparable:
        others = f"more than {LONGEST_COMPARED} steps: other filters are compared with filter.compare: true"
    stated = "" if config.estimate is None or config.estimate.loads_as_stated else judged_as_stated_in_words(problem)
    hidden, tuned, untuned = common.undetectable, "", ""
    if tuning:
        tuned = ", ".join(f"{part} {value:.3g}" for part, value in tuning.factors.items())
        untuned = ", ".join(tuning.undecided)
    notes = (
        *test.notes,
        clock_in_words(test, config.train.time_step),
        scheme_in_words(problem, test.h),
        *common.not_held,
        "" if withheld else exact_frequencies_in_words(config),
        withheld or accepted or rests_on_loads_in_words(problem),
        stated,
        others,
        *no_budget,
        *common.bare,
        f"the channels cannot tell {hidden}: what is estimated of it comes from the initial values" if hidden else "",
        f"noises were scaled by the measurements: {tuned}" if tuned else "",
        f"the measurements say nothing about the noise of {untuned}" if untuned else "",
        *common.damage,
    )
    return tuple(filter(None, notes))


@dataclass(frozen=True)
class FilteredGauges:
    """The `System` of a test with a filter: all channels of one gauge are left out together, of all records.

        ŷ = H x̂ˢ,     σ² = H Pˢ Hᵀ + R + Σₖ (Dₖ x̂ˢ + Eₖ w + oₖ)² + σ_b²

    x̂ˢ, Pˢ smoothed from the other channels; H with the column θ ∂H/∂θ q̂ of a free thickness; R of one sample; D, E, o what
    the gauge's own installation may be off by (`Nuisances`), and σ_b the σ of its unknown offset. tells: in words, what some
    channels (k,) of train.h5 cannot tell, empty where nothing; withheld: whether σ is, which then is NaN.
    """

    each: Sequence[Filtering]
    tells: Callable[[np.ndarray], str]
    withheld: bool

    @property
    def labels(self) -> Sequence[str]:
        return self.each[0].test.labels

    @property
    def available(self) -> np.ndarray:
        return np.ones(len(self.labels), dtype=bool)

    @property
    def parts(self) -> Sequence[np.ndarray]:
        owner = self.each[0].problem.channels.gauge[self.each[0].test.channels]
        return [np.flatnonzero(owner == gauge) for gauge in np.unique(owner)]

    @property
    def measured(self) -> Sequence[np.ndarray]:
        return [record.test.values for record in self.each]

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        rest = np.setdiff1d(np.arange(len(self.labels)), part)
        lost = self.tells(self.each[0].test.channels[rest]) if len(rest) else "anything"
        if lost:
            return (), f"the others cannot tell {lost}"
        try:
            others = [record.by(rest) for record in self.each]
            found = filtered_together(others) if len(others) > 1 else (filtered(others[0]),)
        except NumericalError as error:
            return (), f"the others cannot tell {error.what}"
        smoothed = [(one.without_sigma() if self.withheld else one).smoothed for one in found]
        return [_predicted(own.by(part), later) for own, later in zip(self.each, smoothed, strict=True)], ""


def _predicted(given: Filtering, found: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Readings (T, c) of the channels of `given`, and their σ."""
    model, test, nuisances = given.model, given.test, given.nuisances
    states, sampled = model.parameter_states.start, slice(model.every, None, model.every)
    x = found.mean[sampled, 0]
    assert found.covariance is not None
    P = found.covariance[sampled, 0, : model.size, : model.size]
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
    ends = known_ends(test.known, nuisances)[model.every - 1 :: model.every]
    own = np.einsum("dmn,tn->tdm", nuisances.D, x[:, :states]) + np.einsum("dmp,tp->tdm", nuisances.E, ends)
    own += nuisances.offset
    loads = test.known.sum(axis=1)[model.every - 1 :: model.every]
    variance = output_std(J, P) ** 2 + model.noise + np.sum(own**2, axis=1) + test.bias**2
    return x[:, :states] @ H.T + loads @ fed.T, np.sqrt(variance)

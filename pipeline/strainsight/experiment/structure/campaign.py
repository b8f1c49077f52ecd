"""Estimate from a test of one record, or of several records with common parameters and gauges."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, tolerances_of
from strainsight.errors import ConfigError, InconsistentRecordError, NumericalError
from strainsight.estimation.consistency import Tuning
from strainsight.estimation.decision import Decision
from strainsight.estimation.fault_evidence import ShiftedMode, shifted_mode
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import WantedCovariances
from strainsight.experiment.hold_out import applied_factor, field_factor, held_out, left_out
from strainsight.experiment.structure.bonded_gauges import bonded_gauges
from strainsight.experiment.structure.considered import exact_frequencies_in_words, not_held_in_words, tolerated
from strainsight.experiment.structure.consistency import (
    ConsistencyResult,
    Together,
    build_check_record,
    check_consistency,
    together_of,
    turning_of,
)
from strainsight.experiment.structure.damage import damage_of_test
from strainsight.experiment.structure.estimation import Common, Estimation, FilteredGauges, estimation_of_record
from strainsight.experiment.structure.fault_text import CHECK_MODE
from strainsight.experiment.structure.filtering import (
    by_grid,
    compared,
    excluded,
    excluded_in_words,
    last_values,
    out_of_ranges,
    posteriors_of,
    ranges_in_words,
)
from strainsight.experiment.structure.measured import in_record, measured_of, records_of, source_of
from strainsight.experiment.structure.observation import undetectable
from strainsight.experiment.structure.problem import load_dependence_text, problem_of
from strainsight.experiment.structure.record_filter import (
    FilteredRecord,
    RecordFilter,
    Wants,
    filter_by_consistency,
    filter_records_on_grid,
    forecast_in_words,
    forecast_of,
    record_filters,
)
from strainsight.experiment.structure.references import unknown_units
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.surface import (
    damage_grid,
    displaced,
    skin_in_test,
    virtual_labels,
    virtual_of,
    wanted_of,
)
from strainsight.experiment.system import Resources
from strainsight.loads.input_models import Unknowns
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.estimated import Damaged, HoldOut, Posterior
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.sensors.candidates import UNITS, units_in_words

CHECKED, FILTERED, LATER, HELD = 0.4, 0.6, 0.7, 0.95
"""Progress with a short record at the channel check, at begin and end of filtering, and at the end of the hold-out test."""
SHIFTED = 2.0
"""Shift of a natural frequency over what its tolerance predicts, above which a note names the mode. σ is computed with a larger
tolerance above 1: the ratio of Birge, Phys. Rev. 40 (1932), for one tolerance."""
CHECK, REST = 0.15, 0.45
"""Time of the channel check, and of fields and files, relative to one pass of filter and smoother."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Campaign:
    """Estimate from all records of a test.

    records: estimate by record name (empty name if the test is one file); decision: whether σ is reported; undetectable: unknowns
    that the channels cannot determine, in words; tuning: factors on the noises of one record, None if not tuned; together: joint
    estimate, None for one record; posterior: by parameter; damage: of all records; surface: its grid, None if neither damage nor
    fields in time are configured; units: of unknowns and of "the channel" of a dataset; channel_units: of the channels, in
    order; labels: of the virtual gauges."""

    unknowns: Unknowns
    records: dict[str, Estimation]
    decision: Decision
    undetectable: str
    tuning: Tuning | None
    together: Together | None
    posterior: dict[str, Posterior]
    damage: Damaged | None
    surface: VtkHdf | None
    units: Mapping[str, str]
    channel_units: tuple[str, ...]
    labels: tuple[str, ...]

    @property
    def first(self) -> Estimation:
        return next(iter(self.records.values()))

    @property
    def only(self) -> Estimation | None:
        """The only record, None if there are several."""
        return self.first if len(self.records) == 1 else None


def campaign_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    screened: Screened,
    gauges: np.ndarray,
    using: Resources,
) -> Campaign:
    """Read the files, check observability, filter and smooth, then reconstruct fields and damage.

    gauges (k,): numbers of the gauges of the layout. Raises ConfigError if no file is specified, InfeasibleError if the unknowns
    are not observable and this is not allowed, and InconsistentRecordError if every filter diverges on a faulty record or
    records are inconsistent with each other."""
    settings = config.estimate
    records = () if settings is None else records_of(settings)
    if settings is None or not records:
        raise ConfigError(
            "no measurement file is specified",
            key="estimate.file",
            remedy="Set estimate.file to the file with the measurements.",
        )
    progress, began = using.progress, time.perf_counter()

    # measured records
    progress("reading", 0.0)
    structure = Structure(config, using.files, mesh, reduced, training)
    problem = problem_of(structure, screened)
    numbers = bonded_gauges(config, training, gauges, using.files.get("estimate.gauges_file"))
    tests, load_units = [], {name: load.unit for name, load in config.loads.items()}
    for entry in records:
        with in_record(entry.label):
            tests.append(measured_of(entry, using.files[entry.file], problem, numbers, load_units))
    channels = tests[0].channels

    def undetectable_by(some: np.ndarray, allowed: bool = True) -> str:
        return undetectable(problem, some, config.place.instants, config.seed, allowed)

    hidden = undetectable_by(channels, settings.allow_unobservable)

    # filters
    progress("model", 0.2)
    tolerances = tolerated(structure, channels)
    filters, tuning = record_filters(config, problem, tolerances, tests)
    field = displaced(reduced, filters[0])
    skin, bare = skin_in_test(structure, field)
    virtual = virtual_of(structure, field)

    def wanted(record: RecordFilter, run: FilterRun) -> WantedCovariances:
        return wanted_of(config, record, virtual, run)

    passes = 1 if settings.hold_out is None else 1 + len(np.unique(problem.channels.gauge[channels]))
    # damage also tries the other random-walk model of every unknown load
    passes += len(problem.unknowns.inputs) if settings.damage is not None else 0
    if (seconds := forecast_of(filters, wanted)) is not None:
        using.notice(forecast_in_words(filters, passes * seconds))
        progress = paced(progress, time.perf_counter() - began, seconds, passes, settings.hold_out is not None)

    # consistency with the model and with each other
    turning = turning_of(structure, channels)
    judgements, check_records = [], []
    for i, record in enumerate(filters):

        def checking(share: float, i: int = i) -> None:
            of = f" of {records[i].name}" * (len(records) > 1)
            progress(f"channels{of}", CHECKED + (FILTERED - CHECKED) * (i + share) / len(records))

        check_records.append(build_check_record(structure, record, turning))
        judgements.append(check_consistency(record.test, problem, check_records[-1], tolerances.discrepancy, checking))
    together = None if len(records) == 1 else together_of(filters, check_records)
    conflict = together.words if together is not None and all(one.trusted for one in judgements) else ""
    if conflict and not settings.accept_inconsistent:
        raise InconsistentRecordError(
            conflict,
            key="estimate.records",
            remedy="Remove records of another structure or with re-bonded gauges, or correct the known loads and units.",
        )
    uncertain_loads = "" if settings.loads_follow_model else load_dependence_text(problem)
    uncertain_loads += (
        ", or set estimate.loads_follow_model: true if the unknown loads follow their model in process_noise"
        * bool(uncertain_loads)
    )

    def of_records(texts: Sequence[str]) -> str:
        named = zip(records, texts, strict=True)
        return "; ".join(f"record '{one.label}': {text}" if one.label else text for one, text in named if text)

    decision = Decision(
        conflict or of_records([one.words for one in judgements]),
        of_records([one.named for one in judgements]),
        settings.accept_inconsistent,
        (uncertain_loads,),
    )

    # filter and smoother, and further reasons to withhold σ
    progress("filter", FILTERED)
    results, shifted = _filtered(
        config,
        filters,
        decision,
        judgements,
        wanted,
        lambda share: progress("filter and smoother", FILTERED + (LATER - FILTERED) * share),
    )
    if shifted is not None:
        filters = [record.with_wider_frequencies(shifted.size) for record in filters]
    exclusion, note = _excluded_by_comparison(config, filters[0], results[0])
    out_of_range: dict[str, str] = {}
    for record, result in zip(filters, results, strict=True):
        ends = last_values(record.model, result.smoothed)
        out_of_range |= out_of_ranges(config, problem, {name: value for name, (value, _) in ends.items()})
    remedy = f"widen {ranges_in_words(out_of_range)} if such values are plausible, or check loads, units, supports and gauges"
    decision = replace(decision, reasons=(uncertain_loads, exclusion), out_of_range=out_of_range, remedy=remedy)
    withheld = decision.withheld

    # fields and damage
    hold_outs: Sequence[HoldOut | None] = [None] * len(filters)
    if settings.hold_out is not None:
        # the hold-out test checks σ, so it runs even if σ is inconsistent
        system = FilteredGauges(filters, undetectable_by, bool(decision.unfounded))
        hold_outs = held_out(system, lambda task, share: progress(task, LATER + (HELD - LATER) * share))
        if not withheld:
            pairs = zip(hold_outs, tests, strict=True)
            hold_outs = [
                replace(one, field_factor=field_factor(left_out(one, test.labels, test.values))) for one, test in pairs
            ]
    progress("field", HELD if settings.hold_out else LATER)

    def filters_of(changed: PlacementConfig) -> list[RecordFilter]:
        walked = problem_of(replace(structure, config=changed), screened)
        return record_filters(changed, walked, tolerances, tests)[0]

    damage: Damaged | None = None
    damage_notes: tuple[str, ...] = ()
    if settings.damage is not None and skin is not None:
        progress("damage", 0.7)
        damage, damage_notes = damage_of_test(
            config,
            skin,
            virtual,
            filters,
            results,
            withheld,
            applied_factor(hold_outs),
            filters_of,
            lambda share: progress("damage", 0.7 + 0.3 * share),
        )

    # estimate of each record
    not_held = not_held_in_words(structure)
    exact = "" if withheld else exact_frequencies_in_words(config)
    notes = (*bare, note, *_notes(hidden, tuning), *damage_notes, _shift_in_words(shifted))
    common = Common(config, decision, skin, virtual, (*not_held, exact), notes)
    estimations = {}
    for record, result, judgement, hold_out in zip(filters, results, judgements, hold_outs, strict=True):
        source = source_of(record.test, using.files[record.test.record.file], problem.known)
        if conflict:
            judgement = replace(judgement, words=conflict, disagrees=True)
        estimations[record.test.record.name] = estimation_of_record(
            common, source, record, result, judgement, hold_out, damage if len(records) == 1 else None
        )
    surface = estimations[records[0].name].surface if len(records) == 1 else None
    if len(records) > 1 and skin is not None and damage is not None and damage.surface is not None:
        surface = damage_grid(skin, damage.surface)
    kinds = problem.channels.quantity[channels]
    of_channels = {"the channel": kinds, "the biased channel": kinds[filters[0].biased]}
    return Campaign(
        unknowns=problem.unknowns,
        records=estimations,
        decision=decision,
        undetectable=hidden,
        tuning=tuning,
        together=together,
        posterior={} if withheld else posteriors_of(problem, filters[0].start, results[0].grid_run),
        damage=damage,
        surface=surface,
        units={
            **load_units,
            **unknown_units(config),
            **{name: units_in_words(some) for name, some in of_channels.items()},
        },
        channel_units=tuple(UNITS[kind] for kind in kinds),
        labels=virtual_labels(settings.virtual),
    )


def _filtered(
    config: PlacementConfig,
    filters: Sequence[RecordFilter],
    decision: Decision,
    judgements: Sequence[ConsistencyResult],
    wanted: Wants,
    progress: Callable[[float], None],
) -> tuple[tuple[FilteredRecord, ...], ShiftedMode | None]:
    """Run filter and smoother, and a comparison with other filters if configured or cheap. If natural frequencies differ from the
    model by more than their tolerance predicts, run again with the tolerance that fits (Birge ratio), and return the mode."""
    if not decision.accept:
        # σ is withheld; without scaled σ the parameter grid cannot follow inconsistent measurements
        ratios = [one.birge_ratio for one in judgements]
        filters = [replace(record, birge_ratio=ratio) for record, ratio in zip(filters, ratios, strict=True)]
    first, compare = filters[0], config.filter.compare
    try:
        consistent = [decision.accept or one.trusted for one in judgements]
        results, shifted = filter_by_consistency(filters, consistent, wanted, progress), None
        # a load that is unknown may follow a wrong frequency, and is then no witness of it
        if not decision.withheld and not first.problem.unknowns.inputs:
            pairs = zip(filters, results, strict=True)
            shifts = [shifted_mode(one.model, one.considered, result.grid_run, 1.0) for one, result in pairs]
            shifted = max(filter(None, shifts), key=lambda shift: shift.size, default=None)
        if shifted is not None:
            filters = [record.with_wider_frequencies(shifted.size) for record in filters]
            results = filter_by_consistency(filters, consistent, wanted, progress)
        compare = not first.long if compare is None else compare
        if len(filters) == 1 and compare and not decision.withheld and first.problem.method == "grid":
            results = (replace(results[0], compared=compared(first.problem, first.grid_record)),)
        return results, shifted
    except (NumericalError, np.linalg.LinAlgError) as error:
        if decision.inconsistent:
            why = error.what if isinstance(error, NumericalError) else error
            raise InconsistentRecordError(
                f"every filter diverges for this record ({why}): {decision.inconsistent}",
                key="estimate",
                remedy="Check unit and sign of channels and loads, supports and time step. Then run the stage `estimate` again.",
            ) from error
        if len(filters) == 1:
            raise
        raise InconsistentRecordError(
            f"the joint estimate of all records diverges although each record is consistent with the model: {error}",
            key="estimate.records",
            remedy="Estimate each record separately (estimate.file) and compare the parameters.",
        ) from error


def _excluded_by_comparison(config: PlacementConfig, record: RecordFilter, result: FilteredRecord) -> tuple[str, str]:
    """Return why the filter comparison withholds σ, and a note; each may be empty.
    The compared parameter grid filter has no tolerances and an unknown start. With tolerances its result withholds σ only if the
    start is settled and a grid filter with the same tolerances and an unknown start excludes the estimate, too."""
    ends, settled = last_values(record.model, result.smoothed), record.settled is not None
    words = excluded(ends, by_grid(result.compared))
    if not words or tolerances_of(config.tolerances) == NONE:
        return excluded_in_words(words, settled, "estimate.start"), ""
    if settled:
        moving = last_values(record.model, filter_records_on_grid([replace(record, settled=None)])[0].run)
        otherwise = excluded(ends, {name: moving[name] for name in record.model.unknowns.parameters})
        if otherwise:
            return excluded_in_words(otherwise, True, "estimate.start"), ""
    return (
        "",
        f"the comparison of filters neglects tolerances, but estimates with and without tolerances disagree: {words}",
    )


def _shift_in_words(shifted: ShiftedMode | None) -> str:
    if shifted is None or shifted.size <= SHIFTED:
        return ""
    return (
        f"the natural frequencies differ from the model: mode {shifted.mode + 1} by {100 * (shifted.factor - 1):+.2g} %, "
        f"{shifted.size:.2g} times what tolerances.frequency predicts. σ is computed with a tolerance that is larger by this "
        f"factor. {CHECK_MODE.capitalize()}"
    )


def _notes(hidden: str, tuning: Tuning | None) -> tuple[str, ...]:
    tuned = {} if tuning is None else tuning.factors
    undecided = () if tuning is None else tuning.undecided
    factors, untuned = ", ".join(f"{part} {value:.3g}" for part, value in tuned.items()), ", ".join(undecided)
    return (
        f"the channels cannot determine {hidden}; these estimates depend on the initial values" if hidden else "",
        f"noise levels were tuned to the measurements, by the factors: {factors}" if factors else "",
        f"the noise level of {untuned} was not tuned, because the measurements do not determine this level"
        if untuned
        else "",
    )


def paced(progress: Progress, spent: float, seconds: float, passes: int, hold_out: bool) -> Progress:
    """Rescale progress by time: `spent` before the channel check, then `passes` of filter and smoother of `seconds` each."""
    parts = [spent, CHECK * seconds, seconds, (passes - 1) * seconds + REST * seconds]
    plain = [0.0, CHECKED, FILTERED, LATER, 1.0]
    if hold_out:
        parts[3:] = [(passes - 1) * seconds, REST * seconds]
        plain = [0.0, CHECKED, FILTERED, LATER, HELD, 1.0]
    by_clock = np.concatenate([[0.0], np.cumsum(parts) / sum(parts)])
    return lambda task, share: progress(task, float(np.interp(share, plain, by_clock)))

"""The filter on the measurements of a test: one record, or several that share their parameters and what is bonded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, ContradictionError, NumericalError, blame
from strainsight.estimation.consistency import Tuning
from strainsight.estimation.decision import Decision
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import WantedCovariances
from strainsight.experiment.hold_out import held_out
from strainsight.experiment.resources import Resources
from strainsight.experiment.structure.bonded_gauges import bonded_gauges
from strainsight.experiment.structure.candidates import free_thicknesses, thickness_at
from strainsight.experiment.structure.damage_drawn import drawn_damage
from strainsight.experiment.structure.diagnosed import Judgement, Together, judgement_of, together_of
from strainsight.experiment.structure.estimation import Common, Estimation, FilteredGauges, estimation_of_record
from strainsight.experiment.structure.filtered_test import (
    Filtered,
    Filtering,
    Progress,
    Wants,
    filtered,
    filtered_by_verdict,
    model_of,
)
from strainsight.experiment.structure.filtering import posteriors_of
from strainsight.experiment.structure.measured import (
    Measured,
    RecordSettings,
    in_record,
    measured_of,
    records_of,
    settled_in,
    source_of,
)
from strainsight.experiment.structure.nuisances import Tolerated, not_held_in_words, on_average, tolerated
from strainsight.experiment.structure.observation import undetectable
from strainsight.experiment.structure.problem import Problem, initial_covariance, problem_of, rests_on_loads_in_words
from strainsight.experiment.structure.surface import (
    damage_on_surface,
    displaced,
    skin_in_test,
    virtual_strain,
    wanted_of,
)
from strainsight.experiment.structure.suspected import (
    beyond_ranges,
    excluded_by_comparison,
    last_values,
    suspect_of,
    turning_of,
    widen,
)
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.parallel import Sweep
from strainsight.records.estimated import Damaged, HoldOut, Posterior
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training

FEW, TRIED = 20, 1000
"""Samples that are filtered before, and that are timed."""
LONG = 20_000
"""Steps from which on a forecast is made; shorter records are done within a minute or so."""
CHECKED, FILTERED, LATER, HELD = 0.4, 0.6, 0.7, 0.95
"""Shares of a short record where channels are checked, where filter and smoother begin and end, and where every gauge has been
left out."""
CHECK, REST = 0.15, 0.45
"""What the checks of channels before a filter and smoother take, and fields and files after it, over these."""


@dataclass(frozen=True)
class Campaign:
    """What the records of a test say.

    records: what each says, by its name, empty of a test that is one file; decision: whether σ is given; undetectable: what the
    channels cannot tell, in words; tuning: factors on the noises of one record, None where they are as stated; together: what
    they say of each other, None of one; posterior: of every parameter; damage: of all; surface: its grid, None where neither
    that nor pictures in time are asked for.
    """

    records: dict[str, Estimation]
    decision: Decision
    undetectable: str
    tuning: Tuning | None
    together: Together | None
    posterior: dict[str, Posterior]
    damage: Damaged | None
    surface: VtkHdf | None

    @property
    def first(self) -> Estimation:
        return next(iter(self.records.values()))

    @property
    def only(self) -> Estimation | None:
        """The one record; None where there are several."""
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
    """Read the files, check that they can tell the unknowns, filter and smooth; then what no gauge measured.

    gauges (k,): numbers of those of the layout. Raises ConfigError where no file is named, InfeasibleError
    where the channels cannot tell the unknowns and that is not allowed, and ContradictionError where no filter can follow a
    record and one fault of a channel explains why, and where records that agree with the model contradict each other.
    """
    settings = config.estimate
    records = () if settings is None else records_of(settings)
    if settings is None or not records:
        raise ConfigError("no measurements of a test", key="estimate.file", remedy="name the file of the test")
    using.progress("reading", 0.0)
    began = time.perf_counter()
    problem = problem_of(config, using.files, reduced, training, screened)
    named = bonded_gauges(config, training, gauges, using.files.get("estimate.gauges_file"))
    tests, units = [], {name: load.unit for name, load in config.loads.items()}
    for own in records:
        with in_record(own.name if len(records) > 1 else ""):
            tests.append(measured_of(own, using.files[own.file], problem, named, units))
    channels = tests[0].channels
    hidden = undetectable(problem, channels, config.place.instants, config.seed, settings.allow_unobservable)
    using.progress("model", 0.2)
    tolerances = tolerated(config, mesh, reduced, training, channels)
    each, tuning = _filterings(config, settings, problem, tolerances, records, tests)
    field = displaced(reduced, tolerances, each[0])
    skin, bare = skin_in_test(config, settings, mesh, field, using.files)
    free = free_thicknesses(config, mesh, problem.model.reference)
    with blame("estimate.virtual"):
        virtual = virtual_strain(mesh, field, settings.virtual, config.gauges, len(each[0].covariance), free)
    thickness = thickness_at(mesh, free, problem.model.reference)
    turning, judgements, suspects = turning_of(mesh, reduced, training, channels, thickness), [], []

    def wanted(given: Filtering, run: FilterRun) -> WantedCovariances:
        return wanted_of(settings, config.loads, given, virtual, run)

    passes = 1 if settings.hold_out is None else 1 + len(np.unique(problem.channels.gauge[channels]))
    # damage asks for the other walk of every unknown load, too
    passes += len(problem.unknowns.inputs) if settings.damage is not None else 0
    if (seconds := forecast_of(each, wanted)) is not None:
        using.notice(forecast_in_words(each, passes * seconds))
        using = paced(using, time.perf_counter() - began, seconds, passes, settings.hold_out is not None)
    for i, (own, given) in enumerate(zip(records, each, strict=True)):

        def checking(share: float, i: int = i) -> None:
            done = (i + share) / len(records)
            of = f" of {records[i].name}" * (len(records) > 1)
            using.progress(f"channels{of}", CHECKED + (FILTERED - CHECKED) * done)

        suspects.append(suspect_of(config, mesh, reduced, training, given, turning))
        judgements.append(judgement_of(own, given.test, problem, suspects[-1], tolerances.discrepancy, checking))
    trusted = all(own.trusted for own in judgements)
    together = None if len(records) == 1 else together_of(each, suspects, tuple(own.name for own in records))
    apart = together.words if together is not None and trusted else ""
    if apart and not settings.accept:
        raise ContradictionError(
            apart,
            key="estimate.records",
            remedy="leave out what is of another part or of gauges that were bonded anew, or correct its known loads and units",
        )
    using.progress("filter", FILTERED)
    untold = "" if settings.loads_as_stated else rests_on_loads_in_words(problem)
    untold += ", or set estimate.loads_as_stated where the loads are as stated" * bool(untold)
    contradictions, faults = ([getattr(own, what) for own in judgements] for what in ("words", "named"))
    inconsistent = apart or _by_record(records, contradictions)
    decision = Decision(inconsistent, _by_record(records, faults), settings.accept, (untold,))

    def filtering(share: float) -> None:
        using.progress("filter and smoother", FILTERED + (LATER - FILTERED) * share)

    found = _found(config, each, decision, judgements, wanted, filtering)
    excluded, note = excluded_by_comparison(config.tolerances, each[0], found[0])
    beyond: dict[str, str] = {}
    for given, by in zip(each, found, strict=True):
        ends = last_values(given, by.smoothed.mean[-1, 0], by.smoothed.std[-1, 0])
        beyond |= beyond_ranges(config, problem, {name: value for name, (value, _) in ends.items()})
    remedy = f"{widen(beyond)} if that can be, or look for a load, unit, support or gauge that is not as stated"
    decision = replace(decision, reasons=(untold, excluded), beyond=beyond, remedy=remedy)
    withheld = decision.withheld
    without: Sequence[HoldOut | None] = [None] * len(each)
    if settings.hold_out is not None:

        def untold_by(others: np.ndarray) -> str:
            return undetectable(problem, others, config.place.instants, config.seed, True)

        # what contradicts the model is looked for there: the claim is what is tested
        system = FilteredGauges(each, untold_by, bool(decision.unfounded))
        without = held_out(system, lambda doing, share: using.progress(doing, LATER + (HELD - LATER) * share))
    using.progress("field", HELD if settings.hold_out else LATER)

    def otherwise(changed: PlacementConfig) -> list[Filtering]:
        walked = problem_of(changed, using.files, reduced, training, screened)
        return _filterings(changed, settings, walked, tolerances, records, tests)[0]

    damage, damage_words = drawn_damage(config, settings, skin, each, found, withheld, otherwise, using)
    not_held = not_held_in_words(config, reduced, training)
    bare = (*bare, note) if note else bare
    common = Common(decision, hidden, bare, tuning, not_held, virtual, damage_words)
    single, said = len(records) == 1, {}
    for own, given, by, judged, held in zip(records, each, found, judgements, without, strict=True):
        test, of_record = given.test, damage if single else None
        source = source_of(own.settings, using.files[own.file], test.labels, problem.known, test.h * test.every)
        judged = replace(judged, words=apart, apart=True) if apart else judged
        said[own.name] = estimation_of_record(config, skin, own, source, given, by, judged, held, of_record, common)
    posterior = {} if withheld else posteriors_of(problem, each[0].start, found[0].bank)
    surface = None
    if single:
        surface = said[records[0].name].surface
    elif skin is not None and damage is not None and damage.surface is not None:
        surface = damage_on_surface(skin, damage.surface)
    return Campaign(said, decision, hidden, tuning, together, posterior, damage, surface)


def _filterings(
    config: PlacementConfig,
    settings: Estimate,
    problem: Problem,
    tolerances: Tolerated,
    records: Sequence[RecordSettings],
    tests: Sequence[Measured],
) -> tuple[list[Filtering], Tuning | None]:
    """What the filter of every record is given, and how noises were tuned in the last."""
    stated = {**config.validation.initial_std, **settings.initial_std}
    start = initial_covariance(problem, stated, moving=settings.start != "rest")
    # in the order of their names: what is found does not depend on that of the config
    place = np.argsort(np.argsort([own.name for own in records]))
    each, tuning = [], None
    for i, (own, test) in enumerate(zip(records, tests, strict=True)):
        with in_record(own.name if len(records) > 1 else ""):
            settled = settled_in(problem, test) if settings.start == "settled" else None
            model, tuning = model_of(problem, test, own.settings, start)
        model = on_average(tolerances, model, test.channels)
        each.append(Filtering(problem, tolerances, model, test, start, settled, int(place[i]), len(records)))
    return each, tuning


def _by_record(records: Sequence[RecordSettings], texts: Sequence[str]) -> str:
    """What there is to say of each; with its name where there are several."""
    if len(records) == 1:
        return texts[0]
    return "; ".join(f"record '{own.name}': {text}" for own, text in zip(records, texts, strict=True) if text)


def _found(
    config: PlacementConfig,
    each: Sequence[Filtering],
    decision: Decision,
    judgements: Sequence[Judgement],
    wanted: Wants,
    progress: Progress,
) -> tuple[Filtered, ...]:
    """Filter and smoother, with other filters beside them where that is asked for or takes little."""
    if not decision.accept:
        # σ is withheld, and no grid follows parameters that are as wrong as this at the σ that is claimed
        ratios = [own.birge_ratio for own in judgements]
        each = [replace(given, birge_ratio=ratio) for given, ratio in zip(each, ratios, strict=True)]
    try:
        if len(each) > 1:
            return filtered_by_verdict(each, [decision.accept or own.trusted for own in judgements], wanted, progress)
        compare = not each[0].long if config.filter.compare is None else config.filter.compare
        return (filtered(each[0], compare and not decision.withheld, wanted, progress),)
    except (NumericalError, np.linalg.LinAlgError) as error:
        if decision.inconsistent:
            why = error.what if isinstance(error, NumericalError) else error
            raise ContradictionError(
                f"no filter can follow this record, {why}: {decision.inconsistent}",
                key="estimate",
                remedy="correct what is named, and estimate again",
            ) from error
        if len(each) == 1:
            raise
        raise ContradictionError(
            f"no filter can follow all records together, though each agrees with the model: {error}",
            key="estimate.records",
            remedy="estimate each with estimate.file, and compare what they say of the parameters",
        ) from error


@dataclass(frozen=True)
class Paced:
    """`Resources` whose progress is one by the clock, where the plain shares are those of a short record: `plain` shares, as they
    are stated, are `by_clock` of the way."""

    under: Resources
    plain: tuple[float, ...]
    by_clock: tuple[float, ...]

    @property
    def files(self) -> Mapping[str, Path]:
        return self.under.files

    @property
    def notice(self) -> Callable[[str], None]:
        return self.under.notice

    @property
    def sweep(self) -> Sweep:
        return self.under.sweep

    def progress(self, doing: str, share: float) -> None:
        """Say it by the clock."""
        self.under.progress(doing, float(np.interp(share, self.plain, self.by_clock)))


def paced(using: Resources, spent: float, seconds: float, passes: int, hold_out: bool) -> Paced:
    """By the time spent before the channels are checked, and `seconds` of filter and smoother, of which there are `passes`."""
    parts = [spent, CHECK * seconds, seconds, (passes - 1) * seconds + REST * seconds]
    plain: tuple[float, ...] = (0.0, CHECKED, FILTERED, LATER, 1.0)
    if hold_out:
        parts[3:] = [(passes - 1) * seconds, REST * seconds]
        plain = (0.0, CHECKED, FILTERED, LATER, HELD, 1.0)
    by_clock = np.concatenate([[0.0], np.cumsum(parts) / sum(parts)])
    return Paced(using, plain, tuple(by_clock.tolist()))


def forecast_of(each: Sequence[Filtering], wanted: Wants) -> float | None:
    """Seconds that filter and smoother take of records, once, by those of the first samples; None where it is not long."""
    steps = sum(len(own.test.known) for own in each)
    if steps < LONG:
        return None
    few, first = (replace(each[0], test=each[0].test.first(count)) for count in (FEW, TRIED))
    try:
        filtered(few, wanted=wanted)  # what is compiled is not timed
        before = time.perf_counter()
        filtered(first, wanted=wanted)
    except (NumericalError, np.linalg.LinAlgError):  # the estimate itself says what it cannot follow
        return None
    return (time.perf_counter() - before) * steps / len(first.test.known)


def forecast_in_words(each: Sequence[Filtering], seconds: float) -> str:
    """The same as a sentence."""
    steps = sum(len(own.test.known) for own in each)
    return f"filter and smoother of {steps} steps take about {_in_words(seconds)}, by the first {TRIED} of them"


def _in_words(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"

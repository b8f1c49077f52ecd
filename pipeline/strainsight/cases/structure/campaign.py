"""The filter on the measurements of a test: one record, or several that share their parameters and what is bonded."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.augmentation.linearisation import linearisation_instants, linearise
from strainsight.augmentation.observability import undetectable_directions, undetectable_in_words, unseen_along
from strainsight.cases.resources import Resources
from strainsight.cases.structure.bonded_gauges import bonded_gauges
from strainsight.cases.structure.damage_drawn import drawn_damage
from strainsight.cases.structure.diagnosed import Judgement, Together, judgement_of, together_of
from strainsight.cases.structure.estimation import Common, Estimation, estimation_of_record
from strainsight.cases.structure.filtered_test import (
    Filtered,
    Filtering,
    Progress,
    Wants,
    filtered,
    filtered_by_verdict,
    model_of,
)
from strainsight.cases.structure.filtering import posteriors_of
from strainsight.cases.structure.forecast import CHECKED, FILTERED, HELD, LATER, forecast_in_words, forecast_of, paced
from strainsight.cases.structure.hold_out import held_out
from strainsight.cases.structure.measured import Measured, measured_of, settled_in
from strainsight.cases.structure.nuisances import Tolerated, not_held_in_words, on_average, tolerated
from strainsight.cases.structure.problem import Problem, initial_covariance, problem_of, withheld_in_words
from strainsight.cases.structure.records_of_test import RecordSettings, in_record, records_of
from strainsight.cases.structure.source import source_of
from strainsight.cases.structure.surface import damage_on_surface, virtual_strain
from strainsight.cases.structure.surface_in_test import displaced, skin_in_test, wanted_of
from strainsight.cases.structure.suspected import suspect_of, turning_of
from strainsight.cases.structure.thick_rows import free_thicknesses, thickness_at
from strainsight.cases.structure.withheld import beyond_ranges, excluded_by_comparison, last_values, widen
from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, ContradictionError, InfeasibleError, NumericalError, blame
from strainsight.estimation.decision import Decision
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoothed import Wanted
from strainsight.estimation.tuning import Tuning
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.damage import Damaged
from strainsight.records.estimated import HoldOut, Posterior
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.signals.histories import instant_values

AT_ONCE = 1000
"""Instants that are linearised at a time."""


@dataclass(frozen=True)
class Campaign:
    """What the records of a test say.

    records: what each says, by its name, empty of a test that is one file; decision, undetectable: as of an `Estimation`;
    together: what they say of each other, None of one; posterior: of every parameter; damage: of all; surface: its grid, None
    where neither that nor pictures in time are asked for.
    """

    records: dict[str, Estimation]
    decision: Decision
    undetectable: str
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

    def wanted(given: Filtering, run: FilterRun) -> Wanted:
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
            using.progress(_named("channels", records, i), CHECKED + (FILTERED - CHECKED) * done)

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
    untold = "" if settings.loads_as_stated else withheld_in_words(problem)

    def filtering(share: float) -> None:
        using.progress("filter and smoother", FILTERED + (LATER - FILTERED) * share)

    found = _found(config, each, records, judgements, bool(untold), wanted, filtering)
    excluded, note = excluded_by_comparison(config.tolerances, each[0], found[0])
    beyond: dict[str, str] = {}
    for given, by in zip(each, found, strict=True):
        ends = last_values(given, by.smoothed.mean[-1, 0], by.smoothed.std[-1, 0])
        beyond |= beyond_ranges(config, problem, {name: value for name, (value, _) in ends.items()})
    decision = Decision(
        apart or _contradicted(records, judgements),
        _faults(records, judgements),
        settings.accept,
        (untold, excluded),
        beyond,
        f"{widen(beyond)} if that can be, or look for a load, unit, support or gauge that is not as stated",
    )
    withheld = decision.withheld
    # What contradicts the model is looked for there: the claim is what is tested.
    without = _without_each(config, settings, each, decision.unfounded, using)
    using.progress("field", HELD if settings.hold_out else LATER)

    def otherwise(changed: PlacementConfig) -> list[Filtering]:
        walked = problem_of(changed, using.files, reduced, training, screened)
        return _filterings(changed, settings, walked, tolerances, records, tests)[0]

    damage, damage_words = drawn_damage(config, settings, skin, each, found, withheld, otherwise, using)
    not_held = not_held_in_words(config, reduced, training)
    bare = (*bare, note) if note else bare
    common = Common(decision, hidden, bare, tuning, not_held, virtual, damage_words)
    single, said = len(records) == 1, {}
    for i, (own, given) in enumerate(zip(records, each, strict=True)):
        test = given.test
        source = source_of(own.settings, using.files[own.file], test.labels, problem.known, test.h * test.every)
        judged = replace(judgements[i], words=apart, apart=True) if apart else judgements[i]
        said[own.name] = estimation_of_record(
            config,
            skin,
            own,
            source,
            given,
            found[i],
            judged,
            None if without is None else without[i],
            damage if single else None,
            common,
        )
    posterior = {} if withheld else posteriors_of(problem, each[0].start, found[0].bank)
    surface = None
    if single:
        surface = said[records[0].name].surface
    elif skin is not None and damage is not None and damage.surface is not None:
        surface = damage_on_surface(skin, damage.surface)
    return Campaign(said, decision, hidden, together, posterior, damage, surface)


def estimation_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    screened: Screened,
    gauges: np.ndarray,
    using: Resources,
) -> Estimation:
    """Of a test that is one record, as `campaign_of`. Raises ConfigError where there are several."""
    found = campaign_of(config, mesh, reduced, training, screened, gauges, using).only
    if found is None:
        raise ConfigError(
            "several records", key="estimate.records", remedy="take `campaign`, which has each by its name"
        )
    return found


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


def _named(what: str, records: Sequence[RecordSettings], i: int) -> str:
    return f"{what} of {records[i].name}" if len(records) > 1 else what


def _contradicted(records: Sequence[RecordSettings], judgements: Sequence[Judgement]) -> str:
    """What contradicts the model, record by record; empty where nothing does."""
    if len(records) == 1:
        return judgements[0].words
    pairs = zip(records, judgements, strict=True)
    return "; ".join(f"record '{own.name}': {judged.words}" for own, judged in pairs if not judged.trusted)


def _faults(records: Sequence[RecordSettings], judgements: Sequence[Judgement]) -> str:
    """The faults that are named, record by record."""
    if len(records) == 1:
        return judgements[0].named
    pairs = zip(records, judgements, strict=True)
    return "; ".join(f"{own.name}: {judged.named}" for own, judged in pairs if judged.named)


def _found(
    config: PlacementConfig,
    each: Sequence[Filtering],
    records: Sequence[RecordSettings],
    judgements: Sequence[Judgement],
    untold: bool,
    wanted: Wants,
    progress: Progress,
) -> tuple[Filtered, ...]:
    """Filter and smoother, with other filters beside them where that is asked for or takes little."""
    contradicted = _contradicted(records, judgements)
    if not records[0].settings.accept:
        # σ is withheld, and no grid follows parameters that are as wrong as this at the σ that is claimed
        ratios = [own.birge_ratio for own in judgements]
        each = [replace(given, birge_ratio=ratio) for given, ratio in zip(each, ratios, strict=True)]
    try:
        if len(each) > 1:
            accept = records[0].settings.accept
            return filtered_by_verdict(each, [accept or own.trusted for own in judgements], wanted, progress)
        settings = records[0].settings
        compare = not each[0].long if config.filter.compare is None else config.filter.compare
        withheld = untold or (bool(contradicted) and not settings.accept)
        return (filtered(each[0], compare and not withheld, wanted, progress),)
    except (NumericalError, np.linalg.LinAlgError) as error:
        if contradicted:
            why = error.what if isinstance(error, NumericalError) else error
            raise ContradictionError(
                f"no filter can follow this record, {why}: {contradicted}",
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


def _without_each(
    config: PlacementConfig, settings: Estimate, each: Sequence[Filtering], untold: str, using: Resources
) -> tuple[HoldOut, ...] | None:
    """Every gauge by the others where that is asked for; untold: why there is no σ whatever the records are, else empty."""
    if settings.hold_out is None:
        return None

    def hidden(channels: np.ndarray) -> str:
        return undetectable(each[0].problem, channels, config.place.instants, config.seed, True)

    return held_out(each, hidden, bool(untold), using.progress)


def undetectable(problem: Problem, channels: np.ndarray, instants: int, seed: int, allowed: bool) -> str:
    """In words what these channels (k,) cannot tell: at some instant of the training run, and along all of it. Empty where that
    is nothing.

    Raises InfeasibleError where there is something and that is not allowed.
    """
    p, u = problem, instant_values(problem.u)
    at = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, instants, seed)
    if not any(undetectable_directions(F, H).shape[1] for F, H in zip(*_linearised(p, channels, at), strict=True)):
        return ""
    hidden = _hidden_along(p, channels)
    if not hidden.shape[1]:
        return ""
    words = undetectable_in_words(hidden, p.unknowns.state_names)
    if allowed:
        return words
    raise InfeasibleError(
        f"the {len(channels)} channels cannot tell {words}",
        key="estimate.channels",
        remedy="give more channels, or go on all the same with --allow-unobservable",
    )


def _linearised(problem: Problem, channels: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F* (s, n*, n*) and H* (s, m, n*) at some instants of the training run."""
    p = problem
    motion = p.model, p.unknowns, p.model.reference, p.x[at], instant_values(p.u)[at]
    F = linearise(*motion)
    return F, p.channels.sensed(channels).linearised(*motion, F)


def _hidden_along(problem: Problem, channels: np.ndarray) -> np.ndarray:
    """Directions (n*, d): of the loads, which are the same at all instants, else of the parameters by all of the run."""
    k, n = len(problem.unknowns.parameters), 2 * problem.model.size
    states = problem.unknowns.size(problem.model) - k
    driven, read = [], []
    for part in np.array_split(np.arange(len(problem.x)), -(-len(problem.x) // AT_ONCE)):
        F, H = _linearised(problem, channels, part)
        driven.append(F[:, :n, states:])
        read.append(H[:, :, states:])
    F, H = F[0, :states, :states], H[0, :, :states]
    alone = undetectable_directions(F, H)
    if alone.shape[1] or not k:
        return np.pad(alone, [(0, k), (0, 0)])
    inputs = problem.unknowns.position(problem.model)[: len(problem.unknowns.inputs)]
    motion = F[:n, :n], F[:n, inputs], H[:, :n], H[:, inputs]
    loads, parameters = unseen_along(*motion, np.concatenate(driven), np.concatenate(read), problem.h)
    hidden = np.zeros((states + k, parameters.shape[1]))
    hidden[inputs], hidden[states:] = loads, parameters
    return hidden

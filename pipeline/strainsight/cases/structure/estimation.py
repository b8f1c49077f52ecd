"""The filter on the measurements of a test, and what no gauge measured (1.53-1.60)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.augmentation.unknowns import Unknowns
from strainsight.cases.resources import Resources
from strainsight.cases.structure.bonded_gauges import bonded_gauges
from strainsight.cases.structure.channels import units_in_words
from strainsight.cases.structure.compared import compared
from strainsight.cases.structure.detectable import undetectable
from strainsight.cases.structure.diagnosed import ACCEPT, Judgement, clock_in_words, judgement_of
from strainsight.cases.structure.filtering import by_moments
from strainsight.cases.structure.hold_out import held_out
from strainsight.cases.structure.measured import Measured, measured_of, settled_in
from strainsight.cases.structure.nuisances import Tolerated, not_held_in_words, nuisances_of, tolerated
from strainsight.cases.structure.posterior import posteriors_of
from strainsight.cases.structure.problem import (
    Problem,
    filter_model,
    initial_covariance,
    problem_of,
    rests_on_loads_in_words,
    scheme_in_words,
    withheld_in_words,
)
from strainsight.cases.structure.resultants import resultants_of
from strainsight.cases.structure.settings import parameters_of, unknown_units
from strainsight.cases.structure.source import source_of
from strainsight.cases.structure.surface import (
    largest_reading,
    skin_of,
    surface_in_time,
    surface_then,
    virtual_labels,
    virtual_strain,
)
from strainsight.cases.structure.suspected import suspect_of, turning_of
from strainsight.cases.structure.variance import Shares, budget_of
from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, ContradictionError, DeckError, NumericalError, blame
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.biased import driven_with_offsets
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.settled import Settled
from strainsight.estimation.smoother import Smoothed, smooth
from strainsight.estimation.tuning import Tuning, scale_noise, tune
from strainsight.fem.memory import require_memory
from strainsight.gauges.candidates import STRAIN, UNITS
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.budget import budget_of_shares
from strainsight.records.estimated import (
    Channels,
    Compared,
    Estimated,
    Moment,
    Offsets,
    Resultant,
    Source,
    VirtualStrain,
)
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training

LONGEST_COMPARED = 20_000
"""Steps of a record that is filtered by the other methods, too, without being asked for."""
SHORTER = "give a part of the record at a time, or a larger machine"


@dataclass(frozen=True)
class Estimation:
    """What the measurements of a test say.

    unknowns; estimated: histories, channels and strains; units: of what it holds; channel_units: of every channel; verdict on
    the innovations; tuning: factors on the noises, None where they are as stated; withheld: that there is no σ, and why, empty
    where there is one; judgement: whether the record agrees with the model; accepted: whether σ is given all the same;
    undetectable: what the channels cannot tell, in words; places of the resultants, labels of the virtual gauges; surface: its
    pictures in time, None where none are asked for.
    """

    unknowns: Unknowns
    estimated: Estimated
    units: Mapping[str, str]
    channel_units: tuple[str, ...]
    verdict: Verdict
    tuning: Tuning | None
    withheld: str
    judgement: Judgement
    accepted: bool
    undetectable: str
    places: tuple[str, ...]
    labels: tuple[str, ...]
    surface: VtkHdf | None


def estimation_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    screened: Screened,
    gauges: np.ndarray,
    using: Resources,
) -> Estimation:
    """Read the file, check that it can tell the unknowns, filter and smooth; then what no gauge measured.

    gauges (k,): numbers of those of the layout. Raises ConfigError where no file is named, InfeasibleError
    where the channels cannot tell the unknowns and that is not allowed, and ContradictionError where no filter can follow a
    record and one fault of a channel explains why.
    """
    settings = config.estimate
    if settings is None or settings.file is None:
        raise ConfigError("no measurements of a test", key="estimate.file", remedy="name a CSV, HDF5 or UFF58 file")
    using.progress("reading", 0.0)
    problem = problem_of(config, using.files, reduced, training, screened)
    named = bonded_gauges(config, training, gauges, using.files.get("estimate.gauges_file"))
    test = measured_of(settings, using.files["estimate.file"], problem, named)
    allowed = settings.allow_unobservable
    hidden = undetectable(problem, test.channels, config.place.instants, config.seed, allowed)
    using.progress("filter", 0.2)
    start = initial_covariance(
        problem, {**config.validation.initial_std, **settings.initial_std}, moving=settings.start != "rest"
    )
    settled = settled_in(problem, test) if settings.start == "settled" else None
    model, tuning = _model(problem, test, settings, start, using)
    tolerances = tolerated(config, mesh, reduced, training, test.channels)
    using.progress("channels", 0.4)
    at = np.flatnonzero(test.bias > 0)
    covariance = np.diag(np.concatenate([np.diag(start), test.bias[at] ** 2]))
    turning = turning_of(mesh, reduced, training, test.channels)
    suspect = suspect_of(
        config,
        mesh,
        reduced,
        training,
        tolerances,
        model,
        test.channels,
        covariance,
        test.known,
        test.values,
        at,
        settled,
        turning,
    )
    discrepancy = tolerances.discrepancy

    def checking(share: float) -> None:
        using.progress("channels", 0.4 + 0.2 * share)

    judgement = judgement_of(settings, test, problem, suspect, discrepancy, checking)
    long = len(test.values) * test.every > LONGEST_COMPARED
    contradicted = "" if judgement.trusted or settings.accept else f"σ is not to be trusted: {judgement.words}"
    withheld = contradicted or ("" if settings.loads_as_stated else withheld_in_words(problem))
    compare = not long if config.filter.compare is None else config.filter.compare
    try:
        run, smoothed, beside, bank = _filtered(
            problem, tolerances, model, test, start, settled, compare and not withheld
        )
    except (NumericalError, np.linalg.LinAlgError) as error:
        if judgement.trusted:
            raise
        raise ContradictionError(
            f"no filter can follow this record: {judgement.words.removesuffix(f', {ACCEPT}')}",
            key="estimate.channels",
            remedy="correct the channel, and estimate again",
        ) from error
    budget, not_so = _budget(problem, tolerances, model, test, start, run, smoothed, settled, withheld, long)
    if withheld:
        run, smoothed = _without_sigma(run, smoothed)
    without = None
    if settings.hold_out is not None:

        def smoothed_by(part: FilterModel, measured: Measured) -> Smoothed:
            run, later, *_ = _filtered(problem, tolerances, part, measured, start, settled, False)
            return _without_sigma(run, later)[1] if withheld else later

        def told(channels: np.ndarray) -> str:
            return undetectable(problem, channels, config.place.instants, config.seed, True)

        without = held_out(problem, tolerances, model, test, told, smoothed_by, using.progress)
    using.progress("field", 0.95 if without else 0.7)
    with blame("estimate.virtual"):
        virtual = virtual_strain(mesh, reduced.basis, settings.virtual, config.gauges, smoothed)
    surface, moment, bare = _surfaces(config, settings, mesh, reduced, test, model, smoothed, using)
    judged = verdict(run.whitened[:, 0])
    resultants = resultants_of(config.loads, problem.unknowns.inputs, model, smoothed)
    rests = withheld or rests_on_loads_in_words(problem)
    if settings.accept and not judgement.trusted:
        rests = f"accepted (estimate.accept), and σ given all the same: {judgement.words.removesuffix(f', {ACCEPT}')}"
    clock = clock_in_words(test, config.train.time_step)
    words = clock, scheme_in_words(problem, test.h), *not_held_in_words(config, reduced, training), rests
    notes = (*test.notes, *filter(None, words), *not_so, *bare, *_doubts(hidden, tuning))
    if withheld:
        notes += ("filter.compare: other filters are not compared where σ is withheld",) * bool(config.filter.compare)
    elif long and config.filter.compare is None and problem.method == "bank" and problem.unknowns.parameters:
        notes += (f"more than {LONGEST_COMPARED} steps: other filters are compared with filter.compare: true",)
    source = source_of(settings, using.files["estimate.file"], test.labels, problem.known)
    kinds = problem.channels.quantity[test.channels]
    units = unknown_units(config) | {"the channel": units_in_words(kinds)}
    return Estimation(
        problem.unknowns,
        replace(
            _estimated(model, test, run, smoothed, resultants, virtual, notes, source, judgement),
            moment=moment,
            posterior={} if withheld else posteriors_of(problem, start, bank),
            compared=beside,
            budget=budget_of_shares(budget),
            hold_out=without,
        ),
        units | {"the biased channel": units_in_words(kinds[test.bias > 0])},
        tuple(UNITS[kind] for kind in kinds),
        judged,
        tuning,
        withheld,
        judgement,
        settings.accept,
        hidden,
        tuple(resultants),
        virtual_labels(settings.virtual),
        surface,
    )


def _model(
    problem: Problem, test: Measured, settings: Estimate, start: np.ndarray, using: Resources
) -> tuple[FilterModel, Tuning | None]:
    """The filter's model at the channels of the test, its noises tuned where the config says so."""
    # A stated σ is that of a sample of the file.
    stated = test.std * np.sqrt(test.h * test.every / problem.h)
    model = replace(filter_model(problem, test.channels, test.h, stated=stated), every=test.every)
    if not settings.tune.parts:
        return model, None
    using.progress("tuning", 0.3)
    with blame("estimate.tune"):
        tuning = tune(model, np.zeros(model.size), start, test.known, test.values, settings.tune.parts)
    return scale_noise(model, tuning.factors), tuning


def _filtered(
    problem: Problem,
    tolerances: Tolerated,
    model: FilterModel,
    test: Measured,
    start: np.ndarray,
    settled: Settled | None,
    compare: bool,
) -> tuple[FilterRun, Smoothed, Compared | None, BankRun | None]:
    """Filter and smoother, with the offsets of channels as unknowns behind x*; what other filters make of the samples; and the
    bank, where it is one."""
    at = np.flatnonzero(test.bias > 0)
    core = driven_with_offsets(model, test.known, at)
    steps, kept = len(test.values) * test.every, 2 if core.linear else 3
    # covariances of filter and smoother, and the Jacobians between them
    require_memory(8.0 * kept * steps * core.size**2, f"{steps} steps of {core.size} states", SHORTER)
    covariance = np.diag(np.concatenate([np.diag(start), test.bias[at] ** 2]))
    if problem.method == "bank":
        nuisances, rest = nuisances_of(tolerances, model, test.channels), np.zeros(len(covariance))
        bank = filter_bank(model, rest, covariance, test.known, test.values, nuisances, biased=at, settled=settled)
        later = smooth_bank(model, rest, covariance, test.known, test.values, nuisances, bank, at, settled)
        beside = compared(problem, model, covariance, test.known, test.values, at) if compare else None
        return bank.run, later, beside, bank
    run = by_moments(problem, model, np.zeros(core.size), covariance, test.known, test.values, "all", at)
    return run, smooth(core, run, covariance=True), None, None


def _budget(
    problem: Problem,
    tolerances: Tolerated,
    model: FilterModel,
    test: Measured,
    start: np.ndarray,
    run: FilterRun,
    smoothed: Smoothed,
    settled: Settled | None,
    withheld: str,
    long: bool,
) -> tuple[Shares, tuple[str, ...]]:
    """What the variances are made of, and why there is none."""
    if withheld:
        return {}, ()
    if long:
        return {}, (f"more than {LONGEST_COMPARED} steps: no budget of the variance",)
    if (test.bias > 0).any():
        return {}, ("no budget of the variance where offsets of channels are unknown",)
    return budget_of(problem, tolerances, model, test.channels, start, test.known, test.values, run, smoothed, settled)


def _estimated(
    model: FilterModel,
    test: Measured,
    run: FilterRun,
    smoothed: Smoothed,
    resultants: Mapping[str, Resultant],
    virtual: VirtualStrain | None,
    notes: tuple[str, ...],
    source: Source,
    judgement: Judgement,
) -> Estimated:
    estimate, later = (physical(model, own.mean[:, 0], own.std[:, 0]) for own in (run, smoothed))
    sampled, biased = slice(test.every - 1, None, test.every), np.flatnonzero(test.bias > 0)
    mean, std = (values[-1, 0, model.size :] for values in (smoothed.mean, smoothed.std))
    return Estimated(
        time=test.time[0] + run.time,
        estimate={name: own[0] for name, own in estimate.items()},
        std={name: own[1] for name, own in estimate.items()},
        smoothed={name: own[0] for name, own in later.items()},
        smoothed_std={name: own[1] for name, own in later.items()},
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
        bias=Offsets(channel=biased, mean=mean, std=std) if len(biased) else None,
        resultant={str(i): own for i, own in enumerate(resultants.values())},
        virtual=virtual,
        known=dict(zip(model.known_inputs, _at_instants(test.known).T, strict=True)),
        source=source,
        notes=notes,
        posterior={},
        trusted=judgement.trusted,
        check=judgement.check,
    )


def _at_instants(held: np.ndarray) -> np.ndarray:
    """Loads (T + 1, n) at the ends of the steps through which they are held (T, HOLD, n)."""
    return np.concatenate([held[:, 0], held[-1:].sum(axis=1)])


def _surfaces(
    config: PlacementConfig,
    settings: Estimate,
    mesh: Mesh,
    reduced: Reduced,
    test: Measured,
    model: FilterModel,
    smoothed: Smoothed,
    using: Resources,
) -> tuple[VtkHdf | None, Moment | None, tuple[str, ...]]:
    """The surface in time where it is asked for, and at the moment of the largest reading; neither where nothing is solid, or
    no stress known, with the reason.

    Strains are looked at alone where there are any; else each channel beside its noise. Raises ConfigError where a surface in
    time is asked for and the mesh has no solids, DeckError where they have no material.
    """
    if not mesh.blocks:
        if settings.field is not None:
            raise ConfigError(
                "the mesh has no solids, and so no surface", key="estimate.field", remedy="remove the key"
            )
        return None, None, ()
    parameters = parameters_of(config.parameters, mesh, using.files, config.mesh.matrices)
    try:
        skin = skin_of(mesh, reduced.basis, parameters)
    except DeckError as error:
        # A model that came as matrices needs no materials, but for this.
        if settings.field is not None:
            raise
        return None, None, (f"no strain and stress of the surface: {error.what}",)
    surface = None if settings.field is None else surface_in_time(skin, model, smoothed, settings.field)
    biased, offset = np.flatnonzero(test.bias > 0), np.zeros(len(test.labels))
    offset[biased] = smoothed.mean[-1, 0, model.size :]
    strains = STRAIN if model.quantity is None else np.asarray(model.quantity)
    noise = np.sqrt(model.noise.reshape(-1, len(test.labels)).mean(axis=0))
    scale = np.where(strains == STRAIN, 1.0, np.inf) if np.any(strains == STRAIN) else noise
    k, channel = largest_reading(test.values, offset, np.broadcast_to(scale, noise.shape))
    then = (k + 1) * test.every
    return surface, surface_then(skin, model, smoothed, then, float(test.time[k + 1]), test.labels[channel]), ()


def _without_sigma(run: FilterRun, smoothed: Smoothed) -> tuple[FilterRun, Smoothed]:
    """NaN for σ and covariance, so that whatever is computed from them is NaN too."""
    assert smoothed.covariance is not None
    none = replace(smoothed, std=np.nan * smoothed.std, covariance=np.nan * smoothed.covariance)
    return replace(run, std=np.nan * run.std), none


def _doubts(hidden: str, tuning: Tuning | None) -> list[str]:
    words = []
    if hidden:
        words.append(f"the channels cannot tell {hidden}: what is estimated of it comes from the initial values")
    if tuning:
        factors = ", ".join(f"{part} {value:.3g}" for part, value in tuning.factors.items())
        words.append(f"noises were scaled by the measurements: {factors}")
        if tuning.undecided:
            words.append(f"the measurements say nothing about the noise of {', '.join(tuning.undecided)}")
    return words

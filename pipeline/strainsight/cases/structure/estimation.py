"""The filter on the measurements of a test, and what no gauge measured (1.53-1.60)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from strainsight.augmentation.unknowns import Unknowns
from strainsight.cases.resources import Resources
from strainsight.cases.structure.bonded_gauges import bonded_gauges
from strainsight.cases.structure.channels import units_in_words
from strainsight.cases.structure.damage import asked_places, damage_in_test, damage_notes
from strainsight.cases.structure.detectable import undetectable
from strainsight.cases.structure.diagnosed import ACCEPT, Judgement, clock_in_words, judgement_of
from strainsight.cases.structure.filtered_test import (
    LONGEST_COMPARED,
    Filtered,
    Filtering,
    budget_in,
    filtered,
    model_of,
)
from strainsight.cases.structure.histories import histories
from strainsight.cases.structure.hold_out import held_out
from strainsight.cases.structure.measured import measured_of, settled_in
from strainsight.cases.structure.nuisances import not_held_in_words, tolerated
from strainsight.cases.structure.posterior import posteriors_of
from strainsight.cases.structure.problem import (
    initial_covariance,
    problem_of,
    rests_on_loads_in_words,
    scheme_in_words,
    withheld_in_words,
)
from strainsight.cases.structure.resultants import resultants_of
from strainsight.cases.structure.settings import unknown_units
from strainsight.cases.structure.source import source_of
from strainsight.cases.structure.surface import Skin, virtual_labels, virtual_strain
from strainsight.cases.structure.surface_in_test import grid_of, moment_of, skin_in_test, wanted_of
from strainsight.cases.structure.suspected import suspect_of, turning_of
from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, ContradictionError, NumericalError, blame
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.model import physical
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoothed import Wanted
from strainsight.estimation.tuning import Tuning
from strainsight.gauges.candidates import UNITS
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.budget import budget_of_shares
from strainsight.records.damage import Damaged
from strainsight.records.estimated import Channels, Estimated, HoldOut, Offsets, Resultant, Source
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training


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
        raise ConfigError("no measurements of a test", key="estimate.file", remedy="name the file of the test")
    using.progress("reading", 0.0)
    problem = problem_of(config, using.files, reduced, training, screened)
    named = bonded_gauges(config, training, gauges, using.files.get("estimate.gauges_file"))
    test = measured_of(settings, using.files["estimate.file"], problem, named)
    hidden = undetectable(problem, test.channels, config.place.instants, config.seed, settings.allow_unobservable)
    skin, bare = skin_in_test(config, settings, mesh, reduced.basis, using.files)
    using.progress("model", 0.2)
    stated = {**config.validation.initial_std, **settings.initial_std}
    start = initial_covariance(problem, stated, moving=settings.start != "rest")
    settled = settled_in(problem, test) if settings.start == "settled" else None
    model, tuning = model_of(problem, test, settings, start)
    tolerances = tolerated(config, mesh, reduced, training, test.channels)
    given = Filtering(problem, tolerances, model, test, start, settled)
    with blame("estimate.virtual"):
        virtual = virtual_strain(mesh, reduced.basis, settings.virtual, config.gauges, len(given.covariance))
    suspect = suspect_of(config, mesh, reduced, training, given, turning_of(mesh, reduced, training, test.channels))

    def checking(share: float) -> None:
        using.progress("channels", 0.4 + 0.2 * share)

    judgement = judgement_of(settings, test, problem, suspect, tolerances.discrepancy, checking)
    contradicted = "" if judgement.trusted or settings.accept else f"σ is not to be trusted: {judgement.words}"
    untold = "" if settings.loads_as_stated else withheld_in_words(problem)
    withheld = contradicted or untold
    using.progress("filter", 0.6)
    wanted = partial(wanted_of, settings, config.loads, given, virtual)
    found = _found(config, given, judgement, withheld, wanted)
    budget, not_so = ({}, ()) if withheld else budget_in(given, found)
    if withheld:
        found = found.without_sigma()
    # What contradicts the model is looked for there: the claim is what is tested.
    without = _without_each(config, settings, given, untold, using)
    using.progress("field", 0.95 if without else 0.7)
    damage = _damage(config, settings, skin, given, found, withheld, using)
    resultants = resultants_of(config.loads, problem.unknowns.inputs, model, found.smoothed)
    not_held = not_held_in_words(config, reduced, training)
    notes = (
        *test.notes,
        *_words(config, given, judgement, withheld, not_held),
        *not_so,
        *bare,
        *_doubts(hidden, tuning),
    )
    if settings.damage is not None:
        notes += damage_notes(settings.damage, withheld)
    source = source_of(settings, using.files["estimate.file"], test.labels, problem.known)
    kinds = problem.channels.quantity[test.channels]
    units = unknown_units(config) | {"the channel": units_in_words(kinds)}
    return Estimation(
        problem.unknowns,
        replace(
            _estimated(given, found, resultants, judgement, source, notes),
            virtual=None if virtual is None else virtual.smoothed(found.smoothed),
            moment=None if skin is None else moment_of(skin, given, found.smoothed),
            posterior={} if withheld else posteriors_of(problem, start, found.bank),
            compared=found.compared,
            budget=budget_of_shares(budget),
            hold_out=without,
            damage=damage,
        ),
        units | {"the biased channel": units_in_words(kinds[given.biased])},
        tuple(UNITS[kind] for kind in kinds),
        verdict(found.run.whitened[:, 0]),
        tuning,
        withheld,
        judgement,
        settings.accept,
        hidden,
        tuple(resultants),
        virtual_labels(settings.virtual),
        grid_of(settings, skin, given, found.smoothed, None if damage is None else damage.surface),
    )


def _found(
    config: PlacementConfig,
    given: Filtering,
    judgement: Judgement,
    withheld: str,
    wanted: Callable[[FilterRun], Wanted],
) -> Filtered:
    """Filter and smoother, with other filters beside them where that is asked for or takes little."""
    compare = not given.long if config.filter.compare is None else config.filter.compare
    try:
        return filtered(given, compare and not withheld, wanted)
    except (NumericalError, np.linalg.LinAlgError) as error:
        if judgement.trusted:
            raise
        raise ContradictionError(
            f"no filter can follow this record: {judgement.words.removesuffix(f', {ACCEPT}')}",
            key="estimate.channels",
            remedy="correct the channel, and estimate again",
        ) from error


def _without_each(
    config: PlacementConfig, settings: Estimate, given: Filtering, untold: str, using: Resources
) -> HoldOut | None:
    """Every gauge by the others where that is asked for; untold: why there is no σ whatever the record is, else empty."""
    if settings.hold_out is None:
        return None

    def hidden(channels: np.ndarray) -> str:
        return undetectable(given.problem, channels, config.place.instants, config.seed, True)

    return held_out(given, hidden, bool(untold), using.progress)


def _damage(
    config: PlacementConfig,
    settings: Estimate,
    skin: Skin | None,
    given: Filtering,
    found: Filtered,
    withheld: str,
    using: Resources,
) -> Damaged | None:
    """Damage where it is asked for, without its interval where σ is withheld."""
    if settings.damage is None or skin is None:
        return None
    draws = None if withheld else histories(given, found, settings.damage.draws, config.seed)
    asked = asked_places(skin, settings.virtual, config.gauges)

    def counting(share: float) -> None:
        using.progress("damage", 0.7 + 0.3 * share)

    return damage_in_test(settings.damage, asked, given.model, found.smoothed, draws, counting)


def _estimated(
    given: Filtering,
    found: Filtered,
    resultants: Mapping[str, Resultant],
    judgement: Judgement,
    source: Source,
    notes: tuple[str, ...],
) -> Estimated:
    model, test, run, smoothed = given.model, given.test, found.run, found.smoothed
    estimate, later = (physical(model, own.mean[:, 0], own.std[:, 0]) for own in (run, smoothed))
    sampled = slice(test.every - 1, None, test.every)
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
        bias=Offsets(channel=given.biased, mean=mean, std=std) if len(given.biased) else None,
        resultant={str(i): own for i, own in enumerate(resultants.values())},
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


def _words(
    config: PlacementConfig, given: Filtering, judgement: Judgement, withheld: str, not_held: tuple[str, ...]
) -> tuple[str, ...]:
    """What a reader has to know of the estimate, sentence by sentence."""
    problem, test = given.problem, given.test
    rests = withheld or rests_on_loads_in_words(problem)
    if not withheld and not judgement.trusted:
        rests = f"accepted (estimate.accept), and σ given all the same: {judgement.words.removesuffix(f', {ACCEPT}')}"
    others, comparable = "", problem.method == "bank" and problem.unknowns.parameters
    if withheld and config.filter.compare:
        others = "filter.compare: other filters are not compared where σ is withheld"
    elif not withheld and given.long and config.filter.compare is None and comparable:
        others = f"more than {LONGEST_COMPARED} steps: other filters are compared with filter.compare: true"
    words = clock_in_words(test, config.train.time_step), scheme_in_words(problem, test.h), *not_held, rests, others
    return tuple(filter(None, words))


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

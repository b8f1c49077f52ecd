"""The record of a test as a suspect: the bank that judges it, and what its gauges would read turned.

record that exclude each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, StatedTolerances, tolerances_of
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.decision import out_of_range
from strainsight.estimation.faults import ANGLES
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.suspect import Suspect
from strainsight.experiment.structure.filtered_test import Filtered, Filtering, banks_of
from strainsight.experiment.structure.nuisances import nuisances_of, on_average, tolerated
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.references import unknown_units
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import Thickness
from strainsight.records.estimated import Compared
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.rows import channel_rows, fits
from strainsight.sensors.surface import turned


@dataclass(frozen=True)
class Turning:
    """What gauges would read turned on the surface.

    rows (m, angles, n): of channels by ANGLES, per reduced coordinate, NaN where a channel cannot be turned; missed
    (m, angles, n_u, misalignments): likewise, of misaligned loads; channels (m,) of train.h5.
    """

    channels: np.ndarray
    rows: np.ndarray
    missed: np.ndarray


def turning_of(
    mesh: Mesh, reduced: Reduced, training: Training, channels: np.ndarray, thickness: Thickness | None = None
) -> Turning:
    """Of channels (m,) of train.h5; only gauges of strain on the mesh can be turned, whose grid then stays on the surface, and no
    bridges, the arms of which would be turned each by itself. thickness: of shells at the guess, where it is free."""
    n, missed = training.rows.shape[1], reduced.misaligned.missed
    rows = np.full((len(channels), len(ANGLES), n), np.nan)
    more = np.zeros((*rows.shape[:2], *missed.shape[1:]))
    pool = training.candidates
    own = np.flatnonzero((pool.quantity == STRAIN)[channels] & ~pool.bridged[channels] & (training.given is None))
    if len(own):
        both = np.hstack([reduced.basis, missed.reshape(len(missed), -1)])
        facets = exterior_facets(mesh)
        for k, angle in enumerate(ANGLES):
            part = _apart(_turned(pool.take(channels[own]), angle))
            well = np.flatnonzero(fits(mesh.position, part, facets))
            read = channel_rows(mesh.position, part.take(well), both, facets=facets, thickness=thickness)
            rows[own[well], k], more[own[well], k] = read[:, :n], read[:, n:].reshape(-1, *missed.shape[1:])
    return Turning(channels, rows, more)


def suspect_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    given: Filtering,
    turning: Turning,
) -> Suspect:
    """By the bank, whatever filter estimates: no other takes the tolerances in."""
    model, test = given.model, given.test
    channels = test.channels
    Q, at = np.array(model.Q), model.parameter_states
    Q[..., at, :], Q[..., :, at] = 0.0, 0.0
    constant = replace(model, Q=Q)
    wide = np.full((*turning.rows.shape[:2], model.size), 0.0)
    wide[..., : turning.rows.shape[-1]] = turning.rows
    moving, motion = np.array(given.covariance), given.model.motion
    moving[motion, motion] = np.diag(np.abs(given.problem.x).max(axis=0) ** 2)

    def with_turned(j: int, angle: float) -> tuple[FilterModel, Nuisances]:
        k, channel = ANGLES.index(angle), channels[j]
        H = np.array(constant.H)
        H[j] = wide[j, k]
        # rows of the guess: how they change with a thickness is known of the channel as it was meant
        change = constant.change.of_terms(lambda X: np.where((np.arange(len(X)) == j)[:, None], 0.0, X))
        one = np.zeros(len(training.candidates))
        one[channel] = angle
        rows, missed = np.array(training.rows), np.array(training.missed)
        rows[channel], missed[channel] = turning.rows[j, k], turning.missed[j, k]
        as_turned = replace(training, candidates=_turned(training.candidates, one), rows=rows, missed=missed)
        own = tolerated(config, mesh, reduced, as_turned, channels)
        # the others have what they read on average over their installations already
        H[j] = on_average(own, replace(constant, H=H), channels).H[j]
        changed = replace(constant, H=H, change=change)
        return changed, nuisances_of(own, changed, channels)

    return Suspect(
        model=constant,
        mean=np.zeros(len(given.covariance)),
        covariance=given.covariance,
        known=test.known,
        samples=test.values,
        nuisances=nuisances_of(given.tolerances, constant, channels),
        biased=given.biased,
        settled=given.settled,
        turned_rows=wide,
        turned=with_turned,
        load=np.tile(np.arange(len(given.problem.known)), 2)[: test.known.shape[-1]],
        moving=moving,
    )


def _turned(pool: Candidates, angle: float | np.ndarray) -> Candidates:
    each = np.broadcast_to(np.asarray(angle, dtype=float), (len(pool),))
    return replace(pool, direction=turned(pool.direction, pool.normal, each))


def _apart(pool: Candidates) -> Candidates:
    """Every channel a gauge of its own."""
    return replace(pool, gauge=np.arange(len(pool)))


EXCLUDED = 5.0
"""Of the σ of both together: two estimates that are farther apart exclude each other."""
Values = Mapping[str, tuple[float, float]]
"""Parameter → value and σ [SI]."""


def beyond_ranges(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Parameter → a sentence, of those whose values [SI] are beyond `parameters.*.range`.

    Modes and static responses of `rom` span the range; a damping factor multiplies C within the reduced model and is exact
    anywhere.
    """
    free = [name for name in problem.unknowns.parameters if name != problem.model.damping.parameter]
    ranges = {name: config.parameters[name].range for name in free}
    return out_of_range(values, ranges, unknown_units(config), "rom")


def widen(beyond: Mapping[str, str]) -> str:
    """What to do about parameters beyond their ranges."""
    return f"widen {' and '.join(f'parameters.{name}.range' for name in beyond)}"


def last_values(given: Filtering, mean: np.ndarray, std: np.ndarray) -> Values:
    """Of the unknowns, from the augmented state (n,)."""
    return {name: (float(value), float(own)) for name, (value, own) in physical(given.model, mean, std).items()}


def excluded_by_comparison(tolerances: StatedTolerances, given: Filtering, found: Filtered) -> tuple[str, str]:
    """Why there is no σ, and a note, each empty where there is nothing to say.

    The bank beside the estimate has no tolerances, and an unknown start. Where tolerances are stated, the estimate stands against
    it, unless the start is settled and a bank with the same tolerances and an unknown start excludes the estimate, too.
    """
    ends = last_values(given, found.smoothed.mean[-1, 0], found.smoothed.std[-1, 0])
    words = excluded(ends, by_bank(found.compared))
    if not words or tolerances_of(tolerances) == NONE:
        return excluded_in_words(words, given.settled is not None, "estimate.start"), ""
    if given.settled is not None:
        run = banks_of([replace(given, settled=None)])[0].run
        moving = last_values(given, run.mean[-1, 0], run.std[-1, 0])
        if otherwise := excluded(ends, {name: moving[name] for name in given.model.unknowns.parameters}):
            return excluded_in_words(otherwise, True, "estimate.start"), ""
    return "", f"the comparison takes tolerances for exact, which this record excludes: {words}, with and without them"


def excluded(found: Values, other: Values) -> str:
    """Which parameters two estimates give values that exclude each other, in words; empty where none."""
    words = []
    for name, (b, t) in other.items():
        a, s = found[name]
        if abs(np.log(a / b)) > EXCLUDED * np.hypot(s / a, t / b):
            words.append(f"{name} is {a:.4g} ± {100 * s / a:.2g} % or {b:.4g} ± {100 * t / b:.2g} %")
    return "; ".join(words)


def by_bank(beside: Compared | None) -> dict[str, tuple[float, float]]:
    """By the bank of a comparison; empty where nothing was compared."""
    if beside is None:
        return {}
    return {name: (float(value[0]), float(beside.std[name][0])) for name, value in beside.estimate.items()}


def excluded_in_words(words: str, settled: bool, key: str) -> str:
    """Why there is no σ, by the words of `excluded`; settled: whether the start of the estimate is, as `key` says."""
    remedy = (
        f"with a settled and with an unknown start: check {key}" if settled else "by two searches: report this record"
    )
    return f"two estimates exclude each other: {words}, {remedy}" if words else ""

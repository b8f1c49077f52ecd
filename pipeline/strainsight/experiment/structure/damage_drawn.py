"""Damage of a test, drawn as the samples say that its unknown loads walk."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun
from strainsight.estimation.bank_smoother import AT_ONCE, Paths, bank_paths
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.smoother import smoother_errors
from strainsight.experiment.resources import Resources
from strainsight.experiment.structure.damage import (
    SHOWN,
    SHOWN_DECIDED,
    Recorded,
    asked_places,
    damage_in_test,
    damage_notes,
)
from strainsight.experiment.structure.filtered_test import Filtered, Filtering, banks_of
from strainsight.experiment.structure.surface import Skin
from strainsight.records.estimated import Damaged

OTHER = {"random_walk": "integrated_random_walk", "integrated_random_walk": "random_walk"}
DECISIVE = 10.0
"""Of ln evidence, odds of 2·10⁴: by less the samples do not tell one walk from the other."""

T = TypeVar("T")


@dataclass(frozen=True)
class _Walked:
    """Filters by one choice of walks; banks None of another filter."""

    config: PlacementConfig
    each: Sequence[Filtering]
    banks: Sequence[BankRun | None]


def drawn_damage(
    config: PlacementConfig,
    settings: Estimate,
    skin: Skin | None,
    each: Sequence[Filtering],
    found: Sequence[Filtered],
    withheld: str,
    otherwise: Callable[[PlacementConfig], list[Filtering]],
    using: Resources,
) -> tuple[Damaged | None, tuple[str, ...]]:
    """Damage of all records where it is asked for, without its interval where σ is withheld, and what a reader has to know of it.

    otherwise: what the filters are given by a config in which loads walk otherwise.
    """
    own = settings.damage
    if own is None or skin is None:
        return None, ()
    using.progress("damage", 0.7)
    walked = _walks(config, each, found, None if withheld else otherwise)
    drawn = walked.best
    shown = SHOWN if walked.undecided else SHOWN_DECIDED

    def counting(share: float) -> None:
        using.progress("damage", 0.7 + 0.3 * share)

    records = [
        Recorded(
            given.model,
            one.smoothed,
            skin.field.states(one.smoothed.mean),
            None if withheld else histories(by, replace(one, bank=bank), own.draws, config.seed),
        )
        for given, one, by, bank in zip(each, found, drawn.each, drawn.banks, strict=True)
    ]
    damage = damage_in_test(own, asked_places(skin, settings.virtual, config.gauges), records, counting, shown)
    return damage, damage_notes(own, withheld, shown, walks_in_words(drawn.config, walked.changed))


def _walks(
    config: PlacementConfig,
    each: Sequence[Filtering],
    found: Sequence[Filtered],
    otherwise: Callable[[PlacementConfig], list[Filtering]] | None,
) -> Walks[_Walked]:
    """How unknown loads walk by the samples of all records, for histories that are drawn; otherwise: None where none are."""
    unknown = each[0].problem.unknowns.inputs
    stated = _Walked(config, each, [one.bank for one in found])
    if otherwise is None or not may_walk_otherwise(config, unknown):
        return Walks(stated, (), unknown or ("motion",))

    def other(so_far: _Walked, name: str) -> _Walked | None:
        changed = walking(so_far.config, name)
        try:
            given = otherwise(changed)
            return _Walked(changed, given, banks_of(given))
        except (NumericalError, np.linalg.LinAlgError):
            return None

    def evidence(own: _Walked) -> float:
        return float(sum(bank.run.log_likelihood[0] for bank in own.banks if bank is not None))

    return walks(stated, unknown, other, evidence)


def histories(given: Filtering, found: Filtered, count: int, seed: int) -> Iterator[Paths]:
    """`count` draws of q (N, T + 1, n) with the parameters of each, in parts; by the bank where there is one, with z behind it.

    A parameter that a filter lets drift is its mean over the record.
    """
    if found.bank is not None:
        q = slice(0, given.model.model.size)
        yield from bank_paths(given.bank_record, found.bank, count, seed, q, given.record)
        return
    model, known, at = given.model, given.test.known, given.biased
    q = slice(0, model.model.size)
    core, rng = driven_with_offsets(model, known, at), np.random.default_rng(seed)
    part = max(1, AT_ONCE // ((len(known) + 1) * core.size))
    for first in range(0, count, part):
        error = smoother_errors(core, found.run, min(part, count - first), rng)
        error += found.smoothed.mean[None, :, 0]
        yield Paths(error[:, :, model.parameter_states].mean(axis=1), error[:, :, q])


@dataclass(frozen=True)
class Walks(Generic[T]):
    """best: what the samples speak for; changed: loads that walk otherwise in it than stated; undecided: loads of which the
    samples do not tell one walk from the other."""

    best: T
    changed: tuple[str, ...]
    undecided: tuple[str, ...]


def walks(
    stated: T, loads: Sequence[str], other: Callable[[T, str], T | None], evidence: Callable[[T], float]
) -> Walks[T]:
    """Load by load the walk of the larger evidence, by DECISIVE or more:

        ln p(y | other walk) − ln p(y | walk so far)

    everything else integrated out of both. other: the same with the other walk of one load; evidence: ln p(y), −∞ where no
    filter follows the samples, which is None of other.
    """
    best, level = stated, evidence(stated)
    changed, undecided = [], []
    for name in loads:
        tried = other(best, name)
        found = -np.inf if tried is None else evidence(tried)
        if tried is not None and found >= level + DECISIVE:
            best, level = tried, found
            changed.append(name)
        elif found > level - DECISIVE:
            undecided.append(name)
    return Walks(best, tuple(changed), tuple(undecided))


def walking(config: PlacementConfig, name: str) -> PlacementConfig:
    """The config with the other walk of one load, κ as stated."""
    load = config.loads[name]
    noise = load.process_noise.model_copy(update={"model": OTHER[load.process_noise.model]})
    return config.model_copy(update={"loads": {**config.loads, name: load.model_copy(update={"process_noise": noise})}})


def may_walk_otherwise(config: PlacementConfig, unknown: Sequence[str]) -> bool:
    """Whether the walks of all unknown loads can be compared: all are one, with intensities that do not depend on the step, and a
    bank filters them, with evidence that has everything integrated out."""
    stated = all(config.loads[name].process_noise.model in OTHER for name in unknown)
    return stated and config.filter.method == "bank" and config.process_noise.rule == "continuous"


def walks_in_words(config: PlacementConfig, changed: Sequence[str]) -> str:
    """How loads walk in the draws; config: of the draws; empty where as stated."""
    if not changed:
        return ""
    each = [(f"loads.{name}.process_noise.model", config.loads[name].process_noise.model) for name in changed]
    keys = ", ".join(f"{key}: {model}" for key, model in each)
    return (
        f"the samples speak for another walk of {', '.join(changed)} than is stated, and damage is drawn by it; loads, strains "
        f"and their σ are by that which is stated: {keys} has all by the other"
    )

"""Damage of a test, drawn as the samples say that its unknown loads walk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.resources import Resources
from strainsight.cases.structure.damage import (
    SHOWN,
    SHOWN_DECIDED,
    Recorded,
    asked_places,
    damage_in_test,
    damage_notes,
)
from strainsight.cases.structure.filtered_test import Filtered, Filtering, banks_of
from strainsight.cases.structure.histories import histories
from strainsight.cases.structure.surface import Skin
from strainsight.cases.structure.walks import Walks, may_walk_otherwise, walking, walks, walks_in_words
from strainsight.config.estimate import Estimate
from strainsight.config.placement import PlacementConfig
from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun
from strainsight.records.damage import Damaged


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

"""Which walk an unknown load takes, by the samples: draws of a history are as rough as the load's model says that it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from strainsight.config.placement import PlacementConfig

OTHER = {"random_walk": "integrated_random_walk", "integrated_random_walk": "random_walk"}
DECISIVE = 10.0
"""Of ln evidence, odds of 2·10⁴: by less the samples do not tell one walk from the other."""

T = TypeVar("T")


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

"""Estimates of a structure that have left the range which its reduced model was made for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.cases.out_of_range import beyond_their_ranges, withheld_beyond
from strainsight.cases.structure.filtered_test import Filtered, Filtering
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.settings import unknown_units
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.model import physical
from strainsight.records.validated import Validated


def beyond_ranges(config: PlacementConfig, each: Sequence[Filtering], found: Sequence[Filtered]) -> dict[str, str]:
    """Parameter → a sentence, of those that came out beyond `parameters.*.range`."""
    beyond: dict[str, str] = {}
    for given, own in zip(each, found, strict=True):
        values = physical(given.model, own.smoothed.mean[:, 0], own.smoothed.std[:, 0])
        last = {name: float(values[name][0][-1]) for name in given.problem.unknowns.parameters}
        beyond |= _beyond(config, given.problem, last)
    return beyond


def out_of_range_in_words(beyond: Mapping[str, str]) -> str:
    """That there is no σ as these parameters came out beyond their ranges, empty where none did."""
    return withheld_beyond(
        beyond,
        f"widen {_keys(beyond)} if that can be, or look for a load, unit, support or gauge that is not as stated",
    )


def validated_out_of_range(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> str:
    """The same of a validation; values of the parameters [SI]."""
    beyond = _beyond(config, problem, values)
    return withheld_beyond(beyond, f"widen {_keys(beyond)}")


def without_sigma(own: Validated) -> Validated:
    """A validation without σ of its run: NaN. Random sets and repeats, each an estimate of its own, keep theirs."""

    def nothing(std: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: np.full_like(values, np.nan) for name, values in std.items()}

    return replace(
        own,
        std=nothing(own.std),
        smoothed_std=nothing(own.smoothed_std),
        gauge=replace(own.gauge, std=np.full_like(own.gauge.std, np.nan)),
        field=replace(own.field, std=np.full_like(own.field.std, np.nan)),
        noise=replace(own.noise, std=nothing(own.noise.std)),
        compared=None,
        budget=None,
    )


def _beyond(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Modes and static responses of `rom` span the range; a damping factor multiplies C within the reduced model and is exact
    anywhere."""
    free = [name for name in problem.unknowns.parameters if name != problem.model.damping.parameter]
    ranges = {name: config.parameters[name].range for name in free}
    return beyond_their_ranges(values, ranges, unknown_units(config), "rom")


def _keys(beyond: Mapping[str, str]) -> str:
    return " and ".join(f"parameters.{name}.range" for name in beyond)

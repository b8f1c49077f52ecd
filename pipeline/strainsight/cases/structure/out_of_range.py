"""Estimates that have left the range which the reduced model was made for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from strainsight.cases.structure.filtered_test import Filtered, Filtering
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.settings import unknown_units
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.model import physical


def out_of_range_in_words(config: PlacementConfig, each: Sequence[Filtering], found: Sequence[Filtered]) -> str:
    """That there is no σ as a parameter came out beyond `parameters.*.range`, empty where none did.

    Modes and static responses of `rom` span the range; what the model is off by beyond it is in no σ. A damping factor multiplies
    C within the reduced model and is exact anywhere.
    """
    beyond: dict[str, str] = {}
    for given, own in zip(each, found, strict=True):
        values = physical(given.model, own.smoothed.mean[:, 0], own.smoothed.std[:, 0])
        last = {name: float(values[name][0][-1]) for name in given.problem.unknowns.parameters}
        beyond |= beyond_their_ranges(config, given.problem, last)
    if not beyond:
        return ""
    return (
        f"σ is withheld: {'; '.join(beyond.values())}: widen {_keys(beyond)} if that can be, or look for a load, unit, support "
        "or gauge that is not as stated"
    )


def beyond_their_ranges(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Parameter → that its value lies beyond its range, for those that do and that the reduced model is not exact in."""
    units, found = unknown_units(config), {}
    for name in problem.unknowns.parameters:
        low, high = config.parameters[name].range
        if name != problem.model.damping.parameter and not low <= values[name] <= high:
            unit = "" if units[name] == "1" else f" {units[name]}"
            found[name] = (
                f"{name} came out at {values[name]:.4g}{unit}, and rom made the model for {low:.4g} to {high:.4g}"
            )
    return found


def validated_out_of_range(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> str:
    """That no σ of a validation covers what left its range, empty where nothing did; values of the parameters [SI]."""
    beyond = beyond_their_ranges(config, problem, values)
    if not beyond:
        return ""
    return f"{'; '.join(beyond.values())}: no σ covers what the model is off by there, widen {_keys(beyond)}"


def _keys(beyond: Mapping[str, str]) -> str:
    return " and ".join(f"parameters.{name}.range" for name in beyond)

"""Estimates that have left the range which the reduced model was made for."""

from __future__ import annotations

from collections.abc import Sequence

from strainsight.cases.structure.filtered_test import Filtered, Filtering
from strainsight.cases.structure.settings import unknown_units
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.model import physical


def out_of_range_in_words(config: PlacementConfig, each: Sequence[Filtering], found: Sequence[Filtered]) -> str:
    """That there is no σ as a parameter came out beyond `parameters.*.range`, empty where none did.

    Modes and static responses of `rom` span the range; what the model is off by beyond it is in no σ. A damping factor multiplies
    C within the reduced model and is exact anywhere.
    """
    units, beyond = unknown_units(config), {}
    for given, own in zip(each, found, strict=True):
        values = physical(given.model, own.smoothed.mean[:, 0], own.smoothed.std[:, 0])
        for name in given.problem.unknowns.parameters:
            low, high = config.parameters[name].range
            value = float(values[name][0][-1])
            if name != given.problem.model.damping.parameter and not low <= value <= high:
                unit = "" if units[name] == "1" else f" {units[name]}"
                beyond[name] = (
                    f"{name} came out at {value:.4g}{unit}, and rom made the model for {low:.4g} to {high:.4g}"
                )
    if not beyond:
        return ""
    keys = " and ".join(f"parameters.{name}.range" for name in beyond)
    return (
        f"σ is withheld: {'; '.join(beyond.values())}: widen {keys} if that can be, or look for a load, unit, support or gauge "
        "that is not as stated"
    )

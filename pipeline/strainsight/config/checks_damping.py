"""What a parameter that multiplies the damping demands of the rest of a config."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.placement import PlacementConfig, RayleighDamping
from strainsight.config.problem import Problem
from strainsight.config.tolerances import tolerances_of

DAMPING = "damping_factor"


def damping_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Of parameters that are a damping_factor."""
    names = [name for name, own in config.parameters.items() if own.property == DAMPING]
    for name in names[1:]:
        what = f"the damping is multiplied by {names[0]} already"
        yield Problem(f"parameters.{name}", what, "keep one of the two", at_key=True)
    for name in names:
        own = config.parameters[name]
        if own.region is not None:
            what = f"a {DAMPING} multiplies `damping` in every mode: it has no region"
            yield Problem(f"parameters.{name}.region", what, "remove the key")
        law = config.damping
        none = not (law.alpha or law.beta) if isinstance(law, RayleighDamping) else not law.ratio
        if none:
            what = f"a {DAMPING} of no damping (`damping` is zero)"
            yield Problem(f"parameters.{name}.property", what, "give `damping` what is expected, such as ratio: 0.01")
        spread = tolerances_of(config.tolerances).damping
        if name in config.place.estimate and spread > 1:
            what = (
                f"one factor of all modes, which each may be damped {spread:g} times more or less (tolerances.damping)"
            )
            remedy = "state that they keep their ratios, tolerances: {damping: 1}, or do not estimate it"
            yield Problem(f"parameters.{name}.property", what, remedy)
        if config.train.model == "static":
            what = "damping, which a structure without inertia does not feel (train.model: static)"
            yield Problem(f"parameters.{name}.property", what, "train.model: dynamic")

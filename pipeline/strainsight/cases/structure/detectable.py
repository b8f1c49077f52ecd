"""Whether the channels of a test can tell the unknowns."""

from __future__ import annotations

import numpy as np

from strainsight.augmentation.linearisation import linearisation_instants, linearise
from strainsight.augmentation.observability import undetectable_directions, undetectable_in_words
from strainsight.cases.structure.problem import Problem
from strainsight.errors import InfeasibleError
from strainsight.signals.histories import instant_values


def undetectable(problem: Problem, channels: np.ndarray, instants: int, seed: int, allowed: bool) -> str:
    """In words what these channels (k,) cannot tell at some of the instants of the training run; empty where nothing.

    Raises InfeasibleError where there is something and that is not allowed.
    """
    p, u = problem, instant_values(problem.u)
    at = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, instants, seed)
    motion = p.model, p.unknowns, p.model.reference, p.x[at], u[at]
    every = linearise(*motion)
    for F, H in zip(every, p.channels.sensed(channels).linearised(*motion, every), strict=True):
        hidden = undetectable_directions(F, H)
        if hidden.shape[1]:
            words = undetectable_in_words(hidden, p.unknowns.state_names)
            if allowed:
                return words
            raise InfeasibleError(
                f"the {len(channels)} channels cannot tell {words}",
                key="estimate.channels",
                remedy="give more channels, or go on all the same with --allow-unobservable",
            )
    return ""

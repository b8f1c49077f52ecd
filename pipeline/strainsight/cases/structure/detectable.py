"""Whether the channels of a test can tell the unknowns."""

from __future__ import annotations

import numpy as np

from strainsight.augmentation.linearisation import linearisation_instants, linearise
from strainsight.augmentation.observability import undetectable_directions, undetectable_in_words, unseen_along
from strainsight.cases.structure.problem import Problem
from strainsight.errors import InfeasibleError
from strainsight.signals.histories import instant_values

AT_ONCE = 1000
"""Instants that are linearised at a time."""


def undetectable(problem: Problem, channels: np.ndarray, instants: int, seed: int, allowed: bool) -> str:
    """In words what these channels (k,) cannot tell: at some instant of the training run, and along all of it. Empty where that
    is nothing.

    Raises InfeasibleError where there is something and that is not allowed.
    """
    p, u = problem, instant_values(problem.u)
    at = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, instants, seed)
    if not any(undetectable_directions(F, H).shape[1] for F, H in zip(*_linearised(p, channels, at), strict=True)):
        return ""
    hidden = _hidden_along(p, channels)
    if not hidden.shape[1]:
        return ""
    words = undetectable_in_words(hidden, p.unknowns.state_names)
    if allowed:
        return words
    raise InfeasibleError(
        f"the {len(channels)} channels cannot tell {words}",
        key="estimate.channels",
        remedy="give more channels, or go on all the same with --allow-unobservable",
    )


def _linearised(problem: Problem, channels: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F* (s, n*, n*) and H* (s, m, n*) at some instants of the training run."""
    p = problem
    motion = p.model, p.unknowns, p.model.reference, p.x[at], instant_values(p.u)[at]
    F = linearise(*motion)
    return F, p.channels.sensed(channels).linearised(*motion, F)


def _hidden_along(problem: Problem, channels: np.ndarray) -> np.ndarray:
    """Directions (n*, d): of the loads, which are the same at all instants, else of the parameters by all of the run."""
    k, n = len(problem.unknowns.parameters), 2 * problem.model.size
    states = problem.unknowns.size(problem.model) - k
    driven, read = [], []
    for part in np.array_split(np.arange(len(problem.x)), -(-len(problem.x) // AT_ONCE)):
        F, H = _linearised(problem, channels, part)
        driven.append(F[:, :n, states:])
        read.append(H[:, :, states:])
    F, H = F[0, :states, :states], H[0, :, :states]
    alone = undetectable_directions(F, H)
    if alone.shape[1] or not k:
        return np.pad(alone, [(0, k), (0, 0)])
    inputs = problem.unknowns.position(problem.model)[: len(problem.unknowns.inputs)]
    motion = F[:n, :n], F[:n, inputs], H[:, :n], H[:, inputs]
    loads, parameters = unseen_along(*motion, np.concatenate(driven), np.concatenate(read), problem.h)
    hidden = np.zeros((states + k, parameters.shape[1]))
    hidden[inputs], hidden[states:] = loads, parameters
    return hidden

"""Why a step of a bench was not solved, where its config shows it."""

from __future__ import annotations

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.errors import ConfigError, InfeasibleError, NumericalError, StrainsightError
from strainsight.multibody.initial import constraints_at, project_position
from strainsight.multibody.laws.friction import Friction

LOCKED = 0.02
"""Share of what the start has of the independence of its constraints, below which they are near a dead centre."""


def explained(error: NumericalError, bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError:
    """Drives that lead where the joints do not let them, friction that is too sharp for its step, or the error as it is.

    q (n,) the start; u (T + 1, nu) at 0, h, 2h, …
    """
    return _out_of_reach(bench, q, u, h) or _sharp(error, bench) or error


def _out_of_reach(bench: Bench, q: np.ndarray, u: np.ndarray, h: float) -> StrainsightError | None:
    """φ(q, p(t)) = 0 from instant to instant, each from the last: does a configuration allow what the drives ask for, and is it
    further from one where the constraints depend on each other, a dead centre, than LOCKED of the start?"""
    drives = bench.system.drives
    if not drives.names:
        return None
    first = 0.0
    for k, own in enumerate(u):
        try:
            q = project_position(bench.system, q, own)
            share = _independence(bench, q, own)
            first = share if k == 0 else first
            why = "stand at a dead centre" if share < LOCKED * first else ""
        except InfeasibleError:
            why = "do not let the drives go on"
        if why:
            asked = ", ".join(f"{name} {own[drives.at + i]:.4g}" for i, name in enumerate(drives.names))
            return ConfigError(
                f"at t = {k * h:g} s the joints {why}, at {asked} [m or rad]",
                key=f"joints.{drives.names[0]}.drive" if len(drives.names) == 1 else "joints",
                remedy="let it go less far, or move its frames",
            )
    return None


def _independence(bench: Bench, q: np.ndarray, u: np.ndarray) -> float:
    """Smallest singular value of the gradients of all constraints, each of length 1 in the metric."""
    B = constraints_at(bench.system, q, u)[1] / bench.system.metric
    return float(np.linalg.svd(B / np.linalg.norm(B, axis=1)[:, None], compute_uv=False)[-1])


def _sharp(error: NumericalError, bench: Bench) -> StrainsightError | None:
    laws = {e.force.name: e.force.law for e in bench.system.elements}
    sharp = {name: law.speed for name, law in laws.items() if isinstance(law, Friction) and law.coulomb > 0}
    if not sharp or "was not solved" not in error.what:
        return None
    name = min(sharp, key=lambda own: sharp[own])
    return NumericalError(
        error.what,
        key=f"forces.{name}",
        remedy=f"its friction may be too sharp for the step: raise its speed of {sharp[name]:g}, or take a smaller "
        "simulate.time_step",
    )

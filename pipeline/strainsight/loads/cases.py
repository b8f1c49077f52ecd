"""What one known motion can tell: the seven cases of tables 6.1 and 6.2, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strainsight.errors import ConfigError
from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.loads.linearisation import linearisation_instants, linearise
from strainsight.loads.measurement import Sensed
from strainsight.loads.observability import Observability, observability
from strainsight.loads.unknowns import Unknowns
from strainsight.rom.model import ReducedModel, modal_basis

GROUPS = 4
ORDER = tuple(chosen for count in range(1, GROUPS + 1) for chosen in combinations(range(GROUPS), count))
"""Which of inputs, moduli, densities and damping are unknown together; the first three in the order of the tables."""


@dataclass(frozen=True)
class Case:
    """PBH at λ = 0 of one set of unknowns, at the instant of the median of its scaled condition.

    label: "input+E+rho"; unknowns: their names; found: condition, σ_min, the thesis's raw condition and the null
    direction, all of that one instant; instant: its index in the motion, −1 where there is none; instants: how many the
    median is over; reason: why it is unobservable without a computation, else empty.

    """

    label: str
    unknowns: tuple[str, ...]
    found: Observability
    instant: int
    instants: int
    reason: str = ""


def cases(
    model: ReducedModel,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    *,
    inputs: Sequence[str],
    moduli: Sequence[str],
    densities: Sequence[str],
    damping: Sequence[str] = (),
    amplitude: Mapping[str, float],
    guess: Mapping[str, float],
    sensed: Sensed,
    largest: np.ndarray,
    instants: int,
    seed: int,
) -> tuple[Case, ...]:
    """Every combination of unknown inputs, moduli, densities and damping at the same motion; fewer where a group is empty.

    Each is linearised at its own `linearisation_instants`; the instant of the median condition speaks for it, of an even
    number the better of the two in the middle. Inputs are random walks, whatever the filter takes them for.

    theta: all parameters [SI]; x (s, 2n) = [q, q̇], u (s, n_u) [N]: the motion; inputs, moduli, densities, damping: names;
    amplitude [N], guess [SI]: scales of the unknowns; sensed: every channel (m,); largest (m,): largest reading of the
    channel's quantity in that motion, by which its row is divided. A parameter on which the motion never depends makes its
    cases unobservable, with that as the reason.
    Raises ConfigError where a quantity reads nothing in the motion. Source: thesis (6.1), tables 6.1 and 6.2.
    """
    groups = (("input", tuple(inputs)), ("E", tuple(moduli)), ("rho", tuple(densities)), ("damping", tuple(damping)))
    if not np.all(largest > 0):
        raise ConfigError(
            f"{np.sum(~(largest > 0))} of {len(largest)} channels are of a quantity that reads nothing in the motion",
            remedy="load the structure, or leave these sensors out",
        )
    lam = modal_basis(model, model.reference)[0]
    n = model.size
    energy = float(np.sqrt(np.sum(lam * x[:, :n] ** 2 + x[:, n:] ** 2, axis=1)).max())
    scaled, plain = _compressed(sensed, 1 / np.asarray(largest)), _compressed(sensed, np.ones(len(largest)))
    found = []
    for chosen in ORDER:
        if any(not groups[g][1] for g in chosen):
            continue
        label = "+".join(groups[g][0] for g in chosen)
        parameters = tuple(name for g in chosen if g > 0 for name in groups[g][1])
        unknowns = Unknowns(groups[0][1] if 0 in chosen else (), parameters, amplitude, guess)
        try:
            at = linearisation_instants(model, unknowns, theta, x, u, instants, seed)
        except ConfigError as error:
            nothing = Observability(float("inf"), 0.0, float("inf"), "")
            found.append(Case(label, unknowns.names, nothing, -1, 0, error.what))
            continue
        motion = model, unknowns, theta, x[at], u[at]
        F = linearise(*motion)
        by_size, as_is = (own.linearised(*motion, F) for own in (scaled, plain))
        results = [
            _observability(*own, unknowns=unknowns, frequency=np.sqrt(lam), energy=energy)
            for own in zip(F, by_size, as_is, strict=True)
        ]
        middle = np.argsort([result.condition for result in results], kind="stable")[(len(at) - 1) // 2]
        found.append(Case(label, unknowns.names, results[middle], int(at[middle]), len(at)))
    return tuple(found)


def _observability(
    F: np.ndarray,
    scaled: np.ndarray,
    plain: np.ndarray,
    unknowns: Unknowns,
    frequency: np.ndarray,
    energy: float,
) -> Observability:
    """`observability` with every row divided by its own reading; the raw condition is that of the rows as they are."""
    return observability(
        F,
        scaled,
        names=unknowns.names,
        frequency=frequency,
        state_amplitude=energy,
        largest_strain=1.0,
        raw_scale=unknowns.scale,
        raw_rows=plain,
    )


def _compressed(own: Sensed, factor: np.ndarray) -> Sensed:
    """Few rows for each quantity with the same HᵀH at any θ, and so the same singular values, whatever the pool; factor (m,) of
    each of its rows."""
    n, labels = own.rows.shape[1], list(own.change.terms)
    both = factor[:, None] * np.hstack([own.rows, *(own.change.terms[label] for label in labels)])
    parts = [(kind, np.linalg.qr(both[own.quantity == kind], mode="r")) for kind in np.unique(own.quantity)]
    R = np.vstack([R for _, R in parts])
    terms = {label: R[:, k * n : (k + 1) * n] for k, label in enumerate(labels, start=1)}
    change = AffineOperator(NO_CHANGE.constant, terms, own.change.coefficients)
    return Sensed(R[:, :n], np.concatenate([np.full(len(R), kind) for kind, R in parts]), change)

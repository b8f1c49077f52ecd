"""Gauges left out of a test in turn: what the others say that each of them reads, beside what it read."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from strainsight.cases.structure.filtered_test import Filtered, Filtering, filtered, filtered_together
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import acceleration_rows, known_ends, theta_at
from strainsight.estimation.motion import surface_reading
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.update import output_std
from strainsight.records.estimated import HoldOut


def held_out(
    each: Sequence[Filtering],
    tells: Callable[[np.ndarray], str],
    withheld: bool,
    progress: Callable[[str, float], None],
) -> tuple[HoldOut, ...]:
    """Predict every gauge in every record by the others: all channels of one gauge are left out together, of all records.

        ŷ = H x̂ˢ,     σ² = H Pˢ Hᵀ + R + Σₖ (Dₖ x̂ˢ + Eₖ w + oₖ)² + σ_b²

    x̂ˢ, Pˢ smoothed from the other channels; H with the column θ ∂H/∂θ q̂ of a free thickness; R of one sample; D, E, o what
    the gauge's own installation may be off by (`Nuisances`), and σ_b the σ of its unknown offset. tells: in words, what some
    channels (k,) of train.h5 cannot tell, empty where nothing; withheld: whether σ is. NaN for a gauge without which the others
    cannot tell the unknowns, and for a σ that is withheld.
    """
    test = each[0].test
    owner = each[0].problem.channels.gauge[test.channels]
    found = [np.full((2, *own.test.values.shape), np.nan) for own in each]
    said = [""] * len(owner)
    gauges = np.unique(owner)
    for i, gauge in enumerate(gauges):
        progress(f"without {test.labels[int(np.argmax(owner == gauge))]}", 0.7 + 0.25 * i / len(gauges))
        out, rest = np.flatnonzero(owner == gauge), np.flatnonzero(owner != gauge)
        lost = tells(test.channels[rest]) if len(rest) else "anything"
        by: tuple[Filtered, ...] = ()
        try:
            by = () if lost else _filtered([own.by(rest) for own in each])
        except NumericalError as error:
            lost = error.what
        for j in out:
            said[j] = f"the others cannot tell {lost}" if lost else ""
        for own, one, values in zip(each, by, found, strict=False):
            values[:, :, out] = _predicted(own.by(out), (one.without_sigma() if withheld else one).smoothed)
    return tuple(HoldOut(predicted=mean, std=std, left_in=tuple(said)) for mean, std in found)


def _filtered(each: Sequence[Filtering]) -> tuple[Filtered, ...]:
    return filtered_together(each) if len(each) > 1 else (filtered(each[0]),)


def _predicted(given: Filtering, found: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Readings (T, c) of the channels of `given`, and their σ."""
    model, test, nuisances = given.model, given.test, given.nuisances
    states, sampled = model.parameter_states.start, slice(model.every, None, model.every)
    x = found.mean[sampled, 0]
    assert found.covariance is not None
    P = found.covariance[sampled, 0, : model.size, : model.size]
    theta = theta_at(model, x[-1:, model.parameter_states])
    read = model.rows_at(theta).reshape(-1, model.size)
    H, fed = read[:, :states].copy(), np.zeros((len(test.channels), len(model.known_inputs)))
    slope = np.zeros((1, len(H), model.size - states))
    if model.change.terms:
        _, J = surface_reading(model, model.H[:, : model.model.size], model.change, x[:, : model.size])
        slope = J[..., model.parameter_states]
    if model.accelerometers is not None:
        moving = model.accelerometers
        on_states, on_known = acceleration_rows(model, theta, read[moving, : model.model.size])
        H[moving], fed[moving], slope[:, moving] = on_states[0], on_known[0], 0.0
    J = np.concatenate([np.broadcast_to(H, (len(slope), *H.shape)), slope], axis=-1)
    ends = known_ends(test.known, nuisances)[model.every - 1 :: model.every]
    own = np.einsum("dmn,tn->tdm", nuisances.D, x[:, :states]) + np.einsum("dmp,tp->tdm", nuisances.E, ends)
    own += nuisances.offset
    loads = test.known.sum(axis=1)[model.every - 1 :: model.every]
    variance = output_std(J, P) ** 2 + model.noise + np.sum(own**2, axis=1) + test.bias**2
    return x[:, :states] @ H.T + loads @ fed.T, np.sqrt(variance)

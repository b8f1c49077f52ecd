"""Gauges left out of a test in turn: what the others say that each of them reads, beside what it read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.cases.structure.channels import size_in_words
from strainsight.cases.structure.filtered_test import Filtered, Filtering, filtered, filtered_together
from strainsight.errors import NumericalError
from strainsight.estimation.conditional import acceleration_rows, known_ends, theta_at
from strainsight.estimation.motion import surface_reading
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.update import output_std
from strainsight.estimation.verdict import OVERCONFIDENT, Claim, claim_of, samples_alike
from strainsight.records.estimated import HoldOut
from strainsight.workflow.output import Scalar, Table


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


@dataclass(frozen=True)
class Left:
    """Of a channel that was left out: RMS of its readings, and of what the others say less these [unit of the channel]; share of
    the samples within 2σ; the verdict on error over σ, None where there is no σ or the others cannot tell."""

    reading: float
    error: float
    inside: float
    claim: Claim | None


def left_out(found: HoldOut, measured: np.ndarray) -> list[Left]:
    """Every channel of a test; measured (T, m) its samples. Neighbouring samples are off alike: as many draws as the samples are
    worth (`samples_alike`)."""
    rows = []
    for predicted, std, own in zip(found.predicted.T, found.std.T, measured.T, strict=True):
        error = predicted - own
        there = np.isfinite(error)
        scaled = error[there] / std[there]
        claim = claim_of(error[there], std[there], alike=samples_alike(scaled)) if np.isfinite(scaled).any() else None
        inside = float(np.mean(np.abs(scaled) < 2)) if claim is not None else np.nan
        rows.append(Left(_rms(own[there]), _rms(error[there]), inside, claim))
    return rows


def hold_out_numbers(found: HoldOut, labels: tuple[str, ...], measured: np.ndarray) -> dict[str, Scalar]:
    """Share of all samples within 2σ; error over σ of every channel."""
    rows = left_out(found, measured)
    inside = [own.inside for own in rows if own.claim is not None]
    numbers: dict[str, Scalar] = {"hold_out.inside": float(np.mean(inside))} if inside else {}
    each = zip(labels, rows, strict=True)
    return numbers | {f"hold_out.ratio.{label}": own.claim.ratio for label, own in each if own.claim is not None}


def misfits_in_words(found: HoldOut, labels: tuple[str, ...], measured: np.ndarray) -> list[str]:
    """The channels that the others contradict, the worst first: a wrong one misleads what is predicted of others, too."""
    rows = zip(labels, left_out(found, measured), strict=True)
    off = [(own.claim.ratio, label) for label, own in rows if own.claim and own.claim.verdict == OVERCONFIDENT]
    said = [f"{label} (error {ratio:.2g} σ)" for ratio, label in sorted(off, key=lambda one: -one[0])]
    return [f"the other gauges contradict {', '.join(said)}"] if said else []


def hold_out_table(found: HoldOut, labels: tuple[str, ...], units: tuple[str, ...], measured: np.ndarray) -> Table:
    """What every channel read and what the others say of it."""
    lines = []
    for label, unit, own, said in zip(labels, units, left_out(found, measured), found.left_in, strict=True):
        if said:
            lines.append((label, "–", "–", "–", "–", said))
            continue
        share = f"{100 * own.error / own.reading:.3g} %" if own.reading > 0 else "–"
        claim = ("–", "–", "σ is withheld")
        if own.claim is not None:
            claim = f"{own.claim.ratio:.2g}", f"{100 * own.inside:.3g} %", own.claim.verdict
        lines.append((label, size_in_words(own.reading, unit), share, *claim))
    return Table(
        "every gauge by the others",
        ("channel", "RMS reading", "RMS error", "error over σ", "within 2σ", "verdict"),
        tuple(lines),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan

"""Single samples that no model foresees: found one after the other by their innovations, and marked as missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strainsight.estimation.bank import BankRun
from strainsight.estimation.fault_search import Suspect, explained, suspected
from strainsight.estimation.faults import Explained, Fault

SPIKE = 8.0
"""Of its σ, from which an innovation is no noise."""
ROUNDS = 12
"""Most samples of one disturbance that are marked one after the other."""
APART = 10
"""Samples between two disturbances: within it the filter still follows the first."""
MOST_SHARE, ALWAYS, MOST_ROWS = 0.01, 5, 50
"""Share of the readings that may be marked, and the number of them that may be in any record; instants of large innovations, as
many as which are no spikes."""
SILENT = 3
"""Instants one after the other without any reading, which explain whatever comes behind them."""

SUDDEN = 1e6
"""Factor on the intensity of unknown loads, with which they may change from one sample to the next."""

Fit = Callable[[Suspect], tuple[Explained, BankRun | None]]


def sizes_of(suspect: Suspect, bank: BankRun) -> tuple[np.ndarray, np.ndarray]:
    """Size (T,) of the innovations of all channels together over their σ; and every one (T, m) over what is usual of its
    channel."""
    every = suspect.model.every
    sampled = slice(every - 1, None, every)
    size = np.sqrt(np.nansum(bank.run.whitened[sampled, 0] ** 2, axis=1))
    innovation = np.abs(np.nan_to_num(bank.run.innovation[sampled, 0]))
    usual = np.maximum(suspect.noise, 1.5 * np.median(innovation, axis=0))
    return size, innovation / usual


def spikes_of(suspect: Suspect, fit: Fit = lambda own: explained(own, None)) -> tuple[Fault, Suspect, Explained] | None:
    """Few samples without which a record agrees with its model, the record without them, and how it fits; None where it does not
    come to agree. fit: how a record does.

    They are sought beside unknown loads that may change at once, which channels then show together. The first sample of every
    disturbance is that of the channel whose innovation is largest; what follows it is what the filter made of it.
    """
    marked: list[tuple[int, int]] = []
    free, samples = _with_sudden_loads(suspect), suspect.samples.copy()
    found = fit(free)
    most = max(ALWAYS, int(MOST_SHARE * samples.size))
    for _ in range(ROUNDS):
        if found[1] is None:
            return None
        size, each = sizes_of(suspect, found[1])
        rows = np.flatnonzero(size > max(SPIKE, 0.1 * size.max()))
        if not len(rows):
            break
        if len(rows) > max(MOST_ROWS, MOST_SHARE * len(samples)):
            return None
        rows = rows[np.diff(rows, prepend=-APART - 1) > APART]
        marked += [(int(np.argmax(each[k])), int(k)) for k in rows]
        if len(marked) > most:
            return None
        samples[tuple(np.transpose(marked)[::-1])] = np.nan
        found = fit(replace(free, samples=samples))
    else:
        return None
    without = replace(suspect, samples=samples)
    silent = np.isnan(samples).all(axis=1) & np.isfinite(suspect.samples).any(axis=1)
    if not marked or any(silent[k : k + SILENT].sum() == SILENT for k in np.flatnonzero(silent)):
        return None
    as_stated = fit(without)
    if suspected(*as_stated):
        return None
    spans = _joined(marked)
    return Fault("spikes", spans[0][0], 0.0, spans=spans), without, as_stated[0]


def _with_sudden_loads(suspect: Suspect) -> Suspect:
    model, Q = suspect.model, suspect.model.Q.copy()
    Q[..., model.input_states, model.input_states] *= SUDDEN
    return replace(suspect, model=replace(model, Q=Q))


def _joined(marked: list[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    """Spans of samples that follow one another, by channel and time."""
    spans: list[tuple[int, int, int]] = []
    for channel, k in sorted(marked):
        if spans and spans[-1][0] == channel and spans[-1][2] == k:
            spans[-1] = (channel, spans[-1][1], k + 1)
        else:
            spans.append((channel, k, k + 1))
    return tuple(spans)

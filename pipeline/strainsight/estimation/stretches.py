"""Which part of a long record is checked for faults: where its channels read most, and a filter that begins there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.model import FilterModel
from strainsight.estimation.suspect import Suspect

LONGEST = 4000
"""Samples of a stretch at most."""
MOST = 3
"""Stretches of a record at most that are checked."""
FAINT_READING = 3.0
"""Of the noise of a sample, up to which a reading counts as rest."""
TAIL, FEWEST = 0.01, 20
"""Share of the energy of the readings that may lie before the moving part, and behind it; fewest samples of such a part."""
LEAD = 0.25
"""Share of a stretch that lies before the instant for which it was chosen; of rest beside the part that moves."""


def loudest_stretches(suspect: Suspect) -> tuple[tuple[int, int], ...]:
    """First sample of a stretch and the one behind its last, MOST of them at most: where the channels read most, then where
    those read most that read less than half of that in the stretches before. The whole record where it is no longer than one."""
    energy = _energy(suspect)
    count = len(energy)
    if count <= LONGEST:
        return ((0, count),)
    stretches = [_loudest(_second_largest(energy))]
    of_channels = [(_loudest(own), own) for own in energy.T]
    for stretch, own in sorted(of_channels, key=lambda one: one[0]):
        there = max(float(own[slice(*each)].sum()) for each in stretches)
        if len(stretches) < MOST and there < 0.5 * float(own[slice(*stretch)].sum()):
            stretches.append(stretch)
    return tuple(stretches)


def stretch_at(suspect: Suspect, sample: int) -> tuple[int, int]:
    """The stretch about a sample, a quarter of it before that."""
    first = max(0, min(sample - int(LEAD * LONGEST), len(suspect.samples) - LONGEST))
    return first, min(first + LONGEST, len(suspect.samples))


def at_rest(part: Suspect) -> bool:
    """Whether no two channels of a stretch read more than noise together, but for a few samples."""
    return bool(np.count_nonzero(_second_largest(_energy(part))) < FEWEST)


def loudest_channel(part: Suspect) -> int:
    """The channel that reads most over its noise."""
    return int(np.argmax(_energy(part).sum(axis=0)))


def with_intensity(part: Suspect, factor: float) -> Suspect:
    """A stretch whose unknown loads are less intense by a factor: Q and the covariance of the motion are multiplied by it."""
    n, size = part.model.parameter_states.start, np.sqrt(factor)

    def scaled(model: FilterModel) -> FilterModel:
        Q = model.Q.copy()
        Q[..., :n, :n] *= factor
        return replace(model, Q=Q)

    def turned(channel: int, angle: float) -> tuple[FilterModel, Nuisances]:
        model, nuisances = part.turned(channel, angle)
        return scaled(model), nuisances

    covariance = part.covariance.copy()
    covariance[:n] *= size
    covariance[:, :n] *= size
    return replace(part, model=scaled(part.model), covariance=covariance, turned=turned)


def moving_part_of(part: Suspect) -> Suspect:
    """Where a stretch moves, with a quarter of that before and behind it; all of it where more than half does."""
    if part.span is None:
        return part
    first, behind = part.span
    more = int(LEAD * (behind - first))
    begin = max(0, first - more)
    return replace(part_of(part, begin, min(len(part.samples), behind + more)), span=(first - begin, behind - begin))


def part_of(suspect: Suspect, begin: int, end: int) -> Suspect:
    """Samples from begin to before end, with the part of them that moves.

    A stretch that is not the beginning of its record begins in an unknown motion, as wide as its readings ask for; a periodic
    motion and a drift, t/T of the record, go on.
    """
    every, whole = suspect.model.every, len(suspect.samples)
    samples = suspect.samples[begin:end]
    part = replace(
        suspect,
        samples=samples,
        known=suspect.known[begin * every : end * every],
        begin=suspect.begin + begin,
        span=_moving_part(_second_largest(_energy(suspect)[begin:end])),
    )
    if (begin, end) == (0, whole):
        return part
    loads = suspect.known.shape[-1]

    def within(nuisances: Nuisances) -> Nuisances:
        if nuisances.E.shape[-1] == loads:
            return nuisances
        E, drift = nuisances.E.copy(), nuisances.E[..., -1]
        E[..., -1] = drift * (end - begin) / whole
        return replace(nuisances, E=E, offset=nuisances.offset + drift * begin / whole)

    def turned(channel: int, angle: float) -> tuple[FilterModel, Nuisances]:
        model, nuisances = suspect.turned(channel, angle)
        return model, within(nuisances)

    settled = suspect.settled
    if settled is not None:
        phase = np.exp(1j * settled.frequency * begin * every * suspect.model.h)
        settled = replace(settled, held=settled.held * phase[:, None, None])
    return replace(
        part,
        covariance=suspect.covariance if begin == 0 else _unknown_motion(suspect, samples),
        nuisances=within(suspect.nuisances),
        settled=settled,
        turned=turned,
    )


def _energy(suspect: Suspect) -> np.ndarray:
    """Squares (T, m) of the readings over their noise, less what is rest; those of single samples count for nothing."""
    y = suspect.samples
    if len(suspect.biased):
        y = y.copy()
        known = np.isfinite(y[:, suspect.biased]).any(axis=0)
        at = suspect.biased[known]
        y[:, at] -= np.nanmedian(y[:, at], axis=0)
    size = np.abs(np.nan_to_num(y)) / suspect.noise
    if len(size) > 2:
        size[1:-1] = np.sort([size[:-2], size[1:-1], size[2:]], axis=0)[1]
    return np.asarray(np.maximum(size**2 - FAINT_READING**2, 0.0))


def _second_largest(energy: np.ndarray) -> np.ndarray:
    """Of the channels at every instant (T,): no single wrong channel decides on it."""
    return np.asarray(np.sort(energy, axis=1)[:, -min(2, energy.shape[1])])


def _loudest(energy: np.ndarray) -> tuple[int, int]:
    """The stretch of LONGEST samples with the most energy (T,), the first of equal ones."""
    whole = np.concatenate([[0.0], np.cumsum(energy)])
    first = int(np.argmax(whole[LONGEST:] - whole[:-LONGEST]))
    return first, first + LONGEST


def _moving_part(energy: np.ndarray) -> tuple[int, int] | None:
    """The shortest part with all of the energy (T,) but TAIL at either end; None where it is more than half of all samples."""
    whole = np.cumsum(energy)
    if not len(energy) or not whole[-1] > 0:
        return None
    first, last = np.searchsorted(whole, np.array([TAIL, 1 - TAIL]) * whole[-1])
    return (int(first), int(last) + 1) if FEWEST <= last + 1 - first <= 0.5 * len(energy) else None


def _unknown_motion(suspect: Suspect, samples: np.ndarray) -> np.ndarray:
    """The covariance of a motion that nothing is known of, widened where the channels (T, m) read more than it foresees."""
    covariance = suspect.covariance if suspect.moving is None else suspect.moving
    model, n = suspect.model, suspect.model.parameter_states.start
    rows = model.H[..., :n]
    foreseen = np.sqrt(np.einsum("mi,ij,mj->m", rows, covariance[:n, :n], rows))
    largest = np.nanmax(np.abs(np.nan_to_num(samples)), axis=0)
    use = foreseen > 0
    if model.accelerometers is not None:
        use &= ~model.accelerometers
    wider = max(1.0, float(np.median(largest[use] / foreseen[use]))) if use.any() else 1.0
    P = covariance.copy()
    P[:n] *= wider
    P[:, :n] *= wider
    return P

"""The compiled loops of counting cycles and adding up their damage; `counting`, `curve` and `sums` have the equations.

One file, because the compiled code that numba keeps on disk does not notice a change in another file.
"""

from __future__ import annotations

import numpy as np

from strainsight.compiled import njit

NONE, GOODMAN, FKM = 0, 1, 2
"""Corrections of the mean stress."""
SIGNED_VON_MISES, PRINCIPAL = 0, 1
"""One number of a state of stress."""


@njit(cache=True, nogil=True)
def reversals(signal, out):  # type: ignore[no-untyped-def]
    """Into out (T,): first sample, every peak and valley, last sample; how many."""
    n = 0
    for value in signal:
        if n and value == out[n - 1]:
            continue
        if n > 1 and (out[n - 1] - out[n - 2]) * (value - out[n - 1]) > 0:
            out[n - 1] = value
        else:
            out[n] = value
            n += 1
    return n


@njit(cache=True, nogil=True)
def count(signal, work, cycles):  # type: ignore[no-untyped-def]
    """ASTM E1049 5.4.4 into cycles (T, 3): range, mean, ½ or 1; how many. work (2, T)."""
    turns = reversals(signal, work[0])
    stack, height, found = work[1], 0, 0
    for i in range(turns):
        stack[height] = work[0, i]
        height += 1
        while height >= 3:
            last, before = abs(stack[height - 1] - stack[height - 2]), abs(stack[height - 2] - stack[height - 3])
            if last < before:
                break
            first, second = stack[height - 3], stack[height - 2]
            cycles[found, 0], cycles[found, 1] = before, 0.5 * (first + second)
            if height == 3:
                cycles[found, 2] = 0.5
                stack[0], stack[1] = stack[1], stack[2]
                height = 2
            else:
                cycles[found, 2] = 1.0
                stack[height - 3] = stack[height - 1]
                height -= 2
            found += 1
    for i in range(height - 1):
        cycles[found, 0], cycles[found, 1] = abs(stack[i + 1] - stack[i]), 0.5 * (stack[i] + stack[i + 1])
        cycles[found, 2] = 0.5
        found += 1
    return found


@njit(cache=True, nogil=True)
def corrected(range_, mean, rule, constant):  # type: ignore[no-untyped-def]
    """The range at mean zero that does the same damage; constant: tensile strength, or sensitivity M."""
    if rule == NONE or range_ <= 0.0:
        return range_
    if rule == GOODMAN:
        if mean <= 0.0:
            return range_
        return range_ / (1.0 - mean / constant) if mean < constant else np.inf
    amplitude, M = 0.5 * range_, constant
    if mean <= -amplitude:
        return range_ * (1.0 - M)
    if mean <= amplitude:
        return 2.0 * (amplitude + M * mean)
    if mean <= 3.0 * amplitude:
        return 2.0 * (1.0 + M) * (amplitude + M / 3.0 * mean) / (1.0 + M / 3.0)
    return range_ * (1.0 + M) ** 2 / (1.0 + M / 3.0)


@njit(cache=True, nogil=True)
def cycle_damage(range_, curve):  # type: ignore[no-untyped-def]
    """1/N of one cycle; curve: range at one cycle's damage 1/cycles, cycles, slope, range at the knee, second slope, range at the
    cut-off."""
    reference, cycles, slope, knee, second, cut_off = curve
    if range_ <= cut_off:
        return 0.0
    if range_ >= knee:
        return (range_ / reference) ** slope / cycles
    return (knee / reference) ** slope / cycles * (range_ / knee) ** second


@njit(cache=True, nogil=True)
def sums(signals, curve, rule, constant, out):  # type: ignore[no-untyped-def]
    """Of every signal (p, T): Miner's sum, and Σ n (ΔS/reference)^slope, into out (p, 2)."""
    steps = signals.shape[1]
    work, cycles = np.empty((2, steps)), np.empty((steps, 3))
    for p in range(len(signals)):
        found = count(signals[p], work, cycles)
        miner, moment = 0.0, 0.0
        for i in range(found):
            own = corrected(cycles[i, 0], cycles[i, 1], rule, constant)
            power = (own / curve[0]) ** curve[2]
            moment += cycles[i, 2] * power
            if own >= curve[3] and own > curve[5]:
                miner += cycles[i, 2] * power / curve[1]
            else:
                miner += cycles[i, 2] * cycle_damage(own, curve)
        out[p, 0], out[p, 1] = miner, moment


@njit(cache=True, nogil=True)
def one_number(stress, kind, out):  # type: ignore[no-untyped-def]
    """Of stress (p, 6, T), shears last: principal stress of the largest size, or von Mises' with its sign, into out (p, T)."""
    for p in range(len(stress)):
        for t in range(stress.shape[2]):
            x, y, z = stress[p, 0, t], stress[p, 1, t], stress[p, 2, t]
            a, b, c = stress[p, 3, t], stress[p, 4, t], stress[p, 5, t]
            middle = (x + y + z) / 3.0
            x, y, z = x - middle, y - middle, z - middle
            J2 = 0.5 * (x * x + y * y + z * z) + a * a + b * b + c * c
            if J2 <= 0.0:
                out[p, t] = middle if kind == PRINCIPAL else 0.0
                continue
            J3 = x * y * z + 2.0 * a * b * c - x * b * b - y * c * c - z * a * a
            radius = 2.0 * np.sqrt(J2 / 3.0)
            cosine = 4.0 * J3 / (radius * radius * radius)
            angle = np.arccos(min(1.0, max(-1.0, cosine))) / 3.0
            highest = middle + radius * np.cos(angle)
            lowest = middle + radius * np.cos(angle + 2.0 * np.pi / 3.0)
            positive = highest + lowest >= 0.0
            if kind == PRINCIPAL:
                out[p, t] = highest if positive else lowest
            else:
                out[p, t] = np.sqrt(3.0 * J2) if positive else -np.sqrt(3.0 * J2)

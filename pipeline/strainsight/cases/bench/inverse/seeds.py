"""The numbers of an estimate once a seed: what a statement over many seeds rests on."""

from __future__ import annotations

import numpy as np

from strainsight.cases.bench.inverse.estimation import Estimated
from strainsight.cases.bench.inverse.numbers import Numbers, load_numbers, mismatch_numbers, parameter_numbers


def numbers_of_seeds(own: Estimated, inputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Name → the number of every seed (seeds,) by its first start, NaN of a seed that diverged: of loads, parameters, innovations
    and sensors, as in the summary. None of a single seed. inputs: names of the unknown loads."""
    starts = len(own.unknowns.starts)
    runs = range(0, own.mean.shape[1], starts)
    if len(runs) < 2:
        return {}
    found = [_numbers(own, inputs, seed, run) if own.lost[run] < 0 else {} for seed, run in enumerate(runs)]
    names = dict.fromkeys(name for numbers in found for name in numbers)
    return {name: np.array([float(numbers.get(name, np.nan)) for numbers in found]) for name in names}


def _numbers(own: Estimated, inputs: tuple[str, ...], seed: int, run: int) -> Numbers:
    """Of one seed; truths are one for all, or one a seed."""
    model, late = own.trial.model, len(own.nis) // 2
    truth = min(seed, own.reality.inputs.shape[1] - 1)
    numbers: Numbers = {"nis": float(np.nanmean(own.nis[late:, run]))}
    for name, at, column in zip(inputs, model.u, own.unknowns.inputs, strict=True):
        load = own.reality.inputs[1:, truth, column]
        if np.isfinite(load).all():
            numbers |= load_numbers(name, load, own.mean[1:, run, at], own.std[1:, run, at])
    for name in own.unknowns.free:
        column = own.bench.system.parameters.index(own.unknowns.parameters[name])
        true = own.reality.theta[min(seed, len(own.reality.theta) - 1), column]
        xi = own.mean[-1, run, model.xi]
        values, slopes = own.unknowns.coordinates.theta(xi)
        s, P = slopes[column], own.xi_covariance[-1, min(run, own.xi_covariance.shape[1] - 1)]
        last, std = np.array([values[column]]), np.array([np.sqrt(max(float(s @ P @ s), 0.0))])
        if np.isfinite(true):
            numbers |= parameter_numbers(name, np.array([true]), last, std)
    for name, part in own.sensors.channels.items():
        given = own.used.channels.get(name)
        read = min(seed, own.reality.readings.shape[1] - 1)
        measured = own.reality.readings[:, read, part] if given is None else own.measured[:, run, given]
        numbers |= mismatch_numbers(name, measured, own.reading[1:, seed, part])
    return numbers

"""How the unknown loads of a bench move in time, as its config states it."""

from __future__ import annotations

import numpy as np

from strainsight.augmentation.input_models import WALK, input_model
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Load
from strainsight.config.bench.estimate import Estimate
from strainsight.config.loads import Sine
from strainsight.multibody.inverse.loads import LoadProcess, load_process


def load_process_of(config: BenchConfig, h: float) -> LoadProcess:
    """Of all unknown loads in their order, in steps of h [s]."""
    models, amplitudes = [], []
    for name, entry in _asked(config).inputs.items():
        walks = entry.model == "random_walk"
        frequency, amplitude = (1.0, 1.0) if walks else typical_of(config, name)
        models.append(input_model(entry.model, frequency, entry.kappa, entry.smoothness, entry.damping))
        amplitudes.append(amplitude)
    return load_process(models, np.array(amplitudes), increments_of(config, h), h)


def increments_of(config: BenchConfig, h: float) -> np.ndarray:
    """σ (nu,) of the change of every unknown load in a step of h [s] [N, N m]: as stated; of a walk that states none a √(κωh), of
    the other models about aωh, at most a."""
    estimate, found = _asked(config), []
    for name, entry in estimate.inputs.items():
        if entry.increment is not None:
            found.append(entry.increment * (h if estimate.increments == "second" else 1.0))
            continue
        frequency, amplitude = typical_of(config, name)
        turned = 2 * np.pi * frequency * h
        if entry.model == "random_walk":
            found.append(amplitude * float(np.sqrt((WALK if entry.kappa is None else entry.kappa) * turned)))
        else:
            found.append(amplitude * min(1.0, turned))
    return np.array(found)


def typical_of(config: BenchConfig, name: str) -> tuple[float, float]:
    """Frequency [Hz] and amplitude [N, N m] of an unknown load: as stated, else of the sine that its history is."""
    entry, force = _asked(config).inputs[name], config.forces[name]
    assert isinstance(force, Load)
    sine = force.signal if isinstance(force.signal, Sine) else None
    frequency = entry.frequency or (None if sine is None else sine.frequency)
    amplitude = entry.amplitude or (None if sine is None else sine.amplitude)
    assert frequency is not None  # checked with the config
    assert amplitude is not None
    return frequency, amplitude


def _asked(config: BenchConfig) -> Estimate:
    assert config.estimate is not None
    return config.estimate

"""Channels of a bench left out of its filter in turn: what the others say that each of them reads, beside what it read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, StrainSensor
from strainsight.config.bench.estimate import Method
from strainsight.errors import ConfigError, NumericalError
from strainsight.experiment.bench.inverse.filtering import predicted
from strainsight.experiment.bench.inverse.trial import Trial
from strainsight.experiment.bench.sensors import Sensors, units_of
from strainsight.experiment.hold_out import Left, left_out


@dataclass(frozen=True)
class HeldOut:
    """Of every channel of the filter (m,): predicted and std (T, seeds, m) by the others, NaN where there is none; left_in: why
    it was not left out, empty where it was; units; rows: the judgement over all seeds."""

    predicted: np.ndarray
    std: np.ndarray
    left_in: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[Left, ...]


def held_out(
    config: BenchConfig,
    method: Method,
    used: Sensors,
    given: np.ndarray,
    y: np.ndarray,
    trial_with: Callable[[np.ndarray], Trial],
    tells: Callable[[Trial, np.ndarray], None],
    starts: int,
    progress: Callable[[str, float], None],
) -> HeldOut:
    """Predict every gauge with all its grids, and every component of another sensor, by the other channels, for all seeds of
    y (T, B, m) from their first starts:

        ŷ = h(x̂),     σ² = H P Hᵀ + R + Σₖ (H Sₖ − Dₖ x̂ − oₖ)²

    x̂, P filtered from the other channels up to this sample, its own offset among the states with what is known of it beforehand;
    R of one sample; S what installation of the others leaves x̂ off by, D x̂ + o what its own does to the reading (`considered`).
    given (m,): channels that were measured; trial_with: the filter by some of these; tells: raises ConfigError where they cannot
    tell the unknowns. A channel without which that is so, or a filter diverges, stays in.
    """
    own = y[:, ::starts]
    mean, std = (np.full(own.shape, np.nan) for _ in range(2))
    left_in = ["the filter is not given it"] * len(given)
    parts = [part for part in _parts(config, used) if given[part].any()]
    for i, part in enumerate(parts):
        progress(f"without {_label(used, part[0])}", i / len(parts))
        others = given.copy()
        others[part] = False
        why = ""
        try:
            if not others.any():
                why = "there is no other"
            else:
                trial = trial_with(others)
                tells(trial, others)
                mean[..., part], std[..., part], lost = predicted(method, _of_seeds(trial, starts), own, part)
                if lost.any():
                    why = f"without it {lost.sum()} of {len(lost)} runs diverge"
        except (ConfigError, NumericalError) as error:
            why = f"without it {error.key}: {error.what}" if error.key else f"without it: {error.what}"
        for channel in part:
            left_in[channel] = why if given[channel] else left_in[channel]
    stayed = [bool(why) for why in left_in]
    mean[..., stayed] = std[..., stayed] = np.nan
    labels = [_label(used, channel) for channel in range(len(given))]
    units = tuple(unit for name, part in used.channels.items() for unit in units_of(config.sensors[name], part))
    return HeldOut(mean, std, tuple(left_in), units, left_out(mean, std, left_in, labels, own))


def _parts(config: BenchConfig, used: Sensors) -> Iterator[np.ndarray]:
    """Channels that are left out together."""
    for name, part in used.channels.items():
        channels, entry = np.arange(part.start, part.stop), config.sensors[name]
        grids = np.ones(len(channels), dtype=int)
        if isinstance(entry, StrainSensor) and entry.gauges:
            grids = np.array([len(gauge.angles) if gauge.angles else 1 for gauge in entry.gauges])
        yield from np.split(channels, np.cumsum(grids)[:-1])


def _label(used: Sensors, channel: int) -> str:
    """Sensor and component, as numbers of a summary name them."""
    name, part = next(own for own in used.channels.items() if own[1].start <= channel < own[1].stop)
    return f"{name}.{channel - part.start + 1}"


def _of_seeds(trial: Trial, starts: int) -> Trial:
    """The first start of every seed."""
    first = slice(None, None, starts)
    model = replace(trial.model, offset=trial.model.offset[first])
    return replace(trial, model=model, start=trial.start[first], covariance=trial.covariance[first])

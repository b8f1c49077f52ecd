"""Whether the numbers of a model, its training run and its sensors are of sizes that the later stages can work with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.errors import InfeasibleError, at_least, at_most
from strainsight.rom.model import Damping

LEAST_PERIODS = 1e-3
"""Periods of the last mode in a training run. In fewer the stiffness adds less than (2π 1e-3)²/2, a fifty-thousandth, to
what the mass does, in every mode: no gauge tells a modulus, and the Riccati equation of 4e-5 periods is beyond double
precision."""
MOST_PERIODS = 1e6
"""Periods of the first mode in a time step: the motion is the static one to all digits."""
READINGS = (1e-50, 1e50)
"""Largest reading of a training run [strain, m/s², m]: its fourth power, which covariances need, is a number."""
MOST_DAMPED = 1e4
"""Damping ratio of the mode that is damped least."""
SIGNAL_TO_NOISE = (1e-4, 1e9)
"""RMS reading over σ of the best sensor. Below it nothing is learnt; above it rounding of the model is louder than σ, and
the Riccati equation is beyond double precision from 1e11 on."""


def hertz(frequency: float, decimals: int) -> str:
    """A frequency [Hz] with so many decimals, or four digits where decimals would be none or too many."""
    return f"{frequency:.{decimals}f}" if 1 <= frequency < 1e6 else f"{frequency:.4g}"


def refuse_damping(damping: Damping, frequency: np.ndarray) -> None:
    """Raise InfeasibleError where every mode is damped MOST_DAMPED times as much as one that just does not swing.

    frequency (modes,) [Hz].
    """
    omega = 2 * np.pi * frequency
    ratio = damping.viscous(omega**2)[0] / (2 * omega)
    if ratio.min() > MOST_DAMPED:
        least = int(np.argmin(ratio))
        raise InfeasibleError(
            f"a damping ratio of {ratio[least]:.2g} at {frequency[least]:.4g} Hz, and no mode has less: nothing would move",
            key="damping",
            remedy="a ratio of 1 is critical, ζ = (α/ω + βω)/2 with ω = 2πf: check alpha [1/s] and beta [s]",
        )


def refuse_times(frequency: np.ndarray, duration: float, step: float, section: str = "train") -> None:
    """Raise InfeasibleError where a training run is over before any mode swings, or all swing a million times in a step.

    frequency (modes,) [Hz], ascending; duration, step [s] of the config's `section`.
    """
    first, last = float(frequency[0]), float(frequency[-1])
    units = "check mesh.length_unit, mesh.mass_unit, modulus and density"
    if last * duration < LEAST_PERIODS:
        raise InfeasibleError(
            f"{duration:g} s are {last * duration:.2g} periods of the last mode, {last:.4g} Hz: the structure's stiffness "
            "is not felt in so short a run",
            key=f"{section}.duration",
            remedy=f"take at least {at_least(LEAST_PERIODS / last)} s, better a few periods of the first; or {units}",
        )
    if first * step > MOST_PERIODS:
        raise InfeasibleError(
            f"{step:g} s are {first * step:.2g} periods of the first mode, {first:.4g} Hz: only the static response is left",
            key=f"{section}.time_step",
            remedy=f"take at most {at_most(MOST_PERIODS / first)} s; or {units}",
        )


def refuse_readings(readings: np.ndarray) -> None:
    """Raise InfeasibleError where the largest readings (channels,) [strain, m/s², m] are too large or small to square twice."""
    largest, (low, high) = float(np.abs(readings).max(initial=0.0)), READINGS
    if largest == 0 or low <= largest <= high:
        return
    much = "more" if not largest <= high else "less"
    limit = high if much == "more" else low
    raise InfeasibleError(
        f"the largest reading of the training run is {largest:.2g} (strain, m/s² or m), {much} than {limit:g}",
        key="loads",
        remedy="check the amplitude of the loads [N] and the modulus [Pa]",
    )


def refuse_noise(best: Mapping[str, tuple[float, float]]) -> None:
    """Raise InfeasibleError where all sensors drown in their noise, or some have next to none.

    best: config key of a kind of sensors → its largest RMS reading and the σ of its noise [strain, m/s², m].
    """
    low, high = SIGNAL_TO_NOISE
    key, (signal, noise) = max(best.items(), key=lambda item: item[1][0] / item[1][1] if item[1][1] else np.inf)
    if signal > high * noise:
        raise InfeasibleError(
            f"a noise of {noise:.3g} is {noise / signal:.1g} of the largest RMS reading, {signal:.3g}: the model itself is "
            "rounded to more",
            key=f"{key}.noise_std",
            remedy=f"take at least {at_least(signal / high)}; it is a strain (1 µm/m is 1e-6), m/s² or m",
        )
    if 0 < signal < low * noise:
        raise InfeasibleError(
            f"a noise of {noise:.3g} is {noise / signal:.1g} times the largest RMS reading, {signal:.3g}: nothing can be learnt",
            key=f"{key}.noise_std",
            remedy=f"take at most {at_most(signal / low)}; it is a strain (1 µm/m is 1e-6), m/s² or m",
        )

"""What the gauges of a test read, what the others say of them, and the spectra of what is left."""

from __future__ import annotations

import numpy as np

from strainsight.gauges.candidates import UNITS
from strainsight.records.estimated import Estimated
from strainsight.records.training import Training
from strainsight.report.tested.data import HoldOut, Reading, Spectrum
from strainsight.signals.spectra import density, noise_density


def readings_of(own: Estimated, marks: tuple[int, ...], training: Training) -> tuple[Reading, ...]:
    """Of every channel, measured and as the model has it; marks: of their gauges on the page."""
    gauge, offsets = own.gauge, {}
    if own.bias is not None:
        offsets = {
            int(c): (float(m), float(s)) for c, m, s in zip(own.bias.channel, own.bias.mean, own.bias.std, strict=True)
        }
    found = []
    for i, label in enumerate(gauge.label):
        offset = offsets.get(i)
        shift = 0.0 if offset is None else offset[0]
        found.append(
            Reading(
                label=label,
                gauge=marks[i],
                unit=UNITS[int(training.candidates.quantity[gauge.channel[i]])],
                time=gauge.time,
                measured=gauge.measured[:, i] - shift,
                estimated=gauge.estimated[:, i] - shift,
                std=gauge.std[:, i],
                noise_std=float(gauge.noise_std[i]),
                offset=offset,
            )
        )
    return tuple(found)


def held_out_of(own: Estimated, readings: tuple[Reading, ...]) -> tuple[HoldOut, ...]:
    """Of every channel that was left out, as the others predict it."""
    if own.hold_out is None:
        return ()
    return tuple(
        HoldOut(
            label=reading.label,
            gauge=reading.gauge,
            unit=reading.unit,
            time=own.gauge.time,
            measured=own.gauge.measured[:, i],
            predicted=own.hold_out.predicted[:, i],
            std=own.hold_out.std[:, i],
        )
        for i, reading in enumerate(readings)
        if not own.hold_out.left_in[i]
    )


def residual_spectrum(reading: Reading) -> Spectrum | None:
    """Of what is left of a channel, beside that of its noise; None of a record that is too short."""
    step = step_of(reading.time)
    frequency, found = density(reading.residual, step)
    if not len(frequency):
        return None
    return Spectrum(reading.label, reading.unit, frequency, found, noise_density(reading.noise_std, step))


def load_spectrum(name: str, unit: str, own: Estimated) -> Spectrum | None:
    """Of a load that was found; None of a record that is too short."""
    frequency, found = density(own.smoothed[name], step_of(own.time))
    return Spectrum(name, unit, frequency, found) if len(frequency) else None


def step_of(time: np.ndarray) -> float:
    """Between samples [s]; 1 s where there is one sample."""
    return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 1.0

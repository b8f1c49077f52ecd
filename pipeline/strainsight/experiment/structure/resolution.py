"""Signals and noise that no amplifier of strain gauges can tell: what is too small, by how much, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.records.training import Screened, Training
from strainsight.sensors.candidates import STRAIN, UNITS

RESOLVED = 1e-7
"""[strain] What an amplifier resolves, 0.1 µm/m: a rule of ours, for a bandwidth of some Hz to kHz."""
QUIETEST = 5e-8
"""[strain] Noise of one sample that hardly any channel stays below, 0.05 µm/m: half of that."""
LOUDER = "load the part harder, or check the unit of the load and the moduli"


def unresolved_candidates(training: Training) -> str:
    """Says that the largest training reading of every strain gauge is below `RESOLVED`; empty where some is not."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (largest := float(training.peak[straining].max())) >= RESOLVED:
        return ""
    return (
        f"The largest training reading of all gauges is {_size(largest)}: an amplifier resolves {_size(RESOLVED)}. "
        f"{LOUDER.capitalize()} (loads.*.signal, mesh.length_unit, mesh.mass_unit)."
    )


def quiet_noise(training: Training, screened: Screened) -> str:
    """Says that the noise of the strain gauges is below `QUIETEST`; empty where it is not."""
    straining = training.candidates.quantity == STRAIN
    if not straining.any() or (noise := float(screened.noise_std[straining].min())) >= QUIETEST:
        return ""
    return (
        f"The noise of the strain gauges is {_size(noise)} a sample, less than the {_size(QUIETEST)} that an amplifier has: σ is "
        "too small where it comes from noise. State that of yours, gauges.noise_std: {value: …} [strain]."
    )


def loud_noise(training: Training, screened: Screened) -> str:
    """Says that the noise of every sensor of a kind exceeds its largest training reading; empty where it does not."""
    loud = []
    for quantity in np.unique(training.candidates.quantity):
        alike = training.candidates.quantity == quantity
        noise, largest = float(screened.noise_std[alike].min()), float(training.peak[alike].max())
        if noise > largest:
            loud.append(f"{noise:.3g} {UNITS[quantity]}, with readings of at most {largest:.3g}")
    if not loud:
        return ""
    return (
        f"The noise of a sample exceeds every training reading: {'; '.join(loud)}. Check noise_std, which is in the unit of the "
        "reading (1 µm/m is 1e-6), and the loads."
    )


def unresolved_gauges(listed: GaugeList) -> Iterator[str]:
    """A sentence on the gauges of a layout whose largest training reading is below `RESOLVED`: that of their largest channel."""
    weak = [i for i in range(len(listed.labels)) if listed.unit[i] == UNITS[STRAIN] and listed.peak[i] < RESOLVED]
    if not weak:
        return
    those = ", ".join(f"{listed.labels[i]} ({_size(float(listed.peak[i]))})" for i in weak)
    others = "" if len(weak) == len(listed.labels) else ", or move them (gauges.include, gauges.exclude)"
    yield (
        f"Below the {_size(RESOLVED)} that an amplifier resolves is all that is read by {those} in training: {LOUDER}{others}."
    )


def _size(strain: float) -> str:
    return f"{1e6 * strain:.2g} µm/m" if np.isfinite(strain) else "nothing finite"

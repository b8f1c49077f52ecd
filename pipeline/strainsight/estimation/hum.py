"""Mains hum that all channels have in common, as the cause of inconsistent measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.fault_evidence import CheckRecord, explain_record
from strainsight.estimation.faults import BELIEVABLE, Explained, Fault
from strainsight.estimation.grid_filter import GridRun, filter_on_grid

REFITTED = 2
"""How often a sine of mains hum is fitted again."""
MAINS = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)
"""Frequencies [Hz] of mains hum."""


def explain_hum(record: CheckRecord, as_it_is: Explained, grid_run: GridRun) -> Explained | None:
    """Evidence of a record with a sine of a mains frequency that is common to all channels, at the most likely parameters; None
    below two samples a period.

        max over f, c of   −½ ‖ν̃ − B(f) c‖² − ln T

    ν̃: whitened innovations; B: those of cos 2πft and sin 2πft alone; two fitted constants cost ½ ln T each. The best sine is
    subtracted from the samples and fitted again, as it also changes the linearisation about them."""
    rate = 1 / (record.model.every * record.model.h)
    fits = [_fit_hum(record, as_it_is, grid_run, f) for f in MAINS if 2 * f < rate]
    best = max((fit for fit in fits if fit is not None), key=lambda fit: fit[0].evidence, default=None)
    for _ in range(REFITTED):
        if best is None or best[0].ratio <= BELIEVABLE:
            break
        one, hum = best
        assert one.fault is not None
        cleaned = replace(record, samples=record.samples - hum)
        fit, run = explain_record(cleaned, None)
        again = None if run is None else _fit_hum(cleaned, fit, run, one.fault.amount)
        if again is None or again[0].evidence <= one.evidence:
            break
        best = again[0], hum + again[1]
    return None if best is None else best[0]


def _fit_hum(
    record: CheckRecord, as_it_is: Explained, grid_run: GridRun, f: float
) -> tuple[Explained, np.ndarray] | None:
    """Fit of a common sine of a frequency [Hz], and the sine (T, 1); None if the filter fails."""
    time = record.model.every * record.model.h * (record.begin + 1 + np.arange(len(record.samples)))
    considered = replace(record.considered, learned=True)
    still = None if record.settled is None else replace(record.settled, hold=0 * record.settled.hold)
    white = grid_run.run.whitened[record.sampled, 0]
    valid = np.isfinite(white)
    waves = record.noise.max() * np.stack([wave(2 * np.pi * f * time) for wave in (np.cos, np.sin)], axis=1)
    columns = []
    for wave in waves.T:
        samples = np.where(np.isfinite(record.samples), wave[:, None], np.nan)
        silent = replace(record, samples=samples, known=0 * record.known, considered=considered, settled=still)
        try:
            run = filter_on_grid(silent.known_at(np.array(as_it_is.point)), "readings").run
        except NumericalError:
            return None
        columns.append(run.whitened[record.sampled, 0][valid])
    B = np.stack(columns, axis=1)
    c, *_ = np.linalg.lstsq(B, white[valid], rcond=None)
    rest = white[valid] - B @ c
    gain = 0.5 * float(white[valid] @ white[valid] - rest @ rest) - float(np.log(valid.sum()))
    ratio = float(np.sqrt(np.mean(rest**2)))
    return Explained(Fault("hum", 0, f), as_it_is.evidence + gain, ratio, point=as_it_is.point), (waves @ c)[:, None]

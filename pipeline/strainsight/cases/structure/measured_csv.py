"""What the layout measured in a validation, as a file of a test that `estimate` reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.cases.structure.trial import Trial
from strainsight.csv_cells import csv_bytes

UNITS = ("m/m", "m/s2", "m")
"""Of strain, acceleration and displacement, as a measurement file writes them."""


def measured_csv(trial: Trial, labels: Sequence[str], measured: np.ndarray, units: Mapping[str, str]) -> bytes:
    """Time, a column a channel ("G2.3 [m/m]" is the third grid of G2) and the known loads; the first row has loads only.

    labels (k,) of the gauges of the layout; measured (T, m) by their channels; units of the loads.
    """
    channels = trial.problem.channels.of(trial.gauges)
    which, grid = np.nonzero(channels >= 0)
    quantity = trial.problem.channels.quantity[channels[which, grid]]
    each = zip(which.tolist(), grid.tolist(), quantity.tolist(), strict=True)
    names = [f"{labels[i]}{f'.{j + 1}' if j else ''} [{UNITS[q]}]" for i, j, q in each]
    loads = [f"{name} [{units[name]}]" for name in trial.problem.known]
    first = np.concatenate([trial.time[:1], np.full(len(names), np.nan), trial.known[0, 0]])
    rows = np.vstack([first, np.column_stack([trial.time[1:], measured, trial.known.sum(axis=1)])])
    numbers = (["" if np.isnan(x) else f"{x:.12g}" for x in row] for row in rows)
    return csv_bytes([["time [s]", *names, *loads], *numbers])

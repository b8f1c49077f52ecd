"""Influence matrix of a layout: static readings per unit of each load, and signal-to-noise ratios."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.experiment.layout.gauge_list import GaugeList, channel_labels
from strainsight.experiment.structure.structure import Structure
from strainsight.records.placed import Influence
from strainsight.records.training import Screened
from strainsight.runner.output import Table
from strainsight.sensors.candidates import ACCELERATION, UNITS
from strainsight.text import reading_unit

FREE = 1e-9
"""Square of the lowest frequency over that of the highest mode below which a structure has no static response."""


def influence_of(
    structure: Structure, screened: Screened, channels: np.ndarray, size: Mapping[str, float]
) -> Influence | None:
    """Static readings per unit of each load at the guess, in the modal coordinates of the reduced model (M = I, K = Λ):

        Φ = R Λ⁻¹ S

    Its condition is that of σ⁻¹ Φ diag(size) for the unknown loads; None for fewer than two. channels (m,); size [SI]: of the
    unknowns. None for a structure that can move freely, as it has no static response."""
    training, model = structure.training, structure.reduced.model
    lam = np.diag(model.stiffness.at(model.reference))
    if lam.min() <= FREE * lam.max():
        return None
    reading = training.rows[channels] @ (model.input_shape / lam[:, None])
    reading[training.candidates.quantity[channels] == ACCELERATION] = 0.0
    std = screened.noise_std[channels]
    unknown = [i for i, name in enumerate(model.inputs) if name in size]
    whitened = reading[:, unknown] * [size[model.inputs[i]] for i in unknown] / std[:, None]
    return Influence(
        load=tuple(model.inputs),
        unit=tuple(structure.config.loads[name].unit for name in model.inputs),
        reading=reading,
        signal_to_noise=training.rms[channels] / std,
        condition=float(np.linalg.cond(whitened)) if len(unknown) > 1 else None,
    )


INFLUENCE = "influence matrix: static readings per unit load"
"""Title of the table, before its condition number."""
PER = {"N": (1e3, "kN"), "N m": (1e3, "kN m"), "Pa": (1e6, "MPa")}
"""Unit of a load for which readings are given."""


def influence_table(influence: Influence, listed: GaugeList) -> Table:
    """Table of the influence matrix of a layout."""
    scales = [PER.get(unit, (1.0, unit)) for unit in influence.unit]
    labels, quantities, rows = channel_labels(listed), listed.channels.quantity, []
    for i, values in enumerate(influence.reading * [scale for scale, _ in scales]):
        factor, shown = reading_unit(float(np.abs(values).max()), UNITS[int(quantities[i])])
        rows.append((labels[i], shown, *(f"{x / factor:.4g}" for x in values), f"{influence.signal_to_noise[i]:.3g}"))
    heads = (f"per {unit} of {name}" for name, (_, unit) in zip(influence.load, scales, strict=True))
    condition = "" if influence.condition is None else f"; condition number {influence.condition:.3g}"
    columns = ("channel", "unit", *heads, "RMS in training over noise")
    return Table(f"{INFLUENCE}{condition}", columns, tuple(rows))

"""Readings of a layout per unit of each load: influence matrix (static) and frequency response functions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.experiment.layout.gauge_list import GaugeList, channel_labels
from strainsight.experiment.structure.structure import Structure
from strainsight.records.placed import FrequencyResponse, Influence
from strainsight.records.training import Screened
from strainsight.rom.model import frequency_response
from strainsight.runner.output import Table
from strainsight.sensors.candidates import ACCELERATION, STRAIN, UNITS
from strainsight.text import PER_LOAD, reading_unit

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


def influence_table(influence: Influence, listed: GaugeList) -> Table:
    """Table of the influence matrix of a layout."""
    scales = [PER_LOAD.get(unit, (1.0, unit)) for unit in influence.unit]
    labels, quantities, rows = channel_labels(listed), listed.channels.quantity, []
    for i, values in enumerate(influence.reading * [scale for scale, _ in scales]):
        factor, shown = reading_unit(float(np.abs(values).max()), UNITS[int(quantities[i])])
        rows.append((labels[i], shown, *(f"{x / factor:.4g}" for x in values), f"{influence.signal_to_noise[i]:.3g}"))
    heads = (f"per {unit} of {name}" for name, (_, unit) in zip(influence.load, scales, strict=True))
    condition = "" if influence.condition is None else f"; condition number {influence.condition:.3g}"
    columns = ("channel", "unit", *heads, "RMS in training over noise")
    return Table(f"{INFLUENCE}{condition}", columns, tuple(rows))


EXCITED = 1e-6
"""Share of a mode in the static strain, relative to that of the largest one, from which a load excites the mode."""
LOWEST, HIGHEST, POINTS = 0.1, 1.05, 200
"""First frequency over the first natural frequency, last one over the last natural frequency, and number in equal ratios."""
AROUND = np.array([-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0])
"""Further frequencies at each natural frequency, in half-power half-widths ζ f."""


def frequency_response_of(structure: Structure, listed: GaugeList, channels: np.ndarray) -> FrequencyResponse | None:
    """Frequency response functions of the strain gauges at the guess, from 0 Hz to the last mode of the reduced model.

    channels (m,) of the listed gauges. None for a quasi-static model, without damping, for a structure that can move freely,
    without strain gauges, and if no load excites a mode."""
    training, model, last = structure.training, structure.reduced.model, float(structure.reduced.frequency[-1])
    is_strain = training.candidates.quantity[channels] == STRAIN
    lam = np.diag(model.stiffness.at(model.reference))
    if structure.config.train.model == "static" or not is_strain.any() or lam.min() <= FREE * lam.max():
        return None
    rows = training.rows[channels[is_strain]]
    share = np.abs(rows).max(axis=0)[:, None] * np.abs(model.input_shape) / lam[:, None]
    modes = np.flatnonzero(lam <= (2 * np.pi * HIGHEST * last) ** 2)
    excited = share[modes] > EXCITED * share.max(axis=0)
    half_width = model.damping.at(model.reference).viscous(lam)[0][modes] / (4 * np.pi)
    if not excited.any() or not half_width.all():
        return None
    natural = np.sqrt(lam[modes]) / (2 * np.pi)
    around = natural[:, None] + half_width[:, None] * AROUND
    between = np.geomspace(LOWEST * natural.min(), HIGHEST * last, POINTS)
    frequency = np.unique(np.concatenate([[0.0], between, around[around > 0]]))
    H = frequency_response(model, model.reference, rows, frequency)
    return FrequencyResponse(
        load=tuple(model.inputs),
        unit=tuple(structure.config.loads[name].unit for name in model.inputs),
        channel=tuple(label for label, strain in zip(channel_labels(listed), is_strain, strict=True) if strain),
        gauge=listed.channels.gauge[is_strain],
        frequency=frequency,
        magnitude=np.abs(H),
        phase=np.angle(H),
        natural=natural,
        excited=excited,
    )


def frequency_response_table(response: FrequencyResponse) -> Table:
    """Table of the magnitude at 0 Hz and at the natural frequencies that each load excites."""
    rows = []
    for i, (load, unit) in enumerate(zip(response.load, response.unit, strict=True)):
        scale, per = PER_LOAD.get(unit, (1.0, unit))
        for frequency in (0.0, *response.natural[response.excited[:, i]]):
            strain = 1e6 * scale * response.magnitude[np.searchsorted(response.frequency, frequency), :, i]
            rows.append((load, f"{frequency:.4g}", f"µm/m per {per}", *(f"{x:.4g}" for x in strain)))
    title = "FRF: magnitude of the frequency response functions, static and at the excited natural frequencies"
    return Table(title, ("load", "frequency [Hz]", "unit", *response.channel), tuple(rows))

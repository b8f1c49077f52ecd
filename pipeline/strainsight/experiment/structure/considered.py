"""Considered parameters of the filter (Schmidt-Kalman): errors of installation, loads, damping, frequencies and stiffness, with σ
from the tolerances."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, tolerances_of
from strainsight.estimation.conditional import (
    ConsideredParameters,
    acceleration_rows,
    theta_at,
)
from strainsight.estimation.model import FilterModel
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.tolerated_loads import (
    ToleratedLoads,
    acting,
    inputs_changed,
    of_loads,
    stacked,
    tolerated_loads,
)
from strainsight.experiment.structure.tolerated_masses import (
    frequency_errors,
    inertia_rows,
    lacking_mass,
    load_mass_std,
)
from strainsight.experiment.structure.truth import modulus_estimated
from strainsight.sensors.candidates import ACCELERATION, STRAIN, Candidates
from strainsight.sensors.installation import COMMON, COMMON_GAIN, InstallationStd

SOURCE = {
    "along": "position",
    "across": "position",
    "angle": "angle",
    "tilt_along": "angle",
    "tilt_across": "angle",
    "gain": "gain",
    COMMON_GAIN: "common gain",
    "transverse": "transverse sensitivity",
    "mesh": "mesh",
    "along_twice": "position",
    "across_twice": "position",
    "along_across": "position",
    "turned_twice": "angle",
}
"""Derivative of a reading → source in a variance budget."""


RENEWED = ("offset", "drift", "temperature")
"""Sources with independent errors in every record of a test, as gauges are zeroed before each."""


@dataclass(frozen=True)
class Zero:
    """Error independent of the motion: source; std (k,) of k channels [unit of the channel]; owner (k,): channels with the same
    number share one error; drifts: whether it grows with t/T to this value at the end of the record."""

    source: str
    std: np.ndarray
    owner: np.ndarray
    drifts: bool


@dataclass(frozen=True)
class Tolerated:
    """Tolerances of channels: σ times derivatives with respect to installation and other errors.

    channels (k,): of train.h5, ascending; quantity (k,); channel_of_grid, sign, gauge: of g grids (`Candidates.grids`), gauge is
    common to grids that move together; slope: name → (g, n) per reduced coordinate; unreduced: name → (g, f) per load error
    outside the reduced basis [1/N]; mean (g, n): mean change of the reading; zeros: errors independent of the motion;
    loads: load errors; load_mass (n_u,): σ of the mass at each force [kg]; damping, frequency, masses, lacking, stiffness,
    learned, discrepancy: see `ConsideredParameters`."""

    channels: np.ndarray
    quantity: np.ndarray
    channel_of_grid: np.ndarray
    sign: np.ndarray
    gauge: np.ndarray
    slope: dict[str, np.ndarray]
    unreduced: dict[str, np.ndarray]
    mean: np.ndarray
    zeros: tuple[Zero, ...]
    loads: ToleratedLoads
    damping: float
    frequency: np.ndarray
    masses: int
    load_mass: np.ndarray
    lacking: np.ndarray
    stiffness: float
    learned: bool
    discrepancy: float


def tolerated(structure: Structure, channels: np.ndarray) -> Tolerated:
    """Tolerances of channels (any,) of train.h5, −1 for none, from the config."""
    tolerances, pool, std = structure.tolerances, structure.pool, structure.installation
    reduced, training = structure.reduced, structure.training
    # a sensitivity needs all channels of a gauge
    wanted = pool.channels(np.unique(pool.gauge[np.unique(channels[channels >= 0])]))
    part = pool.take(wanted)
    sensitivity, grids, n = structure.sensitivity(wanted), part.grids, reduced.model.size
    free = ~grids.bonded[:, None]
    sigma = {name: value for name, value in std.by_name.items() if value > 0}
    scaled = {
        name: value * getattr(sensitivity, name) * (free if name in COMMON else 1.0) for name, value in sigma.items()
    }
    mean, missed = std.mean(sensitivity) * free, training.missed[wanted]
    loads = tolerated_loads(tolerances, reduced, missed + part.read(mean[:, n:]).reshape(missed.shape), part.quantity)
    felt = {name: rows for name, rows in scaled.items() if rows.any()}
    # a gain (std 0 here) has no displacement
    unreduced = {
        name: loads.std * rows[:, n:].reshape(len(rows), *missed.shape[1:])[:, loads.load, loads.way]
        for name, rows in felt.items()
    }
    return Tolerated(
        wanted,
        part.quantity,
        part.channel_of_grid,
        part.sign_of_grid,
        grids.gauge,
        {name: rows[:, :n] for name, rows in felt.items()},
        unreduced,
        mean[:, :n],
        _zeros(std, part),
        loads,
        float(np.log(tolerances.damping)),
        *frequency_errors(structure, training.rows[wanted]),
        load_mass_std(structure),
        lacking_mass(structure),
        0.0 if modulus_estimated(structure.config) else tolerances.model,
        tolerances.treat == "estimate",
        tolerances.discrepancy,
    )


def _zeros(std: InstallationStd, part: Candidates) -> tuple[Zero, ...]:
    each, common, differential = np.arange(len(part)), *std.warmed
    straining, ones = part.quantity == STRAIN, np.ones(len(part.grids))
    zeros = (
        Zero("offset", std.offset * straining, each, drifts=False),
        Zero("drift", std.drift * straining, each, drifts=True),
        Zero("temperature", common * straining * part.read(ones), np.zeros_like(each), drifts=True),
        Zero("temperature", differential * straining * np.sqrt(part.added(ones)), part.gauge, drifts=True),
    )
    return tuple(zero for zero in zeros if zero.std.any())


def not_held_in_words(structure: Structure) -> tuple[str, ...]:
    """Sentences on tolerances that σ does not include."""
    sentences, tolerances, loads = [], structure.tolerances, structure.config.loads
    if structure.training.strain_operator is not None and (
        tolerances.position or tolerances.angle or tolerances.transverse or tolerances.mesh
    ):
        sentences.append(
            "σ does not include position, angle, transverse sensitivity and mesh errors of imported gauges, because the "
            "imported strain operator has no gradients (tolerances.position, tolerances.angle, tolerances.transverse, "
            "tolerances.mesh)"
        )
    change = structure.reduced.misaligned.shape
    for key, std, of in (
        ("load_angle", tolerances.load_angle, change[..., :2]),
        ("load_position", tolerances.load_position, change[..., 2:]),
    ):
        # moments and body forces have no point of action, pressures and rotations no direction either
        rigid = [
            name
            for i, name in enumerate(structure.reduced.model.inputs)
            if std > 0
            and not of[:, i].any()
            and not (loads[name].pressure or loads[name].rotation)
            and (key == "load_angle" or not (loads[name].moment or loads[name].gravity))
        ]
        if rigid:
            sentences.append(
                f"tolerances.{key} has no effect on σ for {', '.join(rigid)}: "
                "this error does not change the response of the model"
            )
    return tuple(sentences)


def exact_frequencies_in_words(config: PlacementConfig) -> str:
    """Warning that σ assumes exact natural frequencies, if other tolerances are set."""
    tolerances = tolerances_of(config.tolerances)
    if tolerances == NONE or tolerances.frequency > 0 or config.train.model == "static":
        return ""
    return (
        "σ assumes exact masses and natural frequencies; a mass error of 1 % causes a modulus error of 1 %. For uncertain "
        "frequencies set tolerances.frequency: 0.01"
    )


def on_average(tolerated: Tolerated, model: FilterModel, channels: np.ndarray) -> FilterModel:
    """Filter model with the mean reading of channels (m,) of train.h5 over installation errors."""
    at = np.searchsorted(tolerated.channels, channels)
    rows, n = np.zeros((len(tolerated.channels), tolerated.mean.shape[1])), tolerated.mean.shape[1]
    np.add.at(rows, tolerated.channel_of_grid, tolerated.sign[:, None] * tolerated.mean)
    H = model.H.copy()
    H[:, :n] += rows[at]
    return replace(model, H=H)


def build_considered(
    tolerated: Tolerated, model: FilterModel, channels: np.ndarray, behind: bool = False
) -> ConsideredParameters:
    """Considered parameters of a filter with channels (m,) of train.h5.

    Direction and point of loads, gain of known loads; position, angles, gain, transverse sensitivity, offset and drift of gauges;
    temperature. behind: append the static residual of misaligned loads to the smoother states (`field_beyond`)."""
    at = np.searchsorted(tolerated.channels, channels)
    m, n, states = len(channels), model.model.size, model.parameter_states.start
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    moving = tolerated.quantity[at] == ACCELERATION
    errors = acting(tolerated.loads, model)
    shapes = {"D": (m, states), "E": (m, len(model.known_inputs)), "B": (m, len(errors)), "offset": (m,), "drift": (m,)}
    sources: list[str] = []
    columns: dict[str, list[np.ndarray]] = {key: [] for key in shapes}

    def add(source: str, **rows: np.ndarray) -> None:
        sources.append(source)
        for key, shape in shapes.items():
            columns[key].append(rows.get(key, np.zeros(shape)))

    changes = []
    for source, on_states, on_known, change in of_loads(tolerated.loads, model, at, moving):
        add(source, D=on_states, E=on_known)
        changes.append(change)
    row_of = np.full(len(tolerated.channels), -1)
    row_of[at] = np.arange(m)
    grids = np.flatnonzero(row_of[tolerated.channel_of_grid] >= 0)
    grids = grids[np.argsort(row_of[tolerated.channel_of_grid[grids]], kind="stable")]
    row, accelerated = (
        row_of[tolerated.channel_of_grid[grids]],
        tolerated.quantity[tolerated.channel_of_grid[grids]] == ACCELERATION,
    )

    def read(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Readings of grids with these rows, per state and per known load."""
        sensed, fed = np.zeros((len(grids), states)), np.zeros((len(grids), len(model.known_inputs)))
        sensed[:, :n] = tolerated.sign[grids, None] * rows[grids]
        if moving.any():
            on_states, on_known = acceleration_rows(model, at_guess, rows[grids][accelerated])
            sensed[accelerated], fed[accelerated] = on_states[0], on_known[0]
        return sensed, fed

    for name, rows in tolerated.slope.items():
        sensed, fed = read(rows)
        unreduced = (tolerated.sign[:, None] * tolerated.unreduced[name][:, errors])[grids] * ~accelerated[:, None]
        owner = tolerated.gauge[grids] if name in COMMON else np.arange(len(grids)) * (name != COMMON_GAIN)
        for each in np.unique(owner):
            part = owner == each
            if sensed[part].any():
                rows_of = (_rows(m, row[part], values[part]) for values in (sensed, fed, unreduced))
                add(SOURCE[name], **dict(zip("DEB", rows_of, strict=True)))
    for zero in tolerated.zeros:
        for each in np.unique(zero.owner[at]):
            off = np.where(zero.owner[at] == each, zero.std[at], 0.0)
            if off.any():
                add(zero.source, **{"drift" if zero.drifts else "offset": off})
    D, E, B, offset, drift = (stacked(columns[key], shape) for key, shape in shapes.items())
    return ConsideredParameters(
        tuple(sources),
        D,
        np.concatenate([E, drift[..., None]], axis=2) if drift.any() else E,
        offset,
        tolerated.damping,
        tolerated.stiffness,
        tolerated.learned,
        tolerated.discrepancy,
        stacked(changes, model.model.input_shape.shape),
        inputs_changed(tolerated.loads, model)[errors],
        tolerated.loads.std[errors],
        behind,
        B,
        frequency=tolerated.frequency,
        masses=tolerated.masses,
        inertia=inertia_rows(tolerated.load_mass, model),
        lacking=tolerated.lacking,
    )


def _rows(m: int, row: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Add values to the given rows of m zero rows; the arms of a bridge share a row."""
    whole = np.zeros((m, values.shape[1]))
    np.add.at(whole, row, values)
    return whole

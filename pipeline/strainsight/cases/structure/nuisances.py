"""What the filter takes as exact and is not: installation of its gauges, loads, damping, stiffness; with their σ from the
tolerances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.cases.structure.drawn import installation_std, modulus_estimated
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import Tolerances, tolerances_of
from strainsight.estimation.conditional import (
    Nuisances,
    acceleration_change,
    acceleration_rows,
    on_loads,
    theta_at,
)
from strainsight.estimation.model import FilterModel
from strainsight.gauges.candidates import ACCELERATION, STRAIN, Candidates
from strainsight.gauges.sensitivity import COMMON, OWN, given_sensitivity, sensitivity_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training

SOURCE = {
    "along": "position",
    "across": "position",
    "angle": "angle",
    "tilt_along": "angle",
    "tilt_across": "angle",
    "gain": "gain",
    "transverse": "transverse sensitivity",
}
"""Derivative of a reading → what it is one of, in a budget."""
LOAD_GAIN = "load gain"
MISALIGNMENT = ("load direction", "load direction", "load point", "load point")
"""What the misalignments of a load are, in a budget."""


@dataclass(frozen=True)
class ToleratedLoads:
    """σ times the derivatives with respect to how the loads of a model act: source (f,); load (f,) its column; shape (f, n) of
    the input shape [1/√kg]; missed (f, k) static readings of k channels per N, beyond what the coordinates hold."""

    source: tuple[str, ...]
    load: np.ndarray
    shape: np.ndarray
    missed: np.ndarray


@dataclass(frozen=True)
class Tolerated:
    """σ times the derivatives of some channels with respect to their installation.

    channels (k,) of train.h5, ascending; gauge (k,) of each; quantity (k,); slope: name → (k, n) per reduced coordinate, those
    without a tolerance left out; offset (k,) σ of an offset [unit of the channel]; loads: how they act; damping, stiffness,
    learned, discrepancy: of `Nuisances`.
    """

    channels: np.ndarray
    gauge: np.ndarray
    quantity: np.ndarray
    slope: dict[str, np.ndarray]
    offset: np.ndarray
    loads: ToleratedLoads
    damping: float
    stiffness: float
    learned: bool
    discrepancy: float


def tolerated(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, training: Training, channels: np.ndarray
) -> Tolerated:
    """Of channels (any,) of train.h5, −1 for none, by the tolerances of the config."""
    own, std, pool = tolerances_of(config.tolerances), installation_std(config), training.candidates
    # whole gauges: a sensitivity needs all channels that move as one
    wanted = pool.channels(np.unique(pool.gauge[np.unique(channels[channels >= 0])]))
    part = pool.take(wanted)
    slope = _slopes(mesh, reduced, training, part, wanted, std.position)
    free = ~part.bonded[:, None]
    sigma = {name: value for name, value in std.by_name.items() if value > 0}
    scaled = {name: value * slope[name] * (free if name in COMMON else 1.0) for name, value in sigma.items()}
    return Tolerated(
        wanted,
        pool.gauge[wanted],
        part.quantity,
        {name: rows for name, rows in scaled.items() if rows.any()},
        std.offset * (part.quantity == STRAIN),
        _loads(own, reduced, training.missed[wanted], part.quantity),
        float(np.log(own.damping)),
        0.0 if modulus_estimated(config) else own.model,
        own.treat == "estimate",
        own.discrepancy,
    )


def _loads(own: Tolerances, reduced: Reduced, missed: np.ndarray, quantity: np.ndarray) -> ToleratedLoads:
    """Of all loads, as if every one were known; those that change nothing are left out. missed (k, n_u, misalignments)."""
    model, off = reduced.model, reduced.misaligned.shape
    std = np.repeat([np.deg2rad(own.load_angle), own.load_position], 2)
    source, load, shape, read = [], [], [], []
    for i in range(len(model.inputs)):
        for name, sigma, change, static in zip(MISALIGNMENT, std, off[:, i].T, missed[:, i].T, strict=True):
            if sigma > 0 and (change.any() or static.any()):
                source.append(name)
                load.append(i)
                shape.append(sigma * change)
                read.append(sigma * np.where(quantity == ACCELERATION, 0.0, static))
        if own.load_gain > 0:
            source.append(LOAD_GAIN)
            load.append(i)
            shape.append(own.load_gain * model.input_shape[:, i])
            read.append(np.zeros(len(missed)))
    return ToleratedLoads(
        tuple(source), np.array(load, dtype=int), _stacked(shape, (model.size,)), _stacked(read, (len(missed),))
    )


def not_held_in_words(config: PlacementConfig, reduced: Reduced, training: Training) -> tuple[str, ...]:
    """Which tolerances σ does not hold, a sentence each."""
    found, installed, own = [], installation_std(config), tolerances_of(config.tolerances)
    if training.given is not None and (installed.position or installed.angle or installed.transverse):
        found.append(
            "σ holds no errors of place, direction and transverse sensitivity of the given gauges: their rows do not say how the "
            "strain is beside them (tolerances.position, angle, transverse)"
        )
    change = reduced.misaligned.shape
    for key, std, of in (
        ("load_angle", own.load_angle, change[..., :2]),
        ("load_position", own.load_position, change[..., 2:]),
    ):
        rigid = [name for i, name in enumerate(reduced.model.inputs) if std > 0 and not of[:, i].any()]
        if rigid:
            found.append(
                f"σ holds no such error as tolerances.{key} states of {', '.join(rigid)}: no motion of the model follows it"
            )
    return tuple(found)


def _slopes(
    mesh: Mesh, reduced: Reduced, training: Training, part: Candidates, channels: np.ndarray, std: float
) -> dict[str, np.ndarray]:
    if training.given is None:
        facets = exterior_facets(mesh)
        found = sensitivity_rows(mesh.position, part, reduced.basis, std, facets=facets)
    else:
        found = given_sensitivity(training.rows[channels])
    return {name: getattr(found, name) for name in (*COMMON, *OWN)}


def nuisances_of(own: Tolerated, model: FilterModel, channels: np.ndarray) -> Nuisances:
    """Of a filter with these channels (m,) of train.h5: direction and point of every load, gain of every known one; place and
    turns of every gauge, gain, transverse sensitivity and offset of every channel."""
    at = np.searchsorted(own.channels, channels)
    m, n, states = len(channels), model.model.size, model.parameter_states.start
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    moving = own.quantity[at] == ACCELERATION
    sources, D, E, shape = _of_loads(own.loads, model, at, moving)
    offset = [np.zeros(m)] * len(D)
    for name, rows in own.slope.items():
        sensed = np.zeros((m, states))
        sensed[:, :n] = rows[at]
        fed = np.zeros((m, len(model.known_inputs)))
        if moving.any():
            on_states, on_known = acceleration_rows(model, at_guess, rows[at][moving])
            sensed[moving], fed[moving] = on_states[0], on_known[0]
        owner = own.gauge[at] if name in COMMON else np.arange(m)
        for each in np.unique(owner):
            there = (owner == each)[:, None]
            if not (sensed * there).any():
                continue
            sources.append(SOURCE[name])
            D.append(np.where(there, sensed, 0.0))
            E.append(np.where(there, fed, 0.0))
            offset.append(np.zeros(m))
    for row in np.diag(own.offset[at]):
        if row.any():
            sources.append("offset")
            D.append(np.zeros((m, states)))
            E.append(np.zeros((m, len(model.known_inputs))))
            offset.append(row)
    return Nuisances(
        tuple(sources),
        _stacked(D, (m, states)),
        _stacked(E, (m, len(model.known_inputs))),
        _stacked(offset, (m,)),
        own.damping,
        own.stiffness,
        own.learned,
        own.discrepancy,
        _stacked(shape, model.model.input_shape.shape),
    )


def _of_loads(
    own: ToleratedLoads, model: FilterModel, at: np.ndarray, moving: np.ndarray
) -> tuple[list[str], list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Source, D (m, states), E (m, n_known) and change of the input shape (n, n_u), load by load; at (m,): rows of `missed`;
    moving (m,): which channels are accelerometers. Static readings at the guess."""
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    named = model.model.inputs
    sources: list[str] = []
    D: list[np.ndarray] = []
    E: list[np.ndarray] = []
    shape: list[np.ndarray] = []
    known = set(model.known_inputs)
    used = known | set(model.unknowns.inputs)
    for source, i, column, missed in zip(own.source, own.load.tolist(), own.shape, own.missed, strict=True):
        if named[i] not in (known if source == LOAD_GAIN else used):
            continue
        change = np.zeros(model.model.input_shape.shape)
        change[:, i] = column
        direct = np.zeros((len(at), len(named)))
        direct[:, i] = missed[at]
        if moving.any():
            direct[moving] = model.H[moving, : model.model.size] @ acceleration_change(model, at_guess, change)[0]
        on_states, on_known = on_loads(model, direct)
        sources.append(source)
        D.append(on_states)
        E.append(on_known)
        shape.append(change)
    return sources, D, E, shape


def _stacked(parts: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    return np.stack(parts) if parts else np.zeros((0, *shape))

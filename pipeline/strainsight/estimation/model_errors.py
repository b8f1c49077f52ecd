"""Errors of the model that may explain inconsistent measurements. They are compared by evidence with faults of sensors."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.faults import Fault
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord
from strainsight.rom.model import ReducedModel, modal_basis
from strainsight.sensors.candidates import STRAIN

R = TypeVar("R", bound=GridRecord)

STEPS = {"frequency": 0.02, "mass": 0.005, "damping": 2.0}
"""First step of the search: change of a frequency, of the first frequency by an added mass, and factor on damping ratios."""
WIDER = 10.0
"""Factor on the tolerances of direction and point of a load."""
DIRECTION = "load direction"
"""Source of the errors by rotations of a load."""
MISALIGNED = (DIRECTION, "load point")
"""Sources of load errors that `direction` makes larger."""
GAIN = 0.2
"""Prior σ of a gain common to all strain gauges."""


def model_errors(model: FilterModel, considered: ConsideredParameters) -> list[Fault]:
    """First errors to try: frequencies of the modes that the channels measure, masses at known loads, damping, direction and
    point of the loads, drift of all gauges, and their gain if a load is known. A mass at an unknown load cannot be distinguished
    from another load."""
    rows, rom = considered.frequency[1 : len(considered.frequency) - considered.masses], model.model
    modes = np.flatnonzero(rows.any(axis=0))
    step = STEPS["frequency"]
    errors = [Fault("frequency", int(j), factor) for j in modes for factor in (1 - step, 1 + step)]
    known = [rom.inputs.index(name) for name in model.known_inputs]
    errors += [Fault("mass", i, mass) for i in known if (mass := _mass(rom, force_shapes(model, considered, i))) > 0]
    errors += [Fault("damping", 0, factor) for factor in (1 / STEPS["damping"], STEPS["damping"])]
    errors += [Fault("direction", 0)] * bool(set(considered.source) & set(MISALIGNED))
    if _straining(model).sum() < 2:
        return errors
    return [*errors, Fault("warming", 0), *[Fault("gain", 0)] * bool(model.known_inputs)]


def force_shapes(model: FilterModel, considered: ConsideredParameters, load: int) -> np.ndarray:
    """Input shapes (r, a) of unit forces at the point of a load, along the load and perpendicular to it. The latter are the
    changes of the shape by rotations, known if these have a tolerance."""
    turned = [
        considered.shape[k, :, load] / std
        for k, std in enumerate(considered.load_std)
        if considered.source[k] == DIRECTION and considered.load[k] == load
    ]
    return np.column_stack([model.model.input_shape[:, load], *turned])


def _mass(model: ReducedModel, shapes: np.ndarray) -> float:
    """Mass [kg] at a load that lowers the first frequency by the first step; 0 if it hardly does. shapes: `force_shapes`."""
    _, phi = modal_basis(model, model.reference)
    each = np.sum((phi.T @ shapes) ** 2, axis=1)
    moved, all_modes = float(each[0]), float(np.max(each))
    return ((1 - STEPS["mass"]) ** -2 - 1) / moved if moved > 1e-6 * all_modes else 0.0


def further(fault: Fault) -> Fault | None:
    """The same error twice as large; None for errors without a size."""
    if fault.kind == "frequency":
        return replace(fault, amount=1 + 2 * (fault.amount - 1))
    if fault.kind == "mass":
        return replace(fault, amount=2 * fault.amount)
    return replace(fault, amount=fault.amount * (2 if fault.amount > 1 else 0.5)) if fault.kind == "damping" else None


def between(first: Fault, second: Fault) -> Fault:
    """The error halfway between two sizes."""
    return replace(first, amount=(first.amount + second.amount) / 2)


def apply_model_error(record: R, fault: Fault, before: float = 0.0) -> R:
    """The record with a model that has this error; before: share of the record before these samples.

    frequency of mode j times f     M + (f⁻² − 1) Mφⱼφⱼᵀ M
    mass m at a load                M + m s sᵀ,   s the `force_shapes` of the load
    damping                         ratios times the factor
    direction                       tolerances of direction and point of the loads times WIDER
    warming, gain                   one more considered constant, common to all strain gauges
    """
    model, considered = record.model, record.considered
    rom = model.model
    if fault.kind == "damping":
        return replace(record, model=replace(model, model=replace(rom, damping=rom.damping.scaled(fault.amount))))
    if fault.kind in ("frequency", "mass"):
        if fault.kind == "frequency":
            _, phi = modal_basis(rom, rom.reference)
            s = rom.mass.at(rom.reference) @ phi[:, fault.channel]
            added = (fault.amount**-2 - 1) * np.outer(s, s)
        else:
            s = force_shapes(model, considered, fault.channel)
            added = fault.amount * s @ s.T
        mass = replace(rom.mass, constant=rom.mass.constant + added)
        return replace(record, model=replace(model, model=replace(rom, mass=mass)))
    if fault.kind == "direction":
        return replace(record, considered=_wider_loads(considered))
    straining = _straining(model)
    if fault.kind == "gain":
        theta = {**model.fixed, **model.unknowns.guess}
        rows = GAIN * straining[:, None] * model.rows_at(theta)[..., : model.parameter_states.start]
        return replace(record, considered=add_constant(considered, fault.kind, record.known, rows=rows))
    count = np.maximum(np.isfinite(record.samples).sum(axis=0), 1)
    largest = np.sqrt(np.max(straining * np.nansum(record.samples**2, axis=0) / count))
    offset, drift = before * largest * straining, (1 - before) * largest * straining
    return replace(record, considered=add_constant(considered, fault.kind, record.known, offset=offset, drift=drift))


def _straining(model: FilterModel) -> np.ndarray:
    """1 for each strain gauge (m,), else 0."""
    quantity = np.full(model.H.shape[-2], STRAIN) if model.quantity is None else model.quantity
    return np.asarray(quantity == STRAIN, dtype=float)


def _wider_loads(considered: ConsideredParameters) -> ConsideredParameters:
    """Direction and point of the loads with a tolerance WIDER times as large; not gain and interpolation error."""
    count = len(considered.shape)
    factor = np.array([WIDER if source in MISALIGNED else 1.0 for source in considered.source])
    factor[count:] = 1.0
    B = considered.B if considered.B is None else considered.B * factor[: considered.B.shape[-1]]
    return replace(
        considered,
        D=considered.D * factor[:, None, None],
        E=considered.E * factor[:, None, None],
        offset=considered.offset * factor[:, None],
        B=B,
        shape=considered.shape * factor[:count, None, None],
    )


def add_constant(
    considered: ConsideredParameters,
    source: str,
    known: np.ndarray,
    rows: np.ndarray | None = None,
    offset: np.ndarray | None = None,
    drift: np.ndarray | None = None,
) -> ConsideredParameters:
    """Add one considered constant. known (T, HOLD, n_known): the known loads. Per unit of the constant: rows (m, n) on the
    states, offset (m,) of the readings, drift (m,) of the readings over the samples."""
    (_, m, n), loads = considered.D.shape, known.shape[-1]
    E = np.pad(considered.E, [(0, 1), (0, 0), (0, int(drift is not None and considered.E.shape[-1] == loads))])
    if drift is not None:
        E[-1, :, -1] = drift
    return replace(
        considered,
        source=(*considered.source, source),
        D=np.concatenate([considered.D, np.zeros((1, m, n)) if rows is None else rows.reshape(1, m, n)]),
        E=E,
        offset=np.concatenate([considered.offset, np.zeros((1, m)) if offset is None else offset[None]]),
        B=None if considered.B is None else np.pad(considered.B, [(0, 1), (0, 0), (0, 0)]),
    )

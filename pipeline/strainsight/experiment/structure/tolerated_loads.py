"""Errors of direction, point and gain of the loads, with σ from the tolerances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.tolerances import Tolerances
from strainsight.estimation.conditional import acceleration_change, load_rows, theta_at
from strainsight.estimation.model import FilterModel
from strainsight.records.reduced import Reduced
from strainsight.sensors.candidates import ACCELERATION

LOAD_GAIN = "load gain"
BETWEEN = "load between samples"
"""Interpolation error of a recorded load; in a filter of a test it is a separate known input without a shape."""
MISALIGNMENT = ("load direction", "load direction", "load point", "load point")
"""Names of the load misalignments in a budget."""


@dataclass(frozen=True)
class ToleratedLoads:
    """σ times the derivatives with respect to load errors.

    source (f,): name in the budget; load (f,): column; std (f,) [rad] or [m] and way (f,): of the misalignment, 0 for a gain;
    shape (f, n): change of the input shape [1/√kg]; missed (f, k): static readings of k channels per N outside the reduced basis.
    """

    source: tuple[str, ...]
    load: np.ndarray
    std: np.ndarray
    way: np.ndarray
    shape: np.ndarray
    missed: np.ndarray


def tolerated_loads(
    tolerances: Tolerances, reduced: Reduced, missed: np.ndarray, quantity: np.ndarray
) -> ToleratedLoads:
    """Errors of all loads, taken as known; errors without effect are omitted. missed (k, n_u, misalignments)."""
    model, off = reduced.model, reduced.misaligned.shape
    std = np.repeat([np.deg2rad(tolerances.load_angle), tolerances.load_position], 2)
    errors: list[tuple[str, int, float, int, np.ndarray, np.ndarray]] = []
    nothing = np.zeros(len(missed))
    for i in range(len(model.inputs)):
        each = zip(MISALIGNMENT, std, off[:, i].T, missed[:, i].T, strict=True)
        for way, (name, sigma, change, static) in enumerate(each):
            if sigma > 0 and (change.any() or static.any()):
                read = sigma * np.where(quantity == ACCELERATION, 0.0, static)
                errors.append((name, i, sigma, way, sigma * change, read))
        if tolerances.load_gain > 0:
            errors.append((LOAD_GAIN, i, 0.0, 0, tolerances.load_gain * model.input_shape[:, i], nothing))
        errors.append((BETWEEN, i, 0.0, 0, model.input_shape[:, i], nothing))
    source, load, sigma_of, way_of, shapes, readings = zip(*errors, strict=True) if errors else ((),) * 6
    return ToleratedLoads(
        source,
        np.array(load, dtype=int),
        np.array(sigma_of, dtype=float),
        np.array(way_of, dtype=int),
        stacked(shapes, (model.size,)),
        stacked(readings, (len(missed),)),
    )


def interpolation_error(name: str) -> str:
    """Name of the filter input for the interpolation error of a known load."""
    return f"{name}, {BETWEEN}"


def with_interpolation_errors(model: FilterModel) -> FilterModel:
    """Append an interpolation-error input for every known load; it has no shape and acts through a constant ν only."""
    plain, errors = model.model, tuple(interpolation_error(name) for name in model.known_inputs)

    def wider(shape: np.ndarray) -> np.ndarray:
        return np.pad(shape, [(0, 0), (0, len(errors))])

    reduced = replace(
        plain,
        inputs=(*plain.inputs, *errors),
        input_shape=wider(plain.input_shape),
        input_slope={name: wider(slope) for name, slope in plain.input_slope.items()},
    )
    return replace(model, model=reduced, known_inputs=(*model.known_inputs, *errors))


def inputs_changed(loads: ToleratedLoads, model: FilterModel) -> np.ndarray:
    """Filter input (f,) that each error changes, −1 without one."""
    named, known = model.model.inputs, set(model.known_inputs)
    used = known | set(model.unknowns.inputs)

    def changed(source: str, i: int) -> int:
        name = interpolation_error(named[i]) if source == BETWEEN else named[i]
        return named.index(name) if name in (known if source == LOAD_GAIN else used) else -1

    pairs = zip(loads.source, loads.load.tolist(), strict=True)
    return np.array([changed(source, i) for source, i in pairs], dtype=int)


def acting(loads: ToleratedLoads, model: FilterModel) -> np.ndarray:
    """Errors (f′,) that apply to a filter: a gain for known loads, an interpolation error for recorded loads."""
    return np.flatnonzero(inputs_changed(loads, model) >= 0)


def field_beyond(loads: ToleratedLoads, model: FilterModel, reduced: Reduced) -> np.ndarray:
    """σ times the static displacement of all nodes (3 nodes, f′) per N outside the reduced basis, for the errors of a filter."""
    which = acting(loads, model)
    return np.asarray(loads.std[which] * reduced.misaligned.missed[:, loads.load[which], loads.way[which]])


def of_loads(
    loads: ToleratedLoads, model: FilterModel, at: np.ndarray, moving: np.ndarray
) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield source, D (m, states), E (m, n_known) and change of the input shape (n, n_u) of each error, at the guess.

    at (m,): rows of `missed`; moving (m,): whether a channel is an accelerometer."""
    at_guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
    for each, i in enumerate(inputs_changed(loads, model).tolist()):
        if i < 0:
            continue
        change = np.zeros(model.model.input_shape.shape)
        change[:, i] = loads.shape[each]
        direct = np.zeros((len(at), len(model.model.inputs)))
        direct[:, i] = loads.missed[each][at]
        if moving.any():
            direct[moving] = model.H[moving, : model.model.size] @ acceleration_change(model, at_guess, change)[0]
        yield loads.source[each], *load_rows(model, direct), change


def stacked(parts: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Stack k parts to (k, *shape), also for k = 0."""
    return np.stack(parts) if parts else np.zeros((0, *shape))

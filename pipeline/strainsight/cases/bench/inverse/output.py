"""What the estimate of a bench writes: histories, comparisons, tables, and the loads as a command history."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from strainsight.cases.bench.inverse.numbers import (
    load_numbers,
    mismatch_numbers,
    parameter_numbers,
    ratio_numbers,
)
from strainsight.cases.bench.inverse.verdicts import SURE, message_of, warnings_of
from strainsight.cases.bench.sensors import unit_of
from strainsight.estimation.consistency import not_identified
from strainsight.workflow.output import Dataset, Output, Scalar, Table

if TYPE_CHECKING:
    from strainsight.stages.bench.estimate import Estimated

LEARNED = 0.5
"""Share of its first σ below which a parameter counts as learned."""
METHODS = {
    "iterated": "iterated with the step inside",
    "one_shot": "one-shot, put back onto the constraints",
    "undamped": "iterated without damping",
}
TRUTHS = {
    "fine": "the bench with h/{substeps}",
    "own": "the filter's own step",
    "walk": "drawn from the filter's own model",
}


def estimate_output(config: Any, found: Estimated) -> Output:
    """The Output of the stage."""
    inputs, more = _inputs(config, found)
    parameters, still_more = _parameters(config, found)
    sensors, mismatches = _sensors(config, found)
    model = found.trial.model
    violation = np.array([_violation(found, k) for k in range(len(found.time))])
    nis, late = found.nis[:, 0], found.nis[len(found.nis) // 2 :]
    m, nu = len(found.trial.noise), len(found.unknowns.inputs)
    lost = int(np.sum(found.lost >= 0))
    truth = _truth(config)
    summary: dict[str, Scalar] = {
        "steps": len(nis),
        "step": float(model.h),
        "channels": m,
        "unknowns": nu + len(found.unknowns.free),
        "runs": found.mean.shape[1],
        "lost": lost,
        "nis": float(np.nanmean(late)) if np.isfinite(late).any() else -1.0,
        "expected_nis": (m - nu) / m if config.estimate.truth.model != "walk" else 1.0,
        "violation": float(np.nanmax(violation)),
        "method": METHODS[config.estimate.method.update],
        "truth": truth,
    }
    finite = {key: value for key, value in (more | still_more | mismatches).items() if _said(value)}
    datasets = {
        "/time": Dataset(found.time, "s", "time, the start first"),
        "/q": Dataset(found.mean[:, 0, model.q], "SI", "estimated coordinates (time × coordinate)", ("/time", "")),
        "/violation": Dataset(violation, "1", "largest constraint violation of the estimate, relative", ("/time",)),
        "/nis": Dataset(nis, "1", "normalised innovation squared over the number of channels"),
        "/lost": Dataset(found.lost, "1", "step in which each run was lost, -1: none"),
    }
    loads = {name: found.mean[:, 0, model.u.start + i] for i, name in enumerate(config.estimate.inputs)}
    known = summary | finite
    warnings = [*found.said, *warnings_of(config, found.unknowns.free, known, float(known["nis"]), found.lost)]
    tables = [_table(config, found, finite)]
    if warnings:
        tables.append(Table("warnings", ("",), tuple((text,) for text in warnings)))
    return Output(
        datasets=datasets | inputs | parameters | sensors,
        summary=known,
        message=message_of(config, found.unknowns.free, known, METHODS[config.estimate.method.update], truth),
        tables=tuple(tables),
        files={"loads.csv": _command_history(found.time, loads)} if loads and found.lost[0] < 0 else {},
    )


def _inputs(config: Any, found: Estimated) -> tuple[dict[str, Dataset], dict[str, Scalar]]:
    datasets: dict[str, Dataset] = {}
    numbers: dict[str, Scalar] = {}
    model = found.trial.model
    for i, (name, column) in enumerate(zip(config.estimate.inputs, found.unknowns.inputs, strict=True)):
        unit = "N" if config.forces[name].type == "force" else "N m"
        at = model.u.start + i
        mean = found.mean[:, :, at]
        std = np.where(np.isfinite(mean), found.std[:, :, at], np.nan)
        place = f"/inputs/{name}"
        datasets[f"{place}/estimate"] = Dataset(mean[:, 0], unit, f"estimate of {name}", ("/time",))
        datasets[f"{place}/std"] = Dataset(std[:, 0], unit, "its standard deviation", ("/time",))
        true = found.reality.inputs[:, :, column]
        if np.isfinite(true).all():
            datasets[f"{place}/true"] = Dataset(true[:, 0], unit, "the true load", ("/time",))
            numbers |= load_numbers(name, true[1:, 0], mean[1:, 0], std[1:, 0])
            if mean.shape[1] > 1:
                # truths are one for all, or one a seed, and starts run within a seed
                each = np.broadcast_to(np.repeat(true, mean.shape[1] // true.shape[1], axis=1), mean.shape)
                half = len(mean) // 2
                error = np.sqrt(np.mean((mean - each)[half:] ** 2, axis=0))
                datasets[f"/runs/inputs/{name}/error"] = Dataset(
                    error, unit, "rms error over the second half, of every run"
                )
                numbers[f"ratio.{name}"] = float(np.sqrt(np.nanmean(((mean - each)[half:] / std[half:]) ** 2)))
        if name in found.elsewhere:
            there = found.elsewhere[name]
            datasets[f"{place}/there"] = Dataset(there, unit, "the load on the bench that was measured", ("/time",))
            numbers |= ratio_numbers(name, there[1:], mean[1:, 0])
    return datasets, numbers


def _parameters(config: Any, found: Estimated) -> tuple[dict[str, Dataset], dict[str, Scalar]]:
    datasets: dict[str, Dataset] = {}
    numbers: dict[str, Scalar] = {}
    unknowns = found.unknowns
    names = list(found.bench.system.parameters)
    starts = len(unknowns.starts)
    for i, name in enumerate(unknowns.free):
        column = names.index(unknowns.parameters[name])
        entry = config.estimate.parameters[name]
        unit = "Pa" if entry.bearing is None else "m"
        theta, std = _in_theta(found, column)
        place = f"/parameters/{name}"
        what = name if entry.bearing is None else f"{entry.property} of {entry.bearing}"
        datasets[f"{place}/estimate"] = Dataset(theta[:, 0], unit, f"estimate of {what}", ("/time",))
        datasets[f"{place}/std"] = Dataset(std[:, 0], unit, "its standard deviation", ("/time",))
        true = np.broadcast_to(
            np.repeat(found.reality.theta[:, column], theta.shape[1] // len(found.reality.theta)), theta.shape[1]
        )
        known = bool(np.isfinite(true).all())
        if known:
            datasets[f"{place}/true"] = Dataset(np.array(true[0]), unit, "the true value")
        if theta.shape[1] > 1:
            for key, values, said in (
                ("start", theta[0], "first guess"),
                ("estimate", theta[-1], "estimate at the end"),
                ("std", std[-1], "its standard deviation"),
            ):
                datasets[f"/runs/parameters/{name}/{key}"] = Dataset(values, unit, f"{said}, of every run")
        apart = starts > 1 and bool(not_identified(theta[-1, :starts], std[-1, :starts]))
        learned = bool(np.all(std[-1, :starts] < LEARNED * unknowns.std[i]))
        wrong = known and bool(np.any(np.abs(theta[-1] - true) > SURE * std[-1]))
        numbers[f"identified.{name}"] = learned and not apart and not (starts > 1 and wrong)
        if known:
            numbers |= parameter_numbers(name, true, theta[-1], std[-1])
            datasets |= _errors(name, unit, theta[-1] - true)
    return datasets, numbers


def _errors(name: str, unit: str, error: np.ndarray) -> dict[str, Dataset]:
    path = f"/runs/parameters/{name}/error"
    return {path: Dataset(error, unit, "estimate less true value at the end, of every run")} if len(error) > 1 else {}


def _in_theta(found: Estimated, column: int) -> tuple[np.ndarray, np.ndarray]:
    """A parameter and its σ, √(s P_ξξ sᵀ) with s = ∂θ/∂ξ (T + 1, runs)."""
    xi, P = found.mean[:, :, found.trial.model.xi], found.xi_covariance
    theta, std = np.full(xi.shape[:2], np.nan), np.full(xi.shape[:2], np.nan)
    for at in np.ndindex(xi.shape[:2]):
        if np.isfinite(xi[at]).all():
            values, slopes = found.unknowns.coordinates.theta(xi[at])
            theta[at], s = values[column], slopes[column]
            std[at] = np.sqrt(max(float(s @ P[at[0], min(at[1], P.shape[1] - 1)] @ s), 0.0))
    return theta, std


def _sensors(config: Any, found: Estimated) -> tuple[dict[str, Dataset], dict[str, Scalar]]:
    datasets: dict[str, Dataset] = {}
    numbers: dict[str, Scalar] = {}
    for name, own in found.sensors.channels.items():
        unit, what = unit_of(config.sensors[name])
        used = name in found.used.channels
        measured = found.measured[:, 0, found.used.channels[name]] if used else found.reality.readings[:, 0, own]
        expected = found.reading[1:, own]
        place = f"/sensors/{name}"
        datasets[f"{place}/used"] = Dataset(np.array(used), "1", "whether the filter was given it")
        datasets[f"{place}/expected"] = Dataset(expected, unit, f"by the estimate: {what}")
        if np.isfinite(measured).any():
            said = "measured" if used else "true, not given to the filter"
            datasets[f"{place}/measured"] = Dataset(measured, unit, f"{said}: {what}")
            numbers |= mismatch_numbers(name, measured, expected)
    return datasets, numbers


def _violation(found: Estimated, k: int) -> float:
    x = found.mean[k, :1]
    return float(found.trial.model.violation(x)[0]) if np.isfinite(x).all() else float("nan")


def _truth(config: Any) -> str:
    estimate = config.estimate
    if estimate.measured is not None:
        return f"measured on {estimate.measured['from']}"
    said = TRUTHS[estimate.truth.model].format(substeps=estimate.truth.substeps)
    return said + ("" if estimate.truth.noise else ", without noise")


def _table(config: Any, found: Estimated, numbers: dict[str, Scalar]) -> Table:
    shown: dict[str, tuple[str, ...]] = dict.fromkeys(config.estimate.inputs, ("slope", "offset", "error", "std"))
    shown |= dict.fromkeys(found.elsewhere, ("ratio_slope", "ratio_offset", "ratio_low", "ratio_high"))
    shown |= dict.fromkeys(found.unknowns.free, ("error", "std", "ratio"))
    rows = []
    for name, keys in shown.items():
        cells = [f"{k.replace('_', ' ')} {numbers[f'{k}.{name}']:.4g}" for k in keys if f"{k}.{name}" in numbers]
        rows.append((name, *cells, *[""] * (4 - len(cells))))
    title = "unknowns" if found.elsewhere else "unknowns, errors and σ over the largest true value"
    return Table(title, ("unknown", "", "", "", ""), tuple(rows))


def _command_history(time: np.ndarray, loads: Mapping[str, np.ndarray]) -> bytes:
    """loads.csv: what a test rig has to do to the bench, time [s] and every load [N, N m]."""
    lines = [",".join(["time", *loads])]
    for k, instant in enumerate(time):
        lines.append(",".join([f"{instant:.9g}", *(f"{values[k]:.9g}" for values in loads.values())]))
    return ("\n".join(lines) + "\n").encode()


def _said(value: Scalar) -> bool:
    return not isinstance(value, float) or bool(np.isfinite(value))

"""What estimate writes: histories, channels, resultants, virtual gauges, and the same as CSV and table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from strainsight.cases.structure.measured import Measured
from strainsight.cases.structure.surface import Virtual
from strainsight.estimation.model import FilterModel
from strainsight.estimation.smoother import Smoothed
from strainsight.workflow.output import Dataset, Table

if TYPE_CHECKING:
    from strainsight.stages.estimate import Estimated

Values = Mapping[str, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Resultant:
    """The vector sum of the unknown loads at one place: force (T + 1, 3) [N], magnitude and its σ (T + 1,) [N]."""

    names: tuple[str, ...]
    force: np.ndarray
    magnitude: np.ndarray
    std: np.ndarray


def resultants_of(
    loads: Mapping[str, Any], inputs: Sequence[str], model: FilterModel, smoothed: Smoothed
) -> dict[str, Resultant]:
    """Place ("node 2") → resultant, for every place with more than one unknown load.

    F = Σ dᵢ uᵢ over unit directions d;  σ of |F| to first order: e·D P Dᵀ·e with e = F/|F|.
    """
    places: dict[str, list[str]] = {}
    for name in inputs:
        entry = loads[name]
        if entry.direction is not None:
            where = f"node {entry.node}" if entry.node is not None else f"set {entry.set}"
            places.setdefault(where, []).append(name)
    found = {}
    for where, names in places.items():
        if len(names) < 2:
            continue
        index = [list(inputs).index(name) for name in names]
        d = np.array([np.asarray(loads[name].direction, float) for name in names])
        D = (d / np.linalg.norm(d, axis=1)[:, None]).T * model.amplitude[index]
        at = model.position[index]
        force = smoothed.mean[:, 0, at] @ D.T
        magnitude = np.linalg.norm(force, axis=1)
        e = force / np.where(magnitude > 0, magnitude, 1.0)[:, None]
        assert smoothed.covariance is not None
        P = smoothed.covariance[:, 0][:, at[:, None], at]
        along = e @ D
        std = np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", along, P, along), 0.0))
        found[where] = Resultant(tuple(names), force, magnitude, std)
    return found


def estimate_datasets(
    time: np.ndarray,
    names: Sequence[str],
    units: Mapping[str, str],
    estimate: Values,
    smoothed: Values,
    test: Measured,
    found: Estimated,
    resultants: Mapping[str, Resultant],
    virtual: Virtual,
) -> dict[str, Dataset]:
    scales = ("/gauge/time", "/gauge/label")
    record = {
        "/time": Dataset(time, "s", "time of the estimates, on the clock of the file"),
        "/gauge/time": Dataset(test.time[1:], "s", "sampling times of the channels, the first one starts the filter"),
        "/gauge/label": Dataset(np.array(test.labels, dtype=np.str_), "1", "gauge and grid of every channel"),
        "/gauge/channel": Dataset(test.channels, "1", "row of train.h5 of every channel"),
        "/gauge/measured": Dataset(
            test.values, "strain", "calibrated samples, of motion in m/s² or m (time × channel)", scales
        ),
        "/gauge/estimated": Dataset(
            found.run.gauge_mean[test.every - 1 :: test.every, 0], "strain", "their estimate (time × channel)", scales
        ),
        "/gauge/std": Dataset(
            found.run.gauge_std[test.every - 1 :: test.every, 0], "strain", "its claimed σ (time × channel)", scales
        ),
        "/consistency/whitened": Dataset(
            found.run.whitened[test.every - 1 :: test.every, 0],
            "1",
            "innovations over their σ, white if the model is true (time × channel)",
            scales,
        ),
    }
    for name in names:
        for group, what, values in (
            ("estimate", "filtered estimate of", estimate[name][0]),
            ("std", "claimed standard deviation of the filtered", estimate[name][1]),
            ("smoothed", "smoothed estimate of", smoothed[name][0]),
            ("smoothed_std", "claimed standard deviation of the smoothed", smoothed[name][1]),
        ):
            record[f"/{group}/{name}"] = Dataset(values, units[name], f"{what} {name}", ("/time",))
    biased = np.flatnonzero(test.bias > 0)
    if len(biased):
        n = found.model.size
        record["/bias/channel"] = Dataset(biased, "1", "channels with an unknown offset")
        record["/bias/mean"] = Dataset(
            found.smoothed.mean[-1, 0, n:], "strain", "their offsets, of motion in m/s² or m"
        )
        record["/bias/std"] = Dataset(found.smoothed.std[-1, 0, n:], "strain", "claimed σ of these")
    for i, resultant in enumerate(resultants.values()):
        record[f"/resultant/{i}/force"] = Dataset(
            resultant.force, "N", "sum of the loads there (time × xyz)", ("/time", "")
        )
        record[f"/resultant/{i}/magnitude"] = Dataset(resultant.magnitude, "N", "its size", ("/time",))
        record[f"/resultant/{i}/std"] = Dataset(resultant.std, "N", "claimed σ of its size", ("/time",))
    if len(virtual.labels):
        record["/virtual/strain"] = Dataset(
            virtual.mean, "strain", "smoothed strain where no gauge is (time × grid)", ("/time", "")
        )
        record["/virtual/std"] = Dataset(virtual.std, "strain", "its claimed σ (time × grid)", ("/time", ""))
        record["/virtual/position"] = Dataset(virtual.position, "m", "where (grid × xyz)")
        record["/virtual/direction"] = Dataset(virtual.direction, "1", "along what (grid × xyz)")
    return record


def csv_of(
    time: np.ndarray,
    names: Sequence[str],
    units: Mapping[str, str],
    estimate: Values,
    smoothed: Values,
    virtual: Virtual,
    resultants: Mapping[str, Resultant],
) -> bytes:
    """All time signals as a table, SI units in the header."""
    head, columns = ["time [s]"], [time]
    for name in names:
        for word, values in (
            ("filtered", estimate[name][0]),
            ("filtered std", estimate[name][1]),
            ("smoothed", smoothed[name][0]),
            ("smoothed std", smoothed[name][1]),
        ):
            head.append(f"{name} {word} [{units[name]}]")
            columns.append(values)
    for where, resultant in resultants.items():
        head += [f"{where} {axis} [N]" for axis in "xyz"] + [f"{where} size [N]", f"{where} size std [N]"]
        columns += [*resultant.force.T, resultant.magnitude, resultant.std]
    for i, label in enumerate(virtual.labels):
        head += [f"{label} [strain]", f"{label} std [strain]"]
        columns += [virtual.mean[:, i], virtual.std[:, i]]
    lines = [",".join(head), *(",".join(f"{x:.9g}" for x in row) for row in np.column_stack(columns))]
    return ("\n".join(lines) + "\n").encode()


def estimate_table(names: Sequence[str], units: Mapping[str, str], smoothed: Values, inputs: Sequence[str]) -> Table:
    rows = []
    for name in names:
        value, std = smoothed[name]
        if name in inputs:
            rows.append(
                (
                    name,
                    f"RMS {np.sqrt(np.mean(value**2)):.5g}, {value.min():.5g} to {value.max():.5g} {units[name]}",
                    f"± {np.sqrt(np.mean(std**2)):.3g} {units[name]}",
                )
            )
        else:
            rows.append(
                (name, f"{value[-1]:.5g} {units[name]}", f"± {std[-1]:.3g} ({100 * std[-1] / value[-1]:.2g} %)")
            )
    return Table("estimates, smoothed", ("unknown", "estimate", "claimed σ"), tuple(rows))

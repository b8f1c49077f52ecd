"""Artefacts of benches made by hand: what simulate and estimate would write, with numbers that a test can tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.workflow.artefact import Artefact, Header
from strainsight.workflow.output import Dataset, Output, Table
from strainsight.workflow.store import write_artefact

STEPS = 60


def written(folder: Path, stage: str, datasets, summary, tables=()) -> Artefact:
    header = Header(stage, 1, f"key-{folder.name}-{stage}", {}, {}, {})
    return write_artefact(folder / f"{stage}.h5", Output(datasets, summary, stage, tables=tables), header)


def simulated(folder: Path) -> Artefact:
    """A blade on a bearing that one force pulls."""
    time = np.linspace(0.0, 3.0, STEPS + 1)
    load = 5e4 * np.sin(2 * time)
    five = np.outer(load, [1e-10, 2e-9, 3e-9, 4e-9, 5e-9])
    datasets = {
        "/time": Dataset(time, "s", "time"),
        "/inputs/Fz": Dataset(load, "N", "load Fz", ("/time",)),
        "/sensors/relative": Dataset(five, "m or rad", "displacements", ("/time", "")),
        "/sensors/tip": Dataset(five[:, :3], "m", "position", ("/time", "")),
        "/bearings/pitch/displacement": Dataset(five, "m or rad", "displacement", ("/time", "")),
        "/bearings/pitch/load": Dataset(1e9 * five, "N or N m", "load", ("/time", "")),
        "/bearings/pitch/pressure": Dataset(1e9 + np.abs(load) * 1e4, "Pa", "pressure", ("/time",)),
    }
    summary = {"steps": STEPS, "coordinates": 28, "constraints": 7, "violation": 2e-16, "first_frequency": 4.2}
    return written(folder, "simulate", datasets, summary)


def estimated(folder: Path, error=0.01, there=None, truth=True, parameter=True, lost=0, seed=0) -> Artefact:
    """A force and a ball diameter, off by `error` of the largest force; there: the factor on another bench's load."""
    time = np.linspace(0.0, 3.0, STEPS + 1)
    true = 5e4 * np.sin(2 * time)
    wrong = 5e4 * error * np.random.default_rng(seed).standard_normal(len(time))
    one = np.full(len(time), 5e4 * max(error, 1e-12))
    datasets = {
        "/time": Dataset(time, "s", "time"),
        "/inputs/Fz/estimate": Dataset(true + wrong, "N", "estimate", ("/time",)),
        "/inputs/Fz/std": Dataset(one, "N", "σ", ("/time",)),
        "/nis": Dataset(1 + 0.3 * np.cos(9 * time[1:]), "1", "NIS over channels"),
        "/violation": Dataset(np.full(len(time), 1e-16), "1", "violation", ("/time",)),
    }
    summary = {"channels": 9, "unknowns": 2, "nis": 1.0, "expected_nis": 8 / 9, "violation": 1e-16, "lost": lost,
               "method": "iterated <with the step>", "truth": "own step", "std.Fz": error}  # fmt: skip
    if truth:
        datasets["/inputs/Fz/true"] = Dataset(true, "N", "truth", ("/time",))
        summary |= {"error.Fz": error, "slope.Fz": 1.001, "offset.Fz": 12.5, "largest_error.Fz": 3 * error}
    if there is not None:
        datasets["/inputs/Fz/there"] = Dataset(true / there, "N", "load there", ("/time",))
        summary |= {"ratio_slope.Fz": there, "ratio_offset.Fz": 3.0, "ratio_mean.Fz": there}
        summary |= {"ratio_low.Fz": 0.9 * there, "ratio_high.Fz": 1.1 * there}
    if parameter:
        diameter = 0.06 * (1 + 0.01 * np.exp(-5 * time) + error * 1e-3)
        datasets |= {
            "/parameters/ball/estimate": Dataset(diameter, "m", "estimate", ("/time",)),
            "/parameters/ball/std": Dataset(6e-4 * np.exp(-5 * time) + 1e-8, "m", "σ", ("/time",)),
            "/parameters/ball/true": Dataset(np.array(0.06), "m", "truth"),
            "/runs/parameters/ball/estimate": Dataset(0.06 + 1e-7 * np.array([1.0, -2.0, 1.5]), "m", "at the end"),
            "/runs/parameters/ball/std": Dataset(np.full(3, 1.2e-7), "m", "σ"),
            "/runs/parameters/ball/start": Dataset(np.array([0.0606, 0.0594, 0.06]), "m", "start"),
        }
        summary |= {"error.ball": 1e-6, "std.ball": 2e-6, "ratio.ball": 1.1, "identified.ball": True}
    for name, unit, width in (("relative", "m or rad", 5), ("gauges", "strain", 4)):
        scale = 1e-10 if unit == "strain" else 1e-9
        measured = np.outer(true[1:], scale * np.arange(1, width + 1))
        expected = measured + scale * wrong[1:, None]
        datasets |= {
            f"/sensors/{name}/measured": Dataset(measured, unit, "measured"),
            f"/sensors/{name}/expected": Dataset(expected, unit, "expected"),
            f"/sensors/{name}/used": Dataset(np.array(name == "gauges"), "1", "used"),
        }
        summary |= {f"mismatch.{name}": error} | {f"mismatch.{name}.{i}": error for i in range(1, width + 1)}
    warnings = Table("warnings", ("",), (("a noise of 0 is <floored>",),))
    return written(folder, "estimate", datasets, summary, (warnings,))


def placed(folder: Path) -> Artefact:
    """Four gauges of a pool of twelve, and two layouts at random."""
    datasets = {
        "/inputs": Dataset(np.array(["Fz"]), "1", "inputs"),
        "/pool/candidate": Dataset(np.arange(12), "1", "pool"),
        "/elimination/trace": Dataset(np.linspace(1.0, 2.0, 9), "1", "tr(W P)"),
    }
    for layout, std in (("place", 100.0), ("random-1", 900.0), ("random-2", np.inf)):
        datasets |= {
            f"/layouts/{layout}/position": Dataset(np.arange(12.0).reshape(4, 3), "m", "position"),
            f"/layouts/{layout}/direction": Dataset(np.tile([0.0, 0.6, -0.8], (4, 1)), "1", "direction"),
            f"/layouts/{layout}/std": Dataset(np.array([std]), "N or N m", "σ", ("/inputs",)),
        }
    return written(
        folder, "place", datasets, {"candidates": 500, "pool": 12, "selected": 4, "gap": 0.01, "std.Fz": 100.0}
    )

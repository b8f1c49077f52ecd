"""python -m tests.runner.numbers: write what every stage makes of a small beam and a small bench, with its version, to
numbers.json, once a version was raised."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, bricks, finished

KEPT = Path(__file__).parent / "numbers.json"
RUNS: dict[str, tuple[Any, str]] = {"placement": (PLACEMENT_CONFIG, "validate"), "bench": (BENCH_CONFIG, "estimate")}
"""Config, and the last stage whose numbers are kept; pages have no numbers of their own."""
GOLDEN = (np.sqrt(5) - 1) / 2
UNKNOWN = 1e15
"""A condition number beyond is rounding alone."""
AGREES, ROUNDING = 1e-5, 1e-10
"""Relative difference up to which machines agree (docs/trust.md has 1e-7 of the largest number), and what is rounding alone."""


def numbers_of(folder: Path) -> dict[str, dict[str, Any]]:
    """ "run/stage" → version, and dataset → its `size`; of names, whole numbers and flags too where they are numbers."""
    found: dict[str, dict[str, Any]] = {}
    for name, (base, until) in RUNS.items():
        for stage, artefact in finished(folder / name, until, bricks((5, 2, 2), "hex8"), base=base).items():
            own = {path: artefact[path] for path in artefact.paths() if not path.startswith("/VTKHDF")}
            found[f"{name}/{stage}"] = {
                "version": artefact.header.version,
                "numbers": {
                    path: size(np.where(array > UNKNOWN, np.inf, array) if "condition" in path else array)
                    for path, array in own.items()
                    if array.dtype.kind in "fiub"
                },
            }
    return found


def size(array: np.ndarray) -> list[float]:
    """How many numbers, the root r of their mean square, and  Σ_k w_k x_k / (r √n),  w_k = 2 frac(kφ) − 1,  which signs and order
    move and rounding does not; x_k = 0 of what is not finite.

    No dataset is left out of it: signs of mode shapes are fixed (`fem.modes.signs`), and the modes of these beams lie apart.
    """
    x = np.nan_to_num(np.asarray(array, dtype=float).ravel(), nan=0.0, posinf=0.0, neginf=0.0)
    finite = int(np.isfinite(np.asarray(array, dtype=float)).sum())
    root = np.sqrt(np.sum(x**2) / max(finite, 1))
    weight = 2 * np.modf(np.arange(1, x.size + 1) * GOLDEN)[0] - 1
    along = weight @ x / (root * np.sqrt(x.size)) if root > 0 else 0.0
    return [array.size, float(f"{root:.9g}"), float(f"{along:.9g}")]


def differs(one: list[float], other: list[float]) -> bool:
    if one[0] != other[0] or abs(one[1] - other[1]) > AGREES * abs(other[1]) + ROUNDING:
        return True
    return abs(other[1]) > ROUNDING and abs(one[2] - other[2]) > AGREES


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        found = numbers_of(Path(folder))
    lines = [f"{json.dumps(stage)}: {json.dumps(own, sort_keys=True)}" for stage, own in found.items()]
    KEPT.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

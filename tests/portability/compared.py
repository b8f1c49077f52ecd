"""How far two runs of the same configs are apart: their artefacts, dataset by dataset."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from strainsight.runner.artefact import Artefact

SAME = 1e-7
"""What an array may differ by, of its largest number."""
ITSELF = {
    ("rom", "/error/frequency"): 1e-9,  # a reduced model against its own full one: 1e-11 of it, all rounding
    ("rom", "/error/static"): 1e-9,
    ("rom", "projection_error"): 1e-9,
    ("place", "/riccati/residual"): 1e-13,  # of an equation that is solved to rounding
    ("place", "riccati_residual"): 1e-13,
    ("place", "/certificate/gap"): 1e-7,  # a share of the metric, of an optimal layout the rounding of the bound
    ("place", "gap"): 1e-7,
}
"""Numbers that are rounding, or differences of others: held to so much as they stand."""
ERRORS = 1e-9
"""So are errors of `validate`, shares of the truth or of its RMS: the estimate agrees to that, the small difference does not."""
COORDINATES = ("/augmented/F", "/augmented/Q", "/augmented/H")
"""Of a placement in coordinates of unit covariance, where a mode that next to nothing moves is blown up by as much as it is
not known: F and Q differ there by up to 2e-4. They are compared in x*, which has its units from the model."""
SINGULAR = 1 / np.finfo(float).eps
"""A condition beyond this is that of a matrix that double precision cannot tell from a singular one; that of the thesis's
matrix of unlike units, `condition_raw`, is compared where it is less."""


def layouts_apart(one: Path, other: Path) -> dict[str, str]:
    """Everything that is chosen, counted or said in words and is not the same: every dataset that holds no real numbers."""
    found = {}
    for name, a, b in _pairs(one, other):
        if a.paths() != b.paths():
            found[name] = f"datasets {set(a.paths()) ^ set(b.paths())}"
        for path in set(a.paths()) & set(b.paths()):
            x, y = a[path], b[path]
            if x.shape != y.shape or (x.dtype.kind != "f" and not np.array_equal(x, y)):
                found[f"{name}:{path}"] = f"{x} {y}"
        for key, value in a.summary.items():
            if not isinstance(value, float) and value != b.summary[key]:
                found[f"{name}:{key}"] = f"{value} {b.summary[key]}"
    return found


def numbers_apart(one: Path, other: Path) -> dict[str, float]:
    """Every array and every number of a summary: how far apart, as a share of what it may be (1: as far as allowed)."""
    found = {}
    for name, a, b in _pairs(one, other):
        stage = name.split("/")[1]
        x, y = _numbers(a), _numbers(b)
        for path in x.keys() & y.keys():
            error = stage == "validate" and re.search(r"/error/|^(error|smoothed)\.", path)
            allowed = ERRORS if error else ITSELF.get((stage, path))
            found[f"{name}:{path}"] = apart(x[path], y[path], allowed) / (SAME if allowed is None else allowed)
    return found


def apart(x: np.ndarray, y: np.ndarray, absolute: float | None = None) -> float:
    """max |x − y|, over the largest |x| unless it is to be taken as it stands; inf where others are finite."""
    if x.shape != y.shape or not np.array_equal(np.isfinite(x), np.isfinite(y)):
        return np.inf
    there = np.isfinite(x)
    scale = 1.0 if absolute is not None else float(np.abs(x[there]).max(initial=0.0)) or 1.0
    return float(np.abs(x[there] - y[there]).max(initial=0.0)) / scale


def _numbers(artefact: Artefact) -> dict[str, np.ndarray]:
    """Real datasets and numbers of the summary, those in coordinates that are free in those of the model."""
    found = {path: artefact[path] for path in artefact.paths() if artefact[path].dtype.kind == "f"}
    found |= {key: np.array(value) for key, value in artefact.summary.items() if isinstance(value, float)}
    if "/augmented/scale" in found:
        scale = found["/augmented/scale"]
        F, Q, H = (found[path] for path in COORDINATES)
        turned = (scale[:, :, None] * F / scale[:, None], scale[:, :, None] * Q * scale[:, None], H / scale[:, None])
        found |= dict(zip(COORDINATES, turned, strict=True))
    if "/condition_raw" in found:
        found["/condition_raw"] = np.where(found["/condition_raw"] < SINGULAR, found["/condition_raw"], np.inf)
    return found


def _pairs(one: Path, other: Path) -> Iterator[tuple[str, Artefact, Artefact]]:
    names = sorted(str(path.relative_to(one)) for path in one.glob("*/*.h5"))
    assert names == sorted(str(path.relative_to(other)) for path in other.glob("*/*.h5")) != []
    for name in names:
        yield name.removesuffix(".h5"), Artefact(one / name), Artefact(other / name)


def digests(results: Path) -> Mapping[str, str]:
    """artefact → sha256 of what it holds."""
    return {str(path.relative_to(results)): Artefact(path).digest for path in sorted(results.glob("*/*.h5"))}

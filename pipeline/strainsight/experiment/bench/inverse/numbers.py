"""How good an estimate is: loads against true ones, parameters, sensors, one bench's loads over another's."""

from __future__ import annotations

import numpy as np

Numbers = dict[str, float | bool]
"""Of a summary, by name."""
NONE = 1e-9
"""Share of σ below which the true load is none at all."""
SETTLING = 0.1
"""Share of the record, from its start, that fits and quotients leave out: there the first guess is forgotten."""
RELATIVE = 5
"""Components of a relative motion."""
STILL = 0.01
"""Share of the largest component of its unit below which one hardly moves."""
LARGE = 0.3
"""Share of its largest value above which a load is divided by another: near zero a quotient says nothing."""


def load_numbers(name: str, true: np.ndarray, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """slope and offset [N, N m] of the fit estimate = slope · true + offset, settled; the rms error and the mean σ over the
    second half, and the largest error, over the largest |true|. true, estimate, std (T,) after the start."""
    slope, offset = _fit(*_settled(true, estimate))
    largest = float(np.abs(true).max())
    off = estimate - true
    fit: Numbers = {f"slope.{name}": slope, f"offset.{name}": offset}
    if largest <= NONE * float(std.max()):
        return fit  # errors of a load that is none are no share of it
    return fit | {
        f"error.{name}": float(np.sqrt(np.mean(off[len(off) // 2 :] ** 2))) / largest,
        f"largest_error.{name}": float(np.abs(off).max()) / largest,
        f"std.{name}": float(std[len(std) // 2 :].mean()) / largest,
    }


def smoothed_name(name: str) -> str:
    """What a load is called in claims once it is smoothed."""
    return f"smoothed.{name}"


def smoothed_numbers(name: str, true: np.ndarray, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """The rms error and the mean σ of a smoothed load over the second half, over the largest |true|: the same as of the filter's
    estimate. true, estimate, std (T,) after the start."""
    found = load_numbers(name, true, estimate, std)
    return {f"smoothed_{key}.{name}": found[f"{key}.{name}"] for key in ("error", "std") if f"{key}.{name}" in found}


def history_numbers(name: str, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """Of a load that nobody knows: RMS and largest size of its estimate, and RMS of σ [N, N m], settled. (T,) each."""
    estimate, std = _settled(estimate, std)
    return {
        f"rms.{name}": float(np.sqrt(np.mean(estimate**2))),
        f"largest.{name}": float(np.abs(estimate).max()),
        f"rms_std.{name}": float(np.sqrt(np.mean(std**2))),
    }


def ratio_numbers(name: str, there: np.ndarray, estimate: np.ndarray) -> Numbers:
    """A load here over the one of the other bench: RMS over RMS, second half; settled, an affine fit, and the quotient where the
    other is large. (T,) each."""
    here, other = (float(np.linalg.norm(load[len(load) // 2 :])) for load in (estimate, there))
    there, estimate = _settled(there, estimate)
    slope, offset = _fit(there, estimate)
    large = np.abs(there) > LARGE * np.abs(there).max(initial=0.0)
    quotient = estimate[large] / there[large] if large.any() else np.array([np.nan])
    return {
        f"ratio_slope.{name}": slope,
        f"ratio_offset.{name}": offset,
        f"ratio_rms.{name}": here / other if other > 0 else float("nan"),
        f"ratio_mean.{name}": float(quotient.mean()),
        f"ratio_low.{name}": float(quotient.min()),
        f"ratio_high.{name}": float(quotient.max()),
    }


def parameter_numbers(name: str, true: np.ndarray, last: np.ndarray, std: np.ndarray) -> Numbers:
    """Error and σ at the end of the first run, relative to the truth; rms of error/σ over all runs.

    true, last, std (runs,)."""
    size = abs(float(true[0]))
    size = size if size > 0 else 1.0
    numbers: Numbers = {
        f"error.{name}": abs(float(last[0] - true[0])) / size,
        f"std.{name}": float(std[0]) / size,
    }
    if len(last) > 1:
        numbers[f"ratio.{name}"] = float(np.sqrt(np.mean(((last - true) / std) ** 2)))
        numbers[f"largest_error.{name}"] = float(np.abs(last - true).max()) / size
    return numbers


def mismatch_numbers(name: str, measured: np.ndarray, expected: np.ndarray) -> Numbers:
    """rms of measured − expected over that of measured, of every component (T, components) and of the worst; a component that
    hardly moves counts beside the largest of its unit (of a pair of metres and radians: x, y, z, then tilts)."""
    there = np.isfinite(measured)
    if not there.any():
        return {}
    count = np.maximum(there.sum(axis=0), 1)
    off, whole = (
        np.sqrt(np.sum(np.where(there, x, 0.0) ** 2, axis=0) / count) for x in (measured - expected, measured)
    )
    off[~there.any(axis=0)] = np.nan
    for kind in (slice(3), slice(3, None)) if whole.size == RELATIVE else (slice(None),):
        whole[kind] = np.where(whole[kind] < STILL * whole[kind].max(), whole[kind].max(), whole[kind])
    share = np.divide(off, whole, out=np.full_like(off, np.nan), where=whole > 0)
    if not np.isfinite(share).any():
        return {}
    numbers: Numbers = {f"mismatch.{name}": float(np.nanmax(share))}
    if len(share) > 1:
        numbers |= {
            f"mismatch.{name}.{i}": float(value) for i, value in enumerate(share, start=1) if np.isfinite(value)
        }
    return numbers


def size_numbers(name: str, there: np.ndarray, expected: np.ndarray) -> Numbers:
    """rms of what each component of a sensor reads here over that of what it reads on the other bench (T, components)."""
    found = np.isfinite(there) & np.isfinite(expected)
    here, other = (np.sqrt(np.sum(np.where(found, x, 0.0) ** 2, axis=0)) for x in (expected, there))
    share = np.divide(here, other, out=np.full_like(here, np.nan), where=other > 0)
    return {f"size.{name}.{i}": float(value) for i, value in enumerate(share, start=1) if np.isfinite(value)}


def _settled(*histories: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(history[int(SETTLING * len(history)) :] for history in histories)


def _fit(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """slope, offset of y over x; a constant x has the slope of their means and no offset."""
    size = float(np.abs(x).max(initial=0.0)) or 1.0  # of a load of 1e-200 N the square is none
    x = x / size
    spread = x - x.mean()
    if not np.any(np.abs(spread) > 1e-9):
        return (float(y.mean() / x.mean() / size) if x.mean() else float("nan")), 0.0
    slope = float(spread @ y / (spread @ spread))
    return slope / size, float(y.mean() - slope * x.mean())

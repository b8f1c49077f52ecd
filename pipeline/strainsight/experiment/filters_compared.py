"""Comparison of approximate filters with the parameter grid filter on the same samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.estimation.decision import DIVERGED, OVERCONFIDENT, classify_ratio, expected_ratio
from strainsight.records.estimated import GRID_FILTER, Compared
from strainsight.runner.output import Scalar, Table

COMPARED = "comparison of filters (in brackets: error expected by the grid filter divided by the claimed σ)"
WITHOUT_TOLERANCES = COMPARED.replace("filters", "filters without tolerances")
"""Titles of the table."""


def filters_compared(
    filters: tuple[str, ...], names: Sequence[str], ends: np.ndarray, value: np.ndarray, std: np.ndarray
) -> Compared:
    """Compare parameters (k,) from filters (f,) with the first, exact filter by `expected_ratio`.

    ends (f, 2, k): final mean and σ in Gaussian coordinates; value, std (f, k) [SI]. NaN for a filter that diverged."""
    return Compared(
        filter=filters,
        estimate=dict(zip(names, value.T, strict=True)),
        std=dict(zip(names, std.T, strict=True)),
        ratio={
            name: np.array([expected_ratio(*end[:, i], *ends[0, :, i]) for end in ends]) for i, name in enumerate(names)
        },
    )


def _posterior(filters: Compared) -> bool:
    """Whether the grid filter has a finite posterior."""
    return all(np.isfinite(filters.estimate[name][filters.filter.index(GRID_FILTER)]) for name in filters.estimate)


def disagreements_in_words(filters: Compared | None) -> list[str]:
    """Warning, without a full stop, for every overconfident or diverged filter."""
    if filters is None:
        return []
    if not _posterior(filters):
        return ["filters are not compared: without tolerances no parameter values are consistent with the readings"]
    words = []
    for name, ratios_of in filters.ratio.items():
        for filter_, ratio in zip(filters.filter, map(float, ratios_of), strict=True):
            result = classify_ratio(ratio) if filter_ != GRID_FILTER else ""
            if result == OVERCONFIDENT:
                expected = f"the grid filter expects an error of {ratio:.2g} times the σ of the {filter_} filter"
                words.append(f"the {filter_} filter is overconfident about {name}: {expected}")
            elif result == DIVERGED:
                words.append(f"the {filter_} filter diverged and provides no estimate of {name}")
    return words


def ratios(filters: Compared | None) -> dict[str, Scalar]:
    """Numbers by name: "ratio.extended.E"."""
    if filters is None or not _posterior(filters):
        return {}
    return {
        f"ratio.{filter_}.{name}": float(value)
        for name, ratio in filters.ratio.items()
        for filter_, value in zip(filters.filter, ratio, strict=True)
        if filter_ != GRID_FILTER
    }


def comparison_table(filters: Compared, units: Mapping[str, str], title: str = WITHOUT_TOLERANCES) -> Table:
    """Table of value ± σ of every parameter by every filter, with the check of the approximate filters."""
    rows, exact = [], _posterior(filters)
    for name, estimate in filters.estimate.items():
        std, ratio = filters.std[name], filters.ratio[name]
        cells = [name]
        for i, filter_ in enumerate(filters.filter):
            value, size = f"{estimate[i]:.5g}", _spread(float(std[i]), float(estimate[i]))
            if filter_ == GRID_FILTER:
                cells.append(f"{value} {units[name]} {size}" if exact else "no posterior")
            elif not exact:
                cells.append(f"{value} {units[name]} {size}" if np.isfinite(estimate[i]) else DIVERGED)
            else:
                claim = f"{value} {size}, {classify_ratio(float(ratio[i]))} ({ratio[i]:.2g})"
                cells.append(claim if np.isfinite(ratio[i]) else DIVERGED)
        rows.append(tuple(cells))
    return Table(title, ("parameter", *filters.filter), tuple(rows))


def _spread(std: float, estimate: float) -> str:
    """σ relative to the value, absolute if the value is zero."""
    return f"± {100 * std / abs(estimate):.2g} %" if estimate else f"± {std:.2g}"

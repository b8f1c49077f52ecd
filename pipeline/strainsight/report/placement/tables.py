"""Tables of one report: the layout beside those of other rules, and what could be distinguished."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

from strainsight.report.page.markup import measure, plain, share, table
from strainsight.report.placement.data import Case, Criteria, Metric, PlacementReport, Trend

STEADY = (
    "one standard deviation of an unknown with the system held at an instant: it ranks layouts, a filter claims its own"
)


def criteria_table(
    trend: Trend, metrics: Sequence[Metric], criteria: Sequence[Criteria], unit: Mapping[str, str]
) -> str:
    """Layouts by rule, the chosen one and its bound first, the others by their metric.

    metrics: every one, that of the layout first; criteria: layouts, the chosen one first; unit: of every unknown."""
    chosen = criteria[0].chosen if criteria else trend.final
    scale = chosen if 0 < chosen < math.inf else math.nan
    names = [name for name in unit if any(name in entry.std for entry in criteria)]
    full = bool(criteria)
    others = metrics[1:] if full else ()

    def row(title: str, value: float, entry: Criteria | None) -> list[str]:
        cells = [title, plain(value), plain(value / scale)]
        if entry is None:
            return cells + ["–"] * (len(others) + len(names))
        cells += map(plain, entry.values[1:])
        return cells + [_sigma(entry.std.get(name), unit[name]) for name in names]

    rule = f" ({escape(criteria[0].rule)})" if full else ""
    rows = [row(f"<strong>chosen set</strong>{rule}", chosen, criteria[0] if full else None)]
    if trend.lower_bound is not None:
        rows.append(row("certified lower bound", trend.lower_bound, None))
    rules = sorted(criteria[1:], key=lambda entry: (math.isnan(entry.chosen), entry.chosen))
    rows += [row(escape(entry.rule), entry.chosen, entry) for entry in rules]
    head = ["layout by", escape(trend.metric.symbol), "times the chosen", *(escape(m.symbol) for m in others)]
    head += [f"steady-state σ({escape(name)})" for name in names]
    caption = "Layouts of the same size from the same pool"
    caption += ", all scored by the same covariance" if full else ""
    caption += (
        ". The other rules know no limits of the layout, such as a budget, spacing or zones: "
        "what they choose may not be allowed."
        if rules
        else "."
    )
    if any(math.isinf(value) for entry in criteria for value in (*entry.values, *entry.std.values())):
        caption += " ∞: that layout cannot observe all unknowns."
    return table("layouts by rule", head, rows, caption=caption, numeric=range(1, len(head)))


def criteria_meaning(metrics: Sequence[Metric]) -> str:
    """What the columns of the criteria mean, as a list."""
    words = [
        (metric.symbol, metric.meaning + "; what this placement makes small" * (i == 0))
        for i, metric in enumerate(metrics)
    ]
    items = "".join(
        f"<li><strong>{escape(name)}</strong>: {escape(text)}.</li>"
        for name, text in [*words, ("steady-state σ", STEADY)]
    )
    return f"<h3>Criteria, smaller is better in all</h3><ul>{items}</ul>"


def load_cases_table(report: PlacementReport) -> str:
    """Load cases one a row: weight, metric, expected σ of every unknown; "" without load cases."""
    own, names = report.load_cases, list(report.units)
    if own is None:
        return ""
    rows = [
        [
            escape(case),
            plain(float(own.weight[i])),
            plain(float(own.metric[i])),
            *(share(float(own.std[name][i])) if own.acts[name][i] else "silent" for name in names),
        ]
        for i, case in enumerate(own.name)
    ]
    expected = [f"expected σ({escape(name)})" for name in names]
    head = ["load case", "weight", escape(report.trend.metric.symbol), *expected]
    caption = (
        "The layout serves all of them, each by its weight. σ along the training of the case, relative to the amplitude there; "
        "the metric is that of the case alone."
    )
    return table("load cases", head, rows, caption=caption, numeric=range(1, len(head)))


def cases_table(cases: Sequence[Case]) -> str:
    """Sets of unknowns one a row, excitations side by side: condition numbers and what is lost."""
    excitations = list(dict.fromkeys(case.excitation for case in cases))
    grid: dict[tuple[str, ...], dict[str, Case]] = {}
    for case in cases:
        grid.setdefault(case.unknowns, {})[case.excitation] = case

    def row(unknowns: tuple[str, ...], found: dict[str, Case]) -> list[str]:
        cells = [escape(", ".join(unknowns)) or "none"]
        for excitation in excitations:
            case = found.get(excitation)
            cells.append("–" if case is None else plain(case.condition, 3))
        return [*cells, _lost(found, len(excitations))]

    head = ["unknown together", *map(escape, excitations)]
    caption = (
        "Condition number of the Popov-Belevitch-Hautus matrix at λ = 0, the larger the harder to distinguish. "
        "States are scaled by their sizes in the training run, so that rows can be compared at the same excitation."
    )
    rows = [row(unknowns, found) for unknowns, found in grid.items()]
    return table("sets of unknowns", [*head, "what is lost"], rows, caption=caption, numeric=range(1, len(head)))


def _sigma(value: float | None, unit: str) -> str:
    """σ in the unknown's unit, or in words that there is none."""
    if value is None or math.isnan(value):
        return "–"
    return '<data value="inf">cannot observe</data>' if math.isinf(value) else measure(value, unit, 3)


def _lost(found: dict[str, Case], excitations: int) -> str:
    """What is lost, once where it is the same at every excitation."""
    text = [(case.excitation, case.lost) for case in found.values() if case.lost]
    if len(text) == excitations and len({lost for _, lost in text}) == 1:
        return escape(text[0][1])
    return "<br>".join(f"{escape(excitation)}: {escape(lost)}" for excitation, lost in text)

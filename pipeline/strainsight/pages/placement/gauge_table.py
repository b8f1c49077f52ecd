"""Tables of a placement: the chosen gauges, the layout beside those of other rules, load cases, and what can be distinguished."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from strainsight.pages.page.markup import axes, badge, data, decimals, items, measure, plain, share, table
from strainsight.pages.picture.layout import Gauge
from strainsight.pages.placement.data import Criteria, MetricWords, ObservabilityCase, PlacementReport, Trend
from strainsight.positions import PositionAxes
from strainsight.text import number, percent, reading_unit

SINGLE = frozenset({"strain gauge", "rosette", "bridge"})
"""Kinds that people call gauges; with others among them they are sensors."""


EDGES = (
    "Nearest edges: distance to the nearest edge of the face, and the angle from it to the measuring direction, "
    "counter-clockwise as seen from outside; below, the same of the nearest edge that runs across it."
)
BONDED = (
    "Where it is bonded: how much the strain changes over σ of the gauge's place and from end to end of its grid, over its RMS "
    "in training, and how much room there is over it, where that is beyond the limit."
)
REFINED = (
    "On a finer mesh: the change of the strain at the gauge, over its RMS in training, when the elements around it are cut in "
    "half twice. A hot spot changes by more than its share: a corner, the end of a support, a load at a node."
)
UNOBSERVABLE = "∞: without that gauge the unknown can no longer be observed."


def gauge_table(report: PlacementReport) -> str:
    """All gauges, one a row, in a table of where they are and one of what they read and are worth; columns that would be empty
    are left out."""
    return _where(report) + _worth(report)


def _where(report: PlacementReport) -> str:
    gauges, frame = report.layout.gauges, report.layout.frame
    places = decimals(report.layout.points, frame)
    edged = any(len(gauge.edges) for gauge in gauges)
    noted = any(gauge.notes for gauge in gauges)
    rows = [
        [
            badge(gauge.label, index, hollow=gauge.bonded),
            _kind(gauge),
            *map(
                "<br>".join,
                zip(*(axes(x, places, frame) for x, _, _ in gauge.grids[: len(gauge.arms) or 1]), strict=True),
            ),
            "<br>".join(
                _whole(" ".join(data(x, number(round(x, 4), 4)) for x in frame.turn(vector).tolist()))
                for _, vector, _ in gauge.grids
            ),
            *_edges(gauge, frame) * edged,
            *["<br>".join(map(escape, gauge.notes.split("; "))) or "–"] * noted,
        ]
        for index, gauge in enumerate(gauges)
    ]
    head = ["gauge", "kind", *frame.heads, "direction"]
    head += [f"nearest edges [{frame.unit}]", "angle to them"] * edged
    numeric = [2, 3, 4, *range(6, len(head))]
    head += ["where it is bonded"] * noted
    return table("gauges", head, rows, caption=_caption(gauges, frame), numeric=numeric)


def _worth(report: PlacementReport) -> str:
    gauges, names = report.layout.gauges, names_without(report)
    read = any(gauge.peak is not None for gauge in gauges)
    tested = any(gauge.refined is not None for gauge in gauges)
    rows = [
        [
            badge(gauge.label, index, hollow=gauge.bonded),
            *_ids(gauge),
            *[_reading(gauge)] * read,
            *[_changed(gauge)] * tested,
            *(share(gauge.without.get(name, math.nan)) for name in names),
        ]
        for index, gauge in enumerate(gauges)
    ]
    head = ["gauge", "number" if given(gauges) else "element", "facet", "angle"]
    head += ["training peak"] * read + ["strain on a finer mesh"] * tested
    foot = (
        ["all together", *[""] * (len(head) - 1), *expected] if (expected := expected_with_all(report, names)) else []
    )
    head += [f"expected σ({escape(name)}) without it" for name in names]
    caption = _caption_of_worth(gauges)
    return table("gauges: readings", head, rows, caption=caption, numeric=range(1, len(head)), foot=foot)


def names_without(report: PlacementReport) -> list[str]:
    """The unknowns of which it is known what they would be without a gauge."""
    return [u.name for u in report.unknowns if any(u.name in gauge.without for gauge in report.layout.gauges)]


def expected_with_all(report: PlacementReport, names: Sequence[str]) -> list[str]:
    """Cells with the expected σ of these unknowns with all gauges, none where it is not known."""
    sigma = {unknown.name: unknown.expected_std for unknown in report.unknowns}
    return [share(sigma[name]) for name in names] if any(sigma[name] is not None for name in names) else []


def given(gauges: tuple[Gauge, ...]) -> bool:
    """Whether they were given by their strain rows: they lie on no facet, and have a number where others have an element."""
    return not any(gauge.facet for gauge in gauges)


def _caption(gauges: tuple[Gauge, ...], frame: PositionAxes) -> str:
    """What the columns of places mean, as far as they occur."""
    several = any(len(gauge.channels) > 1 for gauge in gauges)
    below = "; a rosette's or triaxial sensor's further directions stand below" * several
    sentences = {
        f"Places and measuring directions are in {frame.in_words()}{below}.": True,
        "The arms of a bridge stand below one another, in the order of the signs beside its kind.": any(
            gauge.arms for gauge in gauges
        ),
        EDGES: any(len(gauge.edges) for gauge in gauges),
        "A gauge and its mirror image were placed as one.": any(gauge.mirror for gauge in gauges),
        BONDED: any(gauge.notes for gauge in gauges),
    }
    return " ".join(text for text, occurs in sentences.items() if occurs)


def _caption_of_worth(gauges: tuple[Gauge, ...]) -> str:
    """What the columns of readings mean, as far as they occur."""
    ids = "Numbers are those of the table of the gauges" if given(gauges) else "Ids are those of the mesh file"
    sentences = {
        f"{ids}; angle is from the projected axis.": True,
        "The peak is the largest reading of the training run, of what the sensor can measure.": any(
            gauge.peak is not None for gauge in gauges
        ),
        REFINED: any(gauge.refined is not None for gauge in gauges),
        UNOBSERVABLE: any(math.isinf(value) for gauge in gauges for value in gauge.without.values()),
    }
    return " ".join(text for text, occurs in sentences.items() if occurs)


def _kind(gauge: Gauge) -> str:
    """Strain gauge, rosette …; what sets it apart from the others of its kind stands below."""
    signs = " ".join("+" if arm.sign > 0 else "−" for arm in gauge.arms)
    text = escape(gauge.kind) + f"<br>{_whole(signs)}" * bool(signs)
    text += f"<br><strong>{_whole('bonded already')}</strong>" * gauge.bonded
    return text + f"<br>mirrors {escape(gauge.mirror)}" * bool(gauge.mirror)


def _ids(gauge: Gauge) -> list[str]:
    """Element, facet and angles [deg] of all its directions: that of the first, and by how much the others are turned about the
    normal; of a bridge elements and facets of its arms."""
    first, angles = gauge.channels[0], "–"
    if gauge.kind in SINGLE:
        turn = [math.atan2(gauge.normal @ np.cross(first, other), first @ other) for other in gauge.channels]
        exact = [round(gauge.angle + math.degrees(angle), 6) for angle in turn]
        angles = "<br>".join(data(angle, f"{number(angle, 3)}°", "°") for angle in exact)
    elements = [str(arm.element) for arm in gauge.arms] or [str(gauge.element)]
    facets = [str(arm.facet) for arm in gauge.arms] or [str(gauge.facet or "–")]
    return ["<br>".join(elements), "<br>".join(facets), angles]


def _edges(gauge: Gauge, frame: PositionAxes) -> list[str]:
    """Distances and angles to both edges of its place, of a bridge of all its arms: two cells."""
    edges = gauge.edges.reshape(-1, 2)
    distance, angle = edges[np.isfinite(edges[:, 0])].T.tolist()
    sizes = [data(x, number(x, 4)) for x in frame.length(np.array(distance)).tolist()]
    turns = ["–" if math.isnan(a) else data(a, f"{number(round(a, 1) + 0.0, 3)}°", "°") for a in angle]
    return ["<br>".join(sizes) or "–", "<br>".join(turns) or "–"]


def _reading(gauge: Gauge) -> str:
    """The training peak against the range, in the unit of the larger; a mark where it goes beyond. Of a bridge its output,
    and the largest strain of an arm against the range of one."""
    if gauge.peak is None:
        return "–"
    finite = [size for size in (gauge.peak, gauge.most or 0.0, gauge.range or 0.0) if math.isfinite(size)]
    factor, unit = reading_unit(max(finite, default=0.0), gauge.unit)

    def shown(value: float, unit: str = "") -> str:
        return data(value, f"{number(value / factor, 3)}{unit}", gauge.unit)

    if gauge.range is None:
        return shown(gauge.peak, f" {unit}")
    text, peak = shown(gauge.peak), gauge.peak
    if gauge.most is not None:
        peak = gauge.most
        text += f"<br>an arm {shown(peak)}"
    text += f" of {shown(gauge.range, f' {unit}')}"
    if peak > gauge.range:
        return f'{text}<br><strong class="mark bad">✕ beyond its range</strong>'
    used = peak / gauge.range if gauge.range > 0 else math.nan
    return f"{text}<br>{data(used, percent(used))}" if math.isfinite(used) else text


def _changed(gauge: Gauge) -> str:
    """How its strain changes on a finer mesh around it, and with forces on nodes spread, where there are any."""
    if gauge.refined is None or gauge.spread is None:
        return "–"
    text = data(gauge.refined, _signed(gauge.refined))
    if gauge.spread:
        text += f"<br>loads spread: {data(gauge.spread, _signed(gauge.spread))}"
    return text + '<br><strong class="mark bad">✕ hot spot</strong>' * gauge.hot


def _signed(share: float) -> str:
    return f"{'+' * (share > 0)}{percent(share)}"


def _whole(text: str) -> str:
    return f'<span class="whole">{text}</span>'


STEADY = (
    "one standard deviation of an unknown with the system held at an instant: it ranks layouts, a filter claims its own"
)


def criteria_table(
    trend: Trend, metrics: Sequence[MetricWords], criteria: Sequence[Criteria], unit: Mapping[str, str]
) -> str:
    """Layouts by rule, the chosen one and its bound first, the others by their metric.

    metrics: every one, that of the layout first; criteria: layouts, the chosen one first; unit: of every unknown."""
    chosen = criteria[0].chosen if criteria else trend.final
    scale = chosen if 0 < chosen < math.inf else math.nan
    names = [name for name in unit if any(name in entry.std for entry in criteria)]
    others = metrics[1:] if criteria else ()

    def row(title: str, value: float, entry: Criteria | None) -> list[str]:
        cells = [title, plain(value), plain(value / scale)]
        if entry is None:
            return cells + ["–"] * (len(others) + len(names))
        return [*cells, *map(plain, entry.values[1:]), *(_sigma(entry.std.get(name), unit[name]) for name in names)]

    rule = f" ({escape(criteria[0].rule)})" if criteria else ""
    rows = [row(f"<strong>chosen set</strong>{rule}", chosen, criteria[0] if criteria else None)]
    if trend.lower_bound is not None:
        rows.append(row("certified lower bound", trend.lower_bound, None))
    rules = sorted(criteria[1:], key=lambda entry: (math.isnan(entry.chosen), entry.chosen))
    rows += [row(escape(entry.rule), entry.chosen, entry) for entry in rules]
    head = ["layout by", escape(trend.metric.symbol), "times the chosen", *(escape(m.symbol) for m in others)]
    head += [f"steady-state σ({escape(name)})" for name in names]
    caption = (
        "Layouts of the same size from the same pool" + ", all scored by the same covariance" * bool(criteria) + "."
    )
    if rules:
        caption += f" {LIMITS}"
    if any(math.isinf(value) for entry in criteria for value in (*entry.values, *entry.std.values())):
        caption += " ∞: that layout cannot observe all unknowns."
    return table("layouts by rule", head, rows, caption=caption, numeric=range(1, len(head)))


LIMITS = "The other rules know no limits of the layout, such as a budget, spacing or zones: what they choose may not be allowed."


def criteria_meaning(metrics: Sequence[MetricWords]) -> str:
    """What the columns of the criteria mean, as a list."""
    words = [
        (metric.symbol, metric.meaning + "; what this placement makes small" * (i == 0))
        for i, metric in enumerate(metrics)
    ]
    meanings = [
        f"<strong>{escape(name)}</strong>: {escape(text)}." for name, text in (*words, ("steady-state σ", STEADY))
    ]
    return f"<h3>Criteria, smaller is better in all</h3>{items(meanings)}"


def load_cases_table(report: PlacementReport) -> str:
    """Load cases one a row: weight, metric, expected σ of every unknown; "" without load cases."""
    cases, names = report.load_cases, list(report.units)
    if cases is None:
        return ""
    rows = []
    for i, case in enumerate(cases.name):
        sigma = [share(float(cases.std[name][i])) if cases.acts[name][i] else "silent" for name in names]
        rows.append([escape(case), plain(float(cases.weight[i])), plain(float(cases.metric[i])), *sigma])
    expected = [f"expected σ({escape(name)})" for name in names]
    head = ["load case", "weight", escape(report.trend.metric.symbol), *expected]
    caption = (
        "The layout serves all of them, each by its weight. σ along the training of the case, relative to the amplitude there; "
        "the metric is that of the case alone."
    )
    return table("load cases", head, rows, caption=caption, numeric=range(1, len(head)))


def cases_table(cases: Sequence[ObservabilityCase]) -> str:
    """Sets of unknowns one a row, excitations side by side: condition numbers and what is lost."""
    excitations = list(dict.fromkeys(case.excitation for case in cases))
    grid: dict[tuple[str, ...], dict[str, ObservabilityCase]] = {}
    for case in cases:
        grid.setdefault(case.unknowns, {})[case.excitation] = case
    rows = []
    for unknowns, by in grid.items():
        conditions = [plain(by[name].condition, 3) if name in by else "–" for name in excitations]
        rows.append([escape(", ".join(unknowns)) or "none", *conditions, _lost(by, len(excitations))])
    head = ["unknown together", *map(escape, excitations), "what is lost"]
    caption = (
        "Condition number of the Popov-Belevitch-Hautus matrix at λ = 0, the larger the harder to distinguish. "
        "States are scaled by their sizes in the training run, so that rows can be compared at the same excitation."
    )
    return table("sets of unknowns", head, rows, caption=caption, numeric=range(1, len(head) - 1))


def _sigma(value: float | None, unit: str) -> str:
    """σ in the unknown's unit, or in words that there is none."""
    if value is None or math.isnan(value):
        return "–"
    return '<data value="inf">cannot observe</data>' if math.isinf(value) else measure(value, unit, 3)


def _lost(cases: Mapping[str, ObservabilityCase], excitations: int) -> str:
    """What is lost, once where it is the same at every excitation."""
    lost = {name: escape(case.lost) for name, case in cases.items() if case.lost}
    if len(lost) == excitations and len(texts := set(lost.values())) == 1:
        return texts.pop()
    return "<br>".join(f"{escape(name)}: {text}" for name, text in lost.items())

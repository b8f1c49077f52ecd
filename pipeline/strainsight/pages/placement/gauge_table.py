"""Tables of a placement: gauges, layouts by other rules, load cases, and observability."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.page.markup import axes, badge, data, decimals, items, measure, plain, share, table
from strainsight.pages.picture.layout import Gauge
from strainsight.pages.placement.data import Criteria, MetricWords, ObservabilityCase, PlacementReport, Trend
from strainsight.positions import PositionAxes
from strainsight.text import number, percent, reading_unit

SINGLE = frozenset({"strain gauge", "rosette", "bridge"})
"""Kinds called gauges; a layout with other kinds consists of sensors."""


EDGES = (
    "Nearest edges: edges of the face on which the gauge is. First line: nearest edge. Second line: nearest edge transverse "
    "to the first one. Angles are positive counter-clockwise about the outward normal."
)
BONDED = (
    "Installation: values that violate an installation limit. Possible values: relative change of strain over one standard "
    "deviation of the gauge position, relative change of strain over the measuring grid, and free height above the gauge."
)
REFINED = (
    "Refined mesh: change of the strain at the gauge if the element size around it is halved twice. The change is relative to "
    "the RMS strain of the training simulation (simulation in the stage `train`). A large change indicates a "
    "hot spot: a corner, the end of a support or a concentrated force."
)


def gauge_table(report: PlacementReport) -> str:
    """Tables of the gauges: positions, and readings with expected σ; empty columns are omitted."""
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
            _vectors(frame, [normal for _, _, normal in gauge.grids[: len(gauge.arms) or 1]]),
            _vectors(frame, [direction for _, direction, _ in gauge.grids]),
            *_edges(gauge, frame) * edged,
            *["<br>".join(map(escape, gauge.notes.split("; "))) or "–"] * noted,
        ]
        for index, gauge in enumerate(gauges)
    ]
    head = ["gauge", "kind", *frame.heads, "normal", "direction"]
    head += [f"distance to nearest edges [{frame.unit}]", "angle from nearest edges to measuring direction"] * edged
    numeric = [2, 3, 4, *range(7, len(head))]
    head += ["installation"] * noted
    several = any(len(gauge.channels) > 1 for gauge in gauges)
    below = "; rosettes and triaxial sensors have one line for each direction" * several
    sentences = {
        f"Positions, normals and measuring directions are in {frame.in_words()}{below}.": True,
        "The arms of a bridge are listed in the order of their signs.": any(gauge.arms for gauge in gauges),
        EDGES: any(len(gauge.edges) for gauge in gauges),
        "A gauge and its mirror image were placed as a pair.": any(gauge.mirror for gauge in gauges),
        BONDED: any(gauge.notes for gauge in gauges),
    }
    return table("gauges", head, rows, caption=_occurring(sentences), numeric=numeric)


def _vectors(frame: PositionAxes, vectors: Sequence[FloatArray]) -> str:
    """Unit vectors in the axes of the frame, one in a line; a dash for none."""
    rows = [frame.turn(vector).tolist() for vector in vectors if np.any(vector)]
    return "<br>".join(_whole(" ".join(data(x, number(round(x, 4), 4)) for x in row)) for row in rows) or "–"


def _worth(report: PlacementReport) -> str:
    gauges = report.layout.gauges
    names = [u.name for u in report.unknowns if any(u.name in gauge.without for gauge in gauges)]
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
    head = ["gauge", "number" if imported(gauges) else "element", "facet", "angle"]
    head += ["training peak"] * read + ["change of strain with refined mesh"] * tested
    foot = ["all gauges", *[""] * (len(head) - 1), *expected] if (expected := expected_with_all(report, names)) else []
    head += [f"expected σ({escape(name)}) without gauge" for name in names]
    ids = "Numbers refer to the imported table of gauges" if imported(gauges) else "Ids refer to the mesh file"
    sentences = {
        f"{ids}; the angle is measured from the projected axis.": True,
        "Training peak: largest reading of the training simulation, relative to the measuring range.": read,
        REFINED: tested,
        "∞: without this gauge the unknown is not observable.": any(
            math.isinf(value) for gauge in gauges for value in gauge.without.values()
        ),
    }
    caption = _occurring(sentences)
    return table("gauges: readings", head, rows, caption=caption, numeric=range(1, len(head)), foot=foot)


def expected_with_all(report: PlacementReport, names: Sequence[str]) -> list[str]:
    """Cells with the expected σ of these unknowns with all gauges, empty if unknown."""
    sigma = {unknown.name: unknown for unknown in report.unknowns if unknown.expected_std is not None}
    cells = [expected_share(one.expected_std, one.reference, one.unit) for name in names if (one := sigma.get(name))]
    return cells if len(cells) == len(names) else []


def expected_share(std: float | None, reference: float, unit: str) -> str:
    """Expected σ, relative and in the unit of the unknown, in two lines."""
    if std is None or not math.isfinite(std) or unit == "1":
        return share(std)
    return f"{share(std)}<br>{measure(std * reference, unit, 3)}"


def imported(gauges: tuple[Gauge, ...]) -> bool:
    """Whether gauges are imported by a strain operator, without facets."""
    return not any(gauge.facet for gauge in gauges)


def _occurring(sentences: Mapping[str, bool]) -> str:
    """Caption of a table: the sentences on what occurs in it."""
    return " ".join(text for text, occurs in sentences.items() if occurs)


def _kind(gauge: Gauge) -> str:
    """Kind of a gauge, with signs, bonded state and mirror image below."""
    signs = " ".join("+" if arm.sign > 0 else "−" for arm in gauge.arms)
    text = escape(gauge.kind) + f"<br>{_whole(signs)}" * bool(signs)
    text += f"<br><strong>{_whole('already bonded')}</strong>" * gauge.bonded
    return text + f"<br>mirrors {escape(gauge.mirror)}" * bool(gauge.mirror)


def _ids(gauge: Gauge) -> list[str]:
    """Cells of elements and facets (of all bridge arms), and angles [deg] of all directions about the normal."""
    first, angles = gauge.channels[0], "–"
    if gauge.kind in SINGLE:
        turn = [math.atan2(gauge.normal @ np.cross(first, other), first @ other) for other in gauge.channels]
        exact = [round(gauge.angle + math.degrees(angle), 6) for angle in turn]
        angles = "<br>".join(data(angle, f"{number(angle, 3)}°", "°") for angle in exact)
    elements = [str(arm.element) for arm in gauge.arms] or [str(gauge.element)]
    facets = [str(arm.facet) for arm in gauge.arms] or [str(gauge.facet or "–")]
    return ["<br>".join(elements), "<br>".join(facets), angles]


def _edges(gauge: Gauge, frame: PositionAxes) -> list[str]:
    """Cells of distances and angles to both edges, for all bridge arms."""
    edges = gauge.edges.reshape(-1, 2)
    distance, angle = edges[np.isfinite(edges[:, 0])].T.tolist()
    sizes = [data(x, number(x, 4)) for x in frame.length(np.array(distance)).tolist()]
    turns = ["–" if math.isnan(a) else data(a, f"{number(round(a, 1) + 0.0, 3)}°", "°") for a in angle]
    return ["<br>".join(sizes) or "–", "<br>".join(turns) or "–"]


def _reading(gauge: Gauge) -> str:
    """Training peak relative to the measuring range, with a mark if it is exceeded; for a bridge also of the largest arm."""
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
        text += f"<br>arm {shown(peak)}"
    text += f" of {shown(gauge.range, f' {unit}')}"
    if peak > gauge.range:
        return f'{text}<br><strong class="mark bad">✕ range exceeded</strong>'
    used = peak / gauge.range if gauge.range > 0 else math.nan
    return f"{text}<br>{data(used, percent(used))}" if math.isfinite(used) else text


def _changed(gauge: Gauge) -> str:
    """Change of strain with a refined mesh, and with distributed nodal forces."""
    if gauge.refined is None or gauge.spread is None:
        return "–"
    text = data(gauge.refined, _signed(gauge.refined))
    if gauge.spread:
        text += f"<br>distributed forces: {data(gauge.spread, _signed(gauge.spread))}"
    return text + '<br><strong class="mark bad">✕ hot spot</strong>' * gauge.hot


def _signed(share: float) -> str:
    return f"{'+' * (share > 0)}{percent(share)}"


def _whole(text: str) -> str:
    return f'<span class="whole">{text}</span>'


STEADY = (
    "steady-state σ of a filter with the model linearised at one instant. Use it only to rank layouts; the σ of the filter in a "
    "run differs"
)


def criteria_table(
    trend: Trend, metrics: Sequence[MetricWords], criteria: Sequence[Criteria], unit: Mapping[str, str]
) -> str:
    """Table of layouts by rule: the chosen layout and its bound first, the others by metric.

    metrics: that of the layout first; criteria: layouts, the chosen one first; unit: of every unknown."""
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
    rows = [row(f"<strong>chosen layout</strong>{rule}", chosen, criteria[0] if criteria else None)]
    if trend.lower_bound is not None:
        rows.append(row("proven lower bound of the placement criterion", trend.lower_bound, None))
    rules = sorted(criteria[1:], key=lambda entry: (math.isnan(entry.chosen), entry.chosen))
    rows += [row(escape(entry.rule), entry.chosen, entry) for entry in rules]
    head = [
        "layout",
        escape(trend.metric.symbol),
        f"{escape(trend.metric.symbol)} relative to chosen layout",
        *(escape(m.symbol) for m in others),
    ]
    head += [f"steady-state σ({escape(name)})" for name in names]
    caption = (
        "All layouts have the same number of gauges, from the same candidates"
        + ", and are evaluated with the same covariance" * bool(criteria)
        + "."
    )
    if rules:
        caption += f" {LIMITS}"
    if any(math.isinf(value) for entry in criteria for value in (*entry.values, *entry.std.values())):
        caption += " ∞: an unknown is not observable with this layout."
    return table("layouts by rule", head, rows, caption=caption, numeric=range(1, len(head)))


LIMITS = "Layouts by other placement rules can violate the limits of this placement, such as budget, spacing and zones."


def criteria_meaning(metrics: Sequence[MetricWords]) -> str:
    """Meaning of the criteria, as a list."""
    words = [
        (metric.symbol, metric.meaning + "; minimised by this placement" * (i == 0)) for i, metric in enumerate(metrics)
    ]
    meanings = [
        f"<strong>{escape(name)}</strong>: {escape(text)}." for name, text in (*words, ("steady-state σ", STEADY))
    ]
    return f"<h3>Criteria (smaller is better)</h3>{items(meanings)}"


def load_cases_table(report: PlacementReport) -> str:
    """Table of load cases: weight, metric, expected σ of every unknown; "" without load cases."""
    cases, names = report.load_cases, list(report.units)
    if cases is None:
        return ""
    rows = []
    for i, case in enumerate(cases.name):
        sigma = [
            expected_share(float(cases.std[name][i]), float(cases.scale[name][i]), unit)
            if cases.acts[name][i]
            else "inactive"
            for name, unit in report.units.items()
        ]
        rows.append([escape(case), plain(float(cases.weight[i])), plain(float(cases.metric[i])), *sigma])
    expected = [f"expected σ({escape(name)})" for name in names]
    head = ["load case", "weight", escape(report.trend.metric.symbol), *expected]
    caption = (
        "The placement minimises the mean or the maximum of the weighted criteria of all load cases. Criterion: value for "
        "the layout in this load case alone. Expected σ: computed with the simulated load history (training simulation) of the "
        "load case. Expected σ of a load is relative to the RMS of the load in this case."
    )
    return table("load cases", head, rows, caption=caption, numeric=range(1, len(head)))


def cases_table(cases: Sequence[ObservabilityCase]) -> str:
    """Table of groups of unknowns by excitation: condition numbers and unobservable combinations."""
    excitations = list(dict.fromkeys(case.excitation for case in cases))
    grid: dict[tuple[str, ...], dict[str, ObservabilityCase]] = {}
    for case in cases:
        grid.setdefault(case.unknowns, {})[case.excitation] = case
    rows = []
    for unknowns, by in grid.items():
        conditions = [plain(by[name].condition, 3) if name in by else "–" for name in excitations]
        rows.append([escape(", ".join(unknowns)) or "none", *conditions, _lost(by, len(excitations))])
    head = ["unknowns", *map(escape, excitations), "not observable"]
    caption = (
        "Condition number of the Popov-Belevitch-Hautus matrix at λ = 0; a larger number means weaker observability. "
        "States are scaled by the motion amplitude of the training simulation (stage `train`), so only numbers in one "
        "column (the same excitation) are comparable."
    )
    return table("groups of unknowns", head, rows, caption=caption, numeric=range(1, len(head) - 1))


def _sigma(value: float | None, unit: str) -> str:
    """σ in the unit of the unknown, or "not observable"."""
    if value is None or math.isnan(value):
        return "–"
    return '<data value="inf">not observable</data>' if math.isinf(value) else measure(value, unit, 3)


def _lost(cases: Mapping[str, ObservabilityCase], excitations: int) -> str:
    """Unobservable combinations, once if equal at every excitation."""
    lost = {name: escape(case.lost) for name, case in cases.items() if case.lost}
    if len(lost) == excitations and len(texts := set(lost.values())) == 1:
        return texts.pop()
    return "<br>".join(f"{escape(name)}: {text}" for name, text in lost.items())

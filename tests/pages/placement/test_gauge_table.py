"""Tables of a placement: gauges, their channels and their readings."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.pages.placement.gauge_table import cases_table, criteria_table, gauge_table
from strainsight.positions import PositionAxes


def vector(values):
    return " ".join(f"{x:.4g}".replace("-", "−") for x in values + 0.0)


def rows(report):
    """Cells of every gauge in words, of both tables, by the column's name."""
    found = []
    for text in re.split("<table[^>]*>", gauge_table(report))[1:]:
        names = re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", text)
        for i, row in enumerate(re.findall(r"<tr>(.*?)</tr>", text.split("<tbody>")[1].split("</tbody>")[0])):
            cells = [re.sub("<[^>]+>", "", cell.replace("<br>", "|")) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
            found += [{}] * (i == len(found))
            found[i] = found[i] | dict(zip(names, cells, strict=True))
    return found


def test_peaks_stand_against_ranges_in_the_units_of_the_instruments(mixed):
    assert [row["training peak"] for row in rows(mixed())] == [
        "91 of 3000 µm/m|3.0\u00a0%", "240 of 200 µm/m|✕ range exceeded", "91 of 3000 µm/m|3.0\u00a0%", "41.2 m/s²",
        "– of 50 m/s²", "0.43 of 2 mm|22\u00a0%",
    ]  # fmt: skip
    assert '<data value="0.00024" data-unit="strain">' in gauge_table(mixed())


def test_places_directions_and_angles_keep_their_exact_values(mixed):
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', gauge_table(mixed()))}
    for gauge in mixed().layout.gauges:
        assert {*gauge.position.tolist(), *np.ravel(gauge.channels).tolist()} <= exact
    assert {0.0, 45.0, 90.0} <= exact
    assert [rows(mixed())[0][f"{axis} [m]"] for axis in "xyz"] == ["0.1000", "0.0200", "0.1200"]


def test_places_and_distances_to_edges_are_in_the_unit_and_axes_of_the_datum(full):
    report = full()
    frame = PositionAxes("mm", 1e-3, np.array([1000.0, 0, 0]), np.diag([-1.0, -1.0, 1.0]))
    first, second, *others = report.layout.gauges
    gauges = (
        replace(first, edges=np.array([[[0.0125, -30.0], [0.25, 60.0]]])),
        replace(second, edges=np.array([[[0.004, 0.0], [np.nan, np.nan]]])),
        *others,
    )
    text = gauge_table(replace(report, layout=replace(report.layout, gauges=gauges, frame=frame)))
    found = rows(replace(report, layout=replace(report.layout, gauges=gauges, frame=frame)))
    assert [row["distance to nearest edges [mm]"] for row in found] == ["12.5|250", "4", "–", "–"]
    assert [row["angle from nearest edges to measuring direction"] for row in found] == ["−30°|60°", "0°", "–", "–"]
    assert (found[0]["x [mm]"], found[0]["y [mm]"], found[0]["z [mm]"]) == ("900.0", "−20.0", "120.0")
    assert found[0]["direction"] == "−1 0 0"
    assert [row["normal"] for row in found] == [vector(frame.turn(gauge.normal)) for gauge in gauges]
    assert "datum coordinates: origin (1000 0 0) mm, x axis (-1 0 0), y axis (0 -1 0) in deck coordinates" in text
    assert "nearest edges" not in gauge_table(report)


def cells(text):
    """Rows of the table as exact values where a cell has one, else as its words."""
    rows = re.findall(r"<tr>(.*?)</tr>", text.split("<tbody>")[1].split("</tbody>")[0])
    return [
        [
            float(exact[1]) if (exact := re.search(r'<data value="([^"]+)"', cell)) else re.sub("<[^>]+>", "|", cell)
            for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)
        ]
        for row in rows
    ]


def head(text):
    return re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", text)


def test_ours_comes_first_with_its_bound_and_the_others_by_their_metric(full):
    report = full()
    text = criteria_table(report.trend, report.metrics, report.criteria, report.units)
    rows = cells(text)
    assert [row[0] for row in rows] == [
        "|chosen layout| (elimination, exchange)", "proven lower bound of the placement criterion", "log-determinant",
        "effective independence",
        "random layout (median of 10 layouts)",
    ]  # fmt: skip
    chosen = report.criteria[0]
    assert rows[0][1:] == [chosen.values[0], 1.0, *chosen.values[1:], 1.15e3, 1.65e8]
    assert rows[1][1:3] == [2.6187, pytest.approx(2.6187 / 2.62)]
    assert rows[1][3:] == ["–"] * 4
    assert rows[3][1:] == [3.5, pytest.approx(3.5 / 2.62), 0.074, 2.9, 1.3e3, 1.9e8]
    assert rows[4][1:] == [np.inf, np.inf, np.inf, np.inf, 2.1e3, np.inf]
    assert head(text)[-2:] == ["steady-state σ(tip)", "steady-state σ(E)"]
    assert "1.15\u00a0kN" in text
    assert "165\u00a0MPa" in text


def test_cases_are_rows_and_excitations_are_columns(full):
    text = cases_table(full().cases)
    assert head(text) == ["unknowns", "training simulation", "35 Hz", "not observable"]
    assert cells(text) == [
        ["tip", 8.0, 16.0, ""],
        ["E, rho", 91.0, 182.0, ""],
        ["tip, E, rho", 9e11, 1.8e12, "tip, E and rho scaled by one factor"],
    ]
    assert "the same excitation" in text

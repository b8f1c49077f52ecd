"""The table of gauges: kinds, what was bonded already, and readings against ranges."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.datum import Frame
from strainsight.report.picture.layout import Arm
from strainsight.report.placement.gauge_table import gauge_table


def rows(report):
    """Cells of every gauge in words, of both tables, by the column's name."""
    found = []
    for text in gauge_table(report).split("<table>")[1:]:
        names = re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", text)
        for i, row in enumerate(re.findall(r"<tr>(.*?)</tr>", text.split("<tbody>")[1].split("</tbody>")[0])):
            cells = [re.sub("<[^>]+>", "", cell.replace("<br>", "|")) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
            found += [{}] * (i == len(found))
            found[i] = found[i] | dict(zip(names, cells, strict=True))
    return found


def test_given_gauges_have_a_number_in_place_of_an_element(full):
    report = full()
    gauges = tuple(replace(gauge, facet=0, element=101 + i) for i, gauge in enumerate(report.layout.gauges))
    given = replace(report, layout=replace(report.layout, gauges=gauges))
    assert [row["number"] for row in rows(given)] == ["101", "102", "103", "104"]
    assert "Numbers are those of the table of the gauges" in gauge_table(given)
    assert [row["element"] for row in rows(report)] == ["1201", "1202", "1203", "1204"]
    assert "Ids are those of the mesh file" in gauge_table(report)


def test_the_arms_of_a_bridge_stand_below_one_another_with_their_signs(full):
    report = full()
    first, *others = report.layout.gauges
    up = np.array([0.0, 0.0, 1.0])
    arms = (
        Arm(first.position, first.direction, up, 1, 1201, 2),
        Arm(first.position - 0.1 * up, np.array([0.0, 1.0, 0.0]), -up, -1, 1300, 1),
    )
    gauges = (replace(first, kind="bridge", arms=arms), *others)
    row, other, *_ = rows(replace(report, layout=replace(report.layout, gauges=gauges)))
    assert row["kind"] == "bridge|+ −"
    assert (row["element"], row["facet"]) == ("1201|1300", "2|1")
    assert row["direction"].split("|")[1] == "0 1 0"
    high, low = (float(z.replace("−", "-")) for z in row["z [m]"].split("|"))
    assert high - low == pytest.approx(0.1)
    assert "|" not in other["element"] + other["x [m]"]


def test_kind_bonded_and_mirror_image_are_reported(mixed):
    assert [row["kind"] for row in rows(mixed())] == [
        "strain gauge|mirrors G3", "rosette", "strain gauge|bonded already|mirrors G1", "accelerometer",
        "accelerometer|bonded already", "displacement sensor",
    ]  # fmt: skip
    text = gauge_table(mixed())
    assert text.count("background:#ffffff") == 2 * 2  # once in either table
    assert "mirror image were placed as one" in text


def test_peaks_stand_against_ranges_in_the_units_of_the_instruments(mixed):
    assert [row["training peak"] for row in rows(mixed())] == [
        "91 of 3000 µm/m|3.0\u00a0%", "240 of 200 µm/m|✕ beyond its range", "91 of 3000 µm/m|3.0\u00a0%", "41.2 m/s²",
        "– of 50 m/s²", "0.43 of 2 mm|22\u00a0%",
    ]  # fmt: skip
    assert '<data value="0.00024" data-unit="strain">' in gauge_table(mixed())


def test_every_direction_of_a_rosette_stands_on_its_own_line(mixed):
    found = rows(mixed())
    assert found[1]["direction"] == "1 0 0|0.7071 0.7071 0|0 1 0"
    assert found[0]["direction"] == "1 0 0"
    assert found[1]["angle"] == "0°|45°|90°"
    assert found[3]["angle"] == "–"


def test_places_directions_and_angles_keep_their_exact_values(mixed):
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', gauge_table(mixed()))}
    for gauge in mixed().layout.gauges:
        assert {*gauge.position.tolist(), *np.ravel(gauge.channels).tolist()} <= exact
    assert {0.0, 45.0, 90.0} <= exact
    assert [rows(mixed())[0][f"{axis} [m]"] for axis in "xyz"] == ["0.1000", "0.0200", "0.1200"]


def test_columns_that_would_be_empty_are_left_out(full, bare):
    for report in (full(), bare):
        assert "training peak" not in gauge_table(report)
    assert "without it" not in gauge_table(full(unknowns=()))


def test_ranges_and_peaks_that_are_no_numbers(mixed):
    layout = mixed().layout
    odd = ((np.inf, 1e-3), (1e-5, np.inf), (0.0, 0.0), (np.nan, np.nan), (1e-5, np.nan), (np.inf, None))
    gauges = tuple(replace(g, peak=peak, range=most) for g, (peak, most) in zip(layout.gauges, odd, strict=True))
    shown = [row["training peak"] for row in rows(mixed(layout=replace(layout, gauges=gauges)))]
    assert shown[0] == "∞ of 1000 µm/m|✕ beyond its range"
    assert shown[1].startswith("10 of ∞ µm/m")
    assert shown[2:] == ["0 of 0 µm/m", "– of – m/s²", "1×10⁻⁵ of – m/s²", "∞ m"]


def test_changes_on_a_finer_mesh_stand_with_their_sign_and_a_mark_where_they_are_too_large(mixed):
    layout = mixed().layout
    none = (None, None, False)
    tested = ((0.002, 0.0, False), (-0.23, 0.0, True), (0.01, 0.3, True), none, (0.0, 0.0, False), none)
    gauges = tuple(
        replace(gauge, refined=refined, spread=spread, hot=hot)
        for gauge, (refined, spread, hot) in zip(layout.gauges, tested, strict=True)
    )
    report = mixed(layout=replace(layout, gauges=gauges))
    assert [row["strain on a finer mesh"] for row in rows(report)] == [
        "+0.20\u00a0%", "−23\u00a0%|✕ hot spot", "+1.0\u00a0%|loads spread: +30\u00a0%|✕ hot spot", "–", "0.000\u00a0%", "–",
    ]  # fmt: skip
    assert "A hot spot changes by more than its share" in gauge_table(report)
    assert "finer mesh" not in gauge_table(mixed())


def test_what_is_to_be_looked_at_where_a_gauge_is_bonded_is_the_last_column_where_there_is_something(mixed):
    layout = mixed().layout
    notes = ("check access: 12 mm", "", "steep gradient here: <8 %; check access: 3 mm", *[""] * (len(layout.gauges) - 3))
    gauges = tuple(replace(gauge, notes=note) for gauge, note in zip(layout.gauges, notes, strict=True))
    report = mixed(layout=replace(layout, gauges=gauges))
    shown = [row["where it is bonded"] for row in rows(report)]
    assert shown[:3] == ["check access: 12 mm", "–", "steep gradient here: &lt;8 %|check access: 3 mm"]
    assert set(shown[3:]) == {"–"}
    assert "how much room there is over it" in gauge_table(report)
    assert "where it is bonded" not in gauge_table(mixed())


def test_places_and_distances_to_edges_are_in_the_unit_and_axes_of_the_datum(full):
    """The datum at (1, 0, 0) m, x back along −x, in mm."""
    report = full()
    frame = Frame("mm", 1e-3, np.array([1000.0, 0, 0]), np.diag([-1.0, -1.0, 1.0]))
    first, second, *others = report.layout.gauges
    gauges = (
        replace(first, edges=np.array([[[0.0125, -30.0], [0.25, 60.0]]])),
        replace(second, edges=np.array([[[0.004, 0.0], [np.nan, np.nan]]])),
        *others,
    )
    text = gauge_table(replace(report, layout=replace(report.layout, gauges=gauges, frame=frame)))
    found = rows(replace(report, layout=replace(report.layout, gauges=gauges, frame=frame)))
    assert [row["nearest edges [mm]"] for row in found] == ["12.5|250", "4", "–", "–"]
    assert [row["angle to them"] for row in found] == ["−30°|60°", "0°", "–", "–"]
    assert (found[0]["x [mm]"], found[0]["y [mm]"], found[0]["z [mm]"]) == ("900.0", "−20.0", "120.0")
    assert found[0]["direction"] == "−1 0 0"
    assert "the datum at (1000 0 0) mm of the deck, x along (-1 0 0), y along (0 -1 0)" in text
    assert "nearest edges" not in gauge_table(report)

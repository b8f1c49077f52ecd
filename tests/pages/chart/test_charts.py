"""Curves that look as the full ones, and figures as files with their numbers and units."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from PIL import Image

from strainsight.pages.chart.drawing import Drawing, figure, recorded_figures, styled, svg, visible_instants
from strainsight.pages.chart.files import INDEX, figure_csv, figure_files, write_figures
from strainsight.pages.chart.panels import dots
from strainsight.pages.placement.figures import placement_figures


def test_every_extreme_survives_decimation():
    draw = np.random.default_rng(5)
    columns = draw.normal(size=(50_000, 3))
    columns[31_234, 1] = 80.0
    columns[7, 2] = -90.0
    index = visible_instants(columns, buckets=200)
    assert len(index) <= 2 + 2 * 3 * 200
    assert {0, 7, 31_234, 49_999} <= set(index.tolist())
    np.testing.assert_array_equal(columns[index].max(axis=0), columns.max(axis=0))
    np.testing.assert_array_equal(columns[index].min(axis=0), columns.min(axis=0))


def drawn(value):
    with styled():
        sheet, axes = figure()
        axes.plot([0.0, 0.123456], [0.0, value], label="a $b <c>")
        axes.set_xticks([0.012345], ["0.012345"])
        axes.legend()
        return svg(sheet)


def test_the_same_data_give_the_same_bytes_and_others_do_not():
    assert drawn(1.0) == drawn(1.0)
    assert drawn(1.0) != drawn(2.0)
    assert b"<dc:date>" not in drawn(1.0)


def columns(content: bytes) -> dict[str, list[str]]:
    head, *rows = list(csv.reader(io.StringIO(content.decode())))
    assert len(set(head)) == len(head)
    return {name: [row[i] for row in rows if row[i]] for i, name in enumerate(head)}


@pytest.fixture
def panels():
    with styled():
        drawn, above, below = figure(4.0, (1.0, 1.0))
        above.set_ylabel("load [N]")
        below.set_ylabel("error\n[%]")
        below.set_xlabel("time [s]")
        yield drawn, above, below


def test_lines_bands_dots_and_bars_come_out_as_they_went_in(panels):
    drawn, above, below = panels
    time, low, high = np.array([0.0, 0.5, 1.0]), np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 6.0])
    above.fill_between(time, low, high, label="±2σ")
    above.plot(time, high, label="estimate")
    above.axhline(7.5, label="limit")
    dots(above, np.array([0.25, 0.75]), np.array([5.0, np.nan]), "measured")
    below.bar(time, high, width=0.1, label="claimed")
    below.axvline(0.4)
    found = columns(figure_csv(drawn))
    assert found == {
        "time [s]": ["0", "0.5", "1"],
        "±2σ low: load [N]": ["1", "2", "3"],
        "±2σ high: load [N]": ["2", "4", "6"],
        "time [s] (2)": ["0.25"],
        "measured: load [N]": ["5"],
        "estimate: load [N]": ["2", "4", "6"],
        "limit: load [N]": ["7.5"],
        "claimed: error [%]": ["2", "4", "6"],
        "time [s] (3)": ["0.4"],
    }


def test_every_figure_of_a_report_has_its_three_files_with_units(full):
    report = full(histories=(), gauge_signals=(), posteriors={}, random_sets=())
    with recorded_figures() as drawn:
        drawings = placement_figures(report)
        files = figure_files(drawings, drawn)
    assert len(files) == 3 * len(drawings) + 1
    assert set(files) >= {"trend.svg", "trend.csv", "trend.png", INDEX}
    trend = columns(files["trend.csv"])
    shown = np.isfinite(report.trend.value)
    np.testing.assert_allclose(np.array(trend["remaining gauges [–]"], float), report.trend.count[shown])
    metric = np.array(trend["tr(W P): placement criterion tr(W P) [–]"], float)
    np.testing.assert_allclose(metric, report.trend.value[shown], 1e-8)
    for name, content in files.items():
        if name.endswith(".csv") and name != INDEX:
            assert any("[" in head for head in columns(content)), name
        if name.endswith(".png"):
            with Image.open(io.BytesIO(content)) as image:
                assert image.convert("RGBA").getpixel((0, 0)) == (255, 255, 255, 255)
    assert [row[0] for row in csv.reader(io.StringIO(files[INDEX].decode()))][1] == "trend"


def test_keys_of_any_name_become_plain_names_that_differ():
    with styled(), recorded_figures() as drawn:
        images = []
        for i in range(5):
            own, axes = figure()
            axes.plot([0, 1], [i, i])
            images.append(svg(own))
        keys = ("../../etc", "A/<b>", "a__b_", "figures", "…")
        files = figure_files([Drawing(k, "t", "c", "a", image) for k, image in zip(keys, images, strict=True)], drawn)
    names = {name.removesuffix(".svg") for name in files if name.endswith(".svg")}
    assert len({name.lower() for name in names}) == 5
    assert all("/" not in name and not name.startswith(".") for name in files)
    assert "figures" not in names


def test_figures_that_are_no_more_are_removed_and_nothing_else(tmp_path):
    folder = tmp_path / "figures"
    index = b"figure,title,caption\n%s,t,c\n"
    write_figures(folder, {"old.svg": b"1", "old.csv": b"1", "old.png": b"1", INDEX: index % b"old"})
    (folder / "mine.png").write_bytes(b"own")
    (tmp_path / "precious.svg").write_bytes(b"own")
    write_figures(folder, {"new.svg": b"2", INDEX: index % b"new"})
    assert sorted(path.name for path in folder.iterdir()) == [INDEX, "mine.png", "new.svg"]
    (folder / INDEX).write_bytes(index % b"../precious")
    write_figures(folder, {"new.svg": b"2"})
    assert (tmp_path / "precious.svg").exists()

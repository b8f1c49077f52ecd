"""The sheet of a gauge on a plate to scale, and the lines that it is drawn of."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from lxml import etree

from strainsight.pages.picture.geometry import paper_axes
from strainsight.pages.sheets.sheet import sheet_svg, sheets_section
from strainsight.pages.sheets.views import Projection, Sheet
from strainsight.positions import PositionAxes

SIZE = np.array([400.0, 150.0, 10.0])
TURN = 30.0
DECK = PositionAxes("mm", 1e-3, np.zeros(3), np.eye(3))


def plate():
    """The twelve edges of 400 × 150 × 10 mm from the origin."""
    corner = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    pairs = [(a, b) for a in corner for b in corner if np.abs(a - b).sum() == 1 and tuple(a) < tuple(b)]
    return np.array(pairs) * SIZE


def sheet(position=(300.0, 20.0, 10.0), turn=TURN, **changed):
    """On the top: 20 mm from the side along x, 100 mm from that along y."""
    d = np.array([math.cos(math.radians(turn)), math.sin(math.radians(turn)), 0.0])
    x = np.array(position)
    right, up = paper_axes(np.array([0.0, 0.0, 1.0]))
    views = [Projection(right, v, plate(), np.zeros((0, 2, 3))) for v in (up, np.array([0.0, 0.0, 1.0]))]
    given = {
        "name": "G1", "kind": "strain gauge", "run": "plate", "deck": "plate.bdf", "layout": "0123456789ab", "frame": DECK,
        "position": x, "normal": np.array([0.0, 0.0, 1.0]), "directions": d[None], "strain": True, "grid": 3.0,
        "grid_width": 0.0, "carrier": (8.0, 4.5), "carrier_of": "assumed",
        "distance": np.array([20.0, 100.0]), "angle": np.array([turn, turn - 90.0]),
        "foot": np.array([[x[0], 0, 10], [400, x[1], 10]]), "along": np.array([[1.0, 0, 0], [0, 1.0, 0]]), "element": 7,
        "facet": 2, "outside": True, "front": views[0], "side": views[1],
    }  # fmt: skip
    return Sheet(**(given | changed))


def parts(text):
    root = etree.fromstring(text.encode())
    name = "{http://www.w3.org/2000/svg}"
    words = [own.text for own in root.iter(f"{name}text")]
    paths = [
        np.array([[float(v) for v in point.split()] for point in own.get("d").rstrip("Z")[1:].split("L")])
        for own in root.iter(f"{name}path")
    ]
    return root, words, paths


def sides(path):
    return np.linalg.norm(np.diff(np.vstack([path, path[:1]]), axis=0), axis=1)


def test_it_stands_alone_on_a4_and_has_no_date():
    root, words, _ = parts(sheet_svg(sheet()))
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("297mm", "210mm", "0 0 297 210")
    text = sheet_svg(sheet())
    assert not re.search(r"href|url\(|<script|<image|<style|20\d\d-", text)
    assert "lengths in mm; angles counter-clockwise about the normal" in words
    assert {"G1", "strain gauge", "mesh file plate.bdf", "run plate, layout 0123456789ab"} <= set(words)


@pytest.mark.parametrize("outside", [True, False])
def test_views_are_from_outside_only_if_nothing_lies_in_front_of_the_gauge(outside):
    _, words, _ = parts(sheet_svg(sheet(outside=outside)))
    assert len([text for text in words if "outside" in text]) == 2 * outside
    assert any("through the part in front of the gauge" in text for text in words) is not outside


def test_dimensions_are_those_of_hand_geometry():
    _, words, _ = parts(sheet_svg(sheet()))
    assert {"x = 300", "y = 20", "z = 10", "20", "100", "30° to the edge"} <= set(words)
    assert {"300 mm", "20 mm, at 30°", "100 mm, at −60°", "3 mm", "8 × 4.5 mm, assumed", "7, 2"} <= set(words)


def test_everything_lies_within_the_frame():
    for turn, position in ((0, (8.0, 8.0, 10.0)), (90, (392.0, 142.0, 10.0)), (-45, (200.0, 75.0, 10.0))):
        _, _, paths = parts(sheet_svg(sheet(position, turn)))
        every = np.concatenate(paths)
        assert every.min() >= 8
        assert np.all(every.max(axis=0) <= [289, 202])


def test_part_and_gauge_are_to_the_scale_that_is_stated():
    """The plate in the view, and the foil in the detail, which is turned by 30° as seen from outside."""
    _, words, paths = parts(sheet_svg(sheet()))
    stated = next(word for word in words if word.startswith("scale: views"))
    ratios = re.findall(r"([\d.]+):([\d.]+)", stated)
    reduced, enlarged = (float(one) / float(other) for one, other in ratios)
    assert reduced < 1 < enlarged
    extents = {tuple(np.round(np.ptp(path, axis=0), 1)) for path in paths if len(path) > 4}
    assert tuple(np.round(reduced * SIZE[:2], 1)) in extents
    assert tuple(np.round(reduced * SIZE[[0, 2]], 1)) in extents
    carrier = enlarged * np.array([4.5, 4.5, 8, 8])
    (foil,) = (path for path in paths if len(path) == 4 and np.allclose(np.sort(sides(path)), carrier, atol=0.05))
    long = next(foil[(i + 1) % 4] - foil[i] for i in range(4) if abs(sides(foil)[i] - 8 * enlarged) < 0.05)
    assert math.degrees(math.atan2(-long[1], long[0])) % 180 == pytest.approx(TURN, abs=0.2)


@pytest.mark.parametrize("seed", range(8))
def test_paper_axes_are_right_handed_with_the_normal_toward_the_reader(seed):
    n = np.random.default_rng(seed).standard_normal(3) if seed > 5 else np.eye(3)[seed % 3] * (1 - 2 * (seed // 3))
    n = n / np.linalg.norm(n)
    right, up = paper_axes(n)
    np.testing.assert_allclose(np.cross(right, up), n, atol=1e-12)
    assert np.linalg.norm(right) == pytest.approx(1)


def test_names_are_text_and_a_page_takes_so_many_sheets():
    hostile = sheet(name='<b>&"', run="</text><script>", deck="a<b.bdf")
    _, words, _ = parts(sheet_svg(hostile))
    assert '<b>&"' in words
    assert sheets_section([]) == ""
    large = b"<svg" + b" " * 900_000 + b"/>"
    page = sheets_section([large] * 5)
    assert page.count("<figure") == 2
    assert "5 drawing sheets" in page
    assert "omits 3 sheets, available as files only" in page

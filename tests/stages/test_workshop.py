"""What the workshop and other programs get of a layout on a beam of 1000 × 100 × 80 mm, by hand geometry and other readers."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
import pyuff

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

from ..robustness.small import write_project
from ..shared import made

SIZE = np.array([1000.0, 100.0, 80.0])
DATUM = "report.datum={origin: [1000, 0, 80], x: [-1, 0, 0], y: [-1, -2, 0]}"
"""At the tip, on top, x back to the root: x' = 1000 − x, y' = −y, z' = z − 80."""
SHORT = ("validate.random_sets=0", "validate.repeats=1", "validate.sweeps={}", "validate.noise_factors=[]")


def in_millimetres(line):
    card, number, system, *x = line.split(",")
    return ",".join([card, number, system, *(f"{1e3 * float(value):.6f}" for value in x)])


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The config of a beam whose deck is in mm, t and s."""
    folder = tmp_path_factory.mktemp("workshop")
    write_project(folder)
    deck = (folder / "beam.bdf").read_text()
    deck = re.sub(r"^GRID.*$", lambda line: in_millimetres(line[0]), deck, flags=re.MULTILINE)
    (folder / "beam.bdf").write_text(deck.replace("MAT1,1,2.1+11,,0.3,7850.", "MAT1,1,2.1+5,,0.3,7.85-9"))
    text = (folder / "beam.yaml").read_text()
    text = text.replace("length_unit: m, mass_unit: kg", "length_unit: mm, mass_unit: t")
    (folder / "beam.yaml").write_text(re.sub(r"^estimate:.*?(?=^validate)", "", text, flags=re.MULTILINE | re.DOTALL))
    return folder / "beam.yaml"


@pytest.fixture(scope="module")
def results(beam):
    """The folder of a run up to its page."""
    return made(beam, *SHORT, DATUM)["report"].path.parent


def rows(path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def numbers(row, *names):
    return np.array([float(row[name]) for name in names])


def test_places_are_in_the_datum_and_the_unit_of_the_deck(results):
    found, given = rows(results / "workshop.csv"), rows(results / "gauges.csv")
    assert [row["gauge"] for row in found] == [row["gauge"] for row in given] == ["G1", "G2", "G3"]
    for row, si in zip(found, given, strict=True):
        x = 1e3 * numbers(si, *(f"position_{axis}" for axis in "xyz"))
        np.testing.assert_allclose(numbers(si, "x_mm", "y_mm", "z_mm"), x, atol=1e-6)
        np.testing.assert_allclose(numbers(row, "x_mm", "y_mm", "z_mm"), [1000 - x[0], -x[1], x[2] - 80], atol=1e-6)
        d = numbers(si, *(f"direction_{axis}" for axis in "xyz"))
        np.testing.assert_allclose(numbers(row, *(f"direction_{axis}" for axis in "xyz")), d * [-1, -1, 1], atol=1e-9)


def test_distances_to_edges_are_those_to_the_sides_of_the_beam(results):
    for row in rows(results / "gauges.csv"):
        aside = np.minimum(x := numbers(row, "x_mm", "y_mm", "z_mm"), SIZE - x)
        normal = np.abs(numbers(row, "normal_x", "normal_y", "normal_z"))
        order = np.argsort(np.where(normal > 0.5, np.inf, aside))[:2]
        np.testing.assert_allclose(numbers(row, "edge_mm", "edge2_mm"), aside[order], atol=1e-6)
        # A gauge along x is across the sides that bound x and along the others.
        np.testing.assert_allclose(numbers(row, "edge_deg", "edge2_deg"), np.where(order == 0, 90, 0), atol=1e-9)


def test_the_universal_file_says_its_unit_and_has_the_same_places(results):
    units, _, nodes = (own for own in pyuff.UFF(str(results / "workshop.unv")).read_sets() if own["type"] in (164, 2420, 2411))
    assert units["length"] == pytest.approx(1000)
    x = np.array([numbers(row, "x_mm", "y_mm", "z_mm") for row in rows(results / "workshop.csv")])
    np.testing.assert_allclose(np.column_stack([nodes["x"], nodes["y"], nodes["z"]]), x, atol=1e-6)
    metres = pyuff.UFF(str(results / "gauges.unv")).read_sets(1)
    assert metres["length"] == 1.0


def test_the_page_has_them_too(results):
    page = (results / "report.html").read_text()
    table = page[page.index('data-table="gauges"') :]
    table = table[: table.index("</table>")]
    assert "x [mm]" in table
    assert "x [m]" not in page
    assert "the datum at (1000 0 80) mm of the deck, x along (-1 0 0), y along (0 -1 0)" in page
    for row in rows(results / "workshop.csv"):
        for name in ("x_mm", "y_mm", "edge_mm", "edge2_mm"):
            assert any(
                float(value) == pytest.approx(float(row[name]), abs=1e-6)
                for value in re.findall(r'<data value="([^"]+)"', table)
            )


@pytest.mark.parametrize(
    ("datum", "key"),
    [
        ("{x: [0, 0, 0]}", "report.datum.x"),
        ("{y: [0, 0, 0]}", "report.datum.y"),
        ("{x: [1, 1, 0], y: [-2, -2, 0]}", "report.datum.y"),
    ],
)
def test_axes_that_are_none_are_refused_with_their_key(beam, datum, key):
    with pytest.raises(ConfigError) as error:
        load_config(beam, [f"report.datum={datum}"])
    assert error.value.key == key

"""Names that stay: a channel means the gauge that was bonded, whatever a later placement calls G1."""

from __future__ import annotations

import csv
import warnings
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight import api
from strainsight.errors import UserError
from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.layout.gauge_list import deck_frame, layout_labels
from strainsight.experiment.layout.output import gauge_csv
from strainsight.experiment.layout.workshop import catman_table
from strainsight.experiment.structure.bonded_gauges import read_bonded
from strainsight.experiment.structure.candidates import fixed_gauges

from ..shared import slowly
from .tested_beam import KNOWN, changed, estimated, result

pytestmark = pytest.mark.usefixtures("no_hot_spots")

NAMES = ("G1", "G2", "G3", "G4")
BEFORE = "estimate.as_placed=false"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The beam with its modulus unknown, validated, and the file of where its gauges went."""
    folder = tmp_path_factory.mktemp("bonded")
    changed(folder, "test", KNOWN)
    (folder / "bonded.csv").write_bytes((folder / "results" / "test" / "gauges.csv").read_bytes())
    return folder


def lines(path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def rewritten(path, rows):
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    return path


def run(project, *settings):
    return estimated(project, project / "results" / "test" / "measured.csv", *settings)


def test_unnamed_gauges_are_numbered_past_the_names_that_are_taken():
    names = ["", "G2", "root", "", ""]
    assert layout_labels(names, np.array([3, 2, 0, 1, 4])) == ("G1", "root", "G3", "G2", "G4")


def test_a_name_of_the_layout_alone_does_not_report_where_a_gauge_was_bonded(project):
    code, said = run(project, BEFORE)
    assert code == 2
    assert "estimate.gauges_file" in said
    assert "the position where the gauge was bonded is unknown" in said


@pytest.mark.slow
def test_the_file_of_the_day_of_bonding_stands_for_the_layout(project):
    assert run(project)[0] == 0
    as_placed = result(project)["/smoothed/E"]
    code, said = run(project, BEFORE, "estimate.gauges_file=bonded.csv")
    assert code == 0, said
    np.testing.assert_array_equal(result(project)["/smoothed/E"], as_placed)


def test_the_file_that_every_placement_writes_anew_reports_of_no_gauge_where_it_was_bonded(project):
    code, said = run(project, BEFORE, f"estimate.gauges_file={project / 'results' / 'test' / 'gauges.csv'}")
    assert code == 2
    assert "gauges.csv in the results folder is overwritten with every new layout" in " ".join(said.split())


def test_a_layout_that_is_ranked_anew_is_refused_and_reports_where_the_gauge_was(project, tmp_path):
    """The file of the day of bonding has the places of G1 and G2 the other way round."""
    rows = lines(project / "bonded.csv")
    rows[0]["gauge"], rows[1]["gauge"] = "G2", "G1"
    file = rewritten(tmp_path / "other.csv", [rows[1], rows[0], *rows[2:]])
    code, said = run(project, BEFORE, f"estimate.gauges_file={file}")
    assert code == 2
    assert "estimate.channels.0.gauge" in said
    was = ", ".join(f"{float(rows[1][f'position_{axis}']):.4g}" for axis in "xyz")
    assert f"G1 was bonded at ({was}) m, but its position in the current layout is" in " ".join(said.split())


@pytest.mark.parametrize(("moved", "turned", "code"), [(2.1e-3, 0, 2), (0, 2.1, 2), *slowly((1.9e-3, 0, 0), (0, 1.9, 0))])
def test_a_gauge_may_have_been_bonded_one_sigma_off(project, tmp_path, moved, turned, code):
    """σ of a place is 2 mm and of a direction 2°."""
    rows = lines(project / "bonded.csv")
    rows[0]["position_x"] = str(float(rows[0]["position_x"]) + moved)
    angle = np.deg2rad(turned)
    rows[0]["direction_x"], rows[0]["direction_y"] = str(np.cos(angle)), str(np.sin(angle))
    file = rewritten(tmp_path / "other.csv", rows)
    found, said = run(project, BEFORE, f"estimate.gauges_file={file}")
    assert found == code, said
    assert code == 0 or ("was bonded at" if moved else "is rotated by 2.1°") in " ".join(said.split())


def test_a_changed_coordinate_that_is_not_used_is_an_error(project, tmp_path):
    rows = lines(project / "bonded.csv")
    was = float(rows[1]["y_m"])
    rows[1]["y_m"] = str(was + 0.01)
    code, said = run(project, BEFORE, f"estimate.gauges_file={rewritten(tmp_path / 'other.csv', rows)}")
    assert code == 2
    said = " ".join(said.split())
    what = f"y_m of G2 is {was + 0.01:.6g} m in line 3 of the file, but {was:.6g} m in the current layout"
    assert f"estimate.gauges_file: {what}; this column is not used" in said
    assert "Enter the bonded position in position_x, position_y and position_z [m], and set gauges.fixed_file" in said


@pytest.mark.parametrize(("column", "warned"), [("x_mm", True), ("x_mm", False), ("position_x", True)])
def test_a_coordinate_that_is_not_used_is_a_warning_for_fixed_gauges(tmp_path, column, warned):
    """The file is that of a model in mm with a gauge at 0.3 m, with one coordinate changed by 7 mm or not at all."""
    cells = {"position_x": 0.3, "x_mm": 300.0}
    cells[column] += warned * (7.0 if column == "x_mm" else 0.007)
    file = tmp_path / "bonded.csv"
    file.write_text(f"{HEAD},x_mm,y_mm,edge_mm\nG1,{cells['position_x']},0,0.095,1,0,0,{cells['x_mm']},0,95\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (entry,) = fixed_gauges(SimpleNamespace(fixed=(), grid_length=0.0), file)
    assert entry.position[0] == cells["position_x"]
    assert len(caught) == warned
    if warned:
        values = f"{cells['x_mm']:g} mm in line 2 of the file, but {1e3 * cells['position_x']:g} mm in position_x"
        assert f"gauges.fixed_file: x_mm of G1 is {values}" in str(caught[0].message)


@pytest.mark.slow
def test_bonded_gauges_keep_names_and_places_in_another_placement(project):
    """Another noise, another pool: the layout for them holds the bonded gauges, and the test says the same of the modulus, but
    that a gauge which is still to be bonded is expected to read σ²(ε − ε_t) less, for a turn of σ = 2°: (1 + ν)σ² of a bent
    beam, and 1 − (f/f₁)² of that in E."""
    assert run(project)[0] == 0
    modulus = result(project)["/smoothed/E"]
    bonded = "gauges.fixed_file=bonded.csv"
    code, said = run(project, BEFORE, bonded, "screen.keep=9")
    assert code == 0, said
    more = 1.3 * np.deg2rad(2.0) ** 2 * (1 - (20 / 39.4) ** 2)
    np.testing.assert_allclose(result(project)["/smoothed/E"] / modulus - 1, more, rtol=0.03)
    assert sorted(row["gauge"] for row in lines(project / "results" / "test" / "gauges.csv")) == list(NAMES)
    for own, was in zip(
        sorted(lines(project / "results" / "test" / "gauges.csv"), key=lambda row: row["gauge"]),
        lines(project / "bonded.csv"),
        strict=True,
    ):
        assert [float(own[f"position_{x}"]) for x in "xyz"] == pytest.approx([float(was[f"position_{x}"]) for x in "xyz"])


@pytest.mark.slow
def test_a_bonded_gauge_may_have_a_name_of_the_users(project):
    row = lines(project / "bonded.csv")[0]
    place, along = ([float(row[f"{vector}_{x}"]) for x in "xyz"] for vector in ("position", "direction"))
    fixed = f"gauges.fixed=[{{name: root, position: {place}, direction: {along}}}]"
    channels = "estimate.channels=[{channel: G1, gauge: root, unit: m/m}]"
    code, said = run(project, BEFORE, fixed, channels)
    assert code == 0, said
    assert result(project)["/gauge/label"].tolist() == ["root"]
    assert "root" in (project / "results" / "test" / "gauges.csv").read_text()


@pytest.mark.slow
def test_a_rosette_comes_back_from_its_file_as_it_was(project, tmp_path):
    rosettes = ["gauges.direction={type: axis, axis: [1, 0.2, 0], angles: [0, 45, 120]}", "gauges.rosette=true"]
    case = api.load(project / "test.yaml", [*rosettes, "place.keep=2"])
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    placed = api.place(case, mesh, reduced, training, api.screen(case, mesh, reduced, training))
    (project / "rosettes.csv").write_bytes(gauge_csv(placed.listed, Expectation({}, {}), mesh, deck_frame("mm")))
    channels = catman_table(placed.listed, SimpleNamespace(gauge_factor=2.0, resistance=120.0))
    table = csv.DictReader(StringIO(channels.decode()), delimiter="\t")
    assert [row["Name"] for row in table] == [f"{name} {angle}°" for name in ("G1", "G2") for angle in (0, 45, 120)]
    again = api.train(api.load(project / "test.yaml", [*rosettes, "gauges.fixed_file=rosettes.csv"]), mesh, reduced)
    assert again.name[:3] == ("G1", "G2", "")
    own, was = again.candidates, training.candidates
    at = was.channels(placed.gauges)
    np.testing.assert_allclose(own.position[:6], was.position[at], atol=1e-9)
    np.testing.assert_allclose(own.direction[:6], was.direction[at], atol=1e-9)
    np.testing.assert_allclose(again.rows[:6], training.rows[at], rtol=1e-6, atol=1e-9 * np.abs(training.rows).max())


HEAD = "gauge,position_x,position_y,position_z,direction_x,direction_y,direction_z"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file is empty"),
        ("gauge,x,y,z\nG1,0,0,0\n", "column missing: position_x"),
        (f"{HEAD}\nG1,0.3,0,0.095,1,0\n", "the line has 6 cells, but the header has 7"),
        (f"{HEAD}\nG1,0.3,nan,0.095,1,0,0\n", "is not a number"),
        (f"{HEAD}\nG1,0.3,0,0.095,0,0,0\n", "has zero length"),
        (f"{HEAD}\n,0.3,0,0.095,1,0,0\n", "gauge name is missing"),
        (f"{HEAD}\nG1,0.3,0,0.095,1,0,0\nG1,0.4,0,0.095,0,1,0\n", "different positions"),
    ],
)
def test_a_file_of_bonded_gauges_that_cannot_be_is_refused_with_its_line(tmp_path, text, says):
    (tmp_path / "bonded.csv").write_text(text)
    with pytest.raises(UserError) as error:
        read_bonded(tmp_path / "bonded.csv")
    assert says in error.value.what
    assert "bonded.csv" in (error.value.where or "")


@pytest.mark.parametrize(
    ("file", "settings", "says"),
    [
        (f"{HEAD},kind\nA1,0.3,0,0.095,0,0,1,accelerometer\n", (), "A1 has the kind 'accelerometer'"),
        (f"{HEAD}\nA1,0.3,0,0.5,1,0,0\n", (), "bonded gauge A1: the position is 0.405 m from the surface"),
        (
            f"{HEAD}\nA1,0.3,0,0.095,1,0,0\n",
            ("gauges.fixed=[{name: A1, position: [0.4, 0, 0.095], direction: [1, 0, 0]}]",),
            "two bonded gauges have the name A1",
        ),
        (
            f"{HEAD}\nA1,0.3,0,0.095,1,0,0\n",
            ("gauges.fixed=[{name: B1, position: [0.3, 0, 0.095], direction: [1, 0, 0]}]",),
            "bonded gauge A1: B1 has the same position and direction",
        ),
    ],
)
def test_bonded_gauges_that_cannot_be_are_refused(project, file, settings, says):
    (project / "wrong.csv").write_text(file)
    code, said = run(project, "gauges.fixed_file=wrong.csv", "place.keep=6", *settings)
    assert code == 2
    assert says in " ".join(said.split())
    assert "gauges.fixed" in said

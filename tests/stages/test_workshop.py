"""What the workshop and other programs get of a layout on a beam of 1000 × 100 × 80 mm, by hand geometry and other readers."""

from __future__ import annotations

import csv
import re
from io import StringIO

import h5py
import meshio
import numpy as np
import pytest
import pyuff
from pyyeti import nastran
from scipy.io import loadmat
from scipy.linalg import solve_continuous_are

from strainsight.cases.layout.exports.element_sets import abaqus_sets, nastran_sets
from strainsight.cases.structure.bonded_file import read_bonded
from strainsight.config.load import load_config
from strainsight.decks.reader import read_mesh
from strainsight.errors import ConfigError, DeckError

from ..robustness.small import write_project
from ..shared import UNSTUDIED, made

SIZE = np.array([1000.0, 100.0, 80.0])
DATUM = "report.datum={origin: [1000, 0, 80], x: [-1, 0, 0], y: [-1, -2, 0]}"
"""At the tip, on top, x back to the root: x' = 1000 − x, y' = −y, z' = z − 80."""
SHORT = (*UNSTUDIED, "validate.sweeps={}")


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


def test_the_new_columns_of_a_layout_change_nothing_of_what_is_read_of_it(results, tmp_path):
    """A file without them, as earlier versions wrote it, is the same to the last bit; workshop.csv is not taken for one."""
    given = rows(results / "gauges.csv")
    kept = [name for name in given[0] if not name.endswith(("_mm", "_deg")) or name == "angle_deg"]
    old = [{name: row[name] for name in kept} for row in given]
    with (tmp_path / "old.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, old[0])
        writer.writeheader()
        writer.writerows(old)
    assert len(given[0]) - len(old[0]) == 7
    new, before = read_bonded(results / "gauges.csv"), read_bonded(tmp_path / "old.csv")
    assert list(new) == list(before)
    for name in new:
        for field in ("position", "direction", "normal", "length", "kind"):
            np.testing.assert_array_equal(getattr(new[name], field), getattr(before[name], field))
    with pytest.raises(DeckError, match="no column position_x"):
        read_bonded(results / "workshop.csv")


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
    assert "nearest edges [mm]" in table
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


def test_every_gauge_has_its_sheet_as_a_file_and_on_the_page(results):
    page = (results / "report.html").read_text()
    assert "3 drawing sheets for the workshop" in page
    for row in rows(results / "workshop.csv"):
        text = (results / f"sheet-{row['gauge']}.svg").read_text()
        words = re.findall(r"<text[^>]*>([^<]*)</text>", text)
        x = numbers(row, "x_mm", "y_mm", "z_mm")
        assert words[-6:][:2] == [row["gauge"], "strain gauge"]
        assert {f"{value:g} mm".replace("-", "−") for value in x} <= set(words)
        assert {"deck beam.bdf", "(1000 0 80) mm", "(−1 0 0)", "(0 −1 0)"} <= set(words)
        # Seen along z the beam lies along x of the datum: both coordinates are dimensioned, if they are not 0.
        assert {f"{name} = {value:g}".replace("-", "−") for name, value in zip("xyz", x, strict=True) if value} <= set(words)
        assert {f"{numbers(row, name)[0]:g}" for name in ("edge_mm", "edge2_mm")} <= set(words)
        assert text[text.index(" viewBox") :].strip() in page


EXPORTS = "report.exports=[nastran, abaqus, catman, labview, mat]"
WIRED = ("report.gauge_factor=2.08", "report.resistance=350")


@pytest.fixture(scope="module")
def exported(beam):
    """The folder of a run with every export."""
    return made(beam, *SHORT, DATUM, EXPORTS, *WIRED)["report"].path.parent


def below(results):
    return {row["gauge"]: int(row["element"]) for row in rows(results / "workshop.csv")}


def test_another_reader_of_nastran_finds_the_elements(exported):
    sets = nastran.rdsets(str(exported / "gauges-nastran.inc"))
    own = below(exported)
    assert sets[9001] == sorted(set(own.values()))
    assert [sets[9002 + i] for i in range(len(own))] == [[element] for element in own.values()]


def test_another_reader_of_abaqus_finds_the_elements_below_the_mesh(exported, beam, tmp_path):
    """meshio's cells are the elements of the deck in order, counted from 0."""
    mesh = read_mesh(beam.parent / "beam.bdf")
    (block,) = mesh.blocks
    lines = ["*NODE", *(f"{i}, {x:.6f}, {y:.6f}, {z:.6f}" for i, (x, y, z) in zip(mesh.node_ids, mesh.position, strict=True))]
    lines.append("*ELEMENT, TYPE=C3D8")
    lines += [", ".join(map(str, (i, *mesh.node_ids[n]))) for i, n in zip(block.ids, block.nodes, strict=True)]
    text = (exported / "gauges-abaqus.inp").read_text()
    (tmp_path / "all.inp").write_text("\n".join(lines) + "\n" + text)
    sets = meshio.read(tmp_path / "all.inp").cell_sets
    own = below(exported)
    assert {f"GAUGE_{name}": [element] for name, element in own.items()} | {"GAUGES": sorted(set(own.values()))} == {
        name: block.ids[cells[0]].tolist() for name, cells in sets.items()
    }


def test_tables_of_channels_have_what_an_amplifier_asks_for(exported):
    def table(name):
        with (exported / name).open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream, delimiter="\t"))

    for i, row in enumerate(catman := table("channels-catman.txt"), start=1):
        assert (row["Channel"], row["Name"], row["Bridge"]) == (str(i), f"G{i}", "quarter")
        assert (row["Gauge factor"], row["Resistance [ohm]"], row["Unit"]) == ("2.08", "350", "um/m")
        # A quarter bridge of 1 mV/V: r = GF ε / 4.
        assert 2.08 * 1e-6 * float(row["um/m per mV/V"]) / 4 == pytest.approx(1e-3)
    assert len(catman) == 3
    for row in table("channels-labview.txt"):
        assert (row["Measurement type"], row["Strain configuration"]) == ("Strain", "Quarter Bridge I")


def test_the_model_in_matlab_is_the_one_that_the_layout_was_chosen_by(exported):
    """scipy's own Riccati solver gives tr(W P) of the layout; the response to the known load is the training peak."""
    found = loadmat(exported / "model.mat")
    with h5py.File(exported / "place.h5") as file:
        scale, weight = file["augmented/scale"][:], file["augmented/weight"][:]
        final = float(file["summary"].attrs["trace_final"])
    A, B, C, Q, R = (found[name] for name in "ABCQR")
    metric = []
    for k in range(A.shape[2]):
        S = scale[k]
        own = A[..., k] * S / S[:, None], C[..., k] * S, Q[..., k] / S / S[:, None]
        P = solve_continuous_are(own[0].T, own[1].T, own[2], R[..., k])
        metric.append(weight[k] @ np.diag(P))
    assert np.mean(metric) == pytest.approx(final, rel=1e-6)
    assert [str(name[0]) for name in found["states"].ravel()][-1] == "E"
    assert [str(name[0]) for name in found["state_units"].ravel()] == ["kg^1/2 m"] * 5 + ["kg^1/2 m/s"] * 5 + ["1"]
    assert [str(own.ravel()[0][0]) for own in (found["loads"], found["load_units"])] == ["tip", "N"]
    y = C[..., 0] @ np.linalg.solve(2j * np.pi * 20 * np.eye(len(A)) - A[..., 0], B[:, 0]) * 1e3
    peaks = [float(row["peak"]) for row in rows(exported / "gauges.csv")]
    # Of 50 samples a period the largest is at most 0.2 % below the amplitude.
    np.testing.assert_allclose(np.abs(y), peaks, rtol=2.5e-3)
    assert b"Created" not in (exported / "model.mat").read_bytes()[:116]


def test_sets_of_many_elements_are_wrapped_and_named_apart():
    many = {"a b": list(range(1, 400, 3)), "a_b": [7], "G1": [12345678, 99999999]}
    text = nastran_sets(many, "näme").decode()
    assert max(map(len, text.splitlines())) <= 72
    sets = nastran.rdsets(StringIO(text))
    assert list(sets.values())[1:] == list(many.values())
    names = re.findall(r"ELSET=(.*)", abaqus_sets(many, "run").decode())
    assert len({name.upper() for name in names}) == 4
    assert max(line.count(",") for line in abaqus_sets(many, "run").decode().splitlines()) < 16

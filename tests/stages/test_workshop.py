"""What the workshop and other programs get of a layout on a beam of 1000 × 100 × 80 mm, by hand geometry and other readers."""

from __future__ import annotations

import csv
import re
import shutil
from io import StringIO

import h5py
import meshio
import numpy as np
import pytest
import pyuff
from pyyeti import nastran
from scipy.io import loadmat
from scipy.linalg import solve_continuous_are

from strainsight.config.load import load_config
from strainsight.decks.reader import read_mesh
from strainsight.errors import ConfigError
from strainsight.experiment.layout.workshop import abaqus_sets, nastran_sets
from strainsight.records.mesh import mesh_from
from strainsight.runner.stage import Context
from strainsight.stages.report import exported, sheet_files, sheets_of, workshop_files, workshop_of_run

from ..edges.beam import TIP, bricks
from ..robustness.small import PLACEMENT
from ..shared import made

SIZE = np.array([1000.0, 100.0, 80.0])
DATUM = "report.datum={origin: [1000, 0, 80], x: [-1, 0, 0], y: [-1, -2, 0]}"
"""At the tip, on top, x back to the root: x' = 1000 − x, y' = −y, z' = z − 80."""


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The config of a beam whose deck is in mm, t and s."""
    folder = tmp_path_factory.mktemp("workshop")
    (folder / "beam.bdf").write_text(bricks((8, 2, 2), length=1e-3, mass=1e3))
    text = PLACEMENT.replace("length_unit: m, mass_unit: kg", "length_unit: mm, mass_unit: t").replace("1000,", f"{TIP},")
    (folder / "beam.yaml").write_text(re.sub(r"^estimate:.*?(?=^validate)", "", text, flags=re.MULTILINE | re.DOTALL))
    return folder / "beam.yaml"


EXPORTS = "report.exports=[nastran, abaqus, catman, labview, mat]"
WIRED = ("report.gauge_factor=2.08", "report.resistance=350")


@pytest.fixture(scope="module")
def results(beam, tmp_path_factory):
    """A folder with a layout and what `report` writes of it for the workshop and for other programs."""
    changes, folder = (DATUM, EXPORTS, *WIRED), tmp_path_factory.mktemp("results")
    upstream = made(beam, *changes, until="place")
    context, mesh = Context(load_config(beam, changes).model, upstream, {}, lambda *_: None), mesh_from(upstream["import"])
    shop = workshop_of_run(context, mesh)
    files = workshop_files(shop) | sheet_files(sheets_of(context, shop, mesh)) | exported(context, shop)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    for name in ("gauges.csv", "gauges.unv", "place.h5"):
        shutil.copy(upstream["place"].path.with_name(name), folder)
    return folder


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


@pytest.mark.parametrize("datum", ["{y: [0, 0, 0]}", "{x: [1, 1, 0], y: [-2, -2, 0]}"])
def test_axes_that_are_none_are_refused_with_their_key(beam, datum):
    with pytest.raises(ConfigError) as error:
        load_config(beam, [f"report.datum={datum}"])
    assert error.value.key == "report.datum.y"


def test_every_gauge_has_its_sheet(results):
    for row in rows(results / "workshop.csv"):
        words = re.findall(r"<text[^>]*>([^<]*)</text>", (results / f"sheet-{row['gauge']}.svg").read_text())
        x = numbers(row, "x_mm", "y_mm", "z_mm")
        # Seen along z the beam lies along x of the datum: both coordinates are dimensioned, if they are not 0.
        assert {f"{name} = {value:g}".replace("-", "−") for name, value in zip("xyz", x, strict=True) if value} <= set(words)
        assert {f"{numbers(row, name)[0]:g}" for name in ("edge_mm", "edge2_mm")} <= set(words)


def below(results):
    return {row["gauge"]: int(row["element"]) for row in rows(results / "workshop.csv")}


def test_another_reader_of_nastran_finds_the_elements(results):
    sets = nastran.rdsets(str(results / "gauges-nastran.inc"))
    own = below(results)
    assert sets[9001] == sorted(set(own.values()))
    assert [sets[9002 + i] for i in range(len(own))] == [[element] for element in own.values()]


def test_another_reader_of_abaqus_finds_the_elements_below_the_mesh(results, beam, tmp_path):
    """meshio's cells are the elements of the deck in order, counted from 0."""
    mesh = read_mesh(beam.parent / "beam.bdf")
    (block,) = mesh.blocks
    lines = ["*NODE", *(f"{i}, {x:.6f}, {y:.6f}, {z:.6f}" for i, (x, y, z) in zip(mesh.node_ids, mesh.position, strict=True))]
    lines.append("*ELEMENT, TYPE=C3D8")
    lines += [", ".join(map(str, (i, *mesh.node_ids[n]))) for i, n in zip(block.ids, block.nodes, strict=True)]
    text = (results / "gauges-abaqus.inp").read_text()
    (tmp_path / "all.inp").write_text("\n".join(lines) + "\n" + text)
    sets = meshio.read(tmp_path / "all.inp").cell_sets
    own = below(results)
    assert {f"GAUGE_{name}": [element] for name, element in own.items()} | {"GAUGES": sorted(set(own.values()))} == {
        name: block.ids[cells[0]].tolist() for name, cells in sets.items()
    }


def test_tables_of_channels_have_what_an_amplifier_asks_for(results):
    def table(name):
        with (results / name).open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream, delimiter="\t"))

    for i, row in enumerate(catman := table("channels-catman.txt"), start=1):
        assert (row["Channel"], row["Name"], row["Bridge"]) == (str(i), f"G{i}", "quarter")
        assert (row["Gauge factor"], row["Resistance [ohm]"], row["Unit"]) == ("2.08", "350", "um/m")
        # A quarter bridge of 1 mV/V: r = GF ε / 4.
        assert 2.08 * 1e-6 * float(row["um/m per mV/V"]) / 4 == pytest.approx(1e-3)
    assert len(catman) == 3
    for row in table("channels-labview.txt"):
        assert (row["Measurement type"], row["Strain configuration"]) == ("Strain", "Quarter Bridge I")


def test_the_model_in_matlab_is_the_one_that_the_layout_was_chosen_by(results):
    """scipy's own Riccati solver gives tr(W P) of the layout; the response to the known load is the training peak."""
    found = loadmat(results / "model.mat")
    with h5py.File(results / "place.h5") as file:
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
    peaks = [float(row["peak"]) for row in rows(results / "gauges.csv")]
    # Of 50 samples a period the largest is at most 0.2 % below the amplitude.
    np.testing.assert_allclose(np.abs(y), peaks, rtol=2.5e-3)
    assert b"Created" not in (results / "model.mat").read_bytes()[:116]


def test_sets_of_many_elements_are_wrapped_and_named_apart():
    many = {"a b": list(range(1, 400, 3)), "a_b": [7], "G1": [12345678, 99999999]}
    text = nastran_sets(many, "näme").decode()
    assert max(map(len, text.splitlines())) <= 72
    sets = nastran.rdsets(StringIO(text))
    assert list(sets.values())[1:] == list(many.values())
    names = re.findall(r"ELSET=(.*)", abaqus_sets(many, "run").decode())
    assert len({name.upper() for name in names}) == 4
    assert max(line.count(",") for line in abaqus_sets(many, "run").decode().splitlines()) < 16

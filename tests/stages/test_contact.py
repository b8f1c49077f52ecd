"""Parts that touch or are bolted: what import and init say of them, and where no gauge is put."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight import api
from strainsight.config.load import load_config
from strainsight.config.template import template
from strainsight.experiment.structure.mesh import contact_warnings, held_below
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.candidates import candidates
from strainsight.sensors.faces import faces_of
from strainsight.stages.suggestion import suggestion
from strainsight_cli.main import app

from ..bodies import body
from ..models import artefacts
from ..wrong.decks import config
from ..wrong.models import pair

ROOT = Path(__file__).parents[2]
LUG, DECK = ROOT / "configs" / "lug" / "lug-input.yaml", ROOT / "meshes" / "lug.bdf.gz"
SEAT = "mesh.faces={seat: {near: [-0.0036, -0.003, 0]}}"


@cache
def lug():
    """The mesh of the lug, its facets and faces."""
    mesh = api.mesh(api.load(LUG))
    facets = exterior_facets(mesh)
    return mesh, facets, faces_of(mesh.position, facets)


def warned(*changes):
    """Warnings of the import; a change of mesh.faces names faces of the same mesh."""
    case = api.load(LUG, ["gauges.exclude=[]", "gauges.surface=all", *changes])
    mesh, facets, faces = lug()
    if any(change.startswith("mesh.faces=") for change in changes):
        mesh = api.mesh(case)
    return list(contact_warnings(case.config, mesh, facets, faces))


@pytest.mark.slow
def test_the_import_reports_what_leaves_the_underside_out_and_then_no_more():
    (said,) = warned()
    assert said.startswith("the flat face of 0.023 m² at (0, 0, 0) m has 4 supported bores")
    lines = dict(part.split(": ", 1) for part in said.split("exclude it from gauges by ")[1].split(" and "))
    assert not warned(*(f"{key}={value}" for key, value in lines.items()))
    (named,) = warned(SEAT)
    assert named.endswith("exclude it from gauges by gauges.exclude: [seat]")
    assert not warned("gauges.surface=SET1-11")


@pytest.mark.slow
@pytest.mark.parametrize("seat", [True, False])
def test_each_gauge_on_that_face_reports_what_holds_it(seat):
    mesh, facets, _ = lug()
    pool = candidates(mesh, facets, None, (0.0,))
    below = pool.normal[:, 2] < -0.99
    below &= pool.position[:, 2] < 1e-9
    said = held_below(mesh, facets, pool)
    want = "the face at (0, 0, 0) m has 4 supported bores" if seat else ""
    assert below.any()
    assert {text for text, own in zip(said, below == seat, strict=True) if own} == {want}


@pytest.mark.slow
def test_init_leaves_it_out_as_the_warning_says_and_the_example_does():
    found = suggestion(DECK)
    (own,) = [place for place in found.places if place.lies_on]
    assert own.lies_on == "4 supported bores"
    text = template("lug.bdf.gz", found)
    assert "4 supported bores: contact face?" in text
    written = yaml.safe_load(text)
    (said,) = warned()
    assert said.endswith(f"mesh.faces: {{seat: {{near: {own.name}}}}} and gauges.exclude: [seat]")
    assert (written["mesh"]["faces"], written["gauges"]["exclude"]) == ({"seat": {"near": json.loads(own.name)}}, ["seat"])
    shipped = yaml.safe_load((LUG.parent / "lug-youngs-modulus.yaml").read_text())
    assert all(shipped[of][key] == written[of][key] for of, key in (("mesh", "faces"), ("gauges", "exclude")))


GIVEN = ("--direction", "0 0 1", "--amplitude", "1e3", "--frequency", "20")
WALL = "0, 0.135, 0.08"
"""A point of the top of the outer wall."""
SMALL = ["rom.modes=4", "rom.parameter_samples=1", "train.time_step=2e-3"]


def bolted(rise, *sets):
    """An Abaqus deck of half a ring, radius 0.03 to 0.15 m, 0.04 m thick, held in its bore; outer wall of rise × 0.02 m."""

    def chart(u, v, w):
        return 0.03 * (1 + u) * np.cos(np.pi * v / 12), 0.03 * (1 + u) * np.sin(np.pi * v / 12), 0.02 * w

    mesh = body("hex8", (4, 12, 2 + rise), chart, keep=lambda i, j, k: k < 2 or i == 3)
    x, rows = mesh.position, mesh.blocks[0].nodes
    ids = np.arange(1, len(x) + 1)
    bolt = ids[np.linalg.norm(x[:, :2], axis=1) < 0.031]
    lines = ["*NODE", *(f"{i}, {', '.join(map(repr, p))}" for i, p in zip(ids, x.tolist(), strict=True))]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=part"]
    lines += [f"{i}, {', '.join(map(str, 1 + row))}" for i, row in enumerate(rows, start=1)]
    for name, nodes in (("bolt", bolt), *((name, ids[:2]) for name in sets)):
        lines += [f"*NSET, NSET={name}", *(f"{node}," for node in nodes)]
    lines += ["*MATERIAL, NAME=steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850.,"]
    lines += ["*SOLID SECTION, ELSET=part, MATERIAL=steel", "*BOUNDARY", "bolt, 1, 3"]
    return "\n".join([*lines, ""])


@pytest.fixture
def init(tmp_path, monkeypatch):
    """init(deck, *options): exit code of `strainsight init`, its output, and the config that it wrote as text."""
    monkeypatch.chdir(tmp_path)

    def call(deck, *options, answers=None):
        (tmp_path / "ring.inp").write_text(deck)
        done = CliRunner().invoke(app, ["init", "ring.inp", "-o", "own.yaml", "--force", *GIVEN, *options], input=answers)
        assert done.exit_code == 0, done.output
        return (tmp_path / "own.yaml").read_text()

    return call


def heights(text, deck):
    """Of the candidates (m,) [m]."""
    return artefacts(text, *SMALL, until="train", files={"ring.inp": deck}, beside="bolted")["train"]["/gauges/position"][:, 2]


@pytest.mark.parametrize(("options", "sets", "name"), [((), (), "seat"), (("--axis", "1 0 0"), ("seat",), "seat-face")])
def test_the_face_that_a_part_stands_on_is_left_out(init, sets, name, options):
    text = init(bolted(2, *sets), "--load", WALL, *options)
    own = yaml.safe_load(text)
    assert own["gauges"]["exclude"][len(options) // 2 :] == [name]
    assert own["mesh"]["faces"].keys() == {"loaded", name}
    lines = [line for line in text.splitlines() if line.split("#")[0].strip() in (f"{name},", f"- {name}")]
    assert [line.split("# ← ")[1].split(";")[0] for line in lines] == ["probable contact face (1 supported bore)"]
    done = CliRunner().invoke(app, ["import", "own.yaml"])
    assert done.exit_code == 0, done.output
    assert "contact face" not in done.output


def test_no_candidate_lies_there_and_without_the_line_some_do(init, tmp_path):
    text = init(deck := bolted(2), "--load", WALL)
    assert heights(text, deck).min() > 1e-9
    (line,) = [line for line in text.splitlines() if line.split("#")[0].strip() == "seat,"]
    other = text.replace(f"{line}\n", "")
    (tmp_path / "own.yaml").write_text(other)
    assert load_config("own.yaml").model.gauges.exclude == ()
    assert heights(other, deck).min() < 1e-9


def test_a_face_that_the_user_has_named_is_not_written_twice(init):
    own = yaml.safe_load(init(bolted(2), "-i", answers="0.09, 0.09, 0\n\nn\n"))
    assert own["mesh"]["faces"] == {"loaded": {"near": [0.09, 0.09, 0]}}
    assert (own["loads"]["force"]["set"], own["gauges"]["exclude"]) == ("loaded", ["loaded"])


BETWEEN = "box: [[0.39, -1, -1], [0.41, 1, 1]]"
TIED = (
    f", faces: {{fine: {{normal: [-1, 0, 0], {BETWEEN}}}, coarse: {{normal: [1, 0, 0], {BETWEEN}}}}}, "
    "ties: [{type: surface, set: fine, to: coarse}]"
)


@pytest.mark.parametrize(
    ("cells", "mesh", "says", "gone"),
    [
        ((4, 1, 1), ", merge: 1.0e-6", "4 nodes were merged into others within 1e-06 m", "nodes coincide with"),
        ((4, 2, 2), TIED, "mesh.ties.0", "without belonging to them"),
    ],
    ids=["merged", "tied"],
)
def test_two_bars_end_to_end_become_one_part(tmp_path, cells, mesh, says, gone):
    (tmp_path / "deck.bdf").write_text(pair((0.4, 0.0, 0.0), cells))
    words = ["import", str(tmp_path / "own.yaml"), "--results", str(tmp_path / "results")]
    outputs = []
    for more in ("", mesh):
        (tmp_path / "own.yaml").write_text(config(mesh=more))
        done = CliRunner(env={"COLUMNS": "4000"}).invoke(app, words)
        assert done.exit_code == 0, done.output
        outputs.append(" ".join(done.output.split()))
    assert gone in outputs[0]
    assert says in outputs[1]
    assert gone not in outputs[1]

"""What `init` writes for a bolted part runs, and puts no gauge on the face that it is bolted to."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight_cli.main import app

from ..bodies import body
from ..models import artefacts

GIVEN = ("--direction", "0 0 1", "--amplitude", "1e3", "--frequency", "20")
WALL = "0, 0.135, 0.08"
"""A point of the top of the outer wall."""
SMALL = ["rom.modes=4", "rom.parameter_samples=1", "train.time_step=2e-3", "screen.keep=12", "place.keep=4", "place.instants=2"]


def bolted(rise, *sets, below=False):
    """An Abaqus deck of half a ring, radius 0.03 to 0.15 m, 0.04 m thick, held in its bore; outer wall of rise × 0.02 m.

    below: with another such part that it lies on, 0.02 m thick, without common nodes, held at its bottom.
    """

    def chart(u, v, w):
        return 0.03 * (1 + u) * np.cos(np.pi * v / 12), 0.03 * (1 + u) * np.sin(np.pi * v / 12), 0.02 * w

    mesh = body("hex8", (4, 12, 2 + rise), chart, keep=lambda i, j, k: k < 2 or i == 3)
    x, rows = mesh.position, mesh.blocks[0].nodes
    if below:
        other = body("hex8", (4, 12, 1), lambda u, v, w: chart(u, v, w - 1))
        x, rows = np.vstack([x, other.position]), np.vstack([rows, len(x) + other.blocks[0].nodes])
    ids = np.arange(1, len(x) + 1)
    bolt = ids[(np.linalg.norm(x[:, :2], axis=1) < 0.031) & (x[:, 2] > -0.01) | (x[:, 2] < -0.01)]
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
    """Of the gauges of the layout (k,) [m]."""
    place = artefacts(text, *SMALL, until="place", files={"ring.inp": deck}, beside="bolted")["place"]
    return place["/selected/final/position"][:, 2]


@pytest.mark.parametrize("options", [(), ("--axis", "1 0 0")])
@pytest.mark.parametrize(("sets", "name"), [((), "seat"), (("seat",), "seat-face")])
def test_the_face_that_a_part_stands_on_is_left_out(init, sets, name, options):
    text = init(bolted(2, *sets), "--load", WALL, *options)
    own = yaml.safe_load(text)
    assert own["gauges"]["exclude"][len(options) // 2 :] == [name]
    assert own["mesh"]["faces"].keys() == {"loaded", name}
    lines = [line for line in text.splitlines() if line.split("#")[0].strip() in (f"{name},", f"- {name}")]
    assert [line.split("# ← ")[1].split(":")[0] for line in lines] == ["held by 1 bore"]
    done = CliRunner().invoke(app, ["import", "own.yaml"])
    assert done.exit_code == 0, done.output
    assert "lies on something" not in done.output


def test_no_gauge_sits_there_and_without_the_line_some_do(init, tmp_path):
    text = init(deck := bolted(2), "--load", WALL)
    assert heights(text, deck).min() > 1e-9
    (line,) = [line for line in text.splitlines() if line.split("#")[0].strip() == "seat,"]
    other = text.replace(f"{line}\n", "")
    (tmp_path / "own.yaml").write_text(other)
    assert load_config("own.yaml").model.gauges.exclude == ()
    assert heights(other, deck).min() < 1e-9


def test_a_face_that_another_part_touches_is_picked_by_its_normal_too(init):
    """A point there is as near to one of them as to the other."""
    own = yaml.safe_load(init(bolted(2, below=True), "--load", WALL))
    normals = {name: tuple(face.get("normal", ())) for name, face in own["mesh"]["faces"].items() if name != "loaded"}
    assert (0, 0, -1) in normals.values()
    assert all(len(normal) == 3 for normal in normals.values())
    done = CliRunner().invoke(app, ["import", "own.yaml"])
    assert done.exit_code == 0, done.output
    assert "lies on something" not in done.output


def test_of_a_plate_one_side_is_left_out_and_the_other_named(init):
    """Both may lie on something. With both left out there would be places on its rims alone."""
    text = init(bolted(0), "--load", "node 1")
    own = yaml.safe_load(text)
    assert own["mesh"]["faces"].keys() == {"seat-1", "seat-2"}
    assert own["gauges"]["exclude"] == ["seat-1"]
    assert "    # seat-2,                     # the other side of the same bores: put it in if something lies there\n" in text
    assert {own["mesh"]["faces"][name]["near"][2] for name in ("seat-1", "seat-2")} == {0.0, 0.04}


@pytest.mark.parametrize("asked", [False, True])
def test_a_face_that_the_user_has_named_is_not_written_twice(init, asked):
    """Any point of the face says which it is."""
    below = "0.09, 0.09, 0"
    options = ("-i",) if asked else ("--load", below)
    own = yaml.safe_load(init(bolted(2), *options, answers=f"{below}\nn\n" if asked else None))
    assert own["mesh"]["faces"] == {"loaded": {"near": [0.09, 0.09, 0]}}
    assert (own["loads"]["force"]["set"], own["gauges"]["exclude"]) == ("loaded", ["loaded"])


def test_a_part_that_is_held_otherwise_has_no_such_face(init):
    text = init(bolted(2).replace("*BOUNDARY\nbolt, 1, 3\n", ""), "--load", WALL, "--held", "0.15, 0, 0.06")
    own = yaml.safe_load(text)
    assert own["mesh"]["faces"].keys() == {"held", "loaded"}
    assert "exclude" not in own["gauges"]
    assert "  # exclude: " in text

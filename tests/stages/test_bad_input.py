"""What a config or a deck asks for and cannot be is refused with file, line and key; a changed include is noticed."""

from __future__ import annotations

import re
import shutil

import pytest
from typer.testing import CliRunner

from strainsight import api
from strainsight.config.load import load_config
from strainsight.decks.reader import read_mesh
from strainsight.errors import ConfigError, StrainsightError, UserError
from strainsight_cli.main import app

from ..shared import ROOT
from .drawn_truths import beam_in

CONFIG = ROOT / "configs" / "cantilever-youngs-modulus.yaml"


def test_fewer_gauges_than_unknowns_is_refused_with_both_numbers():
    changes = ("loads.tip.known=false", "validate.initial_std.tip=0.1", "place.estimate=[E, tip]", "place.keep=1")
    with pytest.raises(ConfigError, match="2 unknown") as caught:
        load_config(CONFIG, changes)
    assert caught.value.key == "place.keep"


def test_a_changed_include_of_the_deck_is_noticed(tmp_path):
    """In a folder of mesh.include_dirs, as beside the deck."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "elsewhere").mkdir()
    text = (ROOT / "meshes" / "cantilever-coarse.bdf").read_text()
    deck = re.sub(r"^MAT1.*$", "INCLUDE '../elsewhere/steel.bdf'", text, flags=re.MULTILINE)
    (tmp_path / "meshes" / "cantilever.bdf").write_text(deck)
    (tmp_path / "elsewhere" / "steel.bdf").write_text("MAT1,1,2.1+11,,.3,7850.\n")
    (tmp_path / "configs").mkdir()
    config = shutil.copy(CONFIG, tmp_path / "configs")

    def command(name):
        words = [name, str(config), "--results", str(tmp_path / "results"), "--set", "mesh.include_dirs=[../elsewhere]"]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
        return done.output

    command("import")
    assert re.search(r"import +up to date", command("status"))
    (tmp_path / "elsewhere" / "steel.bdf").write_text("MAT1,1,2.0+11,,.3,7850.\n")
    assert "steel.bdf changed" in command("status")


PART = {"gauges.include": [{"box": [[0.1, -1, -1], [0.4, 1, 1]]}]}
RHO = {"property": "density", "region": 1, "guess": 7850, "range": [7000, 9000]}
TOGETHER = {
    "loads.tip.known": False,
    "place.estimate": ["tip", "E", "rho"],
    "place.keep": 3,
    "validate.initial_std": {"tip": 0.1, "E": 0.1, "rho": 0.1},
    "parameters.rho": RHO,
}


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"damping.ratio": 0.0, "loads.tip.direction": [0, 0, 1]}, "place.estimate", "add structural damping"),
        (TOGETHER, "place.estimate", "tip, E and rho together: fix or measure one of these unknowns"),
        ({"screen.keep": "all", "place.keep": 80, **PART}, "place.keep", "cannot keep 80 of the"),
    ],
)
def test_what_no_pool_can_do_is_refused_by_place(tmp_path, changes, key, says):
    beam = beam_in(tmp_path)(changes)
    with pytest.raises(StrainsightError, match=says) as caught:
        api.place(beam.case, beam.mesh, beam.reduced, beam.training, beam.screened)
    assert caught.value.key == key


@pytest.mark.parametrize("name", ["a.bdf", "a.bdf.gz", "a.inp", "a.msh", "a.vtu", "a.vtk", "a.med", "a.xyz"])
def test_a_binary_file_is_refused_by_name(tmp_path, name):
    (tmp_path / name).write_bytes(bytes(range(256)) * 40)
    with pytest.raises(UserError) as caught:
        read_mesh(tmp_path / name)
    assert name in str(caught.value)

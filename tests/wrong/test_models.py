"""Wrong models by their names: none is taken in silence, and what is said names the mistake. The decks they are made from have
no warning."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.cases.structure.mesh import mesh_of
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.stages.import_mesh import looked_at
from strainsight_cli.main import app

from .decks import bar, config, frame, inp, msh, plate
from .models import ABAQUS, AT_IMPORT, LATER, OF_PLIES, ON_PLATE, of_gmsh, plies


def written(folder: Path, deck: str, own: dict[str, str]) -> Path:
    (folder / own.get("file", "deck.bdf")).write_text(deck, encoding="utf-8")
    (folder / "own.yaml").write_text(config(**own), encoding="utf-8")
    return folder / "own.yaml"


def said_of(folder: Path, deck: str, own: dict[str, str]) -> tuple[str, ...]:
    """What `import` warns of, or the error that it ends with."""
    path = written(folder, deck, own)
    try:
        loaded = load_config(path).model
        assert isinstance(loaded, PlacementConfig)
        return looked_at(loaded, mesh_of(loaded.mesh, folder / loaded.mesh.file, base=folder))[2]
    except UserError as error:
        return (str(error),)


@pytest.mark.parametrize("name", AT_IMPORT)
def test_a_wrong_model_is_named_when_it_is_imported(name, tmp_path):
    deck, own, words = AT_IMPORT[name]
    said = said_of(tmp_path, deck, own)
    assert any(words in text for text in said), said


def test_gravity_that_no_load_of_the_config_takes_is_not_looked_at(tmp_path):
    for own, looked in (({}, False), ({"load": "deck_load: LOAD-7, factor: true"}, True)):
        path = written(tmp_path, bar("GRAV,7,,9810.,0.,0.,-1."), own)
        done = CliRunner().invoke(app, ["import", str(path), "--results", str(tmp_path / "results")])
        assert (done.exit_code, "pulls with 9810 m/s²" in done.output) == (0, looked)


@pytest.mark.parametrize("name", LATER)
def test_a_wrong_model_is_named_by_the_stage_that_meets_it(name, tmp_path):
    stage, deck, own, words = LATER[name]
    done = CliRunner().invoke(app, [stage, str(written(tmp_path, deck, own)), "--results", str(tmp_path / "results")])
    assert done.exit_code in (1, 2)
    assert words in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("deck", "own"),
    [
        (bar(), {}),
        (plate(), ON_PLATE),
        (plies("45.", "-45.", "-45.", "45."), OF_PLIES),
        (frame(), {}),
        (inp(), ABAQUS),
        (msh(), of_gmsh()),
    ],
)
def test_the_decks_they_are_made_from_have_no_warning(deck, own, tmp_path):
    assert said_of(tmp_path, deck, own) == ()


RECOVERY = "\n,.01,.01,-.01,.01,-.01,-.01,.01,-.01"
STUB = "GRID,60,,.405,0.,0.", "CBAR,50,2,5,60,0.,0.,1.", f"PBAR,2,1,1.-3,1.-7,1.-7,2.-7{RECOVERY}"


@pytest.mark.parametrize(
    "deck",
    [
        bar("GRAV,7,,9.81,0.,0.,-100."),
        bar("GRAV,7,,981.,0.,0.,-1."),
        bar("GRAV,7,,9.81,0.,0.,-1.", "LOAD,8,1000.,1.,7"),
        frame("CONM2,50,5,,50.", section="PBAR,1,1,4.-5,2.-10,1.-10,2.-10"),
        frame(*STUB),
        frame("SPC1,1,345,1,THRU,5", section="PBAR,1,1,4.-4,2.-8,1.-8"),
    ],
    ids=["gravity a hundred times", "as one number", "a load of a thousand times", "a heavy tip", "a stub of 5 mm", "in a plane"],
)
def test_what_is_unusual_and_sound_has_no_warning(deck, tmp_path):
    assert said_of(tmp_path, deck, {}) == ()


def test_there_are_sixty_and_more():
    assert len(AT_IMPORT) + len(LATER) >= 60

"""`import --strict` takes no warning, and `import` says what the model assumes."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight.stages.pages.assumed import ASSUMES
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from .decks import bricks, deck, frame, plate
from .models import ON_PLATE
from .test_models import written


def imported(folder, text, own, *flags):
    words = ["import", str(written(folder, text, own)), "--results", str(folder / "results"), *flags]
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.stderr


def assumed(folder):
    (table,) = [own for own in Artefact(folder / "results" / "own" / "import.h5").tables if own.title == ASSUMES]
    return {what: (count, detail) for what, count, detail in table.rows}


def test_warnings_end_a_strict_import_also_where_it_is_up_to_date(tmp_path):
    wrong = frame(section="PBAR,1,1,4.-4,2.-8,1.-8,2.-4"), {}
    code, said = imported(tmp_path, *wrong)
    assert (code, said.count("warning: "), said.count("is more than I1 + I2")) == (0, 1, 1)
    for _ in range(2):
        code, said = imported(tmp_path, *wrong, "--strict")
        assert code == 2
        assert "1 warning, and --strict takes none: region 1 (PBAR 1): J = 0.0002 m⁴ is more than I1 + I2" in said
        assert "own.yaml:3" in said


def test_a_sound_model_passes_it(tmp_path):
    assert imported(tmp_path, frame(), {}, "--strict") == (0, "")


def test_the_fate_of_cards_connections_and_masses_are_listed(tmp_path):
    parts = [*bricks(), *bricks(at=(0.4, 0.0, 0.0), first=101, element=101)]
    ties = "RBE2,90,5,123,101\nRBE2,91,10,123,106\nRBE2,92,15,123,111\nRBE2,93,20,123,116"
    lines = "PARAM,POST,-1", "TOPVAR,1", "PARAM,COUPMASS,-1"
    text = deck(*parts, "PSOLID,1,1", ties, "CONM2,95,105,,2.5", "CELAS2,60,1.+6,5,3,10,3", *lines)
    assert imported(tmp_path, text, {})[0] == 0
    found = assumed(tmp_path)
    assert found["card CHEXA"] == ("8", "read")
    assert found["card PARAM POST"] == ("1", "left out: it changes neither stiffness, mass nor supports")
    assert "card PARAM COUPMASS" not in found  # it counts
    assert found["card TOPVAR"] == ("1", "left out: what it does is not known here")
    assert found["parts that share no node"] == ("2", "1 with ties, relations and springs")
    assert found["nodes in one place that nothing joins"][0] == "0"
    assert found["rigid-body check: motions left"] == ("0", "")
    count, detail = found["rigid-body check: springs and relations between nodes"]
    assert (count, detail.partition(";")[0]) == ("1", "1 resist one")
    assert found["mass of region 1 PSOLID 1"][0] == f"{2 * 0.4 * 0.1 * 0.1 * 7850:.6g} kg"
    assert found["point masses"][0] == "2.5 kg"


def test_an_enforced_displacement_that_is_held_is_not_said_to_be_left_out(tmp_path):
    assert imported(tmp_path, deck(*bricks(), "PSOLID,1,1", "SPC,1,5,3,.01"), {})[0] == 0
    _, detail = assumed(tmp_path)["card ENFORCED DISPLACEMENT of another value than zero"]
    assert detail.startswith("not as the deck has it: the motion is held at zero")


@pytest.mark.parametrize(("turned", "free"), [((), "12"), ((3,), "12")])
def test_free_sides_of_shells_are_counted(tmp_path, turned, free):
    assert imported(tmp_path, plate(turned=turned), ON_PLATE)[0] == 0
    found = assumed(tmp_path)
    assert found["free sides of shells"] == (free, "0 sides have more than two shells")
    assert found["mass of region 1 PSHELL 1"][0] == f"{0.4 * 0.2 * 0.002 * 7850:.6g} kg"

"""`init` fills in what the deck says and what it is given, leaves the rest blank, and invents nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.deck_properties import Answers, CandidateLocation, LoadAnswer, Suggestion
from strainsight.config.load import load_config
from strainsight.config.template import template
from strainsight.errors import ConfigError
from strainsight_cli.main import app

from ..edges.beam import bricks
from ..strips import gmsh

LOAD = ("--direction", "0 0 1", "--amplitude", "1e3", "--frequency", "20")


@pytest.fixture
def init(tmp_path, monkeypatch):
    """init(*options, deck): exit code and output of `strainsight init beam.bdf`, whose config is own.yaml."""
    monkeypatch.chdir(tmp_path)

    def call(*options, text=None, answers=None):
        Path("beam.bdf").write_text(text or bricks((4, 2, 2)))
        done = CliRunner().invoke(app, ["init", "beam.bdf", "-o", "own.yaml", "--force", *options], input=answers)
        return done.exit_code, done.output + (done.stderr if done.exit_code else "")

    return call


def solids() -> str:
    lines, skip = [], False
    for line in bricks((4, 2, 2), tip=False).replace("SPC = 1\n", "").splitlines():
        skip = line.startswith("SPC1") or (skip and line.startswith(","))
        lines += [] if skip or line.startswith("MAT1") else [line]
    return "\n".join([*lines, ""])


def blanks() -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_config("own.yaml")
    return [problem.key for problem in (caught.value, *caught.value.others)]


def test_missing_answers_are_blank_and_listed(init):
    code, said = init()
    assert code == 0
    assert "fill in the blank lines" in said
    assert {*blanks()} == {f"loads.force.{key}" for key in ("set", "direction", "signal.amplitude")}
    assert init("--amplitude", "10", "--frequency", "5")[0] == 0
    assert {*blanks()} == {"loads.force", "loads.force.direction"}


def test_unsupported_cards_and_support_sets_are_listed(init):
    text = bricks((4, 2, 2)).replace("SPC = 1\n", "SUBCASE 1\nSPC = 1\nSUBCASE 2\nSPC = 7\n")
    text = text.replace("ENDDATA", "SPC1,7,3,1\nCQUAD,901,9,1,2,3,4\nCQUAD,902,9,1,2,3,4\nACCEL1,9\nENDDATA")
    assert init("--load", "node 900001", *LOAD, text=text)[0] == 0
    written = Path("own.yaml").read_text()
    assert re.search(r"#   ACCEL1 +# number: 1, first: beam.bdf:\d+\n  #   CQUAD +# number: 2, first: beam.bdf:\d+\n", written)

    def imported(*changes):
        text = written
        for old, new in changes:
            text = re.sub(old, new, text)
        Path("own.yaml").write_text(text)
        done = CliRunner().invoke(app, ["import", "own.yaml"])
        return done.exit_code, done.stderr

    chosen, ignored = (r"spc: +# ← active support set: 1, 7", "spc: 1"), (r"ignore: \[\]", "ignore: [ACCEL1, CQUAD]")
    assert "set mesh.spc to the support set of the model, for example mesh.spc: 1" in imported(ignored)[1]
    assert "mesh.ignore: [ACCEL1, CQUAD]" in imported(chosen)[1]
    assert imported(ignored, chosen)[0] == 0


@pytest.mark.parametrize("sign", ["\u2028", "\x85", "\n", '"', "\x7f"])
def test_a_name_of_the_deck_stays_a_name(sign):
    name = f"a{sign}  evil: 1"
    place = CandidateLocation("set", name, "4 nodes")
    found = Suggestion(places=(place,), unsupported=((name, 1, name),))
    config = yaml.safe_load(template(f"{name}.inp", found, Answers(loads=(LoadAnswer(place),))))
    assert config["mesh"]["file"] == f"{name}.inp"
    assert config["loads"]["force"]["set"] == name
    assert yaml.safe_load(template("a.inp", found))["loads"]["force"]["set"] is None


def test_config_with_load_option_is_complete(init):
    code, said = init("--load", "node 900001", *LOAD)
    assert (code, "check the lines marked" in said) == (0, True)
    config = load_config("own.yaml").model
    load = config.loads["force"]
    assert (load.node, load.direction, load.signal.amplitude, load.signal.frequency) == (900001, (0, 0, 1), 1e3, 20)
    assert config.place.estimate == ("E",)
    assert config.parameters["E"].guess == pytest.approx(2.1e11)


def test_load_can_be_the_unknown(init):
    assert init("--estimate", "load", "--load", "node 900001", *LOAD)[0] == 0
    config = load_config("own.yaml").model
    assert (config.place.estimate, dict(config.parameters), config.loads["force"].known) == (("force",), {}, False)


def test_faces_and_a_material_make_a_deck_of_solids_alone_whole(init):
    options = ("--material", "steel", "--support", "0, 0.05, 0.04", "--load", "[1, 0.05, 0.04]", *LOAD)
    assert init(*options, text=solids())[0] == 0
    config = load_config("own.yaml").model
    assert {name: face.near for name, face in config.mesh.faces.items()} == {"held": (0, 0.05, 0.04), "loaded": (1, 0.05, 0.04)}
    assert (config.mesh.supports[0].set, config.loads["force"].set) == ("held", "loaded")
    assert config.mesh.materials["material"].youngs_modulus == config.parameters["E"].guess == 2.1e11
    done = CliRunner().invoke(app, ["import", "own.yaml"])
    assert done.exit_code == 0, done.output


def test_a_deck_of_solids_alone_leaves_material_and_support_blank(init):
    assert init(*LOAD, text=solids())[0] == 0
    assert blanks() == [
        "mesh.materials.material.youngs_modulus",
        "mesh.materials.material.poisson_ratio",
        "mesh.materials.material.density",
        "parameters.E.guess",
        "parameters.E.range",
        "validate.truth.parameters.E",
        "mesh.faces.held.near",
        "loads.force.set",
    ]


def test_questions_fill_in_what_options_leave_open(init):
    code, said = init("-i", answers="1\n0 0\n0 0 -1\n1e3\nfast\n20\n\nn\n")
    assert code == 0, said
    assert "'0 0' is not a list of three numbers" in said
    assert "'fast' is not a positive number" in said
    load = load_config("own.yaml").model.loads["force"]
    assert (load.node, load.direction, load.signal.frequency) == (900001, (0, 0, -1), 20)
    assert init("-i", answers="\n\n\n\nn\n")[0] == 0
    assert {*blanks()} == {f"loads.force.{key}" for key in ("set", "direction", "signal.amplitude")}


def test_gravity_and_rotation_loads_of_deck_are_offered(init):
    text = bricks((4, 2, 2)).replace("ENDDATA", "GRAV,5,,9.81,0.,0.,-1.\nRFORCE,6,,,10.,0.,0.,2.\nENDDATA")
    assert init(*LOAD, text=text)[0] == 0
    written = Path("own.yaml").read_text()
    weight = r"deck_load: LOAD-5 +# gravity of 9.81 m/s² along \(0, 0, -1\), acts on the whole mass; set `factor: true`, "
    weight += "omit `direction`"
    assert re.search(f"#   {weight}", written)
    assert re.search(r"#   deck_load: LOAD-6 +# rotation at 125.7 rad/s about \(0, 0, 1\), acts on the whole mass", written)
    assert init("--load", "deck_load LOAD-5", "--frequency", "5", text=text)[0] == 0
    load = load_config("own.yaml").model.loads["LOAD-5"]
    assert (load.deck_load, load.factor, load.signal.amplitude, load.direction) == ("LOAD-5", True, 1.0, None)
    done = CliRunner().invoke(app, ["rom", "own.yaml"])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--load", "set tipp"), "the deck has no node set 'tipp'"),
        (("--load", "somewhere"), "--load  the deck has no load or set 'somewhere'"),
        (("--load", "1 2"), "--load  '1 2' is not a list of three numbers"),
        (("--frequency", "20 5"), "--frequency  '20 5' is not a frequency or a band"),
        (("--load", "node 5", "--amplitude", "1", "--amplitude", "2"), "--amplitude  2 values for 1 load"),
        (("--direction", "up"), "--direction  'up' is not a list of three numbers"),
        (("--amplitude", "inf"), "--amplitude  'inf' is not a positive number"),
        (("--direction", "0 0 0"), "--direction  '0 0 0' is a vector of length zero"),
        (("--material", "steel"), "--material  the deck already has materials"),
        (("--support", "0 0 0"), "--support  the deck already has supports"),
        (("--load", "node ²"), "'²' is not a node id"),
        (("--material", "cheese"), "--material  unknown material 'cheese'"),
        (("--material", "2e11, 0.5, 7850"), "is not a valid material"),
    ],
)
def test_an_answer_that_cannot_be_read_is_refused_with_its_option(init, options, what):
    code, said = init(*options)
    assert (code, what in said) == (2, True), said


@pytest.mark.parametrize(("size", "kind", "spacing"), [(1.0, "3/350", 0.0107), (0.1, "1.5/350", 0.0079), (0.05, None, 0.009)])
def test_the_type_of_gauge_is_one_whose_carrier_fits_the_part(init, size, kind, spacing):
    """The largest face of a beam of 1 × 0.1 m times the size is as a square of 316 mm times it: carriers of 10.7 and 7.9 mm are
    below a third of 316 and 32 mm, and none is of 16 mm."""
    assert init("--load", "node 900001", *LOAD, text=bricks((4, 2, 2), size=size))[0] == 0
    config = load_config("own.yaml").model
    assert (config.gauges.type, config.screen.minimum_spacing) == (kind, spacing)
    assert config.gauges.grid_length == ({"3/350": 0.00318, "1.5/350": 0.00157}[kind] if kind else 0.0)


def test_answers_that_end_before_the_questions_write_nothing(init, tmp_path):
    code, said = init("-i", answers="1\n")
    assert (code, "the input ended" in said) == (2, True), said
    assert not (tmp_path / "own.yaml").exists()


@pytest.mark.parametrize("name", ["1e5", "0x1F", "NULL", "it's", "2"])
def test_the_name_of_a_set_stays_text(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    written = template("a.bdf", Suggestion(), Answers(loads=(LoadAnswer(CandidateLocation("set", name, "a set"), "[0, 0, 1]"),)))
    Path("own.yaml").write_text(
        written.replace("amplitude: }", "amplitude: 1.0}"), encoding="utf-8"
    )
    assert load_config("own.yaml").model.loads["force"].set == name


def test_a_mesh_of_quadrangles_alone_asks_for_their_thickness(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("strip.msh").write_text(gmsh())
    options = ("--material", "steel", "--support", "set root", "--load", "set 1d-5", *LOAD)
    assert CliRunner().invoke(app, ["init", "strip.msh", "-o", "own.yaml", *options]).exit_code == 0
    written = Path("own.yaml").read_text()
    assert blanks() == ["mesh.sections.shells"]
    assert "← shells of the regions skin: thickness [m]" in written
    Path("own.yaml").write_text(written.replace("thickness: }", "thickness: 0.01}"))
    config = load_config("own.yaml").model
    assert config.mesh.supports[0].components == (1, 2, 3, 4, 5, 6)
    assert config.mesh.materials["material"].regions == (3,)
    done = CliRunner().invoke(app, ["import", "own.yaml"])
    assert (done.exit_code, "16 quad4" in done.output) == (0, True)

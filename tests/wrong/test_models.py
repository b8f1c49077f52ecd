"""Wrong models by their names, records with a mistake, `import --strict`, and parameters that have left their range."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.experiment.structure.early import check_files
from strainsight.experiment.structure.filtering import out_of_ranges, ranges_in_words
from strainsight.experiment.structure.mesh import mesh_of
from strainsight.experiment.structure.mesh_tables import ASSUMES
from strainsight.records.record import read
from strainsight.records.validated import Validated
from strainsight.runner.artefact import Artefact
from strainsight.stages.import_mesh import looked_at
from strainsight_cli.example import write
from strainsight_cli.main import app

from ..edges.beam import E, finished
from ..edges.beam import bricks as ranges_bricks
from ..stages.test_first_day import HISTORY, history
from .decks import bar, bricks, config, deck, frame, inp, msh, plate
from .models import ABAQUS, AT_IMPORT, LATER, OF_PLIES, ON_PLATE, of_gmsh, plies


def written(folder: Path, deck: str, own: dict[str, str]) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / own.get("file", "deck.bdf")).write_text(deck, encoding="utf-8")
    (folder / "own.yaml").write_text(config(**own), encoding="utf-8")
    return folder / "own.yaml"


def said_of(folder: Path, deck: str, own: dict[str, str]) -> tuple[str, ...]:
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
        assert (done.exit_code, "has an acceleration of 9810 m/s²" in done.output) == (0, looked)


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


def imported(folder, text, own, *flags):
    words = ["import", str(written(folder, text, own)), "--results", str(folder / "results"), *flags]
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.stderr


def assumed(folder):
    (table,) = [own for own in Artefact(folder / "results" / "own" / "import.h5").tables if own.title == ASSUMES]
    return {what: (count, detail) for what, count, detail in table.rows}


def test_warnings_end_a_strict_import_also_where_it_is_up_to_date(tmp_path):
    assert imported(tmp_path / "sound", frame(), {}, "--strict") == (0, "")
    wrong = frame(section="PBAR,1,1,4.-4,2.-8,1.-8,2.-4"), {}
    code, said = imported(tmp_path, *wrong)
    assert (code, said.count("warning: "), said.count("exceeds I1 + I2")) == (0, 1, 1)
    for _ in range(2):
        code, said = imported(tmp_path, *wrong, "--strict")
        assert code == 2
        assert "--strict does not permit 1 warning: region 1 (PBAR 1): J = 0.0002 m⁴ exceeds I1 + I2" in said
        assert "own.yaml:3" in said


def test_the_fate_of_cards_connections_and_masses_are_listed(tmp_path):
    parts = [*bricks(), *bricks(at=(0.4, 0.0, 0.0), first=101, element=101)]
    ties = "RBE2,90,5,123,101\nRBE2,91,10,123,106\nRBE2,92,15,123,111\nRBE2,93,20,123,116"
    lines = "PARAM,POST,-1", "TOPVAR,1", "PARAM,COUPMASS,-1"
    text = deck(*parts, "PSOLID,1,1", ties, "CONM2,95,105,,2.5", "CELAS2,60,1.+6,5,3,10,3", *lines)
    assert imported(tmp_path, text, {})[0] == 0
    found = assumed(tmp_path)
    assert found["card CHEXA"] == ("8", "read")
    assert found["card PARAM POST"] == ("1", "ignored: no effect on stiffness, mass or supports")
    assert "card PARAM COUPMASS" not in found  # it counts
    assert found["card TOPVAR"] == ("1", "ignored: effect unknown")
    assert found["parts without common nodes"] == ("2", "number of parts if ties, equations and springs count as connections: 1")
    assert found["coincident nodes that are not connected"][0] == "0"
    assert found["rigid-body check: free motions"] == ("0", "")
    count, detail = found["rigid-body check: springs and constraint equations between nodes"]
    assert (count, detail.partition(";")[0]) == ("1", "1 springs or equations resist a rigid-body motion")
    assert found["mass of region 1 PSOLID 1"][0] == f"{2 * 0.4 * 0.1 * 0.1 * 7850:.6g} kg"
    assert found["point masses"][0] == "2.5 kg"


def test_an_enforced_displacement_that_is_held_is_not_said_to_be_left_out(tmp_path):
    assert imported(tmp_path, deck(*bricks(), "PSOLID,1,1", "SPC,1,5,3,.01"), {})[0] == 0
    _, detail = assumed(tmp_path)["card ENFORCED DISPLACEMENT with a nonzero value"]
    assert detail.startswith("the model differs from the deck: the enforced displacement is set to zero")


def test_free_sides_of_shells_are_counted(tmp_path):
    assert imported(tmp_path, plate(turned=(3,)), ON_PLATE)[0] == 0
    found = assumed(tmp_path)
    assert found["free edges of shells"] == ("12", "edges with more than two shells: 0")
    assert found["mass of region 1 PSHELL 1"][0] == f"{0.4 * 0.2 * 0.002 * 7850:.6g} kg"


@pytest.mark.parametrize(("value", "said"), [(2.9e11, False), (3.1e11, True), (0.9e11, True)])
def test_it_is_named_with_its_range_and_the_key(tmp_path, value, said):
    (tmp_path / "own.yaml").write_text(config(), encoding="utf-8")
    model = SimpleNamespace(damping=SimpleNamespace(parameter=None))
    problem = SimpleNamespace(unknowns=SimpleNamespace(parameters=("E",)), model=model)
    beyond = out_of_ranges(load_config(tmp_path / "own.yaml").model, problem, {"E": value})
    words = "but the stage `rom` built the reduced model for values from 1e+11 to 3e+11"
    assert beyond == ({"E": f"E was estimated as {value:.4g} Pa, {words}"} if said else {})
    assert ranges_in_words({"E": ""}) == "parameters.E.range"


@pytest.mark.slow
def test_a_validation_withholds_sigma_there_and_says_it_first_and_on_the_page(tmp_path):
    changes = {"parameters.E.range": [E * (1 - 1e-9), E * (1 + 1e-9)], "parameters.E.guess": E, "place.certificate": False}
    found = finished(tmp_path, "report", ranges_bricks((4, 1, 1)), changes)
    summary = found["validate"].summary
    (page,) = tmp_path.rglob("report.html")
    assert "withheld" in page.read_text(encoding="utf-8")
    assert str(summary["out_of_range"]).startswith("σ is withheld: E was estimated as 2.")
    assert summary["verdict"] == "σ is withheld"
    assert not [key for key in summary if key.split(".")[0] in ("claim", "std", "smoothed_std")]
    own = read(Validated, found["validate"])
    for std in (*own.std.values(), *own.smoothed_std.values(), *own.noise.std.values(), own.gauge.std, own.field.std):
        assert np.isnan(std).all()


def said(folder: Path, *changes: tuple[str, str]) -> str:
    """What the files of the example contradict: the error, or else the warnings."""
    config = folder / "test.yaml"
    text = config.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    config.write_text(text, encoding="utf-8")
    loaded = load_config(config).model
    assert isinstance(loaded, PlacementConfig)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_files(loaded, folder)
        except UserError as error:
            return str(error)
    return " ".join(str(own.message) for own in caught)


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write("test", Path(), False)
    return tmp_path


def rows(folder: Path) -> tuple[str, np.ndarray]:
    head, *lines = (folder / "test.csv").read_text(encoding="utf-8").splitlines()
    return head, np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])


def rewrite(folder: Path, head: str, values: np.ndarray) -> None:
    lines = [head, *(",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in values)]
    (folder / "test.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_the_example_is_sound(project):
    assert said(project) == ""


@pytest.mark.parametrize("mark", [-9999.0, 99999.0])
def test_a_number_that_stands_for_a_missing_value_is_named_with_its_line_and_the_key(project, mark):
    head, values = rows(project)
    values[7:9, 1] = mark
    rewrite(project, head, values)
    found = said(project)
    assert "test.csv:9  estimate.channels.0" in found
    assert f"'G1' has the value {mark:g} um/m in 2 of" in found
    assert "this value marks missing samples" in found
    named = said(project, ("file: test.csv", f'file: test.csv\n  text: {{missing: ["{mark:.9g}"]}}'))
    assert named == ""


@pytest.mark.parametrize("level", [1e5, 9999.0])
def test_a_load_in_a_step_is_a_load(project, level):
    lines = HISTORY["f.csv"].splitlines()
    plateau = [line.partition(",")[0] + f",{level:g}" for line in lines[100:150]]
    (project / "f.csv").write_text("\n".join([*lines[:100], *plateau, *lines[150:]]) + "\n", encoding="utf-8")
    assert "missing value" not in said(project, history())


def test_a_noise_above_every_reading_is_warned_of(project):
    found = said(project, ("channel: G1,", "channel: G1, noise_std: 0.1,"))
    assert "the noise of G1, 0.1, exceeds its largest reading" in found
    assert "G2" not in found


def mark_among_large(values):
    values[:, 1] *= 3000.0 / np.nanmax(np.abs(values[:, 1]))
    values[[20, 40, 41], 1] = -32768.0


def mark_between_smooth(values):
    values[:, 1] = 2500.0 * np.sin(np.linspace(0.0, 20.0, len(values)))
    values[[20, 40, 41], 1] = -999.0


def marks_of_both_signs(values):
    values[20, 1], values[40, 1] = 9999.0, -9999.0


def dead_and_clipped(values):
    limit = 0.5 * np.nanmax(np.abs(values[:, 2]))
    values[:, 1], values[:, 2] = 12.0, np.clip(values[:, 2], -limit, limit)


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (mark_among_large, ["'G1' has the value -32768 um/m in 3 of"]),
        (mark_between_smooth, ["'G1' has the value -999 um/m in 3 of"]),
        (marks_of_both_signs, ["this value marks missing samples"]),
        (dead_and_clipped, ["G1 is constant in all", "G2 is clipped"]),
    ],
)
def test_readings_that_cannot_be_right_are_named(project, mistake, words):
    head, values = rows(project)
    mistake(values)
    rewrite(project, head, values)
    found = said(project)
    assert all(text in found for text in words)


def in_steps(values):
    values[:, 2] = np.repeat(10.0 * np.round(values[::20, 2] / 10.0), 20)[: len(values)]


def with_a_peak_of_999(values):
    values[:, 1] *= 999.0 / np.nanmax(np.abs(values[:, 1]))


@pytest.mark.parametrize(("unusual", "warned"), [(in_steps, "clipped"), (with_a_peak_of_999, "")])
def test_readings_that_happen_to_look_so_are_readings(project, unusual, warned):
    head, values = rows(project)
    unusual(values)
    rewrite(project, head, values)
    assert warned not in said(project) if warned else said(project) == ""


def test_strain_that_is_taken_for_um_per_m_is_below_all_amplifiers(project):
    head, values = rows(project)
    values[:, 1:] *= 1e-6
    rewrite(project, ",".join(name.partition(" [")[0] for name in head.split(",")), values)
    assert "below the amplifier resolution of 0.01 um/m" in said(project)


def test_a_clock_that_is_too_slow_for_a_load_is_warned_of(project):
    head, values = rows(project)
    rewrite(project, head, values[::40])
    assert "Increase the sampling rate" in said(project)


@pytest.mark.parametrize(("old", "new", "words"), [("0.010,", "0.009,", "occurs twice"), ("0.010,", "0.0004,", "decreases")])
def test_a_repeated_time_and_a_broken_clock_are_refused(project, old, new, words):
    text = (project / "test.csv").read_text(encoding="utf-8")
    assert text.count(f"\n{old}") == 1
    (project / "test.csv").write_text(text.replace(f"\n{old}", f"\n{new}"), encoding="utf-8")
    assert words in said(project)


def test_a_history_with_a_mark_is_refused_at_its_line(project):
    (project / "f.csv").write_text(HISTORY["f.csv"].replace("0.100,0.5000", "0.100,-9999"), encoding="utf-8")
    found = said(project, history())
    assert "f.csv:102  loads.tip.signal" in found
    assert "'F' has the value -9999" in found

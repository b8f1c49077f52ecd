"""What a config or a deck asks for and cannot be: exit code 2, one message with file, line and key, and no artefact."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight import api
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError, UserError
from strainsight_cli.main import app

from .drawn_truths import beam_in

ROOT = Path(__file__).parents[2]


@pytest.fixture
def project(tmp_path):
    """A copy of the example: configs/own.yaml beside meshes/cantilever.bdf."""
    (tmp_path / "configs").mkdir()
    (tmp_path / "meshes").mkdir()
    shutil.copy(ROOT / "configs" / "cantilever-youngs-modulus.yaml", tmp_path / "configs" / "own.yaml")
    shutil.copy(ROOT / "meshes" / "cantilever-coarse.bdf", tmp_path / "meshes" / "cantilever.bdf")
    return tmp_path


def change(path: Path, old: str, new: str) -> int:
    """Replace text that is there exactly once; its line number."""
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    return text[: text.index(old)].count("\n") + 1


def refused(project: Path, command: str = "run") -> str:
    done = CliRunner().invoke(
        app, [command, str(project / "configs" / "own.yaml"), "--results", str(project / "results")]
    )
    message = done.output + (done.stderr or "")
    assert done.exit_code == 2, message
    assert "Traceback" not in message
    return message


def written(project: Path) -> set[str]:
    return {path.name for path in (project / "results").rglob("*.h5")}


def test_a_structure_that_can_still_move_is_refused_by_the_names_of_its_motions(project):
    deck = project / "meshes" / "cantilever.bdf"
    lines = deck.read_text().splitlines()
    kept, dropping = [], False
    for line in lines:
        dropping = line.startswith("SPC1") or (dropping and line.startswith((" ", "+")))
        if not dropping and not line.strip().startswith("SPC ="):
            kept.append(line)
    deck.write_text("\n".join(kept) + "\n")
    line = change(project / "configs" / "own.yaml", "mesh: {file", "mesh: {file")
    message = refused(project, "rom")
    assert f"own.yaml:{line}:" in message
    for motion in ("translation x", "translation y", "translation z", "rotation"):
        assert motion in message
    assert "rom.h5" not in written(project)


def test_fewer_gauges_than_unknowns_is_refused_with_both_numbers(project):
    config = project / "configs" / "own.yaml"
    change(config, "known: true", "known: false")
    change(config, "initial_std: {E: 0.1}", "initial_std: {E: 0.1, tip: 0.1}")
    line = change(config, "estimate: [E], installation: ignore, keep: 4", "estimate: [E, tip], keep: 1")
    message = refused(project)
    assert f"own.yaml:{line}:" in message
    assert "place.keep" in message
    assert "2 unknown" in message
    assert not written(project)


def test_a_changed_include_of_the_deck_is_noticed(project):
    """In a folder of mesh.include_dirs, as beside the deck."""
    deck, config = project / "meshes" / "cantilever.bdf", str(project / "configs" / "own.yaml")
    lines = deck.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("MAT1"))
    (project / "elsewhere").mkdir()
    steel = project / "elsewhere" / "steel.bdf"
    steel.write_text("MAT1,1,2.1+11,,.3,7850.\n")
    lines[at] = "INCLUDE '../elsewhere/steel.bdf'"
    deck.write_text("\n".join(lines) + "\n")
    assert "name its folder" in refused(project, "import")
    change(project / "configs" / "own.yaml", "mass_unit: kg", "mass_unit: kg, include_dirs: [../elsewhere]")
    words = [config, "--results", str(project / "results")]
    assert CliRunner().invoke(app, ["import", *words]).exit_code == 0
    assert re.search(r"import +up to date", CliRunner().invoke(app, ["status", *words]).output)
    steel.write_text("MAT1,1,2.0+11,,.3,7850.\n")
    assert "steel.bdf changed" in CliRunner().invoke(app, ["status", *words]).output


def test_more_modes_than_the_model_has_is_refused_at_the_number_of_modes(project):
    line = change(project / "configs" / "own.yaml", "modes: 10", "modes: 20000")
    message = refused(project, "rom")
    assert f"own.yaml:{line}:" in message
    assert "rom.modes" in message


PART = {"gauges.include": [{"box": [[0.1, -1, -1], [0.4, 1, 1]]}]}
RHO = {"property": "density", "region": 1, "guess": 7850, "range": [7000, 9000]}


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"damping.ratio": 0.0, "loads.tip.direction": [0, 0, 1]}, "place.estimate", "give the structure damping"),
        (
            {
                "loads.tip.known": False,
                "place.estimate": ["tip", "E", "rho"],
                "place.keep": 3,
                "validate.initial_std": {"tip": 0.1, "E": 0.1, "rho": 0.1},
                "parameters.rho": RHO,
            },
            "place.estimate",
            "tip, E and rho together: fix one of them",
        ),
        ({"screen.keep": "all", "place.keep": 80, **PART}, "place.keep", "80 gauges"),
    ],
)
def test_what_no_pool_can_do_is_refused_by_place(tmp_path, changes, key, says):
    beam = beam_in(tmp_path)(changes)
    with pytest.raises(StrainsightError, match=says) as caught:
        api.place(beam.case, beam.mesh, beam.reduced, beam.training, beam.screened)
    assert caught.value.key == key


SENSELESS = (bytes(range(256)) * 40, b"", b" \n", b"\x1f\x8b\x08\x00broken", b"hello, mesh\n" * 30)


@pytest.mark.parametrize("name", ["a.bdf", "a.bdf.gz", "a.inp", "a.msh", "a.vtu", "a.vtk", "a.med", "a.xyz"])
def test_an_empty_a_binary_and_a_senseless_file_are_refused_by_name(tmp_path, name):
    """The last formats are read in a process of their own: one content each."""
    for content in SENSELESS if name.endswith(("bdf", "gz", "inp")) else SENSELESS[:1]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError) as caught:
            read_mesh(tmp_path / name)
        assert name in str(caught.value)


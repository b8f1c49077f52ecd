"""Every mistake of a user, in config and deck: exit code 2, one message with file, line and key, and no artefact."""

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


@pytest.mark.parametrize(
    ("old", "new", "key", "says", "by"),
    [
        ("region: 1", "region: PSOLID 2", "parameters.E.region", "PSOLID 1", "rom"),
        ("surface: all", "surface: topside", "gauges.surface", "topside", "train"),
    ],
)
def test_what_the_deck_contradicts_is_refused_by_the_stage_that_finds_it(project, old, new, key, says, by):
    line = change(project / "configs" / "own.yaml", old, new)
    message = refused(project, by)
    assert f"own.yaml:{line}:" in message
    assert key in message
    assert says in message
    assert f"{by}.h5" not in written(project)


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


def test_a_negative_modulus_in_the_deck_is_refused_with_its_line(project):
    deck = project / "meshes" / "cantilever.bdf"
    lines = deck.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("MAT1"))
    lines[at] = "MAT1,1,-2.1+11,,.3,7850."
    deck.write_text("\n".join(lines) + "\n")
    message = refused(project, "import")
    assert f"cantilever.bdf:{at + 1}" in message
    assert not written(project)


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


CONFIG = """\
kind: placement
name: own
mesh: {{file: {file}{more}}}
loads:
  tip: {{node: 4, direction: [0, 0, 1], known: true, signal: {{type: sine, frequency: 20.0, amplitude: 1.0}}}}
parameters: {{E: {{property: youngs_modulus, region: 1, guess: 2.0e11, range: [1.0e11, 3.0e11]}}}}
damping: {{type: modal, ratio: 0.01}}
train: {{duration: 1.0, time_step: 1.0e-3}}
gauges: {{direction: {{type: axis, axis: [1, 1, 1]}}, noise_std: {{value: 1.0e-7}}}}
place: {{estimate: [E], keep: 1}}
validate: {{time_step: 1.0e-3, duration: 1.0, initial_std: {{E: 0.1}}}}
"""

NASTRAN = """\
SOL 103
CEND
BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
GRID,5,,.5,0.,0.
GRID,6,,.5,.5,0.
GRID,7,,0.,.5,0.
GRID,8,,0.,0.,.5
GRID,9,,.5,0.,.5
GRID,10,,0.,.5,.5
GRID,20,,0.,0.,2.
CTETRA,10,1,1,2,3,4,5,6
,7,8,9,10
PSOLID,1,1
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,1,2,3
RBE2,30,20,123,4
ENDDATA
"""

ABAQUS = """\
*HEADING
a tetrahedron
*NODE, NSET=NALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4, ELSET=EALL
10, 1, 2, 3, 4
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, 0.3
*DENSITY
7850.
*BOUNDARY
1, 1, 3
2, 1, 3
3, 1, 3
"""

GMSH = """\
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 1 "steel"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
10 4 2 1 1 1 2 3 4
$EndElements
"""
STEEL = ", materials: {steel: {regions: all, youngs_modulus: 2.1e11, poisson_ratio: 0.3, density: 7850}}"


def imported(folder: Path, name: str, content: str | bytes, more: str = ""):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "own.yaml").write_text(CONFIG.format(file=name, more=more))
    done = CliRunner().invoke(app, ["import", str(folder / "own.yaml"), "--results", str(folder / "results")])
    return done.exit_code, done.output + (done.stderr or "")


@pytest.mark.parametrize(
    ("name", "content", "more"), [("a.bdf", NASTRAN, ""), ("a.inp", ABAQUS, ""), ("a.msh", GMSH, STEEL)]
)
def test_the_decks_that_are_broken_below_are_sound(tmp_path, name, content, more):
    code, message = imported(tmp_path, name, content, more)
    assert code == 0, message


@pytest.mark.parametrize(
    ("name", "text", "old", "new", "line", "says"),
    [
        ("a.bdf", NASTRAN, "SPC1,1,123,1,2,3\nRBE2,30,20,123,4\nENDDATA\n", "SPC1,1,1", 19, "cut off"),
        ("a.bdf", NASTRAN, "GRID,20,,0", "GRID,4,,0", 14, "node id 4 stands twice"),
        ("a.bdf", NASTRAN, "1,2,3,4,5,6", "1,2,3,44,5,6", 15, "node 44"),
        ("a.bdf", NASTRAN, "1,2,3,4,5,6\n,7,8,9,10", "1,2,3,7", 15, "of 1 solid elements 1 tet4 are flat or inverted: 10"),
        ("a.bdf", NASTRAN, "PSOLID,1,1\n", "PSOLID,1,2\n", 17, "material 2"),
        ("a.bdf", NASTRAN, "PSOLID,1,1\n", "INCLUDE 'a.bdf'\nPSOLID,1,1\n", 17, "includes itself"),
        ("a.bdf", NASTRAN, "PSOLID,1,1\n", "INCLUDE '../b.bdf'\nPSOLID,1,1\n", 17, "leaves the folder"),
        ("a.bdf", NASTRAN, "RBE2,30,20,123,4", "RBE2,30,20,123,4,3", 20, "node 3 is clamped"),
        ("a.inp", ABAQUS, "*ELASTIC\n2.1e11, 0.3\n", "*ELASTIC\n", 12, "*ELASTIC"),
        ("a.inp", ABAQUS, "TYPE=C3D4", "TYPE=C3D27", 8, "not supported"),
        ("a.inp", ABAQUS, "MATERIAL=STEEL\n", "MATERIAL=STEAL\n", 10, "'STEAL' is not in the deck"),
        ("a.msh", GMSH, "4 0 0 1\n$EndNodes\n", "4 0 0\n", 8, "truncated"),
        ("a.msh", GMSH, "4 0 0 1\n", "3 0 0 1\n", 13, "stands twice"),
        ("a.msh", GMSH, "10 4 2 1 1 1 2 3 4", "10 19 2 1 1 1 2 3 4 1 2 3 4 1 2 3 4 1", 17, "pyramid"),
    ],
)
def test_a_broken_deck_is_refused_at_its_line(tmp_path, name, text, old, new, line, says):
    assert text.count(old) == 1
    code, message = imported(tmp_path, name, text.replace(old, new), STEEL if name == "a.msh" else "")
    assert code == 2, message
    assert "Traceback" not in message
    assert re.search(rf"{re.escape(name)}:{line}(?!\d)", message), message
    assert says in message
    assert not list((tmp_path / "results").rglob("*.h5"))


SENSELESS = (bytes(range(256)) * 40, b"", b" \n", b"\x1f\x8b\x08\x00broken", b"hello, mesh\n" * 30)


@pytest.mark.parametrize("name", ["a.bdf", "a.bdf.gz", "a.inp", "a.msh", "a.vtu", "a.vtk", "a.med", "a.xyz"])
def test_an_empty_a_binary_and_a_senseless_file_are_refused_by_name(tmp_path, name):
    """The last formats are read in a process of their own: one content each."""
    for content in SENSELESS if name.endswith(("bdf", "gz", "inp")) else SENSELESS[:1]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError) as caught:
            read_mesh(tmp_path / name)
        assert name in str(caught.value)


def test_a_tie_of_the_config_on_a_clamped_node_is_refused_at_its_key(tmp_path):
    more = ", ties: [{type: rigid, reference: 900, at: [0, 0, 2], set: NALL}]"
    code, message = imported(tmp_path, "a.inp", ABAQUS, more)
    assert code == 2, message
    assert "own.yaml:3:" in message
    assert "mesh.ties" in message
    assert "node 1 is clamped in component 1" in message
    assert not list((tmp_path / "results").rglob("*.h5"))


def test_a_mesh_without_material_asks_for_one_in_the_config(tmp_path):
    code, message = imported(tmp_path, "a.msh", GMSH)
    assert code == 2
    assert "region 1 (steel) has no material" in message
    assert "mesh.materials" in message

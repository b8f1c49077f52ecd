"""Every mistake of a user: exit code 2, one message with file, line and key, and nothing written by the stage that found it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

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
    ("old", "new", "key", "says"),
    [
        ("keep: 4,", "kept: 4,", "place.kept", "did you mean"),
        ("length_unit: m,", "length_unit: meter,", "mesh.length_unit", "mm"),
        ("cantilever.bdf", "cantilevr.bdf", "mesh.file", "cantilevr.bdf"),
        ("keep: 4,", "keep: 101,", "place.keep", "100"),
        ("guess: 1.89e+11", "guess: -1.89e+11", "parameters.E.guess", "above 0"),
        ("estimate: [E], installation: ignore, keep: 4", "estimate: [E, tip], keep: 1", "place", "tip"),
        ("estimate: [E]", "estimate: [Ee]", "place.estimate", "E"),
        ("relative_to_strongest: 0.01", "relative_to_strongest: 0", "gauges.noise_std", "above 0"),
    ],
)
def test_what_the_config_alone_shows_is_refused_before_anything_is_written(project, old, new, key, says):
    line = change(project / "configs" / "own.yaml", old, new)
    message = refused(project)
    assert f"own.yaml:{line}:" in message
    assert key in message
    assert says in message
    assert not written(project)


@pytest.mark.parametrize(
    ("old", "new", "key", "says", "by"),
    [
        ("region: 1", "region: 7", "parameters.E.region", "no region 7", "rom"),
        ("region: 1", "region: PSOLID 2", "parameters.E.region", "PSOLID 1", "rom"),
        ("node: 2", "node: 3", "loads.tip", "node 3", "rom"),
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


def test_an_earlier_artefact_survives_a_stage_that_fails(project):
    runner, config = CliRunner(), str(project / "configs" / "own.yaml")
    assert runner.invoke(app, ["import", config, "--results", str(project / "results")]).exit_code == 0
    before = (project / "results" / "cantilever-youngs-modulus" / "import.h5").read_bytes()
    change(project / "meshes" / "cantilever.bdf", "MAT1", "$AT1")
    refused(project, "import")
    assert (project / "results" / "cantilever-youngs-modulus" / "import.h5").read_bytes() == before


@pytest.mark.parametrize("folder", ["meshes", "elsewhere"])
def test_a_changed_include_of_the_deck_is_noticed(project, folder):
    """Whether it lies beside the deck or in a folder of mesh.include_dirs."""
    deck, config = project / "meshes" / "cantilever.bdf", str(project / "configs" / "own.yaml")
    lines = deck.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("MAT1"))
    (project / folder).mkdir(exist_ok=True)
    steel = project / folder / "steel.bdf"
    steel.write_text("MAT1,1,2.1+11,,.3,7850.\n")
    lines[at] = f"INCLUDE '../{folder}/steel.bdf'"
    deck.write_text("\n".join(lines) + "\n")
    if folder == "elsewhere":
        assert "name its folder" in refused(project, "import")
        change(project / "configs" / "own.yaml", "mass_unit: kg", "mass_unit: kg, include_dirs: [../elsewhere]")
    words = [config, "--results", str(project / "results")]
    assert CliRunner().invoke(app, ["import", *words]).exit_code == 0
    assert re.search(r"import +up to date", CliRunner().invoke(app, ["status", *words]).output)
    steel.write_text("MAT1,1,2.0+11,,.3,7850.\n")
    assert "steel.bdf changed" in CliRunner().invoke(app, ["status", *words]).output


def test_a_deck_in_other_units_than_the_config_says_is_refused_by_its_modulus(project):
    """Taken as m-t-s, the deck's modulus is a thousand times the guess."""
    change(project / "configs" / "own.yaml", "mass_unit: kg", "mass_unit: t")
    message = refused(project, "rom")
    assert "parameters.E.guess" in message
    assert "mesh.mass_unit" in message
    assert "rom.h5" not in written(project)


def test_more_modes_than_the_model_has_is_refused_at_the_number_of_modes(project):
    line = change(project / "configs" / "own.yaml", "modes: 10", "modes: 20000")
    message = refused(project, "rom")
    assert f"own.yaml:{line}:" in message
    assert "rom.modes" in message


@pytest.mark.parametrize(
    ("overrides", "key", "says"),
    [
        (["damping.ratio=0.0"], "place.estimate", "give the structure damping"),
        (
            [
                "loads.tip.known=false",
                "place.estimate=[tip, E, rho]",
                "validate.initial_std={tip: 0.1, E: 0.1, rho: 0.1}",
                "parameters.rho={property: density, region: 1, guess: 7850, range: [7000, 9000]}",
            ],
            "place.estimate",
            "tip, E and rho together: fix one of them",
        ),
        (
            ["gauges.include=[{box: [[0.04, -1, -1], [0.3, 1, 1]]}]", "screen.keep=all", "place.keep=40"],
            "place.keep",
            "40 gauges",
        ),
    ],
)
def test_what_no_pool_can_do_is_refused_by_place(project, overrides, key, says):
    settings = [f"--set={text}" for text in ("train.duration=0.2", *overrides)]
    done = CliRunner().invoke(
        app, ["place", str(project / "configs" / "own.yaml"), "--results", str(project / "results"), *settings]
    )
    message = done.output + (done.stderr or "")
    assert done.exit_code == 2, message
    assert key in message
    assert says in message
    assert "place.h5" not in written(project)

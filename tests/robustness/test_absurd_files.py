"""Artefacts that are made up, or damaged by a byte: commands refuse or report them with the file and the remedy.

What the reader itself refuses is in tests/runner/test_store.py.
"""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.errors import ArtefactError
from strainsight.runner.artefact import Artefact, file_digest, seal
from strainsight_cli.main import app

from .small import BENCH, PLACEMENT

SHAPE = 12_345
"""A length that is found again among the bytes of a file."""


def claim(path: Path, count: int) -> None:
    """An array that says it is longer than it is, without a word from HDF5."""
    with h5py.File(path, "r+") as file:
        file["odd"] = np.zeros(SHAPE, dtype=np.int8)
    content, old = path.read_bytes(), struct.pack("<Q", SHAPE)
    assert old in content
    path.write_bytes(content.replace(old, struct.pack("<Q", count)))


def large_chunk(path: Path) -> None:
    """A gibibyte in one piece of a few hundred bytes, of which a few are claimed: as many as are stored."""
    with h5py.File(path, "r+") as file:
        create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        create.set_chunk((1 << 30,))
        create.set_deflate(9)
        space = h5py.h5s.create_simple((64,), (h5py.h5s.UNLIMITED,))
        item = h5py.h5d.create(file.id, b"odd", h5py.h5t.STD_I8LE, space, create)
        item.write_direct_chunk((0,), bytes(64))


def no_summary(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["summary"]


def command(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, words)
    assert "Traceback" not in done.output
    return done.exit_code, done.output + (done.stderr or "")


@pytest.mark.parametrize(
    "make",
    [lambda path: claim(path, 10**12), lambda path: claim(path, 2**63), large_chunk, no_summary],
    ids=["10¹² bytes", "2⁶³ bytes", "a large piece", "no summary"],
)
def test_a_run_that_starts_from_a_made_up_artefact_is_refused_with_its_name(make, placed, project, tmp_path):
    path = tmp_path / "results" / "odd" / "validate.h5"
    path.parent.mkdir(parents=True)
    shutil.copyfile(placed / "beam" / "place.h5", path)
    make(path)
    seal(path)
    for read in (Artefact, file_digest):
        with pytest.raises(ArtefactError) as caught:
            read(path)
        assert caught.value.where == str(path)
    own = project / "odd.yaml"
    own.write_text(PLACEMENT.replace("name: beam", "name: own").replace("guess: 1.9e+11", "guess: {from: odd}"))
    code, said = command("run", str(own), "--results", str(tmp_path / "results"))
    assert (code, str(path) in said) == (2, True), said
    assert not (tmp_path / "results" / "own").exists()


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 4
    path.write_bytes(content)


def test_a_damaged_stage_is_reported_and_written_anew(project, placed, tmp_path):
    results, config = tmp_path / "results", str(project / "beam.yaml")
    shutil.copytree(placed, results)
    path = results / "beam" / "screen.h5"
    flip(path, path.stat().st_size // 2)
    assert "screen.h5: the results file is damaged" in command("status", config, "--results", str(results))[1]
    code, said = command("screen", config, "--results", str(results))
    assert code == 0, said
    assert Artefact(path).digest == Artefact(placed / "beam" / "screen.h5").digest


GUESS = PLACEMENT.replace("name: beam", "name: guess").replace("guess: 1.9e+11", "guess: {from: beam}")
MEASURED = BENCH.replace("name: bench", "name: measured").replace(
    "estimate:\n", "estimate:\n  truth: {noise: false}\n  measured: {from: bench}\n"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["validate", "guess.yaml"], "beam/validate.h5"),
        (["estimate", "measured.yaml"], "bench/simulate.h5"),
        (["view", "beam.yaml", "--screenshot", "view.png"], "beam/place.h5"),
        (["figures", "beam.yaml"], "beam/validate.h5"),
    ],
)
def test_whoever_starts_from_another_run_is_refused(project, undisturbed, tmp_path, monkeypatch, words, file):
    results = tmp_path / "results"
    shutil.copytree(undisturbed, results)
    shutil.copytree(project, tmp_path / "project")
    monkeypatch.chdir(tmp_path / "project")
    for name, text in (("guess", GUESS), ("measured", MEASURED)):
        Path(f"{name}.yaml").write_text(text, encoding="utf-8")
    before = {path: path.read_bytes() for path in results.rglob("*") if path.is_file() and path != results / file}
    flip(results / file, -9)
    code, said = command(*words, "--results", str(results))
    assert code == 2, said
    assert f"{results / file}  the results file is damaged: the checksum does not match the content\n" in said
    assert "run the stage again to replace the file" in said
    assert before == {path: path.read_bytes() for path in results.rglob("*") if path.is_file() and path != results / file}

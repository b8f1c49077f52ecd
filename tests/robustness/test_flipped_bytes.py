"""One byte of an artefact flipped, anywhere: reported with the file and the remedy by whoever reads it, and mended by a run."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest, header_of
from strainsight.workflow.seal import BLOCK, MAGIC

from .small import BENCH, PLACEMENT
from .whole import LOG, compared, names

TRIES, SEED = 200, 5


def flips(artefacts: list[Path], count: int) -> list[tuple[Path, int, int]]:
    """Seeded (artefact, byte, what is flipped of it): every artefact in turn; the seal, the first of HDF5's own, or anywhere."""
    rng = np.random.default_rng(SEED)
    found = []
    for i in range(count):
        path = artefacts[i % len(artefacts)]
        start, end = ((0, BLOCK), (BLOCK, 3 * BLOCK), *[(0, path.stat().st_size)] * 3)[i % 5]
        found.append((path, int(rng.integers(start, end)), int(rng.integers(1, 256))))
    return found


def flipped(path: Path, place: int, bits: int) -> None:
    with path.open("r+b") as stream:
        stream.seek(place)
        byte = stream.read(1)[0]
        stream.seek(place)
        stream.write(bytes([byte ^ bits]))


def test_whoever_reads_it_is_given(undisturbed, tmp_path):
    """None of the tries reads other numbers than were written, or any at all."""
    artefacts = sorted(undisturbed.glob("*/*.h5"))
    assert len(artefacts) == 19
    for path, place, bits in flips(artefacts, TRIES):
        copy = tmp_path / path.name
        shutil.copyfile(path, copy)
        flipped(copy, place, bits)
        for read in (Artefact, header_of):
            with pytest.raises(ArtefactError, match=r"is damaged: |not written by strainsight") as caught:
                read(copy)
            assert caught.value.where == str(copy)
            assert caught.value.remedy
        # As an input of another run: refused, or another file, where it does not even begin as an artefact.
        if place >= len(MAGIC):
            with pytest.raises(ArtefactError):
                file_digest(copy)


def test_a_run_says_so_and_writes_it_anew(project, undisturbed, tmp_path, launcher):
    """A stage of each kind, and a file beside one."""
    results, says = tmp_path / "results", tmp_path / "says"
    shutil.copytree(undisturbed, results)
    for run, stage in (("beam", "screen"), ("beam", "modes"), ("bench", "simulate")):
        path = results / run / f"{stage}.h5"
        flipped(path, path.stat().st_size // 2, 1)
        config = str(project / f"{run}.yaml")
        launcher.start(["status", config, "--results", str(results)], says)
        assert launcher.end() == 0
        assert f"{stage}.h5: the results file is damaged" in says.read_text()
        launcher.start([stage, config, "--results", str(results)], says)
        assert launcher.end() == 0, says.read_text()
    (results / "bench" / "loads.csv").write_bytes((results / "bench" / "loads.csv").read_bytes()[:-1])
    launcher.start(["estimate", str(project / "bench.yaml"), "--results", str(results)], says)
    assert launcher.end() == 0, says.read_text()
    assert "loads.csv was altered" in (results / "bench" / LOG).read_text()
    for run in ("beam", "bench"):
        assert set(compared(results / run, undisturbed / run)) == names(undisturbed / run)


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["validate", "guess.yaml"], "beam/validate.h5"),
        (["estimate", "measured.yaml"], "bench/simulate.h5"),
        (["view", "beam.yaml", "--screenshot", "view.png"], "beam/place.h5"),
        (["figures", "beam.yaml"], "beam/validate.h5"),
    ],
)
def test_whoever_starts_from_another_run_is_refused(project, undisturbed, tmp_path, launcher, words, file):
    results, says = tmp_path / "results", tmp_path / "says"
    shutil.copytree(undisturbed, results)
    shutil.copytree(project, tmp_path / "project")
    command, config, *more = words
    guess = PLACEMENT.replace("name: beam", "name: guess").replace("guess: 1.9e+11", "guess: {from: beam}")
    (tmp_path / "project" / "guess.yaml").write_text(guess, encoding="utf-8")
    measured = BENCH.replace("name: bench", "name: measured").replace(
        "estimate:\n", "estimate:\n  truth: {noise: false}\n  measured: {from: bench}\n"
    )
    (tmp_path / "project" / "measured.yaml").write_text(measured, encoding="utf-8")
    more = [word if word.startswith("-") else str(tmp_path / word) for word in more]
    before = {path: path.read_bytes() for path in results.rglob("*") if path.is_file()}
    flipped(results / file, (results / file).stat().st_size - 9, 4)
    launcher.start([command, str(tmp_path / "project" / config), "--results", str(results), *more], says)
    assert launcher.end() == 2, says.read_text()
    said = says.read_text()
    assert f"{results / file}  the results file is damaged: its checksum is not the one it was written with\n" in said
    assert "run again: a damaged artefact is written anew" in said
    assert "Traceback" not in said
    after = {path: path.read_bytes() for path in results.rglob("*") if path.is_file() and path != results / file}
    assert after == {path: content for path, content in before.items() if path != results / file}

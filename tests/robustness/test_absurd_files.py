"""Artefacts that are made up, or damaged by a byte: refused or reported with the file and the remedy."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest, header_of
from strainsight.workflow.seal import BLOCK, MAGIC, seal
from strainsight_cli.main import app

from .small import BENCH, PLACEMENT
from .whole import LOG, compared, names

LIMIT, SECONDS = 256 << 20, 60.0
OPENED = """
import json, re, resource, sys
from pathlib import Path
from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest, header_of

def kib(what):
    return int(re.search(what + r":\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

limit = 1024 * kib("VmSize") + int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
for path in map(Path, sys.argv[2:]):
    said = {}
    for read in (header_of, Artefact, file_digest):
        try:
            read(path)
        except ArtefactError as error:
            said[read.__name__] = str(error)
    print(json.dumps([path.name, said]), flush=True)
"""
ABSURD = 10**12
SHAPE = 12_345
"""A length that is found again among the bytes of a file."""


def changed(change: Callable[[h5py.File, Path], object]) -> Callable[[Path, Path], object]:
    """What another program can do to a file."""

    def made(path: Path, other: Path) -> None:
        with h5py.File(path, "r+") as file:
            change(file, other)

    return made


def claimed(count: int, attribute: bool = False) -> Callable[[Path, Path], object]:
    """An array that says it is longer than it is, without a word from HDF5."""

    def made(path: Path, other: Path) -> None:
        with h5py.File(path, "r+") as file:
            array = np.zeros(SHAPE, dtype=np.int8)
            if attribute:
                file["summary"].attrs["odd"] = array
            else:
                file["odd"] = array
        content, old = path.read_bytes(), struct.pack("<Q", SHAPE)
        assert old in content
        path.write_bytes(content.replace(old, struct.pack("<Q", count)))

    return made


def large_chunk(file: h5py.File, other: Path) -> None:
    """A gibibyte in one piece of a few hundred bytes, of which a few are claimed: as many as are stored."""
    create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    create.set_chunk((1 << 30,))
    create.set_deflate(9)
    space = h5py.h5s.create_simple((64,), (h5py.h5s.UNLIMITED,))
    item = h5py.h5d.create(file.id, b"odd", h5py.h5t.STD_I8LE, space, create)
    item.write_direct_chunk((0,), bytes(64))


def one_and_the_same(file: h5py.File, other: Path) -> None:
    """Data that is there once and read ten thousand times."""
    file["odd/0"] = np.zeros(100_000)
    for i in range(1, 10_000):
        file[f"odd/{i}"] = file["odd/0"]


def deep(file: h5py.File, other: Path) -> None:
    file.create_group("/".join("a" * 400))


def brackets(file: h5py.File, other: Path) -> None:
    file.attrs["config"] = "[" * 30_000


def many_words(file: h5py.File, other: Path) -> None:
    """Text of any length, kept outside of what is claimed."""
    file.create_dataset("odd", data=["x" * 10_000] * 10, dtype=h5py.string_dtype())


def virtual(file: h5py.File, other: Path) -> None:
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "secret", (3,))
    file.create_virtual_dataset("odd", layout)


FILES = {
    **{
        f"version {version!r}": changed(lambda file, _, version=version: file.attrs.__setitem__("format_version", version))
        for version in (0, 2, "1", np.nan)
    },
    "no version": changed(lambda file, _: file.attrs.__delitem__("format_version")),
    "other format": changed(lambda file, _: file.attrs.__setitem__("format", "strainsight2")),
    "no digest": changed(lambda file, _: file.attrs.__delitem__("digest")),
    "no config": changed(lambda file, _: file.attrs.__setitem__("config", "{")),
    "config of brackets": changed(brackets),
    "external link": changed(lambda file, other: file.__setitem__("odd", h5py.ExternalLink(str(other), "/secret"))),
    "soft link": changed(lambda file, _: file.__setitem__("odd", h5py.SoftLink("/summary"))),
    "soft link to itself": changed(lambda file, _: file.__setitem__("odd", h5py.SoftLink("/odd"))),
    "ring": changed(lambda file, _: file.__setitem__("odd/a", file["/"])),
    "deep": changed(deep),
    "external storage": changed(lambda file, other: file.create_dataset("odd", (4,), "f8", external=[(str(other), 0, 32)])),
    "virtual": changed(virtual),
    "10¹² never written": changed(lambda file, _: file.create_dataset("odd", (ABSURD,), "f8", fillvalue=1.0)),
    "10¹² in pieces": changed(lambda file, _: file.create_dataset("odd", (ABSURD,), "f8", chunks=(1 << 17,))),
    "10¹² claimed": claimed(ABSURD),
    "2⁶³ claimed": claimed(2**63),
    "10¹² claimed by an attribute": claimed(ABSURD, attribute=True),
    "packed": changed(lambda file, _: file.create_dataset("odd", data=np.zeros(10**7), compression="gzip")),
    "a large piece": changed(large_chunk),
    "one and the same": changed(one_and_the_same),
    "long words": changed(many_words),
    "references": changed(lambda file, _: file.create_dataset("odd", data=file.ref, dtype=h5py.ref_dtype)),
    "no tables": changed(lambda file, _: file.__delitem__("tables")),
    "no summary": changed(lambda file, _: file.__delitem__("summary")),
    "nothing but the seal": lambda path, _: path.write_bytes(bytes(BLOCK)),
    "text": lambda path, _: path.write_bytes(path.read_bytes()[:BLOCK] + b"x" * 9000),
}


@pytest.fixture(scope="module")
def files(placed, tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("absurd")
    other = folder / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones(3)
    good = (placed / "beam" / "place.h5").read_bytes()
    made = []
    for name, make in FILES.items():
        path = folder / f"{name}.h5"
        path.write_bytes(good)
        make(path, other)
        seal(path)
        made.append(path)
    for end in map(int, np.random.default_rng(6).integers(BLOCK, len(good), 6)):
        for name, again in (("sealed", True), ("cut", False)):
            path = folder / f"{name} {end}.h5"
            path.write_bytes(good[:end])
            if again:
                seal(path)
            made.append(path)
    return made


def test_every_one_is_refused_with_its_name_within_the_memory_of_a_small_one(files):
    done = subprocess.run(
        [sys.executable, "-c", OPENED, str(LIMIT), *map(str, files)],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert (done.returncode, len(told)) == (0, len(files)), (told[-1:], done.stderr)
    for path, (name, said) in zip(files, told, strict=True):
        assert path.name == name
        assert {"Artefact", "file_digest"} <= said.keys(), (name, said)
        for message in said.values():
            assert message.startswith(f"{path}  ")
            assert "\n    " in message


def command(*words: str) -> tuple[int, str]:
    """Exit code and words of a command in this process."""
    done = CliRunner().invoke(app, words)
    assert "Traceback" not in done.output
    return done.exit_code, done.output + (done.stderr or "")


@pytest.mark.parametrize("name", ["10¹² claimed", "external link"])
def test_a_run_that_starts_from_one_is_refused(name, files, project, tmp_path):
    (path,) = (path for path in files if path.stem == name)
    (tmp_path / "results" / "odd").mkdir(parents=True)
    shutil.copyfile(path, tmp_path / "results" / "odd" / "validate.h5")
    own = project / "odd.yaml"
    own.write_text(PLACEMENT.replace("name: beam", "name: own").replace("guess: 1.9e+11", "guess: {from: odd}"))
    code, said = command("run", str(own), "--results", str(tmp_path / "results"))
    assert code == 2
    assert str(tmp_path / "results" / "odd" / "validate.h5") in said
    assert not (tmp_path / "results" / "own").exists()


TRIES, SEED = 60, 5


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


def test_a_flipped_byte_is_found_by_every_reader(placed, tmp_path):
    """None of the tries reads other numbers than were written, or any at all."""
    artefacts = sorted(placed.glob("*/*.h5"))
    assert len(artefacts) == 7
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


def test_a_damaged_stage_is_reported_and_written_anew(project, placed, tmp_path):
    results, config = tmp_path / "results", str(project / "beam.yaml")
    shutil.copytree(placed, results)
    path = results / "beam" / "screen.h5"
    flipped(path, path.stat().st_size // 2, 1)
    assert "screen.h5: the results file is damaged" in command("status", config, "--results", str(results))[1]
    code, said = command("screen", config, "--results", str(results))
    assert code == 0, said
    assert Artefact(path).digest == Artefact(placed / "beam" / "screen.h5").digest


@pytest.mark.slow
def test_a_damaged_stage_of_a_bench_and_a_changed_table_are_written_anew(project, undisturbed, tmp_path):
    results, config = tmp_path / "results", str(project / "bench.yaml")
    shutil.copytree(undisturbed, results)
    path = results / "bench" / "simulate.h5"
    flipped(path, path.stat().st_size // 2, 1)
    assert command("simulate", config, "--results", str(results))[0] == 0
    (results / "bench" / "loads.csv").write_bytes((results / "bench" / "loads.csv").read_bytes()[:-1])
    assert command("estimate", config, "--results", str(results))[0] == 0
    assert "loads.csv was altered" in (results / "bench" / LOG).read_text()
    assert set(compared(results / "bench", undisturbed / "bench")) == names(undisturbed / "bench")


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
    flipped(results / file, (results / file).stat().st_size - 9, 4)
    code, said = command(*words, "--results", str(results))
    assert code == 2, said
    assert f"{results / file}  the results file is damaged: its checksum is not the one it was written with\n" in said
    assert "run again: a damaged artefact is written anew" in said
    assert before == {path: path.read_bytes() for path in results.rglob("*") if path.is_file() and path != results / file}

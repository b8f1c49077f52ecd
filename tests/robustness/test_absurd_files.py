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

from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest, header_of
from strainsight.workflow.seal import BLOCK, MAGIC, seal

from .small import BENCH, PLACEMENT
from .whole import LOG, compared, names

LIMIT, SECONDS = 256 << 20, 60.0
OPENED = """
import json, re, resource, sys, time
from pathlib import Path
from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest, header_of

def kib(what):
    return int(re.search(what + r":\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

limit = 1024 * kib("VmSize") + int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
before = kib("VmHWM")
for path in map(Path, sys.argv[2:]):
    said, start = {}, time.perf_counter()
    for read in (header_of, Artefact, file_digest):
        try:
            read(path)
        except ArtefactError as error:
            said[read.__name__] = str(error)
    grown = kib("VmHWM") - before
    print(json.dumps([path.name, said, time.perf_counter() - start, grown]), flush=True)
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
        f"version {version!r}": changed(
            lambda file, _, version=version: file.attrs.__setitem__("format_version", version)
        )
        for version in (0, 2, 99, -1, 1.5, "1", np.nan)
    },
    "no version": changed(lambda file, _: file.attrs.__delitem__("format_version")),
    "other format": changed(lambda file, _: file.attrs.__setitem__("format", "strainsight2")),
    "no digest": changed(lambda file, _: file.attrs.__delitem__("digest")),
    "no config": changed(lambda file, _: file.attrs.__setitem__("config", "{")),
    "config of numbers": changed(lambda file, _: file.attrs.__setitem__("config", h5py.Empty("f8"))),
    "config of brackets": changed(brackets),
    "external link": changed(lambda file, other: file.__setitem__("odd", h5py.ExternalLink(str(other), "/secret"))),
    "external link above": changed(lambda file, other: file.__setitem__("odd/a", h5py.ExternalLink(str(other), "/"))),
    "soft link": changed(lambda file, _: file.__setitem__("odd", h5py.SoftLink("/summary"))),
    "soft link to itself": changed(lambda file, _: file.__setitem__("odd", h5py.SoftLink("/odd"))),
    "ring": changed(lambda file, _: file.__setitem__("odd/a", file["/"])),
    "deep": changed(deep),
    "external storage": changed(
        lambda file, other: file.create_dataset("odd", (4,), "f8", external=[(str(other), 0, 32)])
    ),
    "virtual": changed(virtual),
    "10¹² never written": changed(lambda file, _: file.create_dataset("odd", (ABSURD,), "f8", fillvalue=1.0)),
    "10¹² in pieces": changed(lambda file, _: file.create_dataset("odd", (ABSURD,), "f8", chunks=(1 << 17,))),
    "10¹² packed": changed(
        lambda file, _: file.create_dataset("odd", (ABSURD,), "f8", chunks=(1 << 17,), compression="gzip")
    ),
    "10¹² in rows": changed(lambda file, _: file.create_dataset("odd", (10**6, 10**6), "i1", chunks=(1, 10**6))),
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


@pytest.fixture
def files(undisturbed, tmp_path) -> list[Path]:
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones(3)
    good = (undisturbed / "beam" / "place.h5").read_bytes()
    made = []
    for name, make in FILES.items():
        path = tmp_path / f"{name}.h5"
        path.write_bytes(good)
        make(path, other)
        seal(path)
        made.append(path)
    ends = np.random.default_rng(6).integers(BLOCK, len(good), 20)
    for end in map(int, ends):
        for name, again in (("sealed", True), ("cut", False)):
            path = tmp_path / f"{name} {end}.h5"
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
    for path, (name, said, _, _) in zip(files, told, strict=True):
        assert path.name == name
        assert {"Artefact", "file_digest"} <= said.keys(), (name, said)
        for message in said.values():
            assert message.startswith(f"{path}  ")
            assert "\n    " in message
    slowest, grown = max(told, key=lambda entry: entry[2]), told[-1][3]
    print(f"{len(files)} files, at most {1e3 * slowest[2]:.0f} ms ({slowest[0]}), {grown / 1024:.1f} MiB")


@pytest.mark.parametrize("name", ["10¹² claimed", "version 99", "external link", "a large piece", "virtual", "ring"])
def test_a_run_that_starts_from_one_is_refused(name, files, project, undisturbed, tmp_path, launcher):
    (path,) = (path for path in files if path.stem == name)
    (tmp_path / "results" / "odd").mkdir(parents=True)
    path.rename(tmp_path / "results" / "odd" / "validate.h5")
    own = project / "odd.yaml"
    own.write_text(PLACEMENT.replace("name: beam", "name: own").replace("guess: 1.9e+11", "guess: {from: odd}"))
    launcher.start(["run", str(own), "--results", str(tmp_path / "results")], tmp_path / "says")
    assert launcher.end() == 2
    said = (tmp_path / "says").read_text()
    assert str(tmp_path / "results" / "odd" / "validate.h5") in said
    assert "Traceback" not in said
    assert not (tmp_path / "results" / "own").exists()


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

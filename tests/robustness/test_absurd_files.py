"""Artefacts that somebody made up, sealed as real ones are: refused by what they claim, before anything is allocated for it.

They are opened in a process that may take 256 MiB beside what it has, and has to be through with all of them in time.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from strainsight.workflow.seal import BLOCK, seal

from .small import PLACEMENT

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

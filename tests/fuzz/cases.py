"""The damaged files of a group: the words of its formats, what stands beside them, and each by its number."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from random import Random

from .mutation import mutated, packed, words_in
from .seeds import ROOT

SOURCE = ROOT / "pipeline" / "strainsight"
PAIRED = ("case.node", "case.ele", "case.h5")
"""What belongs to another file: beside a damaged one stands the sound other one."""
PACKABLE = (".bdf", ".inp", ".msh", ".mtx", ".vtu")
# fmt: off
PATHS = [
    "../../../../../etc/passwd", "/etc/passwd", "..", ".", "", "/", "~/.bashrc", "/dev/zero", "/proc/self/environ",
    "own.bdf", "own.inp", "beside.inc", "outside", "loop", "pipe", "folder", "x" * 300, "a\x00b", "laugh0.inc",
    "deep0.inc",
]
# fmt: on
"""What an include may ask for; `companions` makes some of them."""
INCLUDES = [f"INCLUDE '{name}'" for name in PATHS] + [f"*INCLUDE, INPUT={name}" for name in PATHS]
INCLUDES += [f"*NODE, INPUT={name}" for name in PATHS] + [f"{name}:/data0" for name in PATHS]
# fmt: off
DECK_LINES = [
    "GRID,1000000000000", "SPC1,1,123456,1,THRU,999999999999", "*NSET, NSET=N, GENERATE\n1, 999999999999, 1",
    "*NODE\n", "*ELEMENT, TYPE=C3D8, ELSET=E", "CHEXA,1,1,1,2,3,4,5,6", ",7,8", "CTETRA,11,1,4,3,2,1", "BEGIN BULK",
    "SET 1 = " + "9" * 5000, "SET 4 = 1 THRU 999999999", "RBE2,5,1,123456,2,3,4", "RBE3,6,,1,123456,1.,123,2,3,4",
    "$Nodes\n999999999", "$Entities\n999999999 0 0 0", "$MeshFormat\n4.1 1 8", "POINTS 999999999 float",
    "CELLS 999999999 5", '<Piece NumberOfPoints="999999999" NumberOfCells="1">', '<!DOCTYPE a [<!ENTITY b "c">]>',
    '<xi:include href="/etc/passwd"/>', '<!ENTITY x SYSTEM "file:///etc/passwd">', "&x;", "NDIME= 3",
    "NPOIN= 99999999", "%%MatrixMarket matrix array real general", "999999999 999999999 1",
    '<AppendedData encoding="raw">_',
]
CONFIG_LINES = [
    "kind: placement", "kind: bench", "kind: suite", "kind: bearing", "kind: [placement]", "kind: {}", "&a [*a, *a]",
    "<<: {}", "? [a]\n: b", "- a", "!!python/object/apply:os.system [true]", "!!binary aGk=", "2026-01-01", "0o17",
    "|", "runs: [{config: /etc/passwd, label: x}]", "runs: [{config: own-suite.yaml, label: x}]",
    "{config: ., label: x}", "name: ../../x", "mesh: {file: ../../../etc/passwd}", "set: {a.b.c: 1}",
    "set: {runs.0.set: {}}", "---", "...", "%YAML 9",
]
TABLE_LINES = [
    "sep=,", "sep=;", "time [s],a", "time,a [um/m],F [kN]", '"', '"time"', "a,a,a", "time [h],a [g],F [lbf]",
    "nan,nan,nan", "0,1,2", "1e9,1,2", "1e300,1,2", "inf,1,2", "    -1", "    58", "   164",
    "    58b     1     2          11         480",
]
OVERRIDES = [
    "place.keep=6", "place.keep=[", "name=../x", "mesh.file=/etc/passwd", "runs.0.set.seed=2", "set.place.keep=6",
    "=1", "loads.tip.signal={type: sine}", "kind=[]", "kind=suite", "parameters.E.range.0=1e400", "runs.9.label=a",
    "a", "a.0.b=1", "kind.a=1", "seed=99999999999999999999", "mesh=1", "runs=[]", "runs.0={}", "set=1", "suffix=x",
    "loads.tip.direction.2=x", "place=&a [*a]", "é=1", "mesh.materials.x={}", "mesh.matrices.stiffness.0.file=x",
    "estimate.channels.0.gauge=1",
]
# fmt: on


@dataclass(frozen=True)
class Case:
    """One damaged file: its name, what it holds, the sound file it was, and what else the reader is asked."""

    name: str
    content: bytes
    origin: str
    choice: int


class Group:
    """The damaged files of a group, each by its number alone: seeds (a folder of `write_seeds`)."""

    def __init__(self, name: str, seeds: Path):
        self.name = name
        self.files = {
            path.name: path.read_bytes() for path in sorted(seeds.iterdir()) if not path.name.startswith("beside")
        }
        folders, lines = WORDS[name]
        self.words = [*words_in(*(SOURCE / folder for folder in folders)), *lines]
        self.names = list(self.files)

    def case(self, seed: int, number: int) -> Case:
        rng = Random(f"{self.name} {seed} {number}")
        name = rng.choice(self.names)
        others = [self.files[rng.choice(self.names)]]
        content = mutated(self.files[name], rng, self.words, others)
        ending = Path(name).suffix
        if ending in PACKABLE and rng.random() < 0.1:
            return Case(f"case{ending}.gz", packed(content, rng), name, rng.randrange(1 << 16))
        return Case(f"case{ending}", content, name, rng.randrange(1 << 16))


WORDS: dict[str, tuple[tuple[str, ...], list[str]]] = {
    "config": (("config",), CONFIG_LINES),
    "deck": (("decks",), [*INCLUDES, *DECK_LINES]),
    "measurement": (("measurements",), TABLE_LINES),
    "results": (("foreign/results",), []),
}
"""Group → modules whose words are those of its formats, and lines beside them."""


def companions(group: str, seeds: Path, folder: Path) -> None:
    """What stands beside every damaged file: sound files, and what no include may follow."""
    folder.mkdir(parents=True)
    for path in seeds.iterdir():
        shutil.copy(path, folder / path.name)
    if group == "deck":
        outside = folder.parent / f"{folder.name}-secret"
        outside.write_text("GRID,77,,0.,0.,0.\n")
        (folder / "outside").symlink_to(outside)
        (folder / "loop").symlink_to("loop")
        os.mkfifo(folder / "pipe")
        (folder / "folder").mkdir()
        for i in range(40):
            (folder / f"laugh{i}.inc").write_text(f"INCLUDE 'laugh{i + 1}.inc'\n" * 2)
        (folder / "laugh40.inc").write_text("GRID,88\n")
        for i in range(1500):
            (folder / f"deep{i}.inc").write_text(f"INCLUDE 'deep{i + 1}.inc'\n")
        for name in PAIRED:
            shutil.copy(folder / f"part{Path(name).suffix}", folder / name)
        (folder / "case-of-h5.xdmf").write_text((folder / "part.xdmf").read_text().replace("part.h5", "case.h5"))

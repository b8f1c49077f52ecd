"""python -m tests.fuzz.campaign [--inputs 20000] [--seed 1] [--group deck …]: read damaged files, and say what went wrong.

Each file follows from its group, the seed and its number alone. What a fault needs is put into build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .cases import Group
from .guard import SECONDS
from .readers import READERS
from .seeds import ROOT, write_seeds

PATIENCE = 9 * SECONDS
"""[s] without a next file, after which the process that reads them is ended."""


@dataclass(frozen=True)
class Fault:
    """A file of a group by its number, and what reading it did."""

    group: str
    number: int
    said: str


def faults(group: str, seeds: Path, work: Path, seed: int, first: int, last: int) -> list[Fault]:
    """What goes wrong with the damaged files first … last − 1; a process that dies is a fault too, and another goes on."""
    found: list[Fault] = []
    fatal = -1
    while first < last:
        words = [group, *map(str, (seeds, work, seed, first, last, fatal))]
        with tempfile.TemporaryFile() as said:
            process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.worker", *words], cwd=ROOT, stdout=said, stdin=subprocess.DEVNULL
            )
            at = _watched(process, work / "at", first)
            said.seek(0)
            found += [Fault(group, line["number"], line["fault"]) for line in map(json.loads, said)]
        if process.returncode == 0:
            return found
        if process.returncode > 0:
            raise RuntimeError((work / "fault").read_text("utf-8"))
        if at == fatal or group == "config":
            found.append(Fault(group, at, f"the process ended with {process.returncode}"))
            at += 1
        # once more, in the child process of the product, which may end
        first, fatal = at, at
    return found


def _watched(process: subprocess.Popen[bytes], at: Path, first: int) -> int:
    """Wait for its end, or end it where it stands still; the number of the file it read last."""
    number, since = first, time.monotonic()
    while process.poll() is None:
        time.sleep(0.2)
        now = int((at.read_text() if at.exists() else "") or first)
        if now != number:
            number, since = now, time.monotonic()
        elif time.monotonic() - since > PATIENCE:
            process.kill()
            process.wait()
    return int((at.read_text() if at.exists() else "") or first)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="of each group")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--group", nargs="+", default=list(READERS), choices=list(READERS))
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "fuzz")
    asked = parser.parse_args(arguments)
    bad = 0
    with tempfile.TemporaryDirectory() as made:
        seeds = Path(made) / "seeds"
        write_seeds(seeds)
        for name in asked.group:
            begun = time.monotonic()
            last = asked.first + asked.inputs
            found = faults(name, seeds, Path(made) / name, asked.seed, asked.first, last)
            bad += len(found)
            print(
                f"{name}: {asked.inputs} damaged files in {time.monotonic() - begun:.0f} s, {len(found)} faults",
                flush=True,
            )
            _keep(Group(name, seeds / name), found, asked.seed, Path(made) / "found", asked.out)
    return 1 if bad else 0


def _keep(group: Group, found: Sequence[Fault], seed: int, kept: Path, out: Path) -> None:
    kinds = Counter(_kind(fault.said) for fault in found)
    for kind, count in kinds.most_common():
        fault = next(fault for fault in found if _kind(fault.said) == kind)
        case = group.case(seed, fault.number)
        folder = out / f"{group.name}-{seed}-{fault.number}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / case.name).write_bytes(case.content)
        for file in (kept / f"{group.name}-{fault.number}").glob("*"):
            shutil.copy(file, folder)  # as it was read, should the sources have changed meanwhile
        (folder / "fault.txt").write_text(f"was {case.origin}, choice {case.choice}\n{fault.said}\n", "utf-8")
        print(f"  {count} × {group.name} {fault.number} ({case.origin}): {fault.said}", flush=True)


def _kind(said: str) -> str:
    return said.partition(": ")[0][:160]


if __name__ == "__main__":
    sys.exit(main())

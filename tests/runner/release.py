"""python -m tests.runner.release: keep what this version makes of a tiny structure and a tiny bench, from import to report, in
released/<version>.tar.xz, which the versions after it have to open."""

from __future__ import annotations

import io
import sys
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from strainsight import __version__
from strainsight.runner.artefact import Artefact
from strainsight.runner.runner import run

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, bricks, config_of
from ..shared import job_of, stages_of

KEPT = Path(__file__).parent / "released"
LARGEST = 300_000
"""[bytes] of a release."""
TINY: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]] = {
    "structure": (PLACEMENT_CONFIG, {"name": "structure", "screen.keep": 4, "rom.modes": 2, "validate.truth.modes": 3}),
    "bench": (BENCH_CONFIG, {"name": "bench", "place.pool": 4, "bodies.beam.modes": 2}),
}
"""Config, and what makes it smaller."""


def made(folder: Path) -> dict[str, Artefact]:
    """Both configs, their deck and their results in the folder; "run/stage" → artefact."""
    (folder / "beam.bdf").write_text(bricks((3, 1, 1)), encoding="ascii")
    found = {}
    for name, (base, changes) in TINY.items():
        text = yaml.safe_dump(config_of(base, changes))
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        job = job_of(folder / f"{name}.yaml", folder / "results")
        for event in run(stages_of(job), job):
            if event.artefact is not None:
                found[f"{name}/{event.stage}"] = event.artefact
    return found


def packed(folder: Path, to: Path) -> int:
    """Configs, deck and results as one archive, without pages, which are made anew of these; its size."""
    with tarfile.open(to, "w:xz", preset=9) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix not in (".html", ".log") and not path.name.startswith("."):
                own = tarfile.TarInfo(str(path.relative_to(folder)))
                content = path.read_bytes()
                own.size = len(content)
                archive.addfile(own, io.BytesIO(content))
    return to.stat().st_size


def unpacked(version: str, folder: Path) -> Path:
    with tarfile.open(KEPT / f"{version}.tar.xz") as archive:
        archive.extractall(folder, filter="data")
    return folder


def main() -> int:
    to = KEPT / f"{__version__}.tar.xz"
    if to.exists() and "--replace" not in sys.argv:
        print(f"{to.name} is kept already, as it was released; --replace before the release alone", file=sys.stderr)
        return 2
    KEPT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        made(Path(name))
        size = packed(Path(name), to)
    print(f"{to.name}: {size / 1e3:.0f} kB")
    return 0 if size <= LARGEST else 1


if __name__ == "__main__":
    sys.exit(main())

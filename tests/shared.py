"""Runs that several tests need are made once, by whichever worker comes first, and kept in build/test-artefacts.

A folder there belongs to one version of the code: of the sources, examples and meshes, of Python and the packages. The
others are removed, but for those that a session is using.
"""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import distributions
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import strainsight
import strainsight_cli
from strainsight.config.load import load_config
from strainsight.experiment.structure import placement
from strainsight.runner.artefact import Artefact
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.runner.stage import Stage
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.placement import PLACEMENT

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "test-artefacts"
SOURCES = (Path(strainsight.__file__).parent, Path(strainsight_cli.__file__).parent, ROOT / "configs", ROOT / "meshes")
FEW = ("screen.keep=40", "place.instants=3")
"""A smaller pool of places, and fewer instants to place for: elimination takes as the square of the pool."""
SHORT = (
    "rom.parameter_samples=2",
    "train.duration=0.2",
    "train.time_step=1e-3",
    "place.instants=2",
    "tolerances.frequency=0",
    "tolerances.damping=1",
    "validate.duration=0.2",
    "validate.time_step=1e-3",
    "validate.random_sets=2",
    "validate.repeats=2",
    "validate.noise_factors=[5.0]",
    "validate.truth.modes=20",
)
"""A placement, shortened where length does not matter."""
COARSE = (
    *SHORT,
    f"mesh.file={ROOT / 'meshes' / 'cantilever-coarse.bdf'}",
    "screen.keep=30",
    "validate.duration=0.1",
    "validate.random_sets=1",
    "validate.truth.modes=12",
)
"""The cantilever in 80 bricks, for what holds on any mesh."""
UNSTUDIED = (
    FEW[0],
    "filter.compare=false",
    "validate.random_sets=0",
    "validate.repeats=1",
    "validate.noise_factors=[]",
)
"""A validation of the layout and the filter alone, without those beside them."""
PLACED_EXACTLY = tuple(f"tolerances.{name}=0" for name in ("position", "angle", "transverse"))
"""For comparisons with gauges of given rows, which know of no strain beside their place."""
HUB = "hub"
"""Runs of the coarse hub, which take what is reduced and placed over."""
BENCHES = "benches"
"""Runs of benches, which take each other's reduced hub over (`made`)."""
_held: list[object] = []


def job_of(config: Path, results: Path, *overrides: str) -> Job:
    loaded = load_config(config, overrides)
    return Job(loaded.data, config.parent, results, loaded.locate, loaded.model)


def stages_of(job: Job, until: str = "") -> tuple[Stage, ...]:
    """All stages of a placement or a bench, or those up to one of them."""
    stages = tuple(PLACEMENT if job.config["kind"] == "placement" else bench_stages(job.config))
    names = [stage.name for stage in stages]
    return stages[: names.index(until) + 1] if until else stages


def made(
    config: Path, *overrides: str, until: str = "", beside: str = "", only: tuple[str, ...] = ()
) -> dict[str, Artefact]:
    """stage → Artefact of a finished run, which is not to be written to: whoever goes on from there copies its folder.

    config: one of the repository, or one that stands in a folder with nothing but what it needs. until: its last stage;
    only: its stages.
    beside: runs of the same word lie in one results folder and take stages over from each other.
    """
    own = str(config) if config.is_relative_to(ROOT) else config.name + _content(config.parent)
    # a letter first: one digest in a thousand has digits and one e, and would be read as a number
    what = "r" + hashlib.sha256("\n".join((own, *overrides, until, beside, *only)).encode()).hexdigest()[:16]
    place = _of_this_code() / (beside or what)
    named = [f"name={what}"] if beside and not any(word.startswith("name=") for word in overrides) else []
    job = job_of(config, place, *overrides, *named)
    stages = [stage for stage in stages_of(job, until) if not only or stage.name in only]
    done = place / f"{what}.done"
    with _alone(place / f"{what}.lock"):
        if not done.exists():
            for _ in run(stages, job):
                pass
            done.touch()
    return {stage.name: Artefact(job.folder / f"{stage.name}.h5") for stage in stages}


def once(name: str, text: str, make: Callable[[Path], None]) -> Path:
    """The folder that make(folder) fills, by whichever worker comes first; not to be written to. name, text: of what it is made,
    beside this code."""
    place = _of_this_code() / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    done = place.with_suffix(".done")
    with _alone(place.with_suffix(".lock")):
        if not done.exists():
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            make(place)
            done.touch()
    return place


def script(path: str) -> ModuleType:
    """The module of a file of the repository that is in no package."""
    spec = spec_from_file_location(Path(path).stem, ROOT / path)
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # for dataclasses
    spec.loader.exec_module(module)
    return module


def slowly(*values: object) -> list[object]:
    """Values of a parametrisation that only the slow tests have; a tuple is one set of values."""
    return [pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.slow) for value in values]


@contextmanager
def without_hot_spots() -> Iterator[None]:
    """Placements do not test their gauges for hot spots, where nobody reads of it: half of their time for a few bonded gauges.

    What is `made` so has to be made so by all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(placement, "tested_hot_spots", lambda *_: None)
        yield


@cache
def strains(train: Artefact) -> np.ndarray:
    """What every candidate of gauges reads in the training simulation (T + 1, m), H q."""
    return np.asarray(train["/coordinate"] @ train["/gauges/row"].T)


@cache
def _of_this_code() -> Path:
    """The folder of this version of the code, held until the process ends; those that nobody holds are removed.

    Once a process: to read all sources takes a quarter of a second."""
    packages = sorted(f"{package.name} {package.version}" for package in distributions())
    code = hashlib.sha256("\n".join([sys.version, *packages, *map(_content, SOURCES)]).encode())
    own = KEPT / code.hexdigest()[:16]
    own.mkdir(parents=True, exist_ok=True)
    _held.append(_lock(own / "held", fcntl.LOCK_SH))
    for other in set(KEPT.iterdir()) - {own}:
        try:
            with _lock(other / "held", fcntl.LOCK_EX | fcntl.LOCK_NB):
                shutil.rmtree(other)
        except OSError:  # in use, or somebody else is removing it
            continue
    return own


def _content(folder: Path) -> str:
    """sha256 of the files of a folder and their names."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.parent.name != "__pycache__":
            found.update(f"{path.relative_to(folder)} {path.stat().st_size}\n".encode())
            found.update(path.read_bytes())
    return found.hexdigest()


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with _lock(path, fcntl.LOCK_EX):
        yield


def _lock(path: Path, kind: int):
    """An open file, locked until it is closed."""
    stream = path.open("a")
    try:
        fcntl.flock(stream, kind)
    except OSError:
        stream.close()
        raise
    return stream

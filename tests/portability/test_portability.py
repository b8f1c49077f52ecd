"""The same layouts exactly, and the same numbers to rounding, on whatever processor, linear algebra, solver and threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from strainsight.workflow.artefact import Header
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.store import write_artefact

from ..robustness import small
from ..shared import ROOT, SHORT
from .compared import digests, layouts_apart, numbers_apart

CONFIGS = (
    "cantilever-youngs-modulus",  # the guess of the two with a force comes from it
    "cantilever-density",
    "cantilever-density-35hz",
    "cantilever-input",
    "cantilever-input-youngs-modulus",
)
AXIS = "direction: {type: axis, axis: [1, 0, 0], angles: [0.0, 45.0]}"
PRINCIPAL = "direction: {type: principal, angles: [0.0, 45.0, 90.0, 135.0]}"
"""Of the small bench: more to be chosen, and all of it mirrored."""
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Setting:
    """What a child is told; needs: features of the processor without which it would crash."""

    environment: dict[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    intel: bool = False
    superlu: bool = False
    compatible: bool = False


def _plain() -> dict[str, str]:
    """NumPy without the code that it has for this processor, and compiled code for any of its family."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    there = [name for name in __cpu_dispatch__ if __cpu_features__.get(name)]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(there), "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


AVX2, AVX512 = ("avx2", "fma"), ("avx512f", "avx512vl", "avx512dq", "avx512bw")
SETTINGS = {
    "OpenBLAS Sandybridge": Setting({"OPENBLAS_CORETYPE": "Sandybridge"}, ("avx",)),
    "OpenBLAS Haswell": Setting({"OPENBLAS_CORETYPE": "Haswell"}, AVX2),
    "OpenBLAS Zen": Setting({"OPENBLAS_CORETYPE": "Zen"}, AVX2),
    "OpenBLAS SkylakeX": Setting({"OPENBLAS_CORETYPE": "SkylakeX"}, AVX512),
    "MKL SSE4_2": Setting({"MKL_ENABLE_INSTRUCTIONS": "SSE4_2"}, intel=True),
    "MKL AVX2": Setting({"MKL_ENABLE_INSTRUCTIONS": "AVX2"}, AVX2, intel=True),
    "MKL AVX512": Setting({"MKL_ENABLE_INSTRUCTIONS": "AVX512"}, AVX512, intel=True),
    "MKL COMPATIBLE": Setting(compatible=True),
    "SuperLU": Setting(superlu=True),
    "two threads": Setting(dict.fromkeys(THREADS, "2")),
    "plain code": Setting(_plain()),
}
DEFAULT = "default"


def processor() -> tuple[set[str], bool]:
    """Its features, and whether it is Intel's."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    flags = next((line for line in lines if line.startswith("flags")), "")
    return set(flags.split()), any("GenuineIntel" in line for line in lines)


def bench_config(folder: Path) -> Path:
    """A small bench with `place`."""
    small.write_project(folder)
    path = folder / "bench.yaml"
    text = path.read_text(encoding="utf-8")
    assert AXIS in text
    path.write_text(text.replace(AXIS, PRINCIPAL), encoding="utf-8")
    return path


def run(results: Path, name: str, runs: list[tuple[str, tuple[str, ...]]]) -> Path:
    """Results of those configs under that setting, skipped where this machine has none."""
    setting = SETTINGS.get(name, Setting())
    features, intel = processor()
    if not features >= set(setting.needs):
        pytest.skip(f"this processor has no {', '.join(sorted(set(setting.needs) - features))}")
    if setting.intel and not intel:
        pytest.skip("MKL looks at MKL_ENABLE_INSTRUCTIONS on processors of Intel only")
    plan = {"results": str(results / name), "runs": runs, "superlu": setting.superlu, "compatible": setting.compatible}
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("child.py")), json.dumps(plan)],
        env={**os.environ, **dict.fromkeys(THREADS, "1"), **setting.environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return results / name


def asked(one: Path, other: Path) -> None:
    assert layouts_apart(one, other) == {}
    assert {name: share for name, share in numbers_apart(one, other).items() if not share <= 1} == {}


def test_an_older_processor_has_the_same_bench(tmp_path):
    runs = [(str(bench_config(tmp_path / "project")), ())]
    old = run(tmp_path, "OpenBLAS Sandybridge", runs)
    asked(run(tmp_path, DEFAULT, runs), old)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    bench = bench_config(tmp_path_factory.mktemp("project"))
    return [*((str(ROOT / "configs" / f"{name}.yaml"), SHORT) for name in CONFIGS), (str(bench), ())]


@pytest.fixture(scope="module")
def by_default(tmp_path_factory, runs):
    return run(tmp_path_factory.mktemp("results"), DEFAULT, runs)


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_other_machines_have_the_same_layouts_and_numbers(name, runs, by_default):
    other = run(by_default.parent, name, runs)
    asked(by_default, other)
    if SETTINGS[name].superlu:  # which has other last digits on any machine: else nothing was compared
        assert digests(by_default) != digests(other)


def test_the_comparison_sees_another_gauge_and_another_digit(tmp_path):
    def written(name, gauges, std, gap):
        path = tmp_path / name / "beam" / "place.h5"
        path.parent.mkdir(parents=True)
        arrays = {"/gauge": gauges, "/std": std, "/certificate/gap": gap}
        datasets = {name: Dataset(np.array(array), "1", "a number a gauge") for name, array in arrays.items()}
        summary = {"cost": 2.0, "selected": 2}
        write_artefact(path, Output(datasets, summary=summary, message=""), Header("place", 1, "0" * 64, {}, {}, {}))
        return tmp_path / name

    one = written("one", [1, 3], [1.0, 100.0], 1e-9)
    same = written("same", [1, 3], [1.0 + 5e-6, 100.0], 5e-8)
    other = written("other", [1, 4], [1.0 + 2e-5, np.inf], 2e-7)
    near = written("near", [1, 3], [1.0 + 2e-5, 100.0], 2e-7)
    asked(one, same)
    assert list(layouts_apart(one, other)) == ["beam/place:/gauge"]
    assert numbers_apart(one, other)["beam/place:/std"] == np.inf
    assert {name for name, share in numbers_apart(one, near).items() if share > 1} == {
        "beam/place:/std",
        "beam/place:/certificate/gap",
    }

"""The same layouts exactly, and the same numbers to rounding, on whatever processor, linear algebra, solver and threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from ..robustness import small
from ..shared import ROOT, SHORT
from .compared import digests, layouts_apart, numbers_apart

CONFIGS = ("cantilever-youngs-modulus", "cantilever-input-youngs-modulus")
"""The guess of the one with a force comes from the other."""
LESS = (*SHORT, "validate.duration=0.05", "validate.random_sets=0", "validate.repeats=1", "validate.noise_factors=[]")
"""Without the studies of a validation, which the small beam has."""
FORCE = ("estimate=null", "loads.tip.known=false")
SMALL = {
    "beam": (),
    "force": (
        *FORCE,
        "parameters={}",
        "place.estimate=[tip]",
        "validate.truth.parameters={}",
        "validate.initial_std={tip: 0.1}",
    ),
    "both": (
        *FORCE,
        "parameters.E.guess={from: beam}",
        "loads.tip.signal.frequency=50.0",
        "place.estimate=[tip, E]",
        "validate.initial_std={tip: 0.1, E: 0.1}",
    ),
}
"""The small beam for its modulus, for a force, and for both from the modulus of the first: every kind of decision, in seconds."""
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
    # a thread that waits sleeps: by default OpenBLAS and MKL let it turn in a loop, which takes twice the time and no other step
    "two threads": Setting(dict.fromkeys(THREADS, "2") | {"OPENBLAS_THREAD_TIMEOUT": "4", "KMP_BLOCKTIME": "0"}),
    "plain code": Setting(_plain()),
}
MACHINES = {
    "an old one": ("OpenBLAS Sandybridge", "MKL COMPATIBLE", "plain code"),
    "a newer one": ("OpenBLAS Haswell", "MKL SSE4_2"),
    "a new one without MKL": ("OpenBLAS Zen", "SuperLU", "two threads"),
    "a new one": ("OpenBLAS SkylakeX", "MKL AVX2"),
    "one with wide registers": ("MKL AVX512",),
}
"""Settings that come together, every setting in one of them: what differs is then looked for setting by setting (`run`)."""
DEFAULT = "default"


def together(names: Iterable[str]) -> Setting:
    each = [SETTINGS[name] for name in names]
    return Setting(
        {key: value for own in each for key, value in own.environment.items()},
        tuple(feature for own in each for feature in own.needs),
        any(own.intel for own in each),
        any(own.superlu for own in each),
        any(own.compatible for own in each),
    )


def processor() -> tuple[set[str], bool]:
    """Its features, and whether it is Intel's."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    flags = next((line for line in lines if line.startswith("flags")), "")
    return set(flags.split()), any("GenuineIntel" in line for line in lines)


def bench_config(folder: Path) -> Path:
    small.write_project(folder)
    path = folder / "bench.yaml"
    text = path.read_text(encoding="utf-8")
    assert AXIS in text
    path.write_text(text.replace(AXIS, PRINCIPAL), encoding="utf-8")
    return path


def missing(name: str) -> dict[str, str]:
    """Settings of a machine, or one alone, that this processor cannot take → why."""
    features, intel = processor()
    found = {}
    for own in MACHINES.get(name, () if name == DEFAULT else (name,)):
        setting = SETTINGS[own]
        if not features >= set(setting.needs):
            found[own] = f"this processor has no {', '.join(sorted(set(setting.needs) - features))}"
        elif setting.intel and not intel:
            found[own] = "MKL looks at MKL_ENABLE_INSTRUCTIONS on processors of Intel only"
    return found


def run(results: Path, name: str, runs: list[tuple[str, tuple[str, ...]]]) -> Path:
    """Results of those configs on that machine, or under that setting alone, without what is missing here; skipped where
    nothing is left."""
    names = MACHINES.get(name, () if name == DEFAULT else (name,))
    there = [own for own in names if own not in missing(name)]
    if names and not there:
        pytest.skip("; ".join(missing(name).values()))
    setting = together(there)
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


@pytest.fixture(scope="module")
def small_runs(tmp_path_factory):
    bench = bench_config(tmp_path_factory.mktemp("project"))
    beam = str(bench.with_name("beam.yaml"))
    return [*((beam, (f"name={name}", *asked)) for name, asked in SMALL.items()), (str(bench), ())]


@pytest.fixture(scope="module")
def small_by_default(tmp_path_factory, small_runs):
    return run(tmp_path_factory.mktemp("small"), DEFAULT, small_runs)


def said(name: str) -> None:
    """Compared, but for these settings: the test says which."""
    if left := missing(name):
        pytest.skip("compared without " + "; ".join(f"{own}: {why}" for own, why in left.items()))


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_other_machines_have_the_same_layouts_and_numbers(name, small_runs, small_by_default):
    other = run(small_by_default.parent, name, small_runs)
    asked(small_by_default, other)
    if "SuperLU" in MACHINES[name]:  # which has other last digits on any machine: else nothing was compared
        assert digests(small_by_default) != digests(other)
    said(name)


@pytest.mark.slow
def test_cantilevers_of_another_machine_have_the_same_layouts_and_numbers(tmp_path):
    runs = [(str(ROOT / "configs" / f"{name}.yaml"), LESS) for name in CONFIGS]
    default, other = (run(tmp_path, name, runs) for name in (DEFAULT, "a new one without MKL"))
    asked(default, other)
    assert digests(default) != digests(other)
    said("a new one without MKL")

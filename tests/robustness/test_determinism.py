"""The same config and seed on one machine: the same results, whatever is around the run; in other threads to the last digits."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from strainsight.runner.artefact import Artefact

from ..edges import beam
from . import small
from .whole import compared, names

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
DIGITS = 1e-10
"""What rounding may do to an array, of its largest number: 1e-16 times the square of the highest over the lowest frequency."""
ROUNDING = {
    "rom.h5": {"/error/frequency", "/error/static"},
    "observe.h5": {"/condition_raw"},
    "place.h5": {"/certificate/gap", "/riccati/residual", "/augmented/F", "/augmented/Q"},
}
"""Numbers that are themselves rounding: of a model held against itself, a residual, a share of what is not observed; and F
and Q in coordinates of unit covariance, where a mode that nothing moves is blown up by 1e14."""


def run(folder: Path, stage: str, config: str, results: Path, start: str = "", **environment: str) -> None:
    """`strainsight STAGE CONFIG` from that folder; start: Python that comes first."""
    code = f"{start}; from strainsight_cli.main import main; main()"
    words = [stage, config, "--results", str(results), "--jobs", "1"]
    done = subprocess.run(
        [sys.executable, "-c", code.removeprefix("; "), *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_what_is_around_a_run_is_not_in_its_results(project, undisturbed, tmp_path):
    moved, results = tmp_path / "a b" / "moved", tmp_path / "elsewhere"
    moved.mkdir(parents=True)
    for path in project.iterdir():
        if path.is_file():
            shutil.copyfile(path, moved / path.name)
    around = {"PYTHONHASHSEED": "12345", "TZ": "Pacific/Chatham", "LC_ALL": "C", "COLUMNS": "60", "HOME": str(tmp_path)}
    for name in ("beam", "bench"):
        run(moved, "run", f"../moved/{name}.yaml", results, **around, **dict.fromkeys(THREADS, "2"))
        assert set(compared(results / name, undisturbed / name)) == names(results / name) == names(undisturbed / name)


@pytest.mark.slow
def test_rounding_of_two_threads_chooses_no_other_layout(tmp_path, monkeypatch):
    monkeypatch.setattr(beam, "SIZE", (1.0, 0.1, 0.1))
    small.write_project(tmp_path)
    for threads in ("1", "2"):
        run(
            tmp_path,
            "place",
            "beam.yaml",
            tmp_path / threads,
            "import numpy, scipy.linalg",
            **dict.fromkeys(THREADS, threads),
        )
    differ, off = set(), {}
    for path in sorted((tmp_path / "1" / "beam").glob("*.h5")):
        one, two = Artefact(path), Artefact(tmp_path / "2" / "beam" / path.name)
        assert one.paths() == two.paths()
        if one.digest != two.digest:
            differ.add(path.name)
        for name in set(one.paths()) - ROUNDING.get(path.name, set()):
            a, b = one[name], two[name]
            if a.dtype.kind != "f":
                np.testing.assert_array_equal(a, b, err_msg=f"{path.name}:{name}")
            else:
                np.testing.assert_array_equal(np.isfinite(a), np.isfinite(b), err_msg=name)
                there = np.isfinite(a)
                scale = np.abs(a[there]).max(initial=0.0) or 1.0
                off[f"{path.name}:{name}"] = np.abs(a[there] - b[there]).max(initial=0.0) / scale
    assert "place.h5" in differ  # else nothing was compared
    assert {name: value for name, value in off.items() if value > DIGITS} == {}
    for name in ("gauges.csv", "gauges.unv"):
        assert (tmp_path / "1" / "beam" / name).read_text() == (tmp_path / "2" / "beam" / name).read_text()


SOLVED = """
import sys
import numpy as np
from scipy import sparse
from strainsight.fem.factorisation import pardiso

line = sparse.diags_array([-np.ones(11), 2.1 * np.ones(12), -np.ones(11)], offsets=[-1, 0, 1])
one = sparse.eye_array(12)
solid = sum(sparse.kron(sparse.kron(*pair), last) for pair, last in (((line, one), one), ((one, line), one), ((one, one), line)))
node = np.array([[2.0, 0.3, 0.1], [0.3, 3.0, 0.2], [0.1, 0.2, 2.5]])
upper = sparse.csr_array(sparse.triu(sparse.kron(solid, node), format="csr"))
upper.sort_indices()
B = np.random.default_rng(0).standard_normal((upper.shape[0], 20))
found = []
for offset in range(8):  # in doubles: memory that begins anywhere
    room = np.empty(B.size + 8)
    moved = room[offset : offset + B.size].reshape(B.shape, order="F")
    moved[:] = B
    solve = pardiso(upper)
    found.append((solve(moved[:, :1]), solve(moved)))
assert all(np.array_equal(x, y) for other in found for x, y in zip(found[0], other))
np.savez(sys.argv[1], single=found[0][0], many=found[0][1])
"""


COMPLEX_FIRST = """
import numpy as np
from scipy import sparse
from strainsight.fem.factorisation import factorise_complex
factorise_complex(sparse.csr_array(sparse.diags_array([2.0 + 1j] * 50)))(np.ones(50, dtype=complex))
"""


@pytest.mark.slow
def test_the_solver_repeats_its_bits_and_more_threads_change_at_most_the_last_digits(tmp_path):
    """MKL takes its branch before its first computation, whichever solver makes that."""
    pytest.importorskip("pypardiso")
    for name, threads, before in (("one", "1", ""), ("after", "1", COMPLEX_FIRST), ("two", "2", ""), ("again", "2", "")):
        words = [sys.executable, "-c", before + SOLVED, str(tmp_path / f"{name}.npz")]
        subprocess.run(words, check=True, env={**os.environ, **dict.fromkeys(THREADS, threads)})
    one, after, two, again = (np.load(tmp_path / f"{name}.npz") for name in ("one", "after", "two", "again"))
    for x in ("single", "many"):
        assert np.array_equal(two[x], again[x])
        assert np.array_equal(one[x], after[x])
        assert np.abs(one[x] - two[x]).max() < 1e-12 * np.abs(one[x]).max()

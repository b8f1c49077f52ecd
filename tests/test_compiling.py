"""Compiled code is made by one process and loaded by the others."""

import os
import subprocess
import sys

import pytest

from .shared import ROOT

MODULE = """
from strainsight.compiled import kept


@kept()
def total(x):
    s = 0.0
    for k in range(len(x)):
        s += x[k]
    return s
"""
PROGRAM = """
import numpy as np
from summed import total

print("ready", flush=True)
input()
total(np.ones(3))
print(sum(total.stats.cache_misses.values()), sum(total.stats.cache_hits.values()), flush=True)
"""
STEP_AND_SLOPES = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.bearing.element import BearingLaw
from strainsight.multibody.forces import Gravity, RelativeElement
from strainsight.multibody.bodies import Frame
from strainsight.multibody.initial import state
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.step import _joined, slopes
from strainsight.multibody.accelerations import balance
from strainsight.multibody.step import step
from strainsight.multibody.system import assemble
from tests.multibody.conftest import Particles

arm = Particles(np.ones(4), np.eye(4, 3), np.ones((4, 3, 1))).flexible("arm", AffineOperator(np.eye(1), {}))
bearing = Bearing(24, 0.4, np.pi / 4, 0.02, 0.0106, 0.0105, 0.0107, 0.0106, 1e-5)
root = Frame("root", "arm", displacement=np.zeros((3, 1)), rotation=np.zeros((3, 1)))
ring = bearing_displacements(Frame("wall"), root)
system = assemble([arm], [], [RelativeElement("ring", ring, BearingLaw(bearing)), Gravity()])
q, v = state(system, {})
slopes(system, _joined([step(system, q, v, np.zeros(0), 1e-5, np.zeros(0))]))
balance(system, q, v, np.zeros(0), np.zeros(0))
functions = {
    function
    for name, module in list(sys.modules.items()) if name.startswith("strainsight.multibody")
    for function in vars(module).values() if isinstance(function, Dispatcher) and function.signatures
}
print(len(functions), sorted(f.py_func.__name__ for f in functions if len(f.signatures) > 1))
"""


@pytest.mark.slow
def test_two_processes_compile_a_function_once(tmp_path):
    (tmp_path / "summed.py").write_text(MODULE)
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen([sys.executable, "-c", PROGRAM], env=env, **pipes) for _ in range(2)]
    for each in both:
        assert each.stdout.readline() == "ready\n"
    for each in both:
        each.stdin.write("\n")
        each.stdin.flush()
    compiled_loaded = sorted(each.communicate()[0].split() for each in both)
    assert compiled_loaded == [["0", "1"], ["1", "0"]]


@pytest.mark.slow
def test_equations_are_compiled_for_one_set_of_types(tmp_path):
    """A process without compiled code on disk, which takes the step, its slopes and the balance in natural coordinates.

    Two of the functions take a transposed matrix, too."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    child = subprocess.run(
        [sys.executable, "-c", STEP_AND_SLOPES], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert child.returncode == 0, child.stderr
    count, several = child.stdout.split(maxsplit=1)
    assert int(count) > 30
    assert several.strip() == "['natural_motions', 'project_rows']"

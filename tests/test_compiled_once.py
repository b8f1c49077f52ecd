"""Compiled code is made by one process and loaded by the others."""

import os
import subprocess
import sys

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

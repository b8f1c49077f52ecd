"""What `make` asks of the system before it sets up: only what there is no way on without stops it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SYSTEM = Path(__file__).parents[1] / ".ci" / "system.py"
WITHOUT = """
import ctypes, glob, importlib.util, runpy, sys
if "{lack}" == "gl":
    def refuse(name): raise OSError(name)
    ctypes.CDLL, glob.glob, sys.platform = refuse, lambda pattern: [], "linux"
else:
    found = importlib.util.find_spec
    importlib.util.find_spec = lambda name: None if name == "ensurepip" else found(name)
sys.argv = [{path!r}, *{words!r}]
runpy.run_path({path!r}, run_name="__main__")
"""


def asked(lack: str, *words: str) -> subprocess.CompletedProcess[str]:
    program = WITHOUT.format(lack=lack, path=str(SYSTEM), words=words)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)


def test_libraries_that_draw_are_a_note():
    done = asked("gl")
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr.startswith("note: pages will have no 3D pictures")
    assert "libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri" in done.stderr
    assert asked("gl", "--packages").stdout.split()[-4:] == ["libegl1", "libgl1", "libegl-mesa0", "libgl1-mesa-dri"]


def test_a_python_without_venv_stops_with_a_way_without_root():
    done = asked("venv")
    assert done.returncode == 1
    assert "-venv" in done.stderr
    assert "make PYTHON=/path/to/python3.11" in done.stderr

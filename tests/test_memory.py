"""What the system has: memory that is available, and what `make` asks for before it sets up."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from strainsight import memory
from strainsight.errors import UserError
from strainsight.memory import available_memory, require_memory

GIB = 1024**3


@pytest.fixture
def system(tmp_path, monkeypatch):
    """A machine with 8 GiB free, no groups and no limits; returns a function that writes its files."""

    def write(path, text):
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(str(text))

    monkeypatch.setattr(memory, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "CGROUP", tmp_path / "cgroup")
    write("proc/meminfo", f"MemTotal: 99999999 kB\nMemFree: 1 kB\nMemAvailable: {8 * GIB // 1024} kB\n")
    write("proc/self/cgroup", "9:cpu,cpuacct:/a\n0::/\n")
    return write


def test_a_system_that_reports_nothing_has_no_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "PROC", tmp_path)
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert available_memory() == math.inf
    require_memory(1e18, "the factor")


@pytest.mark.parametrize("limited", ["/outer/inner", "/outer", "/"])
def test_second_version_of_control_groups_at_any_level(system, limited):
    system("proc/self/cgroup", "0::/outer/inner\n")
    for group in ("/outer/inner", "/outer", "/"):
        system(f"cgroup{group}/memory.max", 3 * GIB if group == limited else "max")
        system(f"cgroup{group}/memory.current", 2 * GIB)
        system(f"cgroup{group}/memory.stat", f"anon 5\ninactive_file {GIB // 2}\nactive_file 7\n")
    assert available_memory() == 1.5 * GIB


@pytest.mark.parametrize("group", ["/outer", ""])
def test_first_version_of_control_groups_also_where_the_path_is_the_hosts(system, group):
    system("proc/self/cgroup", "4:memory:/outer\n1:name=systemd:/x\n0::/\n")
    system(f"cgroup/memory{group}/memory.limit_in_bytes", 2 * GIB)
    system(f"cgroup/memory{group}/memory.usage_in_bytes", GIB)
    system(f"cgroup/memory{group}/memory.stat", f"inactive_file 1\ntotal_inactive_file {GIB // 4}\n")
    assert available_memory() == 1.25 * GIB


def test_the_limit_of_address_space_less_what_is_in_use(system, monkeypatch):
    import resource

    monkeypatch.setattr(resource, "getrlimit", lambda which: (GIB, GIB))
    system("proc/self/statm", f"{GIB // 4 // resource.getpagesize()} 5 5 5 0 5 0\n")
    assert available_memory() == 0.75 * GIB


def test_the_refusal_names_need_and_means(system):
    require_memory(8 * GIB, "the factor")
    with pytest.raises(UserError, match=r"the factor: 9 GiB of memory are needed, but 8 GiB are available") as refused:
        require_memory(9 * GIB, "the factor")
    assert refused.value.exit_code == 2
    assert "coarser mesh" in refused.value.remedy


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


def test_a_python_without_venv_stops_with_a_way_without_root():
    done = asked("venv")
    assert done.returncode == 1
    assert "-venv" in done.stderr
    assert "make PYTHON=/path/to/python3.11" in done.stderr

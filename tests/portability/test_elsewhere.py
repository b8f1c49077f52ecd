"""A Python without fcntl, resource, SIGHUP and the like, as on Windows, and without PARDISO, as on a Mac: the commands work, say
what is not known, hold each other off and end when asked. And no source uses a name of POSIX alone without asking for it."""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ..robustness.small import write_project
from . import elsewhere

ROOT = Path(__file__).parents[2]
CHILD = str(Path(elsewhere.__file__))
SOURCES = [*(ROOT / "pipeline").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]
MORE = ("ftruncate64", "getpgid", "killpg", "setsid", "statvfs", "mkfifo", "uname", "wait", "waitpid")
OF_POSIX = {"os": {*elsewhere.OF_OS, *MORE} - {"fork"}, "signal": set(elsewhere.OF_SIGNAL)}
DOTTED = [rf"{module}\.{name}" for module, names in OF_POSIX.items() for name in sorted(names)]
NAMES = re.compile(rf"\b({'|'.join([*DOTTED, *sorted(elsewhere.MODULES)])})\b")


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    write_project(folder)
    return folder


def call(system: str, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, CHILD, system, *words], cwd=cwd, capture_output=True, text=True, check=False, timeout=120
    )


def start(system: str, *words: str) -> subprocess.Popen[str]:
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, CHILD, system, *words], text=True, **pipes)


@pytest.mark.slow
@pytest.mark.parametrize("system", ["windows", "bare"])
def test_an_import_works_and_the_log_reports_what_is_not_known(system, project):
    results = project / system
    done = call(system, "import", str(project / "beam.yaml"), "--results", str(results))
    assert (done.returncode, done.stderr) == (0, "")
    assert "peak memory unknown on this system" in (results / "beam" / "run.log").read_text(encoding="utf-8")
    assert not (results / "beam" / ".lock").exists()


def test_without_pardiso_a_warning_reports_what_that_costs():
    done = call("windows", "factorise")
    assert done.stdout == f"SuperLU {[float(x) for x in range(1, 10)]}\n"
    assert done.stderr.startswith("warning: the equation solver PARDISO is not available. SuperLU replaces it")
    assert "limited to 100 000 degrees of freedom" in done.stderr


@pytest.mark.slow
def test_a_second_run_is_refused_with_the_first_and_a_killed_one_is_reported(project):
    folder = project / "locked" / "beam"
    words = ("import", str(project / "beam.yaml"), "--results", str(folder.parent))
    with start("windows", "hold", str(folder)) as first:
        assert first.stdout.readline() == "holds\n"
        refused = call("windows", *words)
        assert refused.returncode == 2
        assert f"another run (process {first.pid}) is writing to this folder" in refused.stderr
        first.kill()
    after = call("windows", *words)
    assert after.returncode == 0
    assert f"an earlier run (process {first.pid}) was interrupted" in after.stderr
    assert not (folder / ".lock").exists()


def test_a_stage_that_another_process_computes_is_waited_for(project):
    folder = project / "waited" / "beam"
    with start("windows", "hold", str(folder)) as first:
        assert first.stdout.readline() == "holds\n"
        with start("windows", "wait", str(folder)) as second:
            assert second.stdout.readline() == "waits\n"
            first.stdin.close()
            assert second.stdout.readline() == "has it\n"
            assert second.wait(10) == 0


def test_a_run_ends_when_asked():
    number = signal.SIGTERM
    with start("windows", "sleep") as running:
        assert running.stdout.readline() == "starts\n"
        os.kill(running.pid, number)
        assert running.wait(5) == 128 + number
        assert "finished stages are kept" in running.stderr.read()


def _unasked(path: Path) -> list[str]:
    """Names of POSIX alone in a file, outside of a function or file part that asks for them."""
    text = path.read_text(encoding="utf-8")
    if not NAMES.search(text):
        return []
    tree = ast.parse(text)
    asked = {
        node.args[1].value
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("hasattr", "getattr")
        if len(node.args) > 1 and isinstance(node.args[1], ast.Constant)
    }
    excused = {inner for node in ast.walk(tree) if isinstance(node, ast.Try | ast.With) for inner in ast.walk(node)}
    found = []
    for node in ast.walk(tree):
        if node in excused:
            continue
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr not in asked:
            if node.attr in OF_POSIX.get(node.value.id, ()):
                found.append(f"{path.name}:{node.lineno} {node.value.id}.{node.attr}")
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names = [node.module] if isinstance(node, ast.ImportFrom) else [entry.name for entry in node.names]
            found += [
                f"{path.name}:{node.lineno} {name}" for name in names if name in elsewhere.MODULES - {"pypardiso"}
            ]
    return found


def test_no_source_takes_a_name_of_posix_for_granted(tmp_path):
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import fcntl\nimport os\nos.pread(0, 1, 0)\n", encoding="utf-8")
    assert len(_unasked(wrong)) == 2
    assert [found for path in SOURCES for found in _unasked(path)] == []

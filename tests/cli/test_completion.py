"""Completion as a shell asks for it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

COMMAND = """\
#!{python}
from strainsight_cli.main import app
app(prog_name="strainsight")
"""
BASH = """
eval "$(strainsight --show-completion bash)"
COMP_WORDS=(strainsight {words}); COMP_CWORD={last}
_strainsight_completion strainsight
printf '%s\\n' "${{COMPREPLY[@]}}"
complete -p strainsight
"""


@pytest.fixture(scope="module")
def completed(tmp_path_factory):
    """A function: words as typed → what bash offers for the last one, and last the rule that it was told."""
    folder = tmp_path_factory.mktemp("bin")
    (folder / "strainsight").write_text(COMMAND.format(python=sys.executable), encoding="utf-8")
    (folder / "strainsight").chmod(0o755)
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    # the name of the shell is given, as pytest was perhaps not started by one
    environment = {**os.environ, "PATH": path, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}

    def offered(*words: str) -> list[str]:
        script = BASH.format(words=" ".join(words), last=len(words))
        done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=60, env=environment)
        assert done.returncode == 0, done.stderr
        return [line.strip() for line in done.stdout.splitlines() if line.strip()]

    return offered


@pytest.mark.parametrize(
    ("words", "expected"),
    [(("sta",), {"statics", "status"}), (("do",), {"doctor"}), (("re",), {"reduce", "report"}), (("run", "--dr"), {"--dry-run"})],
)
def test_bash_completes_commands_and_options(words, expected, completed):
    assert set(completed(*words)[:-1]) == expected


def test_bash_falls_back_to_file_names_for_a_config(completed):
    *offered, rule = completed("run", "conf")
    assert offered == []
    assert "-o default" in rule


def test_the_shell_that_asks_is_recognised():
    """Without naming it, as the manual says."""
    command = f"{sys.executable} -m strainsight_cli.main --show-completion; true"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert "COMP_WORDS" in done.stdout

"""Whatever a name holds: no control of a terminal is printed, and no line that was not meant."""

from __future__ import annotations

import ast
import json
import os
import pty
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import strainsight_cli
from strainsight.errors import StrainsightError, UserError, printable
from strainsight.workflow.output import Table
from strainsight_cli.bar import progress_bar
from strainsight_cli.clock import Left
from strainsight_cli.failures import failure_of, plain_warnings, tell
from strainsight_cli.printing import json_line, say
from strainsight_cli.render import failure_json, print_tables
from strainsight_cli.work import note

HERE = Path(strainsight_cli.__file__).parent
CONTROLS = [chr(i) for i in (*range(32), *range(127, 160)) if i != 10]
BIDI = [chr(i) for i in (0x061C, *range(0x200B, 0x2010), *range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x2028, 0x2029, 0xFEFF)]
HOSTILE = "N\n\r\x1b[31mwarning: \x1b]0;title\x07" + "".join(CONTROLS + BIDI) + "\ud800 σ_é 漢"
BAD = {*CONTROLS, *BIDI}


def test_every_control_becomes_an_escape_and_letters_stay():
    assert not BAD & set(printable(HOSTILE))
    for text in ("G1 σ é 漢 µm/m ±√", "0.1\u00a0s", "316\u202f000"):
        assert printable(text) == text
    assert printable("a\x1b[0mb\nc\x9bd\u202ee") == r"a\x1b[0mb\nc\x9bd\u202ee"
    assert printable(printable(HOSTILE)) == printable(HOSTILE)


def test_json_is_read_back_as_it_was():
    line = json_line({"name": HOSTILE, "n": [1, 2.5, None]})
    assert not (BAD | {"\n"}) & set(line)
    assert json.loads(line) == {"name": HOSTILE, "n": [1, 2.5, None]}


@pytest.mark.parametrize(
    "printed",
    [
        lambda: say(HOSTILE),
        lambda: say(HOSTILE, error=True),
        lambda: note(HOSTILE),
        lambda: print_tables([Table(HOSTILE, (HOSTILE, "b"), ((HOSTILE, HOSTILE),))]),
        lambda: tell(failure_of(UserError(HOSTILE, where=HOSTILE, key=HOSTILE, remedy=HOSTILE)), True),
        lambda: tell(failure_of(StrainsightError(HOSTILE)), True),
        lambda: tell(failure_of(ValueError(HOSTILE)), False),
        lambda: tell(failure_of(OSError(2, "No such file", HOSTILE)), False),
        lambda: tell(failure_of(MemoryError(HOSTILE)), False),
        lambda: say(failure_json("place", HOSTILE, HOSTILE)),
    ],
)
def test_what_is_printed_holds_no_control_and_no_forged_line(printed, capsys):
    printed()
    captured = capsys.readouterr()
    text = captured.out + captured.err
    assert text
    assert not BAD & set(text)
    assert not any(line.startswith(("\r", "warning")) for line in text.split("\n"))


def test_a_warning_holds_no_control_and_no_forged_line(capsys):
    with warnings.catch_warnings():
        plain_warnings(False)
        warnings.warn(HOSTILE, stacklevel=1)
    text = capsys.readouterr().err
    assert text.startswith("warning: N\\n\\r\\x1b[31m")
    assert text.count("\n") == 1
    assert not BAD & set(text)


def test_a_bar_holds_no_control_of_a_name(monkeypatch):
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        with progress_bar(True) as move:
            move("run\x1b]0;pwn\x07", "place", "at \x1b[5mG1", 0.5, Left())
        terminal.flush()
        text = os.read(ours, 1 << 16)
    os.close(ours)
    assert b"pwn" in text
    assert b"\x1b]0;" not in text
    assert b"\x1b[5m" not in text


def test_words_of_the_command_line_hold_no_control():
    """A folder full of names is put into the words of a command by `*`."""
    for words in (["status", "a", "b\x1b[31mc"], ["no\x9b31m"], ["status", "--no\x1b[31m"], ["status", "x\x1b]0;t\x07.yaml"]):
        command = [sys.executable, "-m", "strainsight_cli.main", *words]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 2
        assert done.stderr
        assert not BAD & set(done.stdout + done.stderr)


def test_only_one_function_prints():
    """But for tables, whose cells are made printable one by one, and the answer of a child process."""
    for path in HERE.glob("*.py"):
        calls = [ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        prints = {"print", "typer.echo", "typer.secho", "sys.stdout.write", "sys.stderr.write"} & set(calls)
        assert not prints or path.name in ("printing.py", "render.py", "trials.py"), path

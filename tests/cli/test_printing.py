"""What is printed: the bar, time left, completion, and no control of a terminal whatever a name holds."""

from __future__ import annotations

import ast
import json
import os
import pty
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import strainsight_cli
from strainsight.errors import StrainsightError, UserError, printable
from strainsight.processes import SAFE_PATH
from strainsight.runner.output import Table
from strainsight.runner.runner import Event
from strainsight_cli.clock import ends_at
from strainsight_cli.failures import failure_of, plain_warnings, tell
from strainsight_cli.main import main
from strainsight_cli.printing import json_line, say
from strainsight_cli.render import print_tables, stage_json
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


def test_json_roundtrip():
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
        lambda: say(stage_json(Event("place", "failed", HOSTILE), HOSTILE)),
    ],
)
def test_output_has_no_control_characters_or_forged_lines(printed, capsys):
    printed()
    captured = capsys.readouterr()
    text = captured.out + captured.err
    assert text
    assert not BAD & set(text)
    assert not any(line.startswith(("\r", "warning")) for line in text.split("\n"))


def test_warning_has_no_control_characters_or_forged_lines(capsys):
    with warnings.catch_warnings():
        plain_warnings(False)
        warnings.warn(HOSTILE, stacklevel=1)
    text = capsys.readouterr().err
    assert text.startswith("warning: N\\n\\r\\x1b[31m")
    assert text.count("\n") == 1
    assert not BAD & set(text)


@pytest.mark.parametrize(
    "words", [["status", "a", "b\x1b[31mc"], ["no\x9b31m"], ["status", "--no\x1b[31m"], ["status", "x\x1b]0;t\x07.yaml"]]
)
def test_arguments_are_printed_without_control_characters(words, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["strainsight", *words])
    monkeypatch.setattr(sys, "warnoptions", [])
    for name in (SAFE_PATH, "PYDANTIC_DISABLE_PLUGINS"):  # which main sets for the rest of a process
        monkeypatch.setenv(name, "1")
    with pytest.raises(SystemExit) as caught:
        main()
    printed = capfd.readouterr()
    assert caught.value.code == 2
    assert printed.err
    assert not BAD & set(printed.out + printed.err)


def test_only_one_function_prints():
    for path in HERE.glob("*.py"):
        calls = [ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        prints = {"print", "typer.echo", "typer.secho", "sys.stdout.write", "sys.stderr.write"} & set(calls)
        assert not prints or path.name in ("printing.py", "render.py", "trials.py"), path


SCRIPT = """
import time
from strainsight_cli.bar import progress_bar
from strainsight_cli.clock import RemainingTime
with progress_bar(True) as move:
    move("run [1]\\x1b]0;pwn\\x07", "place", "so {far} [red]\\x1b[5m", 0.5, RemainingTime(time.time() + 42.5, 75.0))
    time.sleep(0.3)
    move("run [1]\\x1b]0;pwn\\x07", "", "", 1.0, RemainingTime())
"""
COLOUR = re.compile(rb"\x1b\[[0-9;]*[0-9]m")


def drawn(environment: dict[str, str]) -> bytes:
    own, its = pty.openpty()
    clean = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")}
    settings = {**clean, "TERM": "xterm", "COLUMNS": "160", **environment}
    process = subprocess.Popen([sys.executable, "-c", SCRIPT], stderr=its, stdout=its, env=settings)
    os.close(its)
    said = b""
    while True:
        try:
            part = os.read(own, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        said += part
    os.close(own)
    assert process.wait(timeout=60) == 0
    return said


@pytest.mark.parametrize(("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_progress_bar_shows_remaining_time(environment, coloured):
    said = drawn(environment)
    assert b"about 0:42 of run time left, 1:15 for the next stages" in COLOUR.sub(b"", said)
    assert b"so {far} [red]" in COLOUR.sub(b"", said)
    assert b"run [1]" in COLOUR.sub(b"", said)
    assert b"\x1b]0;" not in said
    assert b"\x1b[5m" not in said
    assert bool([code for code in COLOUR.findall(said) if code != b"\x1b[0m"]) == coloured


def test_progress_bar_is_omitted_in_pipe():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize(
    ("spent", "share", "last", "end"),
    [
        (5.0, 0.9, 60.0, 60.0),  # it took a minute last time: shares are no shares of the time
        (70.0, 0.7, 60.0, 100.0),  # longer than last time: what the share says
        (10.0, 0.25, None, 40.0),
        (1.0, 0.5, None, None),  # too early to say
        (10.0, 0.05, None, None),
        (70.0, 0.0, 60.0, None),
        (10.0, 1.5, None, 10.0),
    ],
)
def test_the_end_of_a_stage(spent, share, last, end):
    found = ends_at(1000.0, 1000.0 + spent, share, last)
    assert found == (None if end is None else pytest.approx(1000.0 + end))

"""The threat model of SECURITY.md: every promise names its test, and a reader changes, opens and starts nothing."""

from __future__ import annotations

import ast
import ctypes
import json
import os
import re
import sys
from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.processes import reader

ROOT = Path(__file__).parents[1]
SECURITY = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
SUSPICIOUS = re.compile(r"\b(eval|exec|system|popen|shell|allow_pickle|pickle)\b")
"""A file without any of these words has no such call and need not be parsed."""
OWN_PICKLES = {"pages/picture/scene.py", "pages/view/viewing.py"}
"""Child processes that this one starts itself, through pipes."""


def promises() -> list[tuple[str, str]]:
    """File and function of every test that the table of promises names."""
    table = SECURITY[SECURITY.index("## Promises") :]
    return re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", table[: table.index("\n## ", 1)])


def test_every_promise_has_a_test_that_is_there():
    rows = [row for row in SECURITY[SECURITY.index("## Promises") :].split("\n## ")[0].splitlines() if row.startswith("| ")]
    assert len(rows) >= 16
    assert all("`tests/" in row for row in rows[1:])  # the first one is the head
    for path, name in promises():
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, f"{path}::{name}"


def calls(tree: ast.AST) -> set[str]:
    """Names of all that is called, as they stand, and "shell" or "allow_pickle" where that is asked for."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            found.add(ast.unparse(node.func))
            for word in node.keywords:
                if word.arg in ("shell", "allow_pickle") and ast.unparse(word.value) != "False":
                    found.add(word.arg)
    return found


def test_nothing_that_is_read_is_executed():
    package = ROOT / "pipeline" / "strainsight"
    for path in [*package.rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        text = path.read_text(encoding="utf-8")
        found = calls(ast.parse(text)) if SUSPICIOUS.search(text) else set()
        assert not found & {"eval", "exec", "os.system", "os.popen", "shell", "allow_pickle"}, path
        if found & {"pickle.load", "pickle.loads"}:
            assert path.relative_to(package).as_posix() in OWN_PICKLES


@pytest.mark.parametrize("name", ["../out", "a/b", "/tmp/x", "..", ".hidden", "a\\b", "a b", "", "x" * 300])
def test_a_name_leads_to_no_other_folder(name):
    example = ROOT / "configs" / "cantilever-youngs-modulus.yaml"
    with pytest.raises(ConfigError, match="name"):
        load_config(example, [f"name={name!r}"])


CHILD = """
import ctypes, json, os, socket, subprocess, sys
from strainsight.processes import receive_request

library = ctypes.CDLL(None, use_errno=True)
functions = {{name: getattr(library, name) for name in {names}}}

def call(name, *arguments):
    if functions[name](*arguments) == -1:
        raise OSError(ctypes.get_errno(), "")  # a PermissionError for EPERM and EACCES

attempts = {{{attempts}}}
os.chdir(receive_request({options}))
outcome = {{"threads": len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1}}
for name, attempt in attempts.items():
    try:
        outcome[name] = repr(attempt())
    except PermissionError:
        outcome[name] = "refused"
    except Exception as error:
        outcome[name] = repr(error)
sys.stdout.write(json.dumps(outcome))
"""
PYTHON = {
    "open": "open('new', 'w')",
    "append": "open('old', 'a')",
    "update": "open('old', 'r+b')",
    "os.open": "os.open('new', os.O_CREAT | os.O_WRONLY)",
    "remove": "os.remove('old')",
    "rename": "os.rename('old', 'new')",
    "mkdir": "os.mkdir('new')",
    "symlink": "os.symlink('old', 'new')",
    "link": "os.link('old', 'new')",
    "chmod": "os.chmod('old', 0)",
    "truncate": "os.truncate('old', 0)",
    "socket": "socket.socket()",
    "connect": "socket.create_connection(('127.0.0.1', 9))",
    "resolve": "socket.getaddrinfo('localhost', 1)",
    "run": "subprocess.run([sys.executable, '-V'])",
    "system": "os.system('touch new')",
    "fork": "os.fork()",
    "exec": "os.execv(sys.executable, [sys.executable])",
    "kill": "os.kill(os.getppid(), 0)",
    "eval": "eval('1 + 1')",
    "exec of text": "exec('a = 1')",
    "compile": "compile('1', '<expr>', 'eval')",
    "compile under a name": "compile('1', '/usr/lib/x.py', 'eval')",
    "pickle": "__import__('pickle').loads(b'cos\\nsystem\\n(S\"touch new\"\\ntR.')",
    "ctypes": "ctypes.CDLL('libm.so.6')",
}
C = {
    "open": "call('open', b'new', os.O_CREAT | os.O_WRONLY, 0o600)",
    "open to write": "call('open', b'old', os.O_WRONLY)",
    "open and cut": "call('open', b'old', os.O_TRUNC)",
    "creat": "call('creat', b'new', 0o600)",
    "unlink": "call('unlink', b'old')",
    "rename": "call('rename', b'old', b'new')",
    "mkdir": "call('mkdir', b'new', 0o700)",
    "mkfifo": "call('mkfifo', b'new', 0o600)",
    "symlink": "call('symlink', b'old', b'new')",
    "link": "call('link', b'old', b'new')",
    "truncate": "call('truncate', b'old', 0)",
    "chmod": "call('chmod', b'old', 0)",
    "utime": "call('utime', b'old', None)",
    "setxattr": "call('setxattr', b'old', b'user.a', b'b', 1, 0)",
    "internet": "call('socket', 2, 1, 0)",
    "socket of the machine": "call('socket', 1, 1, 0)",
    "socketpair": "call('socketpair', 1, 1, 0, (ctypes.c_int * 2)())",
    "fork": "call('fork')",
    "clone": "call('syscall', 56 if os.uname().machine == 'x86_64' else 220, 17, 0, 0, 0, 0)",
    "execv": "call('execv', b'/bin/sh', None)",
    "kill": "call('kill', os.getppid(), 0)",
    "ptrace": "call('ptrace', 16, os.getppid(), 0, 0)",
}


def outcomes(tmp_path, attempts, options=""):
    """What became of each attempt in a reader's process, in a folder that holds one file, `old`."""
    (tmp_path / "old").write_text("as it was")
    lambdas = ", ".join(f"{name!r}: lambda: {attempt}" for name, attempt in attempts.items())
    names = sorted(set(re.findall(r"call\('(\w+)'", lambdas)))
    code = CHILD.format(names=names, attempts=lambdas, options=options)
    with reader([sys.executable, "-P", "-c", code], str(tmp_path), 30.0) as within:
        outcome = json.loads(within(30.0, lambda stream: stream.read()))
    assert outcome.pop("threads") == 1
    return outcome


def unchanged(tmp_path):
    status = (tmp_path / "old").stat()
    return os.listdir(tmp_path) == ["old"] and (tmp_path / "old").read_text() == "as it was" and status.st_mode & 0o400


def test_python_code_can_only_read(tmp_path):
    assert outcomes(tmp_path, PYTHON) == dict.fromkeys(PYTHON, "refused")
    assert unchanged(tmp_path)


def has_landlock():
    return sys.platform == "linux" and ctypes.CDLL(None).syscall(444, None, ctypes.c_size_t(0), 1) >= 3


compiled = pytest.mark.skipif(not has_landlock(), reason="needs a kernel with Landlock, version 3 or later")


@compiled
def test_compiled_code_can_only_read(tmp_path):
    assert outcomes(tmp_path, C) == dict.fromkeys(C, "refused")
    assert unchanged(tmp_path)


def test_reading_threads_and_imports_still_work(tmp_path):
    attempts = {
        "read": "open('old').read()",
        "null": "open(os.devnull, 'w').write('x')",
        "thread": "__import__('concurrent.futures').futures.ThreadPoolExecutor(1).submit(len, 'abc').result()",
        "import": "__import__('wave').__name__",
    }
    expected = {"read": "as it was", "null": 1, "thread": 3, "import": "wave"}
    assert outcomes(tmp_path, attempts) == {name: repr(value) for name, value in expected.items()}


@compiled
def test_a_folder_for_files_that_are_opened_for_writing_is_not_written_either(tmp_path):
    attempts = {
        "update": "call('open', b'old', os.O_RDWR)",
        "elsewhere": f"call('open', {os.fsencode(__file__)!r}, os.O_RDWR)",
        "write": "open('old', 'r+b', buffering=0).write(b'x')",
        "remove": "call('unlink', b'old')",
        "create": "call('open', b'new', os.O_CREAT | os.O_WRONLY, 0o600)",
        "cut": "call('truncate', b'old', 0)",
    }
    outcome = outcomes(tmp_path, attempts, "writable=lambda asked: asked")
    assert outcome.pop("update") == "None"
    assert "File too large" in outcome.pop("write")
    assert outcome == dict.fromkeys(outcome, "refused")
    assert unchanged(tmp_path)

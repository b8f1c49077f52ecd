"""The threat model of SECURITY.md: every promise names its test, which is there; and what holds for all readers at once."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

ROOT = Path(__file__).parents[1]
SECURITY = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
OWN_PICKLES = {"report/picture/offscreen.py", "report/view/viewer.py"}
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
    """No eval or exec, no shell, no pickle but between processes of this program."""
    package = ROOT / "pipeline" / "strainsight"
    for path in [*package.rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        found = calls(ast.parse(path.read_text(encoding="utf-8")))
        assert not found & {"eval", "exec", "os.system", "os.popen", "shell", "allow_pickle"}, path
        if found & {"pickle.load", "pickle.loads"}:
            assert path.relative_to(package).as_posix() in OWN_PICKLES


@pytest.mark.parametrize("name", ["../out", "a/b", "/tmp/x", "..", ".hidden", "a\\b", "a b", "", "x" * 300])
def test_a_name_leads_to_no_other_folder(name):
    example = ROOT / "configs" / "cantilever-youngs-modulus.yaml"
    with pytest.raises(ConfigError, match="name"):
        load_config(example, [f"name={name!r}"])

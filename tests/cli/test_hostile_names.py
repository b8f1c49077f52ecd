"""Names of runs, parameters and loads that are attacks are refused where they become paths or keys."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

from ..pages import hostile


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def config(folder):
    return hostile.config(folder)


@pytest.mark.parametrize("name", hostile.NAMES)
@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("name: beam-hostile", "name: {}", "name"),
        ("  " + "E" * 64 + ":", "  {}:", "parameters"),
        ("  " + "F" * 64 + ":", "  {}:", "loads"),
    ],
)
def test_what_becomes_a_path_or_a_key_is_refused_with_its_place(folder, config, old, new, key, name):
    text = config.read_text(encoding="utf-8")
    assert text.count(old) == 1
    changed = folder / "refused.yaml"
    changed.write_text(text.replace(old, new.format(hostile.quoted(name))), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(changed), "--results", str(folder / "none")])
    said = done.output + (done.stderr or "")
    assert done.exit_code == 2, said
    line = text[: text.index(old)].count("\n") + 1
    assert f"refused.yaml:{line}:" in said
    assert key in said
    assert "Traceback" not in said
    assert not (folder / "none").exists()

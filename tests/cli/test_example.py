"""Examples that come with the package: listed, written, never over other files, and run from the wheel in an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight_cli.example import EXAMPLES
from strainsight_cli.main import app

ROOT = Path(__file__).parents[2]
LARGEST = 400_000
"""[bytes] of an example's files in the wheel, packed."""


@pytest.fixture
def call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["example", *words])


def test_without_a_name_they_are_listed_and_nothing_is_written(call, tmp_path):
    listed = call()
    assert listed.exit_code == 0
    assert [line.split()[0] for line in listed.output.splitlines()[: len(EXAMPLES)]] == list(EXAMPLES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_a_config_whose_files_lie_beside_it(name, call, tmp_path):
    done = call(name)
    assert done.exit_code == 0
    assert f"strainsight run {name}.yaml" in done.output
    loaded = load_config(tmp_path / f"{name}.yaml")
    assert loaded.data["name"] == name
    named = [loaded.data["mesh"]["file"], loaded.data["gauges"]["fixed_file"]]
    named += [(loaded.data["estimate"] or {}).get("file")]
    assert {f"{name}.yaml", *filter(None, named)} == {path.name for path in tmp_path.iterdir()}
    original = load_config(ROOT / EXAMPLES[name].config)
    assert {k: v for k, v in original.data.items() if k not in ("name", "mesh")} == {
        k: v for k, v in loaded.data.items() if k not in ("name", "mesh")
    }


def test_files_that_are_there_stay_and_force_overwrites(call, tmp_path):
    assert call("cantilever").exit_code == 0
    assert call("cantilever").exit_code == 0  # they hold the same
    own = tmp_path / "cantilever.yaml"
    own.write_text("mine", encoding="utf-8")
    (tmp_path / "cantilever.bdf").unlink()
    refused = call("cantilever")
    assert refused.exit_code == 2
    assert refused.stderr.startswith("cantilever.yaml  the file exists, and nothing was written\n    go to an empty folder")
    assert "--force" in refused.stderr
    assert own.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "cantilever.bdf").exists()
    assert call("cantilever", "--force").exit_code == 0
    assert load_config(own).data["name"] == "cantilever"


def test_a_misspelt_name_gets_the_right_one(call):
    refused = call("lugg")
    assert refused.exit_code == 2
    assert refused.stderr == "no example 'lugg'\n    did you mean lug? `strainsight example` lists them\n"


def test_the_build_takes_just_what_examples_consist_of():
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {file for own in EXAMPLES.values() for file in (own.config, *own.files)}
    assert wheel["force-include"] == {file: f"strainsight_cli/shipped/{file}" for file in needed}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    subprocess.run([*pip, "--wheel-dir", str(folder), str(ROOT)], check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


@pytest.mark.slow
def test_the_wheel_alone_writes_and_imports_an_example_in_an_empty_folder(wheel, tmp_path):
    (tmp_path / "unpacked").mkdir()
    (tmp_path / "empty").mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "unpacked")
        shipped = [entry for entry in archive.infolist() if "/shipped/" in entry.filename]
        assert sum(entry.compress_size for entry in shipped) < LARGEST
        assert not [name for name in archive.namelist() if name.startswith(("tests/", "docs/", "meshes/"))]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "unpacked")}

    def strainsight(*words: str) -> subprocess.CompletedProcess[str]:
        # the packages from the wheel, and not those of the repository
        code = (
            f"import strainsight, strainsight_cli.main as main; "
            f"assert all(m.__file__.startswith({str(tmp_path)!r}) for m in (strainsight, main)); main.main()"
        )
        return subprocess.run(
            [sys.executable, "-c", code, *words],
            cwd=tmp_path / "empty",
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )

    written = strainsight("example", "lug")
    assert (written.returncode, written.stderr) == (0, "")
    done = strainsight("import", "lug.yaml")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "empty" / "results" / "lug" / "import.h5").is_file()

"""Examples that come with the package, and what `view` and `figures` need, refuse and write."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from strainsight import memory
from strainsight.config.load import load_config
from strainsight_cli.example import EXAMPLES
from strainsight_cli.main import app
from strainsight_cli.status import single_run_note

from ..robustness.small import write_project

ROOT = Path(__file__).parents[2]
LARGEST = 400_000
"""[bytes] of an example's files in the wheel, packed."""


@pytest.fixture
def call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["example", *words])


def test_examples_are_listed_without_a_name(call, tmp_path):
    listed = call()
    assert listed.exit_code == 0
    assert [line.split()[0] for line in listed.output.splitlines()[: len(EXAMPLES)]] == list(EXAMPLES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_contains_config_and_its_files(name, call, tmp_path):
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


def test_existing_files_are_kept_without_force(call, tmp_path):
    assert call("cantilever").exit_code == 0
    assert call("cantilever").exit_code == 0  # they hold the same
    own = tmp_path / "cantilever.yaml"
    own.write_text("mine", encoding="utf-8")
    (tmp_path / "cantilever.bdf").unlink()
    refused = call("cantilever")
    assert refused.exit_code == 2
    assert refused.stderr.startswith("cantilever.yaml  the file already exists with other content; nothing was written\n")
    assert "--force" in refused.stderr
    assert own.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "cantilever.bdf").exists()
    assert call("cantilever", "--force").exit_code == 0
    assert load_config(own).data["name"] == "cantilever"


def test_build_contains_exactly_the_example_files():
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


CONFIG = str(ROOT / "configs" / "cantilever-youngs-modulus.yaml")


@pytest.fixture
def view_call(tmp_path):
    def called(*words: str):
        return CliRunner().invoke(app, [*words, "--results", str(tmp_path / "results")])

    return called


def said(done) -> str:
    return done.output + (done.stderr or "")


@pytest.mark.slow
def test_after_import_the_mesh_is_pictured_and_a_changed_config_is_reported(view_call, tmp_path):
    assert view_call("import", CONFIG).exit_code == 0
    picture = tmp_path / "mesh.png"
    done = view_call("view", CONFIG, "--screenshot", str(picture))
    assert done.exit_code == 0, said(done)
    assert "640 elements" in done.output
    assert "older than the config" not in said(done)
    with Image.open(picture) as image:
        assert image.size == (1400, 900)
    # the validation's units do not matter to the mesh, those of the deck do
    changed = view_call("view", CONFIG, "--set", "mesh.length_unit=mm", "--screenshot", str(picture))
    assert changed.exit_code == 0, said(changed)
    assert "older than the config" in said(changed)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--screenshot", "a.jpg"), "ends in .png"),
        (("--screenshot", "none/a.png"), "folder not found"),
        (("--what", "stress"), "'field'"),
        (("--body", "hub"), "single body"),
    ],
)
def test_invalid_view_request_has_exit_code_2(view_call, words, text):
    done = view_call("view", CONFIG, *words)
    assert done.exit_code == 2
    assert text in said(done)


@pytest.mark.parametrize("command", ["view", "figures"])
def test_suite_has_no_view(command, view_call, tmp_path):
    suite = tmp_path / "two.yaml"
    suite.write_text(f"kind: suite\nname: two\ntitle: Two\nruns: [{{config: {CONFIG}, label: a}}]\n", encoding="utf-8")
    done = view_call(command, str(suite))
    assert done.exit_code == 2
    assert "one of its runs" in said(done)


@pytest.fixture
def forecast_call(tmp_path):
    write_project(tmp_path)
    words = (str(tmp_path / "beam.yaml"), "--results", str(tmp_path / "results"))
    return lambda command, *more: CliRunner().invoke(app, [command, *words, *more])


FORECAST = (
    "forecast: modes 1 s, rom 1 s, place 3 s, spectrum 1 s, validate 4 s and report 5 s for 246 degrees of freedom, 0.35 GiB; "
    "the forecast of processor time and memory"
)


def lines(result) -> list[str]:
    assert result.exit_code == 0, result.output
    return [line for line in result.output.splitlines() if line.startswith("forecast")]


def test_forecast_has_size_after_import_and_omits_finished_stages(forecast_call, monkeypatch):
    assert lines(forecast_call("run", "--dry-run")) == [
        "forecast: the deck has 0.0 MB; time and memory are known after the import"
    ]
    assert lines(forecast_call("import")) == []
    (line,) = lines(forecast_call("run", "--dry-run"))
    assert line.startswith(FORECAST)
    monkeypatch.setattr(memory, "available_memory", lambda: 0.1 * 2**30)
    (line,) = lines(forecast_call("run", "--dry-run"))
    assert line.endswith("; only 0.1 GiB are available: use a coarser mesh or a larger machine")


def test_forecast_says_that_sigma_is_invalid_without_a_known_load():
    path = ROOT / "configs" / "cantilever-input-youngs-modulus.yaml"
    assert "no load is known, so σ of parameters is invalid" in single_run_note(load_config(path).model)
    assert single_run_note(load_config(ROOT / "configs" / "cantilever-youngs-modulus.yaml").model) == ""

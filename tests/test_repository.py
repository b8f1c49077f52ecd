"""The files beside the package agree with it: citation, workflow, hooks, links of the first pages, locks."""

import ast
import importlib
import re
import tomllib

import pytest
from ruamel.yaml import YAML

import strainsight

from .shared import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHONS = [line.rsplit(" ", 1)[1] for line in PROJECT["classifiers"] if re.search(r":: Python :: 3\.\d+$", line)]


def parsed(name):
    return YAML(typ="safe").load((ROOT / name).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version():
    citation = parsed("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0"
    assert citation["title"] == PROJECT["name"]
    assert str(citation["version"]) == PROJECT["version"] == strainsight.__version__
    assert citation["license"] == PROJECT["license"]
    assert citation["keywords"] == PROJECT["keywords"]
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in PROJECT["authors"]]


def test_the_first_heading_of_the_changes_is_this_version():
    heading = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert heading[1] == PROJECT["version"]


def test_the_workflow_runs_every_python_of_the_classifiers():
    jobs = parsed(".github/workflows/ci.yml")["jobs"]
    linux = jobs["linux"]
    assert linux["strategy"]["matrix"]["python"] == PYTHONS
    assert PROJECT["requires-python"] == f">={PYTHONS[0]}"
    for job in jobs.values():
        assert job["steps"][-1] == {"run": "bash .ci/run"}
        assert "PYTHON" in job["env"]


@pytest.mark.parametrize("name", ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"])
def test_links_of_the_first_pages_lead_to_files(name):
    links = re.findall(r"\]\((?!https?:)([^)#]+)", (ROOT / name).read_text(encoding="utf-8"))
    assert links
    for link in links:
        assert (ROOT / link).exists(), f"{name}: {link}"


def test_what_benchmarks_take_from_the_package_is_there():
    benchmarks = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "benchmarks").glob("*.py")]
    for node in (node for tree in benchmarks for node in ast.walk(tree)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("strainsight"):
            module = importlib.import_module(node.module)
            for name in node.names:
                if not hasattr(module, name.name):
                    importlib.import_module(f"{node.module}.{name.name}")


@pytest.mark.parametrize("lock", ["requirements-dev.lock", ".ci/lowest.lock"])
def test_every_package_of_a_lock_has_hashes(lock):
    head, *packages = re.split(r"\n(?=\S)", (ROOT / lock).read_text(encoding="utf-8").rstrip())
    assert head.startswith("# What `make")
    assert len(packages) > 100
    for package in packages:
        pin, *hashes = package.replace(" \\", "").splitlines()
        assert re.match(r"[\w.-]+==[\w.]+( ; |$)", pin)
        assert hashes
        assert all(re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}", line) for line in hashes)


def test_build_tools_come_from_the_lock():
    from hatchling.build import get_requires_for_build_editable

    system = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    needed = {re.match(r"[\w-]+", line)[0] for line in [*system["requires"], *get_requires_for_build_editable()]}
    for lock in ("requirements-dev.lock", ".ci/lowest.lock"):
        assert needed <= set(re.findall(r"^([\w.-]+)==", (ROOT / lock).read_text(encoding="utf-8"), re.MULTILINE))
    builds = [line for line in (ROOT / "Makefile").read_text(encoding="utf-8").splitlines() if "--editable" in line]
    assert len(builds) == 2
    assert all("--no-index --no-build-isolation" in line for line in builds)


def test_ci_runs_the_commands_of_the_readme_in_their_order():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert re.search(r"^for target in lint run test shard; do$", script, re.MULTILINE)
    from .conftest import SHARDS, shard_of

    assert {shard_of(path) for path in (ROOT / "tests").rglob("test_*.py")} == set(range(1, SHARDS + 1))
    assert f"% {SHARDS} + 1" in (ROOT / "Makefile").read_text(encoding="utf-8")

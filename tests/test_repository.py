"""The files beside the package agree with it: citation, workflow, hooks, links of the first pages, locks, checks of the prose."""

import ast
import importlib
import os
import re
import subprocess
import sys
import tomllib

import pytest
from ruamel.yaml import YAML

import strainsight

from .shared import ROOT, script

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
    assert re.search(r"^make .* lint run$\nfor target in test shard; do$", script, re.MULTILINE)
    from .conftest import SHARDS, shard_of

    assert {shard_of(path) for path in (ROOT / "tests").rglob("test_*.py")} == set(range(1, SHARDS + 1))
    assert f"% {SHARDS} + 1" in (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def prose():
    return script(".ci/prose.py")


LONG = " ".join(["word"] * 31)


@pytest.mark.parametrize(
    ("name", "text", "problems"),
    [
        ("docs/a.md", "# A\nIt is sure and wrong.\nNothing is taken\nover.\n", [(2, "'sure and wrong'"), (3, "'taken over'")]),
        ("README.md", "He mends recommended amendments.\n", [(1, "'mends'")]),
        ("docs/a.md", "`/glued/distance` is how far a glued gauge was moved\n", [(1, "'glued'")]),
        ("docs/a.md", f"{LONG}.\n\n| {LONG}. | b |\n", [(1, "line of 155"), (1, "sentence of 31"), (3, "sentence of 31")]),
        ("docs/a.md", "A. B. C. D. E.\n\nA. B. C.\nD. E. F.\n", [(3, "paragraph of 6")]),
        ("docs/a.md", f"```\n{LONG}\n```\n", []),
        ("pipeline/p/a.py", '"""Sure\nand wrong."""\nx_sure_and_wrong = f"{1} glued"\n',
         [(1, "'Sure and wrong'"), (3, "'glued'")]),
        ("pipeline/p/heard.py", "x = Heard_of(told, mended)\n", [(1, "'Heard'"), (1, "'heard'"), (1, "'told'")]),
        ("pipeline/p/a.py", f'def f(own):\n    """{LONG}."""\n', [(1, "'own' as a name"), (2, "sentence of 31")]),
        ("pipeline/p/a.py", f'x = f"{LONG} {{x}}"\n', [(1, "sentence of 3")]),
        ("tests/a/test_x.py", 'x = "glued"\ndef test_a_card_is_taken_over():\n    pass\n', [(2, "'taken over'")]),
    ],
    ids=[
        "page, across lines", "within a word", "code", "long sentence", "long paragraph", "block of code", "texts of source",
        "names", "vague name", "long message", "names of tests",
    ],
)  # fmt: skip
def test_problem_of_prose_is_reported_at_its_line(prose, tmp_path, name, text, problems):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    reported = prose.problems(tmp_path)
    assert [line for _, line, _ in reported] == [line for line, _ in problems]
    assert all(message.startswith(start) for (_, _, message), (_, start) in zip(reported, problems, strict=True))


def test_listed_are_messages_with_their_remedies_and_keys_with_their_help(prose, tmp_path, monkeypatch):
    source = """
def check(m):
    what = f"the mass {m.value:g} kg is negative" if m.value < 0 else "the mass is not a number"
    raise E(what, remedy="Set a positive mass.")
mass: float = Field(description="Mass of the hub [kg].")
axes.legend(handles, "the two hubs", loc="upper left")
x = "a.b(c) d e"
\"\"\"Not a message.\"\"\"
"""
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline" / "a.py").write_text(source, encoding="utf-8")
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    assert list(prose.user_sentences()) == [
        ("pipeline/a.py", 4, "[the mass {value} kg is negative|the mass is not a number] → Set a positive mass."),
        ("pipeline/a.py", 5, "mass → Mass of the hub [kg]."),
        ("pipeline/a.py", 6, "the two hubs"),
    ]


def test_changed_files_are_those_of_the_last_commit_and_later_edits(prose, tmp_path):
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]

    def commit(*names):
        for name in names:
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(f"glued {len(names)}\n", encoding="utf-8")
        for command in (["add", "-A"], ["commit", "-qm", "x"]):
            subprocess.run([*git, *command], cwd=tmp_path, check=True)

    assert prose.changed_files(tmp_path) is None
    subprocess.run([*git, "init", "-q"], cwd=tmp_path, check=True)
    commit("README.md", "OLD.md", "docs/a.md")
    assert prose.changed_files(tmp_path) is None
    commit("README.md")
    (tmp_path / "docs" / "a.md").write_text("bonded\n", encoding="utf-8")
    (tmp_path / "NEW.md").write_text("glued\n", encoding="utf-8")
    assert prose.changed_files(tmp_path) == {"README.md", "docs/a.md", "NEW.md"}
    assert [name for name, *_ in prose.problems(tmp_path, prose.changed_files(tmp_path))] == ["NEW.md", "README.md"]
    commit(".ci/words.toml")
    assert prose.changed_files(tmp_path) is None


def test_a_test_file_that_cannot_be_imported_is_an_error(tmp_path):
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "test_x.py").write_text("from math import no_such\ndef test_a(): pass\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-c", os.devnull, "--rootdir", ".", "--import-mode=importlib"]
    done = subprocess.run([*command, "."], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == pytest.ExitCode.INTERRUPTED
    assert "cannot import name 'no_such'" in done.stdout

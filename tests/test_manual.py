"""The manual: it builds without a warning and loads nothing, its reference is complete, and what it quotes comes out."""

import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from html.parser import HTMLParser
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from strainsight import api
from strainsight.config.template import config_schema
from strainsight_cli.main import app

from .shared import ROOT, script

DOCS = ROOT / "docs"


quoted = script("docs/quoted.py")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("manual")
    options = ["-q", "-W", "--keep-going", "-D", "run_examples=0", "-D", "nb_execution_mode=off"]
    command = [sys.executable, "-m", "sphinx", *options, "-d", folder / "doctrees", DOCS, folder / "site"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


class Loads(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        named = {key: value or "" for key, value in attributes}
        self.found += [value for key, value in named.items() if key in ("src", "srcset", "data", "poster")]
        if tag == "link":
            self.found.append(named.get("href", ""))


@pytest.mark.slow
def test_the_site_loads_nothing_from_a_network(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        loads = Loads()
        loads.feed(page.read_text(encoding="utf-8"))
        for address in loads.found:
            assert not re.match(r"(?:[a-z]+:)?//", address), f"{page.name} loads {address}"
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"@import\s|url\(\s*['\"]?(?:https?:)?//", text), f"{style.name} loads from elsewhere"


def test_the_reference_lists_every_key_with_its_meaning():
    tables = defaultdict(set)
    for name, page in script("docs/config_reference.py").pages().items():
        listed = re.findall(r"^\| \[?`([^`]+)`.* \| (.*) \|$", page, re.MULTILINE)
        assert all(what.strip() for _, what in listed), name
        for key, _ in listed:
            path, _, last = key.rpartition(".")
            tables[name, path].add(last)
    for name, model in config_schema()["$defs"].items():
        if model.get("properties"):
            assert any(model["properties"].keys() <= keys for keys in tables.values()), name


def test_a_key_of_the_reference_shows_type_default_and_unit():
    pages = script("docs/config_reference.py").pages()
    assert "| `place.keep` | whole number ≥ 1 | required |" in pages["placement-place"]
    assert "| `place.instants` | whole number ≥ 1 | `20` |" in pages["placement-place"]
    assert re.search(r"\| `train.time_step` \| number \\> 0 \| required \| .*\\\[s\\\]", pages["placement-train"])


def test_api_reference_lists_every_public_name():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto\w+:: (\w+)$", text.split("## Errors")[0], re.MULTILINE)
    assert sorted(listed) == sorted(api.__all__)


def test_api_reference_formats_formulas_code_and_fields():
    lines = ["Steady filter.", "", "    0 = F P + P Fᵀ", "", "Use `a*b`, not a*b.", "gain  factor [-]"]
    assert script("docs/api_reference.py").restructured(lines) == [
        "Steady filter.", "", "", "::", "", "    0 = F P + P Fᵀ", "", "", "Use ``a*b``, not a\\*b.", ":gain: factor [-]",
    ]  # fmt: skip


@pytest.mark.slow
def test_the_tutorial_does_what_it_reports(tmp_path):
    few = [f"--set=validate.{own}" for own in ("repeats=2", "random_sets=2", "noise_factors=[]")]
    less = {"run": few, "status": few, "place": ["--set", "place.instants=3"]}
    run_page(DOCS / "tutorial.md", tmp_path, less)


@pytest.mark.slow
def test_the_pages_of_a_bench_do_what_they_report(tmp_path):
    folder = DOCS / "stages" / "bench"
    listed = re.search(r"```{toctree}\n(.*?)```", (folder / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    names = ["index", *listed[1].split()]
    assert set(names) == {page.stem for page in folder.glob("*.md")}
    for name in names:
        run_page(folder / f"{name}.md", tmp_path)


def test_paths_of_the_manual_exist():
    folders = "config|fem|mesh|decks|gauges|rom|augmentation|placement|estimation|multibody|measurements|stages|report|workflow"
    for page in sorted(DOCS.rglob("*.md")):
        if page.parent.name == "config":
            continue
        text = page.read_text(encoding="utf-8")
        for path in re.findall(rf"`((?:{folders})/[\w./]*\w+\.py)`", text):
            assert (ROOT / "pipeline" / "strainsight" / path).is_file(), f"{page.name}: {path}"
        for path in re.findall(r"`((?:tests|benchmarks|configs|meshes|pipeline|cli)/[\w./-]*\w+\.\w+)`", text):
            assert (ROOT / path).is_file(), f"{page.name}: {path}"


def test_commands_and_targets_of_the_manual_exist():
    commands = set(typer.main.get_command(app).commands)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([\w -]+):", makefile, re.MULTILINE)) | commands  # a stage is a target, too
    targets = {word for target in targets for word in target.split()}
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))):
        text = page.read_text(encoding="utf-8")
        parts = re.findall(r"^```\w*\n(.*?)^```|`([^`\n]+)`", text, re.DOTALL | re.MULTILINE)
        code = "\n".join(block or words for block, words in parts)
        for command in re.findall(r"^(?:\$ )?strainsight ([a-z][a-z-]*)", code, re.MULTILINE):
            assert command in commands, f"{page.name}: strainsight {command}"
        for target in re.findall(r"^make (?:\w+=\S+ )*([\w-]+)", code, re.MULTILINE):
            assert target in targets, f"{page.name}: make {target}"


def test_names_that_are_to_be_touched_are_in_their_files():
    found = 0
    for files, what in re.findall(
        r"^\| (`[^|]+) \| (.+) \|$", (DOCS / "extending.md").read_text(encoding="utf-8"), re.MULTILINE
    ):
        places = [
            ROOT / folder / name
            for name in re.findall(r"`([\w/]+\.py)`", files)
            for folder in (".", "pipeline/strainsight")
        ]
        text = "".join(place.read_text(encoding="utf-8") for place in places if place.is_file())
        for name in re.findall(r"`([A-Za-z_]\w+)`", what) if text else ():
            assert re.search(rf"\b{name}\b", text), f"{files}: {name}"
            found += 1
    assert found > 10


@pytest.mark.parametrize(
    ("line", "printed", "same"),
    [
        ("place  done … 100 → 4, gap 0.010 %", "place     done   13.3 s   100 → 4, gap 0.010 %, E ± 0.49 %", True),
        ("E ± 0.49 %", "E ± 0.50 %", True),
        ("E ± 0.49 %", "E ± 0.59 %", False),
        ("3666 nodes", "3665 nodes", False),
        ("3666 nodes", "3666 elements", False),
        ("G1 28 …", "G1  28  0.5  0.6", True),
    ],
)
def test_quoted_lines_are_compared_by_words_and_numbers(line, printed, same):
    assert quoted.within(line, printed) is same


def run_page(page, folder, less=None):
    """Run the commands of a page's `<!-- run -->` blocks in `folder`; every other line of a block has to be printed.

    `<!-- file: NAME -->` before a block of YAML writes it there first. less: words behind a command of strainsight."""
    text = page.read_text(encoding="utf-8")
    for name, content in re.findall(r"<!-- file: (\S+) -->\n```yaml\n(.*?)```", text, re.DOTALL):
        (folder / name).write_text(content, encoding="utf-8")
    blocks = quoted.blocks(text)
    assert blocks
    for block in blocks:
        for command, lines in quoted.commands(block):
            printed = _run(command, folder, less or {})
            for line in quoted.missing(lines, printed):
                pytest.fail(f"{page.name}: {command} does not print\n{line}\nbut\n{printed}")


def _run(command, folder, less):
    """What it prints: a command of strainsight in this process, which has loaded everything already, others by the shell."""
    command = command.replace("REPOSITORY", str(ROOT))
    program, *arguments = shlex.split(command)
    if program == "strainsight":
        before = Path.cwd()
        os.chdir(folder)
        try:
            done = CliRunner(env={"NO_COLOR": "1", "COLUMNS": "120"}).invoke(app, [*arguments, *less.get(arguments[0], ())])
        finally:
            os.chdir(before)
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        code, printed = done.exit_code, done.output
    else:
        said = subprocess.run(command, shell=True, cwd=folder, capture_output=True, text=True)
        code, printed = said.returncode, said.stdout + said.stderr
    assert code == 0, f"{command}\n{printed}"
    return printed

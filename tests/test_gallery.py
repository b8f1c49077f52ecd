"""The gallery and the primer of the manual: what they quote comes out when their commands run."""

from __future__ import annotations

import doctest
import importlib.util
import re

import pytest

from .shared import ROOT

DOCS = ROOT / "docs"
QUICK = ("springs",)
"""Run every time; the others where all of it is."""


def _loaded():
    spec = importlib.util.spec_from_file_location("gallery_pages", DOCS / "gallery_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


gallery = _loaded()


@pytest.fixture(scope="module")
def there(tmp_path_factory):
    return gallery.laid_out(tmp_path_factory.mktemp("gallery"))


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in gallery.names()]
)
def test_a_page_says_what_comes_out(name, there):
    """Without the pictures, which the build of the manual draws."""
    gallery.run(name, there, pictures=False)


def test_the_gallery_lists_its_pages_and_every_page_shows_a_picture():
    assert set(gallery.names()) == {page.stem for page in gallery.FOLDER.glob("*.md")} - {"index"}
    assert len(gallery.names()) >= 10
    index = (gallery.FOLDER / "index.md").read_text(encoding="utf-8")
    for name in gallery.names():
        text = (gallery.FOLDER / f"{name}.md").read_text(encoding="utf-8")
        picture = re.search(rf"^!\[.+\]\(({name}\.(?:png|svg))\)$", text, re.MULTILINE)
        assert picture, name
        assert f"({picture[1]})]({name}.md)" in index, name


def test_every_config_of_the_gallery_is_shown_on_a_page():
    pages = "".join(page.read_text(encoding="utf-8") for page in gallery.FOLDER.glob("*.md"))
    for config in gallery.FOLDER.glob("*.yaml"):
        assert f"{{literalinclude}} {config.name}" in pages, config.name


def test_a_number_that_was_neither_printed_nor_stated_is_found():
    printed, stated = "tip ± 6.5 %, 3471 ± 445 N RMS, 41.17 Hz", "frequency: 20.0"
    assert gallery.unfounded("6.5 %, 3471 N, 41.2 Hz, 20 Hz, `7 %`", printed, stated) == []
    assert gallery.unfounded("8.1 %, and 445 % or 30 Hz", printed, stated) == ["8.1 %", "445 %", "30 Hz"]


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("$ strainsight schema\nno such line\n", "does not print"),
        ("$ strainsight run nothing.yaml\n", "ended with 2"),
        ("$ rm -r results\n", "not a command of strainsight"),
    ],
)
def test_a_page_that_says_something_else_is_refused(block, said, there, tmp_path, monkeypatch):
    (tmp_path / "wrong.md").write_text(f"# Wrong\n\n<!-- run -->\n```console\n{block}```\n", encoding="utf-8")
    monkeypatch.setattr(gallery, "FOLDER", tmp_path)
    with pytest.raises(RuntimeError, match=said):
        gallery.run("wrong", there)


def test_the_numbers_of_the_primer_come_out():
    page = DOCS / "primer.md"
    text = re.sub(r"^```.*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    said = []
    runner = doctest.DocTestRunner()
    runner.run(doctest.DocTestParser().get_doctest(text, {}, page.name, str(page), 0), out=said.append)
    assert runner.tries > 20
    assert not runner.failures, "".join(said)

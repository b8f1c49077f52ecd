"""The examples, the gallery and the primer of the manual do what they say."""

from __future__ import annotations

import ast
import doctest
import importlib.util
import re
import runpy
import shutil

import pytest

from strainsight import api

from .shared import ROOT

FOLDER = ROOT / "docs" / "examples"
LESS = ("place.instants=1", "validate.random_sets=0", "validate.repeats=2", "validate.truth.modes=20", "screen.keep=40")
SHORT = {
    "cantilever-youngs-modulus": ("train.duration=0.1", "validate.duration=0.1", "validate.noise_factors=[]"),
    "test": (),
}


@pytest.fixture
def printed(monkeypatch, tmp_path, capsys):
    """What an example prints, shortened; it draws into the temporary folder."""
    load = api.load

    def run(name, *more):
        def shortened(path, overrides=()):
            own = load(path, overrides)
            return load(path, [*overrides, *LESS, *SHORT[own.config.name], *more])

        monkeypatch.chdir(ROOT)
        monkeypatch.setattr(api, "load", shortened)
        runpy.run_path(str(shutil.copy(FOLDER / f"{name}.py", tmp_path)), run_name="__main__")
        return capsys.readouterr().out

    return run


@pytest.mark.slow
def test_a_layout_takes_twelve_lines(printed):
    code = ast.parse((FOLDER / "layout.py").read_text(encoding="utf-8"))
    assert len(code.body) - 1 <= 12
    text = printed("layout")
    assert re.findall(r"^(G\d) at", text, re.MULTILINE) == ["G1", "G2", "G3", "G4"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("criterion", (), "σ of the force upwards"),
        ("own_list", ("tolerances.frequency=0",), "the layout of `place`"),  # the elimination does not know of it
        ("validation", (), "claimed σ"),
        ("estimate", (), "nothing speaks against the claimed σ"),
    ],
)
def test_an_example_prints_its_numbers_and_draws(printed, tmp_path, name, more, words):
    assert words in printed(name, *more)
    assert any(path.stat().st_size > 5000 for path in tmp_path.glob(f"{name}.*g"))


DOCS = ROOT / "docs"

def _loaded():
    spec = importlib.util.spec_from_file_location("gallery_pages", DOCS / "gallery_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


gallery = _loaded()


@pytest.fixture(scope="module")
def there(tmp_path_factory):
    return gallery.laid_out(tmp_path_factory.mktemp("gallery"))


@pytest.mark.slow
@pytest.mark.parametrize("name", gallery.names())
def test_a_page_says_what_comes_out(name, there):
    """Without the pictures, which the build of the manual draws."""
    gallery.run(name, there, pictures=False)


def test_a_number_that_was_neither_printed_nor_stated_is_found():
    printed, stated = "tip ± 6.5 %, 3471 ± 445 N RMS, 41.17 Hz", "frequency: 20.0"
    assert gallery.unfounded("6.5 %, 3471 N, 41.2 Hz, 20 Hz, `7 %`", printed, stated) == []
    assert gallery.unfounded("8.1 %, and 445 % or 30 Hz", printed, stated) == ["8.1 %", "445 %", "30 Hz"]


def test_a_page_that_says_something_else_is_refused(there, tmp_path, monkeypatch):
    page = "# Wrong\n\n<!-- run -->\n```console\n$ strainsight run nothing.yaml\n```\n"
    (tmp_path / "wrong.md").write_text(page, encoding="utf-8")
    monkeypatch.setattr(gallery, "FOLDER", tmp_path)
    with pytest.raises(RuntimeError, match="ended with 2"):
        gallery.run("wrong", there)


def test_the_numbers_of_the_primer_come_out():
    page = DOCS / "primer.md"
    text = re.sub(r"^```.*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    said = []
    runner = doctest.DocTestRunner()
    runner.run(doctest.DocTestParser().get_doctest(text, {}, page.name, str(page), 0), out=said.append)
    assert runner.tries > 20
    assert not runner.failures, "".join(said)

"""The examples, the gallery and the primer of the manual do what they say."""

from __future__ import annotations

import ast
import doctest
import re
import runpy
import shutil

import pytest

from strainsight import api

from .shared import ROOT, script

DOCS = ROOT / "docs"
FOLDER = DOCS / "examples"
LESS = ("place.instants=1", "validate.random_sets=0", "validate.repeats=2", "validate.truth.modes=20", "screen.keep=40")
SHORT = {
    "cantilever-youngs-modulus": ("train.duration=0.1", "validate.duration=0.1", "validate.noise_factors=[]"),
    "test": (),
}


pages = script("docs/example_pages.py")


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


def numbers(text, pattern):
    return [float(found) for found in re.findall(pattern, text)]


@pytest.mark.slow
def test_a_layout_takes_twelve_lines(printed):
    code = ast.parse((FOLDER / "layout.py").read_text(encoding="utf-8"))
    assert len(code.body) - 1 <= 12
    text = printed("layout")
    assert re.findall(r"^(G\d) at", text, re.MULTILINE) == ["G1", "G2", "G3", "G4"]
    assert 0 < numbers(text, r"will claim: ([\d.]+) %")[0] < 5


@pytest.mark.slow
def test_more_gauges_cost_less_and_criteria_differ(printed, tmp_path):
    text = printed("criterion")
    cost = numbers(text, r"gauges: tr\(W P\) = ([\d.]+)")
    assert len(cost) == 6
    assert cost == sorted(cost, reverse=True)
    assert len(re.findall(r"^\w+: σ of the force upwards", text, re.MULTILINE)) == 3
    assert (tmp_path / "criterion.svg").stat().st_size > 5000


@pytest.mark.slow
def test_a_list_of_ones_own_knows_less_without_a_gauge(printed, tmp_path):
    text = printed("own_list", "tolerances.frequency=0")
    (own,), without = numbers(text, r"your list: σ of E ([\d.]+)"), numbers(text, r"of your list: ([\d.]+)")
    assert len(without) == 4
    assert min(without) >= own
    assert numbers(text, r"the layout of `place`: ([\d.]+)")[0] <= own
    assert (tmp_path / "own_list.svg").stat().st_size > 5000


@pytest.mark.slow
def test_the_error_of_a_validation_is_within_three_of_its_claimed_std(printed, tmp_path):
    text = printed("validation")
    error, std = (numbers(text, pattern)[0] for pattern in (r"error ([\d.]+) %", r"claimed σ ([\d.]+)"))
    assert error < 3 * std
    assert (tmp_path / "validation.svg").stat().st_size > 5000


@pytest.mark.slow
def test_a_test_gives_the_force_and_the_strain_of_the_surface(printed, tmp_path):
    text = printed("estimate")
    assert numbers(text, r"error: ([\d.]+) %")[0] < 20
    assert "consistent with the claimed σ" in text
    assert (tmp_path / "estimate.png").stat().st_size > 5000


def test_every_example_is_in_the_manual():
    listed = re.search(r"```{toctree}\n(.*?)```", (FOLDER / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    assert sorted(listed[1].split()) == [script.stem for script in pages.scripts()]


gallery = script("docs/gallery_pages.py")


@pytest.fixture(scope="module")
def there(tmp_path_factory):
    return gallery.laid_out(tmp_path_factory.mktemp("gallery"))


@pytest.mark.slow
@pytest.mark.parametrize("name", gallery.names())
def test_a_page_says_what_comes_out(name, there):
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

"""The notebooks, the gallery and the primer of the manual do what they say."""

from __future__ import annotations

import doctest
import re
import runpy

import matplotlib
import pytest
from matplotlib import pyplot

from strainsight import api

from .shared import ROOT, script

DOCS = ROOT / "docs"
FOLDER = DOCS / "notebooks"
LESS = ("place.instants=1", "validate.random_sets=0", "validate.repeats=2", "validate.truth.modes=20", "screen.keep=40")
SHORT = {
    "cantilever-youngs-modulus": ("train.duration=0.1", "validate.duration=0.1", "validate.noise_factors=[]"),
    "test": (),
}


@pytest.fixture
def run_notebook(monkeypatch, capsys):
    """Run a notebook, shortened, as a script: (printed text, number of figures)."""
    load = api.load

    def shortened(path, overrides=()):
        return load(path, [*overrides, *LESS, *SHORT[load(path, overrides).config.name]])

    def run(name):
        monkeypatch.chdir(FOLDER)
        monkeypatch.setattr(api, "load", shortened)
        matplotlib.use("agg")
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
        figures = len(pyplot.get_fignums())
        pyplot.close("all")
        return capsys.readouterr().out, figures

    return run


def numbers(text, pattern):
    return [float(hit) for hit in re.findall(pattern, text)]


@pytest.mark.slow
def test_placement_notebook_prints_four_gauges_and_a_calibrated_error(run_notebook):
    text, figures = run_notebook("placement")
    assert re.findall(r"^(G\d) at", text, re.MULTILINE) == ["G1", "G2", "G3", "G4"]
    error, std = (numbers(text, pattern)[0] for pattern in (r"error ([\d.]+) %", r"claimed σ ([\d.]+)"))
    assert error < 3 * std
    assert figures == 3


@pytest.mark.slow
def test_estimation_notebook_recovers_the_force_within_20_percent(run_notebook):
    text, figures = run_notebook("estimation")
    assert numbers(text, r"error: ([\d.]+) %")[0] < 20
    assert "consistent with the claimed σ" in text
    assert figures == 2


@pytest.mark.slow
def test_bench_notebook_recovers_the_force_within_20_percent(run_notebook):
    text, figures = run_notebook("bench")
    assert numbers(text, r"error: ([\d.]+) %")[0] < 20
    assert figures == 2


@pytest.mark.slow
def test_modes_notebook_simulates_the_std_of_the_placement(run_notebook):
    text, figures = run_notebook("modes")
    std, error = (numbers(text, rf"{name}: +([\d.]+)")[0] for name in ("σ of the placement", "RMS of the error"))
    assert error == pytest.approx(std, rel=0.05)
    assert figures == 2


@pytest.mark.slow
def test_criterion_notebook_lowers_the_metric_with_every_gauge(run_notebook):
    text, figures = run_notebook("criterion")
    metric = numbers(text, r"gauges: tr\(W P\) = ([\d.]+)")
    assert len(metric) == 6
    assert metric == sorted(metric, reverse=True)
    assert re.search(r"^frobenius +σ = ", text, re.MULTILINE)
    assert figures == 2


def test_every_notebook_is_in_the_manual():
    listed = re.search(r"```{toctree}\n(?::\w+:\n)?(.*?)```", (FOLDER / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    assert sorted(listed[1].split()) == sorted(path.stem for path in FOLDER.glob("*.py"))


gallery = script("docs/gallery_pages.py")


@pytest.fixture(scope="module")
def there(tmp_path_factory):
    return gallery.laid_out(tmp_path_factory.mktemp("gallery"))


@pytest.mark.slow
@pytest.mark.parametrize("name", gallery.names())
def test_a_page_reports_what_comes_out(name, there):
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

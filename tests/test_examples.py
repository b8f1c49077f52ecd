"""The examples of the manual do what they say, here with less of everything; pages are made of them."""

from __future__ import annotations

import ast
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


@pytest.fixture(scope="module")
def pages():
    spec = importlib.util.spec_from_file_location("example_pages", ROOT / "docs" / "example_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def printed(monkeypatch, tmp_path, capsys):
    """What an example prints, shortened; it draws into the temporary folder."""
    load = api.load

    def shortened(path, overrides=()):
        own = load(path, overrides)
        return load(path, [*overrides, *LESS, *SHORT[own.config.name]])

    def run(name):
        monkeypatch.chdir(ROOT)
        monkeypatch.setattr(api, "load", shortened)
        runpy.run_path(str(shutil.copy(FOLDER / f"{name}.py", tmp_path)), run_name="__main__")
        return capsys.readouterr().out

    return run


def numbers(text, pattern):
    return [float(found) for found in re.findall(pattern, text)]


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
    text = printed("own_list")
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
    assert "nothing speaks against the claimed σ" in text
    assert (tmp_path / "estimate.png").stat().st_size > 5000


def test_every_example_is_in_the_manual(pages):
    listed = re.search(r"```{toctree}\n(.*?)```", (FOLDER / "index.md").read_text(encoding="utf-8"), re.DOTALL)[
        1
    ].split()
    assert sorted(listed) == [script.stem for script in pages.scripts()]


def test_comments_become_prose_and_code_stays_code(pages, tmp_path):
    script = tmp_path / "sum.py"
    script.write_text('"""A sum."""\n\nx = 1\n\n# Two lines\n# of prose.\ny = x + 1  # a remark\nprint(y)\n')
    (tmp_path / "sum.svg").write_text("<svg/>")
    assert pages.page(script, "2\n") == (
        "# A sum\n\n```python\nx = 1\n```\n\nTwo lines of prose.\n\n```python\ny = x + 1  # a remark\nprint(y)\n```\n\n"
        "It prints\n```\n2\n```\n\n![sum](sum.svg)\n"
    )


def test_an_example_that_fails_ends_the_build_with_what_it_said(pages, tmp_path):
    script = tmp_path / "broken.py"
    script.write_text('"""Broken."""\nraise SystemExit("no such deck")\n')
    with pytest.raises(RuntimeError, match=r"broken\.py ended with 1: no such deck"):
        pages.printed_by(script)

"""Page and figures of a test: whole and self-contained in every case, with the numbers of the findings."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.experiment.structure.campaign_text import channel_table
from strainsight.pages.chart.drawing import recorded_figures
from strainsight.pages.chart.files import figure_csv
from strainsight.pages.picture.geometry import at_points
from strainsight.pages.tested.figures import figures_of_test, load_figure, reading_figure, spectrum_figure
from strainsight.pages.tested.page import page_of_test
from strainsight.records.estimated import ChannelsChecked

from ...models import compute_once
from ...shared import slowly
from ..outline import HOSTILE, nothing_comes_from_outside, renamed, whole
from .findings import CASES, NOISE, SAMPLES, findings, held_out, history, load, missing, reading, spectrum, withheld

PNG = b"\x89PNG not really"


def page(case="plain", own=None, pictures=(PNG, PNG), problem="", *, figures=False):
    findings = own or CASES[case]()
    return page_of_test(findings, compute_once(figures_of_test, findings) if figures else (), pictures, problem)


def shown(text, after):
    """The exact numbers of the row that begins with this word."""
    row = re.search(rf'<tr><th scope="row">(?:<span[^>]*>)?{re.escape(after)}(?:</span>)?</th>(.*?)</tr>', text)
    assert row, after
    return [float(value) for value in re.findall(r'<data value="([^"]+)"', row[1])]


@pytest.mark.parametrize(
    ("case", "figures"), [*((case, False) for case in CASES), ("plain", True), *slowly(*((case, True) for case in CASES))]
)
def test_page_is_whole_in_every_case_and_fetches_nothing(case, figures):
    text = page(case, figures=figures)
    outline = whole(text)
    assert not re.search(r"\bnan\b", " ".join(outline.text), re.IGNORECASE)
    for own in CASES[case]().readings if figures else ():
        assert f">{own.label}</h3>" in text


def test_the_first_screen_has_every_unknown_with_its_sigma_and_the_result():
    text = page(figures=True)
    first = text[: text.index("Measured and reconstructed")]
    rms = float(np.sqrt(np.mean(load() ** 2)))
    assert f'<data value="{rms!r}" data-unit="N">' in first
    top = float(load().max())
    assert f'<data value="{top!r}" data-unit="N">' in first
    assert f'<data value="{1.2e9 / 2.1e11!r}">' in first
    assert "✓ the innovations are as large as expected from the configured noise." in first


def test_withheld_sigma_comes_first_with_its_reason_and_no_number_stands_for_it():
    own = withheld()
    text = page("σ withheld")
    answer = re.search(r'<p class="answer"[^>]*>(.*?)</p>', text)
    assert answer
    assert answer[1].startswith(f'<strong class="bad">{own.warnings[0]}.')
    assert answer[1].count("σ withheld") == 2
    assert text.count(">inconsistent<") == 1


def test_a_channel_is_compared_with_its_noise():
    text = page()
    own = findings().readings[0]
    left = own.measured - own.estimated
    size, rest, ratio, top, at, gone = shown(text, "G1")
    assert rest == pytest.approx(np.sqrt(np.mean(left**2)))
    assert ratio == pytest.approx(1.0, abs=0.05) == rest / NOISE
    assert size == pytest.approx(np.sqrt(np.mean(own.measured**2)))
    assert (abs(top), at) == (np.abs(own.measured).max(), own.time[np.abs(own.measured).argmax()])
    assert gone == 0


@pytest.mark.parametrize("consistent", [True, False])
def test_a_large_residual_is_marked_only_in_an_inconsistent_record(consistent):
    own = findings()
    loud = replace(own.readings[0], noise_std=NOISE / 10)
    text = page(own=replace(own, readings=(loud, *own.readings[1:]), consistent=consistent))
    row = re.search(r">G1</span></th>(.*?)</tr>", text)
    assert row
    assert ('class="bad"' in row[1]) is not consistent


def test_missing_samples_are_counted_and_never_drawn_across():
    drawn = (reading_figure(missing().readings[0]), spectrum_figure(missing().residuals[0], "#0072b2"))
    text = page_of_test(missing(), drawn, ())
    assert shown(text, "G1")[-1] == 2100
    assert shown(text, "G2") == [SAMPLES]  # and dashes for what cannot be known of it
    assert "Missing samples in the filter: 2100 of 4000" in text
    assert "G1: missing samples in the file: 1 of 4001" in text
    assert re.search(r"<th[^>]*>missing samples in the filter</th>", text)
    assert "No spectrum of G2: too few consecutive samples" in text
    assert missing().readings[1].missing == SAMPLES


@pytest.mark.parametrize("by_others", [True, False])
def test_predicted_channels_have_the_heading_of_the_terminal(by_others):
    numbers = dict.fromkeys(("measured", "predicted", "residual", "correlation", "gain"), np.ones(1))
    check = ChannelsChecked(by_others=by_others, begin=0.0, end=1.0, fault=("sign",), candidate=(), **numbers)
    gauge = SimpleNamespace(label=("G1",), time=np.array([0.0, 2.0]))
    listed = channel_table(SimpleNamespace(check=check, gauge=gauge), ["strain"])
    how = "from all other channels" if by_others else "one step ahead from all channels"
    assert listed.title == f"readings of the channels, predicted {how}, from 0 to 1 s"
    text = page(own=replace(findings(), checked=listed))
    assert text.count(f">{listed.title.capitalize()}</h2>") == 1
    assert ("one step ahead" in text) is not by_others


def test_held_out_channels_have_a_table_a_cross_plot_and_an_overlay():
    text = page("held out")
    error, share, sigma, inside = shown(text[text.index('data-table="hold-out"') :], "G1")
    own = held_out().hold_out[0]
    residual = own.residual
    assert error == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert share == pytest.approx(np.sqrt(np.mean(residual**2) / np.mean(own.measured**2)))
    assert sigma == pytest.approx(np.sqrt(np.mean((residual / own.std) ** 2)))
    assert inside == pytest.approx(np.mean(np.abs(residual) < 2 * own.std))
    assert inside == pytest.approx(0.954, abs=0.01)
    assert "No gauge was held out" in page()
    assert "No gauge was held out" not in text


def test_names_of_a_config_are_text_on_the_page_and_nothing_else():
    text = page_of_test(renamed(findings()), (), (), HOSTILE)
    assert "<script>alert" not in text
    nothing_comes_from_outside(text)


def numbers(draw):
    """The table of what a figure draws: head → column."""
    with recorded_figures() as figures:
        drawing = draw()
    rows = [line.split(",") for line in figure_csv(figures[drawing.svg]).decode().splitlines()]
    return {name: [float(row[i]) for row in rows[1:] if row[i]] for i, name in enumerate(rows[0])}


def test_a_long_record_keeps_its_peaks_and_is_drawn_in_few_points():
    steps = 200_000
    time, values = 1e-4 * np.arange(1, steps + 1), 1e-5 * np.sin(np.arange(steps))
    values[123_456], values[77] = 9e-4, -7e-4
    own = replace(reading(), time=time, measured=values, estimated=values.copy(), std=np.full(steps, 1e-6))
    drawn = numbers(lambda: reading_figure(own))
    measured = drawn["measured: strain [µm/m]"]
    assert max(measured) == pytest.approx(900)
    assert min(measured) == pytest.approx(-700)
    assert len(measured) < 4000
    assert len(reading_figure(own).svg) < 400_000


def test_a_load_is_drawn_with_its_band_in_its_unit():
    drawn = numbers(lambda: load_figure("load", history("side", load(), 60.0), "#0072b2"))
    high = max(drawn["band high: side [kN]"])
    assert high == pytest.approx((load().max() + 120.0) / 1e3)
    assert not any(
        "band" in name for name in numbers(lambda: load_figure("known", history("tip", load(), np.nan), "#0072b2"))
    )


def test_the_noise_as_stated_is_a_line_at_the_root_of_its_density():
    own = spectrum("G1", level=4e-18)
    drawn = numbers(lambda: spectrum_figure(own, "#0072b2"))
    (level,) = drawn["configured noise: √PSD [nm/m/√Hz]"]
    assert level == pytest.approx(2.0)
    assert max(drawn["residual: √PSD [nm/m/√Hz]"]) == pytest.approx(1e9 * np.sqrt(own.density.max()))


def test_values_of_facets_become_those_of_their_points_and_keep_a_constant():
    own = findings().layout
    np.testing.assert_allclose(at_points(np.full(len(own.faces), 7.0), own.faces, len(own.points)), 7.0)
    values = np.arange(3.0)
    faces = np.array([[0, 1, 2, -1], [1, 2, 3, -1], [2, 3, 4, -1]])
    np.testing.assert_allclose(at_points(values, faces, 6), [0, 0.5, 1.0, 1.5, 2.0, np.nan])

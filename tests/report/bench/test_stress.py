"""The page of a bench says up to which load frequency it is good and how near the stress comes to what is allowed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight.report.bench.data import BenchMotion, BenchRun, BenchStress
from strainsight.report.bench.page import bench_figures, bench_page

from ...models import compute_once

TIME = np.linspace(0.0, 3.0, 7)
LARGEST = 1e6 * np.array([10.0, 40.0, 30.0, 58.68, 20.0, 5.0, 1.0])


def page_of(allowable, picture=()):
    motion = BenchMotion(TIME, {}, (), (), {"band": 0.39642})
    stress = BenchStress("hub", TIME, LARGEST, 6338, allowable)
    run = BenchRun("hubs", "hubs", motion=motion, stress=stress)
    return bench_page(run, compute_once(bench_figures, run), (), picture)


@pytest.mark.parametrize(
    ("allowable", "said"),
    [
        (None, "The time step follows loads up to 0.396 Hz. Von Mises stress on hub: at most 58.68 MPa."),
        (240e6, "Von Mises stress on hub: at most 58.68 MPa, 24 % of the allowable 240 MPa."),
    ],
)
def test_the_first_sentences_have_band_and_stress(allowable, said):
    page = page_of(allowable)
    assert said in re.sub(r"<[^>]+>", "", page).replace("\u00a0", " ")
    assert "beyond the allowable" not in page


def test_a_stress_beyond_the_allowable_comes_first_and_is_in_the_title():
    page = page_of(40e6)
    assert "✕ stress beyond the allowable – hubs" in page
    answer = page[page.index('class="answer"') :]
    share = re.search(r'<data value="([\d.]+)">[^<]*%', answer)
    assert float(share[1]) == pytest.approx(58.68 / 40)
    assert answer.index('class="bad">Stress on hub: at most') < share.start() < answer.index("The time step follows loads")

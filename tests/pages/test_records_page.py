"""The page over the records of a test in a browser: from findings, one record of which contradicts the model."""

from __future__ import annotations

import pytest

from strainsight.report.tested.campaign import campaign_figures, page_of_campaign

from ..report.tested.findings import campaign
from .every import *  # noqa: F403  every page has to pass these

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page, in a folder by which its pictures are called."""
    own = campaign()
    folder = tmp_path_factory.mktemp("pages") / "test-records"
    folder.mkdir()
    (folder / "test.html").write_text(page_of_campaign(own, campaign_figures(own)), encoding="utf-8")
    return folder / "test.html"


@pytest.mark.parametrize("width", [390, 1280])
def test_every_record_is_there_with_its_verdict_and_leads_to_its_page(look, report, width):
    page = look(report, width=width).page
    links = page.locator("main a[href^='test-']")
    assert [links.nth(i).get_attribute("href") for i in range(links.count())][:3] == [
        f"test-{name}.html" for name in ("low", "mid", "high")
    ]
    for i in range(3):
        assert links.nth(i).is_visible()
    assert page.get_by_text("the record contradicts the model").first.is_visible()

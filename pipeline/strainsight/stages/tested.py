"""test: the page of a test, and one for each of several records; everything on them is read from the artefacts, and the files of
the test are not needed for them."""

from __future__ import annotations

from functools import partial

from strainsight.config.placement import PlacementConfig
from strainsight.pages.picture.scene import drawn_or_why
from strainsight.pages.placement.page import TEST_PAGE
from strainsight.pages.tested.campaign import campaign_figures, page_of_campaign
from strainsight.pages.tested.figures import figures_of_test
from strainsight.pages.tested.page import page_of_test, views_of
from strainsight.pages.view.viewing import screenshots
from strainsight.runner.output import Output, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.pages.tested import pages_of


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the pages show and write each as one self-contained file: of a test of several records one over all of them,
    and one for each."""
    found = pages_of(context)
    files: dict[str, bytes] = {}
    warnings: dict[str, None] = {}
    pictured, drawn, problem = 0, 0, ""
    for i, report in enumerate(found.records):
        context.progress(
            f"pictures of {report.record}" if report.record else "pictures", (i + 0.1) / len(found.records)
        )
        views = views_of(report)
        pictures, problem = drawn_or_why(partial(screenshots, views)) if views else (None, "")
        context.progress("figures", (i + 0.5) / len(found.records))
        drawings = figures_of_test(report)
        name = f"test-{report.record}.html" if report.record else TEST_PAGE
        files[name] = page_of_test(report, drawings, tuple(pictures or ()), problem).encode()
        warnings |= dict.fromkeys(report.warnings)
        pictured, drawn = pictured + len(pictures or ()), drawn + len(drawings)
    if (campaign := found.campaign) is not None:
        over = campaign_figures(campaign)
        files = {TEST_PAGE: page_of_campaign(campaign, over).encode()} | files
        warnings, drawn = dict.fromkeys(campaign.warnings), drawn + len(over)
    size = f"{sum(map(len, files.values())) / 1024:.0f} KiB"
    said = f"{', '.join(files)}, {size}" + (f"; no picture: {problem}" if problem else "")
    return Output(
        datasets={},
        summary={"pictures": pictured, "figures": drawn, "warnings": len(warnings)},
        message=said,
        tables=warnings_table(tuple(warnings)),
        files=files,
    )


TEST = Stage(
    "test",
    version=8,
    reads=("name", "seed", "loads", "place.estimate", "estimate.virtual"),
    upstream=("import", "rom", "train", "screen", "place", "estimate"),
    files=(),
    run=run,
)

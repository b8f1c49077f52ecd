"""test: the page of a test; everything on it is read from the artefacts, and the file of the test is not needed for it."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.errors import StrainsightError
from strainsight.report.placement.page import TEST_PAGE
from strainsight.report.tested.field import views_of
from strainsight.report.tested.figures import figures_of_test
from strainsight.report.tested.page import page_of_test
from strainsight.report.view.viewing import screenshots
from strainsight.stages.pages.tested import findings_of
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the page shows and write it as one self-contained file."""
    report = findings_of(context)
    context.progress("pictures", 0.1)
    pictures, problem = [], ""
    views = views_of(report)
    try:
        pictures = screenshots(views) if views else []
    except StrainsightError as error:
        problem = f"{error.what}: {error.remedy}"
    context.progress("figures", 0.5)
    drawings = figures_of_test(report)
    page = page_of_test(report, drawings, tuple(pictures), problem).encode()
    said = f"{TEST_PAGE}, {len(page) / 1024:.0f} KiB" + (f"; no picture: {problem}" if problem else "")
    return Output(
        datasets={},
        summary={"pictures": len(pictures), "figures": len(drawings), "warnings": len(report.warnings)},
        message=said,
        tables=(Table("warnings", ("",), tuple((text,) for text in report.warnings)),) * bool(report.warnings),
        files={TEST_PAGE: page},
    )


TEST = Stage(
    "test",
    version=2,
    reads=("name", "seed", "loads", "place.estimate"),
    upstream=("import", "rom", "train", "screen", "place", "estimate"),
    files=(),
    run=run,
)

"""suite: one page and one table about several runs; everything in them is read from the runs' artefacts."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from strainsight.estimation.decision import FAULTS
from strainsight.pages.picture.scene import drawn_or_why, look, render_all
from strainsight.pages.suite.data import CONFIRMED, CONTRADICTED, HOLDS, Suite
from strainsight.pages.suite.figures import suite_figures
from strainsight.pages.suite.page import suite_page
from strainsight.pages.suite.summary import counts, is_estimated, without_benefit
from strainsight.records.record import written
from strainsight.runner.output import Output
from strainsight.runner.slices import Slice
from strainsight.runner.stage import Context, Stage
from strainsight.stages.pages.suite import numbers_of, suite_of, suite_tables


def run(context: Context[Slice]) -> Output:
    """Gather what the page shows, measure the claims, write it as one self-contained file."""
    suite = suite_of(context)
    context.progress("pictures and figures", 0.5)
    with ThreadPoolExecutor(1) as pool:  # the pictures are another process's work
        waiting = pool.submit(_scenes, suite)
        drawings = suite_figures(suite)
        scenes, problem = waiting.result()
    page = suite_page(suite, drawings, scenes).encode()
    verdicts = [statement.verdict for statement in suite.statements]
    many, estimated, confirmed = len(suite.runs), sum(map(is_estimated, suite.runs)), verdicts.count(CONFIRMED)
    wrong = ", ".join(f"{len(places)} {word}" for word, places in counts(suite).items() if word in FAULTS)
    none = without_benefit(suite)
    message = f"{wrong} of " * bool(wrong) + f"{many} run{'s' * (many != 1)}, {estimated} estimated"
    message += f"; placement brings no benefit in {len(none)}" * bool(none)
    message += f"; {confirmed} of {len(verdicts)} statements confirmed" if verdicts else ""
    held = sum(row.verdict == HOLDS for row in suite.comparisons)
    message += f"; {held} of {len(suite.comparisons)} comparisons hold" if suite.comparisons else ""
    message += f"; report.html, {len(page) / 1024:.0f} KiB"
    return Output(
        datasets=written(numbers_of(suite)),
        summary={
            "pictures": len(scenes),
            "figures": len(drawings),
            "runs": many,
            "estimated": estimated,
            "claims": len(verdicts),
            "confirmed": confirmed,
            "contradicted": verdicts.count(CONTRADICTED),
            "comparisons": len(suite.comparisons),
            "hold": held,
        },
        message=message + (f"; no 3D pictures: {problem}" if problem else ""),
        tables=suite_tables(suite),
        files={"report.html": page},
    )


def _scenes(suite: Suite) -> tuple[dict[str, bytes], str]:
    """Run → its picture, and why there are none; runs with the same layout share one."""
    layouts = {run.name: run.layout for _, run in suite.placements if run.layout is not None}
    looks = {name: look(layout) for name, layout in layouts.items()}
    different = {looks[name]: layout for name, layout in layouts.items()}
    if not different:
        return {}, ""
    drawn, problem = drawn_or_why(lambda: render_all(list(different.values())))
    pictures = dict(zip(different, drawn or (), strict=False))
    return {name: pictures[own] for name, own in looks.items() if own in pictures}, problem


SUITE = Stage(
    "suite",
    version=11,
    reads=("name", "title", "runs", "studies", "claims", "comparisons"),
    upstream=(),
    files=("runs.*.artefacts.*",),
    run=run,
)

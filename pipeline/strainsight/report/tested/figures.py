"""All figures of the page of a test, in the order of the page."""

from __future__ import annotations

from strainsight.report.chart.drawing import BLUE, VERMILION, Drawing, gauge_colour
from strainsight.report.chart.histories import estimate_figure
from strainsight.report.chart.posterior import posterior_figure
from strainsight.report.tested.data import Findings
from strainsight.report.tested.hold_out import hold_out_figures
from strainsight.report.tested.loads import load_figure
from strainsight.report.tested.readings import reading_figure
from strainsight.report.tested.spectra import load_spectrum_figure, residual_figure


def figures_of_test(report: Findings) -> tuple[Drawing, ...]:
    """Those that the report has data for; their keys begin with what they are of: "reading-", "residual-", "hold-out", "load-",
    "known-", "resultant-", "spectrum-", "estimate-", "posterior-"."""
    loads = {own.name for own in report.unknowns if own.kind == "load"}
    drawings = [reading_figure(own) for own in report.readings]
    drawings += hold_out_figures(report.hold_out)
    colours = {own.label: gauge_colour(own.gauge) for own in report.readings}
    drawings += [residual_figure(own, colours.get(own.name, BLUE)) for own in report.residuals]
    drawings += [load_figure("load", own, BLUE) for own in report.histories if own.name in loads]
    drawings += [load_figure("resultant", own, BLUE) for own in report.resultants]
    drawings += [load_figure("known", own, VERMILION) for own in report.known]
    drawings += [load_spectrum_figure(own) for own in report.load_spectra]
    drawings += [estimate_figure(own) for own in report.histories if own.name not in loads]
    drawings += [posterior_figure(own) for own in report.posteriors]
    return tuple(drawings)

"""Figures of a placement page (thesis figures 6.1b, 6.2, 6.5b and 6.6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.estimation.decision import LOST, Claim
from strainsight.pages.arrays import FloatArray, History, IntArray, Reading, largest
from strainsight.pages.chart.drawing import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SERIES,
    SKY,
    VERMILION,
    WIDE,
    Drawing,
    figure,
    gauge_colour,
    styled,
    svg,
    visible_instants,
)
from strainsight.pages.chart.panels import (
    closing_figure,
    dots,
    drawable,
    estimate_figure,
    focus_on,
    last_periods,
    legend_above,
    legend_of_lines,
    log_ticks,
    plain_ticks,
    posterior_figure,
    shown_unit,
    time_axis,
)
from strainsight.pages.placement.data import Noise, PlacementReport, RandomSetErrors, Repeats, Trend
from strainsight.records.placed import FrequencyResponse
from strainsight.text import PER_LOAD, READINGS, number, percent, reading_unit, short


def placement_figures(report: PlacementReport) -> tuple[Drawing, ...]:
    """All figures with data, in the order of the page."""
    unknowns = {unknown.name: unknown for unknown in report.unknowns}
    history = {entry.name: entry for entry in report.histories}
    drawings = [trend_figure(report.trend)]
    if report.frequency_response is not None:
        drawings.append(frequency_response_figure(report.frequency_response))
    for name, entry in history.items():
        kind = unknowns[name].kind if name in unknowns else "parameter"
        drawings += [estimate_figure(entry), closing_figure(entry, kind)]
    for name, posterior in report.posteriors.items():
        drawings.append(posterior_figure(name, unknowns[name].unit, posterior, unknowns[name].truth))
    drawings += map(signal_figure, report.gauge_signals)
    for name in dict.fromkeys(sets.name for sets in report.random_sets):
        sets = tuple(entry for entry in report.random_sets if entry.name == name)
        drawings.append(random_errors_figure(sets))
        if name in history and any(entry.history is not None for entry in sets):
            drawings.append(random_histories_figure(sets, history[name]))
    if report.noise is not None:
        drawings.append(noise_figure(report.noise, list(unknowns)))
    for name, unknown in unknowns.items():
        if unknown.repeats is not None:
            drawings.append(repeats_figure(name, unknown.repeats, unknown.claims))
    return tuple(drawings)


def elbow(count: IntArray, value: FloatArray) -> int | None:
    """Gauge count at the elbow of the trend: the point furthest below the chord on normalised logarithmic axes.

    count (s,), value (s,) > 0. None for a straight trend (distance below a tenth), as with independent noise only."""
    if len(count) < 3 or not np.all(np.isfinite(value)) or value.min() <= 0 or np.ptp(value) == 0:
        return None
    x, y = (np.log(values / values.min()) / np.log(values.max() / values.min()) for values in (count, value))
    ends = np.argmin(x), np.argmax(x)
    below = y[ends[0]] + (y[ends[1]] - y[ends[0]]) * x - y
    best = int(np.argmax(below))
    return int(count[best]) if below[best] > 0.1 else None


@styled()
def trend_figure(trend: Trend) -> Drawing:
    """Metric over the number of remaining gauges, certified bound and elbow."""
    shown = np.isfinite(trend.value)
    count, value = trend.count[shown], trend.value[shown]
    bend, keep, every, symbol = elbow(count, value), int(trend.count[-1]), int(trend.count[0]), trend.metric.symbol
    canvas, axes = figure()
    if len(trend.blocks) > 1:
        for (name, block), colour in zip(trend.blocks.items(), (GREEN, PURPLE, ORANGE, SKY), strict=False):
            axes.plot(trend.count, drawable(block), color=colour, lw=1.2, label=f"variance of {short(name)}")
    axes.plot(count, value, color=BLUE, lw=2, label=symbol)
    axes.plot([keep], [trend.final], "o", color=BLUE, ms=7, label=f"chosen layout: {number(trend.final)}")
    if trend.lower_bound is not None and np.isfinite(trend.lower_bound):
        label = f"proven lower bound: {number(trend.lower_bound)}"
        axes.axhline(trend.lower_bound, color=VERMILION, ls=(0, (5, 3)), lw=1.3, label=label)
    if bend is not None:
        at = value[count == bend][0]
        axes.plot([bend], [at], "D", mfc="none", mec=INK, ms=7, label=f"elbow: {bend} gauges")
    # a logarithmic axis needs a point
    if len(count):
        axes.set_xscale("log")
        if value.min() > 0 and value.max() > 5 * value.min():
            axes.set_yscale("log")
    plain_ticks(axes, "x")
    plain_ticks(axes, "y")
    axes.set(xlabel="remaining gauges [–]", ylabel=f"placement criterion {symbol} [–]")
    legend_above(axes, columns=2)
    ratio = trend.final / value[0] if len(value) and value[0] > 0 else np.nan
    caption = (
        f"{trend.metric.meaning.capitalize()} during the elimination of gauges (from right to left). "
        f"With {keep} of {every} candidates the placement criterion is {number(ratio, 3)} times the value with all candidates."
    )
    if trend.lower_bound is not None:
        caption += f" The dashed line is a proven lower bound of the placement criterion for layouts of {keep} gauges."
    if bend is not None:
        caption += f" With more than {bend} gauges (elbow), the additional gauges mainly average out noise."
    ends = f"{number(trend.value[0])} with {every} candidates to {number(trend.final)} with {keep}"
    alt = f"Line chart of the placement criterion from {ends}."
    return Drawing("trend", "Placement criterion versus number of gauges", caption, alt, svg(canvas))


@styled()
def frequency_response_figure(response: FrequencyResponse) -> Drawing:
    """Magnitude of the strain per unit load over frequency, one panel per load, with the natural frequencies that it excites."""
    frequency, count = response.frequency[1:], len(response.load)
    canvas, *panels = figure(0.9 + 2.2 * count, (1.0,) * count, width=2 * WIDE)
    peaks = []
    for i, (axes, load, unit) in enumerate(zip(panels, response.load, response.unit, strict=True)):
        scale, per = PER_LOAD.get(unit, (1.0, unit))
        strain, natural = 1e6 * scale * response.magnitude[1:, :, i], response.natural[response.excited[:, i]]
        axes.vlines(natural, 0, 1, color=MUTED, lw=0.7, ls=(0, (2, 2)), transform=axes.get_xaxis_transform())
        # a curve below an equal one remains visible
        width = np.linspace(3.0, 1.2, len(strain.T))
        for curve, gauge, label, lw in zip(strain.T, response.gauge, response.channel, width, strict=True):
            axes.plot(frequency, curve, color=gauge_colour(gauge), lw=lw, label=label)
        axes.set(xscale="log", yscale="log", ylabel=f"{short(load)}\n[µm/m per {short(per)}]", xlim=frequency[[0, -1]])
        log_ticks(axes)
        top = frequency[np.argmax(strain.max(axis=1))]
        peaks.append(f"per {per} of {load} {number(strain.max(), 3)} µm/m at {number(top, 3)} Hz")
    plain_ticks(panels[-1], "x")
    panels[-1].set_xlabel("frequency [Hz]")
    legend_of_lines(panels[0], response.channel)
    caption = (
        "Amplitude of the strain at each gauge per unit amplitude of each load, with the damping of the model at the guess. "
        "Dashed: natural frequencies that the load excites. At low frequencies the curves are the influence matrix."
    )
    alt = f"Frequency response functions on logarithmic axes; largest strain {'; '.join(peaks)}."
    return Drawing("frequency-response", "Strain per unit load over frequency", caption, alt, svg(canvas))


@styled()
def signal_figure(signal: Reading) -> Drawing:
    """Measured and estimated reading of one channel over the last periods."""
    window, colour = last_periods(signal.estimated), gauge_colour(signal.gauge)
    factor, unit = reading_unit(largest(signal.measured[window]), signal.unit)
    what = READINGS.get(signal.unit, "reading")
    curves = [drawable(values) / factor for values in (signal.measured, signal.estimated, signal.std)]
    residual = float(np.sqrt(np.mean((curves[0] - curves[1]) ** 2)))
    peak = number(largest(curves[1][window]), 3)
    index = np.arange(len(signal.time))[window]
    index = index[visible_instants(np.column_stack([curve[window] for curve in curves[:2]]))]
    time, (measured, estimated, std) = signal.time[index], (curve[index] for curve in curves)
    canvas, axes, below = figure(4.1, (2.2, 1.0))
    dots(axes, time, measured, "measured")
    if signal.truth is not None:
        truth = drawable(signal.truth)[index] / factor
        axes.plot(time, truth, color=INK, lw=1, ls=(0, (4, 2)), label="without noise")
    axes.plot(time, estimated, color=colour, label="estimated")
    below.fill_between(time, -2 * std, 2 * std, color=colour, alpha=0.35, lw=0)
    dots(below, time, measured - estimated, "")
    axes.set_ylabel(f"{what} [{short(unit)}]")
    below.set_ylabel(f"measured −\nestimated [{short(unit)}]")
    time_axis(below)
    legend_above(axes)
    caption = (
        f"{what.capitalize()} at gauge {signal.label} in the last oscillation periods. Below: measured − "
        f"estimated (RMS {number(residual, 3)} {unit} over the run) and ±2σ band of the estimate."
    )
    alt = f"Line chart of measured and estimated {what} at gauge {signal.label}, peak {peak} {unit}."
    return Drawing(f"signal-{signal.label}", f"Gauge {signal.label}", caption, alt, svg(canvas))


POOLS = (ORANGE, PURPLE)
"""Colours of random layouts by pool."""


@styled()
def random_errors_figure(sets: tuple[RandomSetErrors, ...]) -> Drawing:
    """Errors of random layouts as dots, one row per pool, and of the chosen layout as a line."""
    name, chosen = sets[0].name, sets[0].chosen_error
    canvas, axes = figure(1.5 + 0.6 * len(sets))
    for row, (entry, colour) in enumerate(zip(sets, POOLS, strict=False)):
        error = 100 * entry.finite
        # fixed offsets separate equal errors
        fan = 0.16 * np.resize([0.0, 1.0, -1.0, 0.5, -0.5], len(error))
        axes.plot(error, row + fan, "o", color=colour, ms=6, mec="white", mew=0.6, alpha=0.9)
        if len(error):
            axes.plot([np.median(error)] * 2, [row - 0.3, row + 0.3], color=INK, lw=1.6)
    axes.axvline(100 * chosen, color=BLUE, lw=2)
    axes.set_yticks(range(len(sets)), [f"random,\n{entry.pool_label}" for entry in sets])
    axes.set_ylim(len(sets) - 0.5, -0.9)
    finite = np.concatenate([[100 * chosen], *[100 * entry.finite for entry in sets]])
    if finite.min() > 0 and finite.max() > 8 * finite.min():
        axes.set_xscale("log")
    plain_ticks(axes, "x")
    right = axes.transAxes.inverted().transform(axes.transData.transform((100 * chosen, 0)))[0] > 0.6
    off, align = (-7, "right") if right else (7, "left")
    words = {"textcoords": "offset points", "color": BLUE, "va": "center", "ha": align}
    axes.annotate(f"chosen layout {percent(chosen)}", (100 * chosen, -0.62), (off, 0), **words)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(f"relative error of {short(name)} [%]")
    caption, medians = f"Dots: error of {name} with random layouts (same number of gauges); black bar: median.", []
    for entry in sets:
        better, lost = int(np.sum(entry.finite < chosen)), len(entry.error) - len(entry.finite)
        pool = "all candidates" if entry.pool_label == "all candidates" else "the candidates after screening"
        caption += f" More accurate than the chosen layout: {better} of {len(entry.error)} random layouts from {pool}"
        caption += f"; diverged and not shown: {lost}." if lost else "."
        if len(entry.finite):
            medians.append(f"median error with random layouts from {pool} {percent(float(np.median(entry.finite)))}")
    caption += (
        " Each layout is tested with one random sample of the noise, so a random layout can be more accurate by chance."
    )
    alt = f"Dot plot of errors of {name}: chosen layout {percent(chosen)}; {'; '.join(medians)}"
    return Drawing(f"random-errors-{name}", f"{name}: errors of random layouts", caption, alt, svg(canvas))


@styled()
def random_histories_figure(sets: tuple[RandomSetErrors, ...], chosen: History) -> Drawing:
    """Estimates over time with the chosen layout and with random layouts."""
    factor, unit = shown_unit(chosen)
    canvas, axes = figure()
    values, count, quarter = [], 0, len(chosen.time) // 4
    for entry, colour in zip(sets, POOLS, strict=False):
        for i, curve in enumerate(() if entry.history is None else entry.history / factor):
            index = visible_instants(curve[:, None], buckets=90)
            label = entry.pool_label if i == 0 else None
            axes.plot(chosen.time[index], curve[index], color=colour, lw=0.9, alpha=0.75, label=label)
            values.append(curve[quarter:])
        count += 0 if entry.history is None else len(entry.error)
    index = visible_instants(chosen.mean[:, None], buckets=180)
    axes.plot(chosen.time[index], chosen.mean[index] / factor, color=BLUE, lw=2, label="chosen layout")
    if chosen.truth is not None:
        index, truth = visible_instants(chosen.truth[:, None], buckets=180), chosen.truth / factor
        axes.plot(chosen.time[index], truth[index], color=INK, lw=1.1, ls=(0, (5, 3)), label="true value")
        values.append(truth)
    focus_on(axes, np.concatenate([*values, chosen.mean[quarter:] / factor]))
    time_axis(axes)
    axes.set_ylabel(f"{short(chosen.name)} [{unit}]")
    legend_above(axes)
    caption = (
        f"Estimates of {chosen.name} with random layouts (from all candidates, or from the candidates after "
        "screening) and with the chosen layout. "
        "The axis is scaled to the estimates after the first quarter of the run."
    )
    alt = f"Line chart of estimates of {chosen.name} with {count} random layouts and the chosen layout."
    return Drawing(
        f"random-histories-{chosen.name}", f"{chosen.name}: random layouts over time", caption, alt, svg(canvas)
    )


@styled()
def noise_figure(noise: Noise, names: Sequence[str]) -> Drawing:
    """Error and claimed σ over the gauge noise, one colour per unknown."""
    level = 100 * noise.level
    canvas, axes = figure()
    for name, colour in zip(names, map(str, np.resize(SERIES, len(names))), strict=True):
        axes.plot(level, 100 * noise.std[name], "-", color=colour, lw=1.4, label=f"claimed σ({short(name)})")
        axes.plot(level, 100 * noise.error[name], "o", color=colour, ms=7, label=f"true error of {short(name)}")
    if np.all(level > 0):
        axes.set_xscale("log")
        axes.set_xticks(np.unique(level), [number(value, 3) for value in np.unique(level)])
        axes.minorticks_off()
    if any(line.get_ydata().max(initial=0.0) > 0 for line in axes.get_lines()):
        axes.set_yscale("log")
        plain_ticks(axes, "y")
    axes.set(xlabel="gauge noise [% of the largest RMS reading of a candidate]", ylabel="relative error [%]")
    legend_above(axes, columns=2)
    caption = "True error (dots) and claimed σ (lines) of the estimates versus the gauge noise."
    alt = "; ".join(
        f"errors at a gauge noise of {percent(level)}: "
        + ", ".join(f"{name} {percent(values[i])}" for name, values in noise.error.items())
        for i, level in enumerate(noise.level)
    )
    return Drawing("noise", "Effect of gauge noise", caption, f"Chart of error versus noise: {alt}.", svg(canvas))


@styled()
def repeats_figure(name: str, repeats: Repeats, claims: Sequence[Claim]) -> Drawing:
    """Real error and claimed σ over seeds and starts, smallest error first; claims: on the unknown."""
    claim = next((one for one in claims if one.of == "repeats"), None)
    result = "identified" if repeats.identified else LOST
    order = np.argsort(np.abs(repeats.error))
    error, std = 100 * np.abs(repeats.error[order]), 100 * repeats.claimed_std[order]
    place = np.arange(1, len(error) + 1)
    canvas, axes = figure()
    wrong = claim is not None and claim.overconfident
    axes.bar(place, std, width=0.72, color=BLUE, alpha=0.22, lw=0, label="claimed σ")
    axes.plot(place, error, "X" if wrong else "o", color=VERMILION if wrong else BLUE, ms=6, label="error")
    finite = np.concatenate([error, std])
    finite = finite[np.isfinite(finite) & (finite > 0)]
    if len(finite) and finite.max() > 30 * np.median(std):
        axes.set_yscale("log")
        plain_ticks(axes, "y")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set(xlabel="runs in order of increasing error [–]", ylabel=f"relative error of {short(name)} [%]")
    legend_above(axes)
    caption = (
        f"Relative error and claimed σ of {name} in {len(error)} repeated filter runs with other noise and initial values; the "
        "true values are the same. "
    )
    caption += f"{name} is {LOST}: the measurements hardly reduce its initial uncertainty." * (result == LOST)
    if claim is not None:
        result = f"{claim.result}, {result}"
        low, high = (number(edge, 2) for edge in claim.band)
        caption += (
            f" RMS of error / claimed σ: {number(claim.ratio, 3)} ({low} to {high} if σ is calibrated): {claim.result}."
        )
    alt = f"Chart of {len(error)} repeated runs for {name}, {result}."
    return Drawing(
        f"repeats-{name}", f"{name}: repeated runs with other seeds and initial values", caption, alt, svg(canvas)
    )

"""Figures that compare: random sets beside the chosen one (thesis 6.3-6.4), noise levels, repeated runs."""

from __future__ import annotations

import numpy as np

from strainsight.report.arrays import History
from strainsight.report.chart.drawing import (
    BLUE,
    INK,
    ORANGE,
    PURPLE,
    SERIES,
    VERMILION,
    Drawing,
    figure,
    styled,
    svg,
    visible_instants,
)
from strainsight.report.chart.panels import focus_on, legend_above, plain_ticks, shown_unit, time_axis
from strainsight.report.placement.data import Claim, NoiseRow, RandomSets, Repeats, Unknown
from strainsight.report.placement.verdicts import LOST, OVER
from strainsight.report.text import number, percent, short


def random_errors_figure(sets: tuple[RandomSets, ...]) -> Drawing:
    """Errors of random sets as dots, one row a pool, and the chosen set's as a line."""
    name, chosen = sets[0].name, sets[0].chosen_error
    with styled():
        drawn, axes = figure(1.5 + 0.6 * len(sets))
        for row, (entry, colour) in enumerate(zip(sets, (ORANGE, PURPLE), strict=False)):
            error = 100 * entry.error[np.isfinite(entry.error)]
            # A fixed fan keeps equal errors apart without a random jitter.
            fan = 0.16 * np.resize([0.0, 1.0, -1.0, 0.5, -0.5], len(error))
            axes.plot(error, row + fan, "o", color=colour, ms=6, mec="white", mew=0.6, alpha=0.9)
            if len(error):
                axes.plot([np.median(error)] * 2, [row - 0.3, row + 0.3], color=INK, lw=1.6)
        axes.axvline(100 * chosen, color=BLUE, lw=2)
        axes.set_yticks(range(len(sets)), [f"random,\n{entry.pool_label}" for entry in sets])
        axes.set_ylim(len(sets) - 0.5, -0.9)
        finite = np.concatenate([[100 * chosen], *[100 * entry.error[np.isfinite(entry.error)] for entry in sets]])
        if finite.min() > 0 and finite.max() > 8 * finite.min():
            axes.set_xscale("log")
        plain_ticks(axes, "x")
        right = axes.transAxes.inverted().transform(axes.transData.transform((100 * chosen, 0)))[0] > 0.6
        axes.annotate(
            f"chosen set {percent(chosen)}", (100 * chosen, -0.62), (-7 if right else 7, 0), textcoords="offset points",
            color=BLUE, va="center", ha="right" if right else "left",
        )  # fmt: skip
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(f"relative error of {short(name)} [%]")
        image = svg(drawn)
    caption, parts = f"Error of {name} from random sets of the same size; dots are sets, the bar is their median.", []
    for entry in sets:
        good = entry.error[np.isfinite(entry.error)]
        better, lost = int(np.sum(good < entry.chosen_error)), len(entry.error) - len(good)
        pool = "all candidates" if entry.pool_label == "all candidates" else "the screened pool"
        sentence = f" {better} of {len(entry.error)} drawn from {pool} came closer than the chosen set"
        parts.append(sentence + (f", {lost} diverged and are not drawn." if lost else "."))
    caption += "".join(parts) + " This is one noise sample: a lucky set can come closer."
    alt = f"Dot plot of errors of {name}: chosen set {percent(chosen)}; " + "; ".join(
        f"random from {e.pool_label} median {percent(float(np.median(e.error[np.isfinite(e.error)])))}"
        for e in sets
        if np.isfinite(e.error).any()
    )
    return Drawing(f"random-errors-{name}", f"{name}: errors of random sets", caption, alt, image)


def random_histories_figure(sets: tuple[RandomSets, ...], chosen: History) -> Drawing:
    """The estimate over time from the chosen set against those from random ones."""
    factor, unit = shown_unit(chosen)
    drawable = [
        (entry, colour) for entry, colour in zip(sets, (ORANGE, PURPLE), strict=False) if entry.history is not None
    ]
    with styled():
        drawn, axes = figure()
        values = []
        for entry, colour in drawable:
            assert entry.history is not None
            for i, curve in enumerate(entry.history / factor):
                index = visible_instants(curve[:, None], buckets=90)
                label = entry.pool_label if i == 0 else None
                axes.plot(chosen.time[index], curve[index], color=colour, lw=0.9, alpha=0.75, label=label)
                values.append(curve[len(curve) // 4 :])
        index = visible_instants(chosen.mean[:, None], buckets=180)
        axes.plot(chosen.time[index], chosen.mean[index] / factor, color=BLUE, lw=2, label="chosen set")
        if chosen.truth is not None:
            index = visible_instants(chosen.truth[:, None], buckets=180)
            axes.plot(
                chosen.time[index], chosen.truth[index] / factor, color=INK, lw=1.1, ls=(0, (5, 3)), label="truth"
            )
            values.append(chosen.truth / factor)
        values.append(chosen.mean[len(chosen.mean) // 4 :] / factor)
        focus_on(axes, np.concatenate(values))
        time_axis(axes)
        axes.set_ylabel(f"{short(chosen.name)} [{unit}]")
        legend_above(axes)
        image = svg(drawn)
    caption = (
        f"Estimates of {chosen.name} from random sets, by the pool they were drawn from, beside the chosen one; "
        "the scale shows what happens after the first quarter."
    )
    count = sum(len(entry.error) for entry, _ in drawable)
    alt = f"Line chart of estimates of {chosen.name} from {count} random sets and the chosen set."
    return Drawing(f"random-histories-{chosen.name}", f"{chosen.name}: random sets over time", caption, alt, image)


def noise_figure(rows: tuple[NoiseRow, ...], unknowns: tuple[Unknown, ...]) -> Drawing:
    """Error and claimed standard deviation against the gauge noise, one colour an unknown."""
    level = np.array([row.level for row in rows])
    order = np.argsort(level)
    names = [unknown.name for unknown in unknowns if any(unknown.name in row.error for row in rows)]
    with styled():
        drawn, axes = figure()
        for name, colour in zip(names, np.resize(SERIES, len(names)), strict=True):
            error = np.array([row.error.get(name, np.nan) for row in rows])[order]
            std = np.array([row.std.get(name, np.nan) for row in rows])[order]
            axes.plot(100 * level[order], 100 * std, "-", color=str(colour), lw=1.4, label=f"claimed σ({short(name)})")
            axes.plot(
                100 * level[order], 100 * error, "o", color=str(colour), ms=7, label=f"real error of {short(name)}"
            )
        if np.all(level > 0):
            axes.set_xscale("log")
            axes.set_xticks(100 * np.unique(level), [number(100 * value, 3) for value in np.unique(level)])
            axes.minorticks_off()
        if any(line.get_ydata().max(initial=0.0) > 0 for line in axes.get_lines()):
            axes.set_yscale("log")
            plain_ticks(axes, "y")
        axes.set_xlabel("gauge noise [% of the strongest candidate's RMS]")
        axes.set_ylabel("relative error [%]")
        legend_above(axes, columns=2)
        image = svg(drawn)
    caption = "Dots are what the filter got wrong, lines what it claims as one standard deviation."
    alt = "; ".join(
        f"at {percent(row.level)} noise " + ", ".join(f"{name} {percent(value)}" for name, value in row.error.items())
        for row in rows
    )
    return Drawing("noise", "More noise, less noise", caption, f"Chart of error against noise: {alt}.", image)


def repeats_figure(repeats: Repeats, claim: Claim | None) -> Drawing:
    """Real error beside the claimed standard deviation, over seeds and starts, smallest error first; claim: on all."""
    order = np.argsort(np.abs(repeats.error))
    error, std = 100 * np.abs(repeats.error[order]), 100 * repeats.claimed_std[order]
    place = np.arange(1, len(error) + 1)
    with styled():
        drawn, axes = figure()
        wrong = claim is not None and claim.verdict == OVER
        axes.bar(place, std, width=0.72, color=BLUE, alpha=0.22, lw=0, label="claimed σ")
        axes.plot(place, error, "X" if wrong else "o", color=VERMILION if wrong else BLUE, ms=6, label="error")
        finite = np.concatenate([error, std])
        finite = finite[np.isfinite(finite) & (finite > 0)]
        if len(finite) and finite.max() > 30 * np.median(std):
            axes.set_yscale("log")
            plain_ticks(axes, "y")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_xlabel("run, smallest error first [–]")
        axes.set_ylabel(f"relative error of {short(repeats.name)} [%]")
        legend_above(axes)
        image = svg(drawn)
    caption = (
        f"{len(error)} runs with other noise and other starting values, the truth the same. "
        f"{_agreement(repeats.verdict, claim)}"
    )
    ending = f"{claim.verdict}, {repeats.verdict}" if claim is not None else repeats.verdict
    alt = f"Chart of {len(error)} repeated runs for {repeats.name}, {ending}."
    return Drawing(f"repeats-{repeats.name}", f"{repeats.name}: other seeds, other starts", caption, alt, image)


def _agreement(verdict: str, claim: Claim | None) -> str:
    agree = f"Little more is known of it than before: {LOST}." if verdict == LOST else ""
    if claim is None:
        return agree
    low, high = (number(edge, 2) for edge in claim.band)
    return (
        f"{agree} RMS of error over claimed σ {number(claim.ratio, 3)}, {low} to {high} where σ holds: {claim.verdict}."
    )

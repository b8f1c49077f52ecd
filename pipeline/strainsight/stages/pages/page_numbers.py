"""The numbers of the page: unknowns, trend, histories, criteria, cases, noise, consistency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from strainsight.cases.filters_compared import BANK, comparison_verdict
from strainsight.cases.layout.comparison import RULES
from strainsight.cases.layout.gauge_list import channel_labels
from strainsight.estimation.decision import benefit_of, claims_of, word_of
from strainsight.placement.criteria.choices import criterion_of
from strainsight.placement.criteria.criterion import Criterion
from strainsight.records.estimated import Histories
from strainsight.records.layout import PlacedLayout, metric_key
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import read, unit_of
from strainsight.records.validated import Validated
from strainsight.report.arrays import History
from strainsight.report.placement.data import (
    Case,
    Consistency,
    Criteria,
    GaugeSignal,
    LoadCase,
    Metric,
    NoiseRow,
    OtherFilter,
    Posterior,
    RandomSets,
    Repeats,
    Trend,
    Unknown,
)
from strainsight.stages.pages.page_layout import listed_gauges, placed_scale, placed_size
from strainsight.workflow.artefact import Artefact


def unknown_of(name: str, kind: Any, up: Mapping[str, Artefact]) -> Unknown:
    validate, place = up["validate"], up["place"]
    own, summary, placed = read(Validated, validate), validate.summary, read(Placed, place)
    truth, beyond = own.truth[name], "out_of_range" in summary
    return Unknown(
        name=name,
        unit=unit_of(own, "estimate", name),
        kind=kind,
        guess=placed_scale(name, place),
        truth=float(truth[-1]) if kind == "parameter" else float(np.sqrt(np.mean(truth**2))),
        estimate=float(summary[f"estimate.{name}"]),
        error=float(summary[f"error.{name}"]),
        std=None if beyond else float(summary[f"std.{name}"]),
        smoothed_error=float(summary[f"smoothed.{name}"]),
        expected_std=placed.expected_std[name] / placed_size(name, up),
        worst_case=worst_case_of(name, placed),
        zero=bool(summary.get(f"zero.{name}", False)),
        smoothed_std=None if beyond else float(summary[f"smoothed_std.{name}"]),
        claims=() if beyond else claims_of(name, summary, repeated(name, validate)),
        withheld=beyond,
        benefit=benefit_of(float(summary[f"error.{name}"]), own.all.error[name]),
    )


def worst_case_of(name: str, placed: Placed) -> str:
    """The load case in which an unknown is known least, empty where there are none."""
    return "" if placed.by_case is None else placed.by_case.worst[name]


def load_cases_of(placed: Placed) -> tuple[LoadCase, ...]:
    """The load cases that a layout is placed for."""
    own = placed.by_case
    if own is None:
        return ()
    return tuple(
        LoadCase(
            name,
            float(own.weight[i]),
            float(own.metric[i]),
            {unknown: float(std[i]) if own.acts[unknown][i] else np.nan for unknown, std in own.std.items()},
        )
        for i, name in enumerate(own.name)
    )


def repeated(name: str, validate: Artefact) -> tuple[np.ndarray, np.ndarray]:
    """Error and claimed σ of every repeat, relative."""
    repeats = read(Validated, validate).repeats
    return repeats.error[name], repeats.std[name]


def trend_of(place: Artefact) -> Trend:
    summary, own = place.summary, read(PlacedLayout, place).elimination
    criterion = criterion_of(str(summary["criterion"]))
    key = metric_key(criterion.name)
    value: np.ndarray = getattr(own, key)
    certified = "lower_bound" in summary
    return Trend(
        count=np.arange(int(summary["pool"]), int(summary["pool"]) - len(value), -1),
        value=value,
        blocks={name: own.blocks[:, i] for i, name in enumerate(own.unknowns)},
        final=float(summary[f"{key}_final"]),
        metric=_metric(criterion, place),
        lower_bound=float(summary["lower_bound"]) if certified else None,
        gap=float(summary["gap"]) if certified else None,
    )


def history_of(name: str, validate: Artefact) -> History:
    own = read(Validated, validate)
    values = (by[name] for by in (own.truth, own.estimate, own.std, own.smoothed, own.smoothed_std))
    return History(name, unit_of(own, "estimate", name), own.time, *values)


def posterior_of(name: str, validate: Artefact) -> Posterior:
    own = read(Validated, validate)
    found = own.posterior[name]
    return Posterior(
        name, unit_of(own, "estimate", name), found.value, found.density, found.prior, float(own.truth[name][0])
    )


def repeats_of(names: list[str], validate: Artefact) -> tuple[Repeats, ...]:
    return tuple(
        Repeats(
            name,
            *repeated(name, validate),
            "not identified" if validate.summary.get(f"identified.{name}") is False else "identified",
        )
        for name in names
        if len(repeated(name, validate)[0]) > 1
    )


POOLS: tuple[tuple[str, Literal["all candidates", "screened"]], ...] = (
    ("all", "all candidates"),
    ("screened", "screened"),
)


def random_sets_of(names: list[str], validate: Artefact) -> tuple[RandomSets, ...]:
    own = read(Validated, validate)
    return tuple(
        RandomSets(name, label, sets.error[name], sets.estimate[name].T, float(validate.summary[f"error.{name}"]))
        for name in names
        for sets, label in ((getattr(own, key), label) for key, label in POOLS)
        if len(sets.error[name])
    )


def signals_of(up: Mapping[str, Artefact]) -> tuple[GaugeSignal, ...]:
    own, listed = read(Validated, up["validate"]).gauge, listed_gauges(up)
    units = [unit for unit, own in zip(listed.unit, listed.angles, strict=True) for _ in own]
    return tuple(
        GaugeSignal(label, own.time, own.measured[:, i], own.true[:, i], own.estimated[:, i], own.std[:, i], units[i])
        for i, label in enumerate(channel_labels(listed))
    )


def metrics_of(place: Artefact) -> tuple[Metric, ...]:
    """Every criterion, that of the layout first."""
    return tuple(_metric(criterion_of(name), place) for name in read(PlacedLayout, place).criteria.name)


def _metric(criterion: Criterion, place: Artefact) -> Metric:
    """In words, with the unknowns that it covers where these are not all."""
    own = read(PlacedLayout, place)
    over = own.elimination.unknowns
    of = f", of {' and '.join(over)} alone" * (len(over) < len(own.criteria.std))
    return Metric(criterion.symbol, criterion.meaning + of)


def criteria_of(names: list[str], place: Artefact) -> tuple[Criteria, ...]:
    """This layout, then the others by their metric; of the random sets the one in the middle."""
    own = read(PlacedLayout, place).criteria
    drawn = sorted((i for i, rule in enumerate(own.rule) if rule not in RULES), key=lambda i: own.value[i, 0])
    shown = {i: RULES[rule] for i, rule in enumerate(own.rule) if rule in RULES}
    if drawn:
        shown[drawn[(len(drawn) - 1) // 2]] = f"random, median of {len(drawn)}"
    return tuple(
        Criteria(words, tuple(own.value[i].tolist()), {n: float(own.std[n][i]) for n in names})
        for i, words in shown.items()
    )


def cases_of(observe: Artefact) -> tuple[Case, ...]:
    own = read(Observed, observe)
    return tuple(
        Case(
            tuple(unknowns.split(", ")),
            excitation,
            float(own.condition[i, j]),
            float(own.condition_raw[i, j]),
            str(own.lost[i, j]),
        )
        for j, unknowns in enumerate(own.unknowns)
        for i, excitation in enumerate(own.excitation)
    )


def noise_rows(names: list[str], up: Mapping[str, Artefact]) -> tuple[NoiseRow, ...]:
    validate = up["validate"]
    strongest = float(up["train"].summary["strongest_rms"])
    level = float(up["screen"].summary["noise_std"]) / strongest
    error, std = ({n: float(validate.summary.get(f"{key}.{n}", np.nan)) for n in names} for key in ("error", "std"))
    rows, study = [NoiseRow(level, 1.0, error, std)], read(Validated, validate).noise
    for i, factor in enumerate(study.factor.tolist()):
        error, std = ({n: float(by[n][i]) for n in names} for by in (study.error, study.std))
        rows.append(NoiseRow(level * factor, factor, error, std))
    return tuple(sorted(rows, key=lambda row: row.factor))


def filters_of(own: Histories) -> tuple[OtherFilter, ...]:
    """Every parameter by every filter, the bank first."""
    beside = own.compared
    if beside is None:
        return ()
    return tuple(
        OtherFilter(
            name,
            unit_of(beside, "estimate", name),
            filter_,
            float(values[i]),
            float(beside.std[name][i] / values[i]),
            float(beside.ratio[name][i]),
            "" if filter_ == BANK else comparison_verdict(float(beside.ratio[name][i])),
        )
        for name, values in beside.estimate.items()
        for i, filter_ in enumerate(beside.filter)
    )


def consistency_of(validate: Artefact) -> Consistency:
    nees_band, nis_band = ((float(low), float(high)) for low, high in read(Validated, validate).consistency.band)
    nees, nis = float(validate.summary["nees"]), float(validate.summary["nis"])
    return Consistency(nees, nees_band, word_of(nees, nees_band), nis, nis_band, word_of(nis, nis_band))

"""The numbers of the page: unknowns, trend, histories, criteria, cases, noise, consistency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from strainsight import __version__
from strainsight.cases.layout.comparison import RULES
from strainsight.cases.layout.gauge_list import channel_labels
from strainsight.estimation.verdict import benefit_of, word_of
from strainsight.placement.criteria.choices import criterion_of
from strainsight.placement.criteria.criterion import Criterion
from strainsight.records.layout import PlacedLayout, metric_key
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import read, unit_of
from strainsight.records.validated import Validated
from strainsight.report.arrays import History, Reading
from strainsight.report.placement.data import (
    Case,
    Check,
    Criteria,
    Metric,
    NoiseRow,
    RandomSets,
    Repeats,
    Trend,
    Unknown,
)
from strainsight.report.placement.verdicts import claims_of
from strainsight.stages.pages.page_layout import listed_gauges, placed_scale, placed_size
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.stage import Context


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
        worst_case="" if placed.by_case is None else placed.by_case.worst[name],
        zero=bool(summary.get(f"zero.{name}", False)),
        smoothed_std=None if beyond else float(summary[f"smoothed_std.{name}"]),
        claims=() if beyond else claims_of(name, summary, repeated(name, validate)),
        withheld=beyond,
        benefit=benefit_of(float(summary[f"error.{name}"]), own.all.error[name]),
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


def signals_of(up: Mapping[str, Artefact]) -> tuple[Reading, ...]:
    own, listed = read(Validated, up["validate"]).gauge, listed_gauges(up)
    units = [unit for unit, angles in zip(listed.unit, listed.angles, strict=True) for _ in angles]
    return tuple(
        Reading(label, units[i], own.time, own.measured[:, i], own.estimated[:, i], own.std[:, i], truth=own.true[:, i])
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


def checks_of(validate: Artefact) -> tuple[Check, ...]:
    """NEES and NIS of the filter."""
    names = {"nees": "NEES of the run; band of one instant", "nis": "NIS of the gauges"}
    bands = ((float(low), float(high)) for low, high in read(Validated, validate).consistency.band)
    values = (float(validate.summary[key]) for key in names)
    return tuple(
        Check(name, value, band, word_of(value, band))
        for name, value, band in zip(names.values(), values, bands, strict=True)
    )


def messages(up: Mapping[str, Artefact], stages: Sequence[str]) -> dict[str, str]:
    """What each of these stages came to."""
    return {stage: up[stage].message for stage in stages}


def provenance(context: Context[Any]) -> dict[str, str]:
    """Version, seed, and what tells the artefacts from others."""
    own = {"strainsight": __version__, "seed": str(context.config.seed)}
    return own | {f"{stage} artefact": artefact.key[:16] for stage, artefact in context.upstream.items()}

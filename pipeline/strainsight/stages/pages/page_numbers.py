"""The numbers of the page: unknowns, trend, histories, criteria, cases, noise, consistency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.cases.structure.gauge_list import channel_labels
from strainsight.placement.criteria.choices import criterion_of
from strainsight.placement.criteria.criterion import Criterion
from strainsight.records.placement import RULES, metric_key
from strainsight.report.placement.data import (
    Case,
    Consistency,
    Criteria,
    GaugeSignal,
    History,
    Metric,
    NoiseRow,
    Repeats,
    Trend,
    Unknown,
)
from strainsight.stages.pages.claims import claims_of
from strainsight.stages.pages.page_layout import listed_gauges, placed_scale, true_size
from strainsight.workflow.artefact import Artefact


def unknown_of(name: str, kind: Any, up: Mapping[str, Artefact]) -> Unknown:
    validate, place = up["validate"], up["place"]
    units = validate.attributes(f"/estimate/{name}")["units"]
    summary = validate.summary
    truth = validate[f"/truth/{name}"]
    return Unknown(
        name=name,
        unit=str(units),
        kind=kind,
        guess=placed_scale(name, place),
        truth=float(truth[-1]) if kind == "parameter" else float(np.sqrt(np.mean(truth**2))),
        estimate=float(summary[f"estimate.{name}"]),
        error=float(summary[f"error.{name}"]),
        std=float(summary[f"std.{name}"]),
        smoothed_error=float(summary[f"smoothed.{name}"]),
        expected_std=float(place[f"/expected_std/{name}"]) / true_size(name, validate),
        zero=bool(summary.get(f"zero.{name}", False)),
        smoothed_std=float(summary[f"smoothed_std.{name}"]),
        claims=claims_of(name, summary, repeated(name, validate)),
    )


def repeated(name: str, validate: Artefact) -> tuple[np.ndarray, np.ndarray]:
    """Error and claimed σ of every repeat, relative."""
    return validate[f"/repeats/error/{name}"], validate[f"/repeats/std/{name}"]


def trend_of(place: Artefact) -> Trend:
    summary = place.summary
    criterion = criterion_of(str(summary["criterion"]))
    key = metric_key(criterion.name)
    value, blocks = place[f"/elimination/{key}"], place["/elimination/blocks"]
    certified = "lower_bound" in summary
    return Trend(
        count=np.arange(int(summary["pool"]), int(summary["pool"]) - len(value), -1),
        value=value,
        blocks={str(name): blocks[:, i] for i, name in enumerate(place["/elimination/unknowns"])},
        final=float(summary[f"{key}_final"]),
        metric=_metric(criterion, place),
        lower_bound=float(summary["lower_bound"]) if certified else None,
        gap=float(summary["gap"]) if certified else None,
    )


def history_of(name: str, validate: Artefact) -> History:
    return History(
        name,
        str(validate.attributes(f"/estimate/{name}")["units"]),
        validate["/time"],
        validate[f"/truth/{name}"],
        validate[f"/estimate/{name}"],
        validate[f"/std/{name}"],
        validate[f"/smoothed/{name}"],
        validate[f"/smoothed_std/{name}"],
    )


def repeats_of(names: list[str], validate: Artefact) -> tuple[Repeats, ...]:
    return tuple(
        Repeats(
            name,
            *repeated(name, validate),
            "identified" if validate.summary[f"identified.{name}"] else "not identified",
        )
        for name in names
        if f"identified.{name}" in validate.summary
    )


def signals_of(up: Mapping[str, Artefact]) -> tuple[GaugeSignal, ...]:
    validate, listed = up["validate"], listed_gauges(up)
    time = validate["/gauge/time"]
    measured, true, estimated, std = (validate[f"/gauge/{key}"] for key in ("measured", "true", "estimated", "std"))
    units = [unit for unit, own in zip(listed.unit, listed.angles, strict=True) for _ in own]
    return tuple(
        GaugeSignal(label, time, measured[:, i], true[:, i], estimated[:, i], std[:, i], units[i])
        for i, label in enumerate(channel_labels(listed))
    )


def metrics_of(place: Artefact) -> tuple[Metric, ...]:
    """Every criterion, that of the layout first."""
    return tuple(_metric(criterion_of(name), place) for name in place["/criteria/name"].tolist())


def _metric(criterion: Criterion, place: Artefact) -> Metric:
    """In words, with the unknowns that it covers where these are not all."""
    over = place["/elimination/unknowns"].tolist()
    of = f", of {' and '.join(over)} alone" * (len(over) < len(place.children("/expected_std")))
    return Metric(criterion.symbol, criterion.meaning + of)


def criteria_of(names: list[str], place: Artefact) -> tuple[Criteria, ...]:
    """This layout, then the others by their metric; of the random sets the one in the middle."""
    rules, values = place["/criteria/rule"].tolist(), place["/criteria/value"]
    std = {name: place[f"/criteria/std/{name}"] for name in names}
    drawn = sorted((i for i, rule in enumerate(rules) if rule not in RULES), key=lambda i: values[i, 0])
    shown = {i: RULES[rule] for i, rule in enumerate(rules) if rule in RULES}
    if drawn:
        shown[drawn[(len(drawn) - 1) // 2]] = f"random, median of {len(drawn)}"
    return tuple(
        Criteria(words, tuple(values[i].tolist()), {n: float(std[n][i]) for n in names}) for i, words in shown.items()
    )


def cases_of(observe: Artefact) -> tuple[Case, ...]:
    unknowns = [tuple(text.split(", ")) for text in observe["/unknowns"].tolist()]
    condition, raw, lost = (observe[f"/{key}"] for key in ("condition", "condition_raw", "lost"))
    return tuple(
        Case(unknowns[j], excitation, float(condition[i, j]), float(raw[i, j]), str(lost[i, j]))
        for j in range(len(unknowns))
        for i, excitation in enumerate(observe["/excitation"].tolist())
    )


def noise_rows(names: list[str], up: Mapping[str, Artefact]) -> tuple[NoiseRow, ...]:
    validate = up["validate"]
    strongest = float(up["train"].summary["strongest_rms"])
    level = float(up["screen"].summary["noise_std"]) / strongest
    rows = [
        NoiseRow(
            level,
            1.0,
            {n: float(validate.summary[f"error.{n}"]) for n in names},
            {n: float(validate.summary[f"std.{n}"]) for n in names},
        )
    ]
    for i, factor in enumerate(validate["/noise/factor"].tolist()):
        rows.append(
            NoiseRow(
                level * factor,
                factor,
                {n: float(validate[f"/noise/error/{n}"][i]) for n in names},
                {n: float(validate[f"/noise/std/{n}"][i]) for n in names},
            )
        )
    return tuple(sorted(rows, key=lambda row: row.factor))


def consistency_of(validate: Artefact) -> Consistency:
    nees_band, nis_band = ((float(low), float(high)) for low, high in validate["/consistency/band"])
    return Consistency(float(validate.summary["nees"]), nees_band, float(validate.summary["nis"]), nis_band)

"""Summary numbers, message, tables and CSV time signals of the estimate of a test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.decks.faults import plural
from strainsight.estimation.consistency import check_innovations
from strainsight.estimation.decision import WITHHELD, summarise_record
from strainsight.experiment.filters_compared import comparison_table, disagreements_in_words, ratios
from strainsight.experiment.hold_out import (
    LeftOut,
    field_in_words,
    hold_out_numbers,
    hold_out_table,
    left_out,
    misfits_in_words,
    rms,
    size_in_words,
)
from strainsight.experiment.layout.advice import budget_tables
from strainsight.experiment.structure.campaign import Campaign
from strainsight.experiment.structure.estimation import Estimation
from strainsight.experiment.structure.filtering import posterior_doubts, posterior_numbers
from strainsight.records.estimated import CampaignRecord, DamageAt, Damaged, Estimated, record_group
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import below, written
from strainsight.runner.output import Output, Scalar, Table, warnings_table
from strainsight.text import csv_bytes


def campaign_output(campaign: Campaign) -> Output:
    """Datasets of every record and of the joint estimate, the surface grid, and the texts of the estimate."""
    grid, attributes = ({}, {}) if campaign.surface is None else vtkhdf_datasets(campaign.surface)
    datasets, files, together = dict(grid), {}, campaign.together
    for name, record in campaign.records.items():
        of_record = written(record.estimated, campaign.units)
        datasets |= of_record if campaign.only else below(record_group(name), of_record)
        files[f"estimate{'' if campaign.only else f'-{name}'}.csv"] = _csv(
            record.estimated, campaign.units, campaign.labels
        )
    if together is not None:
        shared = CampaignRecord(
            name=tuple(campaign.records),
            alone=together.alone,
            gain=together.gain,
            posterior=campaign.posterior,
            damage=campaign.damage,
        )
        datasets = written(shared, campaign.units) | datasets
    return Output(
        datasets=datasets,
        attributes=attributes,
        summary=_numbers(campaign),
        message=_message(campaign),
        tables=_tables(campaign),
        files=files,
    )


def _numbers(campaign: Campaign) -> dict[str, Scalar]:
    """Summary numbers by name; with several records the record name is appended."""
    first, together = campaign.first.estimated, campaign.together
    every = [record.estimated for record in campaign.records.values()]
    whole = campaign.first.innovation_check
    if together is not None:
        whole = check_innovations(np.concatenate([one.whitened for one in every]))
    numbers: dict[str, Scalar] = {
        "samples": sum(len(one.gauge.time) for one in every),
        "channels": len(first.gauge.label),
        "verdict": campaign.decision.inconsistent or whole.text,
        "innovation_ratio": whole.ratio,
        **campaign.decision.numbers,
        **_load_numbers(campaign, every),
    }
    for name in campaign.unknowns.parameters:
        numbers[f"estimate.{name}"] = _shared(campaign, name)
        if not campaign.decision.withheld:
            numbers[f"std.{name}"] = rms(first.smoothed_std[name])
    if campaign.tuning:
        numbers |= {f"factor.{part}": float(value) for part, value in campaign.tuning.factors.items()}
    if campaign.undetectable:
        numbers["unobservable"] = campaign.undetectable
    if together is None:
        numbers |= _hold_out_numbers(first)
    else:
        numbers |= {"records": len(every), "gain": together.gain}
        # accepted disagreement of records that agree with the model one by one
        numbers |= {"apart": together.words} if campaign.first.judgement.disagrees else {}
        for name, values in together.alone.items():
            each_alone = zip(campaign.records, values, strict=True)
            numbers |= {f"alone.{name}.{of_record}": float(value) for of_record, value in each_alone}
        for of, record in campaign.records.items():
            each: dict[str, Scalar] = {
                "innovation_ratio": record.innovation_check.ratio,
                "trusted": record.judgement.trusted,
            }
            each |= _load_numbers(campaign, [record.estimated]) | _hold_out_numbers(record.estimated)
            numbers |= {f"{key}.{of}": value for key, value in each.items()}
    numbers |= damage_numbers(campaign.damage, campaign.labels)
    return numbers | posterior_numbers(campaign.posterior) | ratios(first.compared)


def _hold_out_numbers(estimated: Estimated) -> dict[str, Scalar]:
    """Numbers of the hold-out test, and the factor that follows for σ at positions without gauges."""
    factor = None if estimated.hold_out is None else estimated.hold_out.field_factor
    of_field: dict[str, Scalar] = {} if factor is None else {"hold_out.field_factor": factor}
    return hold_out_numbers(without_each(estimated)) | of_field


def _load_numbers(campaign: Campaign, records: Sequence[Estimated]) -> dict[str, Scalar]:
    """RMS of every load over the records, and of its σ unless withheld."""
    numbers: dict[str, Scalar] = {}
    for name in campaign.unknowns.inputs:
        numbers[f"estimate.{name}"] = rms(np.concatenate([one.smoothed[name] for one in records]))
        if not campaign.decision.withheld:
            numbers[f"std.{name}"] = rms(np.concatenate([one.smoothed_std[name] for one in records]))
    return numbers


def _message(campaign: Campaign) -> str:
    """One line."""
    numbers, first, only = _numbers(campaign), campaign.first.estimated, campaign.only
    source = first.source.file if only else f"{len(campaign.records)} records ({', '.join(campaign.records)})"
    parts = [campaign.decision.message] if campaign.decision.message else []
    parts.append(f"{numbers['samples']} samples of {plural(len(first.gauge.label), 'channel')} from {source}")
    for name in campaign.unknowns.names:
        what = " RMS" if name in campaign.unknowns.inputs else ""
        sigma = "" if campaign.decision.withheld else f" ± {numbers[f'std.{name}']:.2g}"
        parts.append(f"{name} {numbers[f'estimate.{name}']:.4g}{sigma} {campaign.units[name]}{what}")
    if "hold_out.inside" in numbers and not campaign.decision.withheld:
        parts.append(
            f"gauges predicted from the other gauges: {100 * numbers['hold_out.inside']:.3g} % of samples within 2σ"
        )
    for of, record in campaign.records.items():
        parts += [text if only else f"{of}: {text}" for text in hold_out_in_words(record.estimated)]
    parts += damage_in_words(campaign.damage)
    parts += posterior_doubts(campaign.posterior, campaign.units)
    parts += disagreements_in_words(first.compared)
    return ", ".join(parts)


def _tables(campaign: Campaign) -> tuple[Table, ...]:
    """Tables of unknowns, or of records and parameters, then those of each record, corrections and warnings."""
    first, only, notes = campaign.first.estimated, campaign.only, list[tuple[str, ...]]()
    tables = [_unknowns_table(campaign) if only else _records_table(campaign)]
    tables += [_parameter_table(campaign)] if not only and campaign.unknowns.parameters else []
    tables += [*damage_tables(campaign.damage, campaign.labels), *budget_tables(first.budget, answer=True)]
    if first.compared is not None:
        tables.append(comparison_table(first.compared, campaign.units))
    for of, record in campaign.records.items():
        left_out_each = without_each(record.estimated)
        each = [hold_out_table(left_out_each, campaign.channel_units, "gauge")] if left_out_each else []
        for table in (*each, channel_table(record.estimated, campaign.channel_units)):
            tables.append(table if only else replace(table, title=f"{table.title}: {of}"))
        notes += [(of, note) for note in filter(None, (record.innovations_in_words, *record.estimated.notes))]
    texts = [text for _, text in notes]
    rows = [("all" if texts.count(text) == len(campaign.records) else of, text) for of, text in notes]
    by_record = (Table("measurements", ("record", ""), tuple(dict.fromkeys(rows)), answer=True),)
    measurements = warnings_table(texts, "measurements", answer=True) if only else by_record
    return (*tables, *measurements, *warnings_table([*filter(None, (campaign.decision.message,))]))


def _unknowns_table(campaign: Campaign) -> Table:
    rows, estimated = [], campaign.first.estimated
    for name, value in estimated.smoothed.items():
        std, unit = estimated.smoothed_std[name], campaign.units[name]
        if name in campaign.unknowns.inputs:
            estimate = f"RMS {rms(value):.5g}, {value.min():.5g} to {value.max():.5g} {unit}"
            sigma = f"± {rms(std):.3g} {unit}"
        else:
            # of a factor the unit is 1
            estimate = f"{value[-1]:.5g}" if unit == "1" else f"{value[-1]:.5g} {unit}"
            sigma = f"± {std[-1]:.3g} ({100 * std[-1] / value[-1]:.2g} %)"
        rows.append((name, estimate, WITHHELD if campaign.decision.withheld else sigma))
    return Table("estimates, smoothed", ("unknown", "estimate", "claimed σ"), tuple(rows), answer=True)


def _records_table(campaign: Campaign) -> Table:
    """One row a record: duration, peak and RMS of every load with σ, innovations within 2σ, and consistency."""
    rows, loads = [], campaign.unknowns.inputs
    for of, record in campaign.records.items():
        time, cells = record.estimated.time, []
        for name in loads:
            value, std = record.estimated.smoothed[name], record.estimated.smoothed_std[name]
            top = int(np.argmax(np.abs(value)))
            cells += [_with_sigma(float(value[top]), float(std[top])), _with_sigma(rms(value), rms(std))]
        inside = f"{100 * innovations_inside(record.estimated):.3g} %"
        consistency = summarise_record(record.judgement.trusted, record.judgement.disagrees)
        rows.append((of, f"{time[-1] - time[0]:.4g} s", *cells, inside, consistency))
    heads = [f"{name} {what} [{campaign.units[name]}]" for name in loads for what in ("peak", "RMS")]
    columns = ("record", "duration", *heads, "innovations within 2σ", "consistency")
    return Table("records", columns, tuple(rows), answer=True)


def innovations_inside(estimated: Estimated) -> float:
    """Share of the innovations of a record within 2σ, NaN without any."""
    known = estimated.whitened[np.isfinite(estimated.whitened)]
    return float(np.mean(np.abs(known) < 2)) if len(known) else np.nan


def _parameter_table(campaign: Campaign) -> Table:
    together, rows = campaign.together, []
    assert together is not None
    for name in campaign.unknowns.parameters:
        value, std = _shared(campaign, name), float(campaign.first.estimated.smoothed_std[name][-1])
        sigma = f"± {std:.3g} ({100 * std / value:.2g} %)"
        each = (f"{alone:.5g}" for alone in together.alone[name])
        shown = WITHHELD if campaign.decision.withheld else sigma
        rows.append((name, f"{value:.5g} {campaign.units[name]}", shown, *each))
    some = 0 < len(_agreeing(campaign)) < len(campaign.records)
    by = "estimate from consistent records" if some else "estimate from all records"
    columns = ("parameter", by, "claimed σ", *(f"{of} alone" for of in campaign.records))
    return Table("parameters shared by all records", columns, tuple(rows), answer=True)


def _with_sigma(value: float, std: float) -> str:
    return f"{value:.4g}" if np.isnan(std) else f"{value:.4g} ± {std:.2g}"


def _agreeing(campaign: Campaign) -> list[Estimation]:
    """Records whose parameters were estimated jointly."""
    return [record for record in campaign.records.values() if campaign.decision.accept or record.judgement.trusted]


def _shared(campaign: Campaign, parameter: str) -> float:
    """Parameter from the consistent records; if none of several is consistent, the most likely value of all."""
    if campaign.together is not None and not _agreeing(campaign):
        return campaign.together.shared[parameter]
    record = next(iter(_agreeing(campaign)), campaign.first)
    return float(np.mean(record.estimated.smoothed[parameter]))


def without_each(estimated: Estimated) -> tuple[LeftOut, ...]:
    """Hold-out results of every gauge, empty if not configured."""
    return left_out(estimated.hold_out, estimated.gauge.label, estimated.gauge.measured)


def hold_out_in_words(estimated: Estimated) -> list[str]:
    """Channels that disagree with their prediction, and what follows for σ at positions without gauges; empty if σ is withheld,
    because an inconsistent record has one message."""
    if estimated.hold_out is None or estimated.hold_out.field_factor is None:
        return []
    return misfits_in_words(without_each(estimated), "gauges") + field_in_words(estimated.hold_out)


def channel_table(estimated: Estimated, units: Sequence[str]) -> Table:
    """Compare every channel with its prediction from the others or from earlier samples; units of the channels."""
    check, time, rows = estimated.check, estimated.gauge.time, []
    for i, (name, unit) in enumerate(zip(estimated.gauge.label, units, strict=True)):
        sizes = (size_in_words(size, unit) for size in (check.measured[i], check.predicted[i]))
        cause = (check.fault[i] or "none",) if check.by_others else ()
        rows.append((name, *sizes, f"{check.residual[i]:.3g}", f"{check.correlation[i]:.3g}", *cause))
    columns = ["channel", "RMS measured", "RMS predicted", "residual / σ", "correlation"]
    columns += ["most likely fault"] if check.by_others else []
    by = "from all other channels" if check.by_others else "one step ahead from all channels"
    whole = check.end - check.begin >= 0.99 * float(time[-1] - time[0])
    part = "" if whole else f", from {check.begin:.4g} to {check.end:.4g} s"
    return Table(f"readings of the channels, predicted {by}{part}", tuple(columns), tuple(rows))


def _csv(estimated: Estimated, units: Mapping[str, str], labels: Sequence[str]) -> bytes:
    columns = {"time [s]": estimated.time}
    for name in estimated.estimate:
        words = ("filtered", "filtered std", "smoothed", "smoothed std")
        values = (estimated.estimate[name], estimated.std[name], estimated.smoothed[name], estimated.smoothed_std[name])
        columns |= {f"{name} {word} [{units[name]}]": value for word, value in zip(words, values, strict=True)}
    for total in estimated.resultant.values():
        columns |= {f"{total.place} {axis} [N]": total.force[:, i] for i, axis in enumerate("xyz")}
        columns |= {f"{total.place} size [N]": total.magnitude, f"{total.place} size std [N]": total.std}
    if (virtual := estimated.virtual) is not None:
        for i, label in enumerate(labels):
            columns |= {f"{label} [strain]": virtual.strain[:, i], f"{label} std [strain]": virtual.std[:, i]}
    rows = np.column_stack(list(columns.values()))
    return csv_bytes([list(columns), *([f"{x:.9g}" for x in row] for row in rows)])


def damage_numbers(damaged: Damaged | None, labels: Sequence[str]) -> dict[str, Scalar]:
    """Damage, its interval, equivalent range [Pa] and life [h] of the worst point and of every virtual gauge."""
    if damaged is None:
        return {}
    numbers: dict[str, Scalar] = {}
    for name, at, i in _places(damaged, labels):
        level = at.damage[i] if np.isfinite(at.damage[i]) else at.of_mean[i]
        numbers[f"damage.of_mean.{name}"] = float(at.of_mean[i])
        if not np.isnan(at.damage[i]):
            numbers |= {
                f"damage.{name}": float(at.damage[i]),
                f"damage.low.{name}": float(at.low[i]),
                f"damage.high.{name}": float(at.high[i]),
                f"equivalent_range.{name}": float(at.range[i]),
            }
        if level > 0:
            numbers[f"life.{name}"] = float(damaged.hours / level)
    return numbers


def damage_in_words(damaged: Damaged | None) -> list[str]:
    """Damage of the worst point of the surface."""
    if damaged is None or damaged.surface is None or damaged.hot_spot is None or not len(damaged.hot_spot):
        return []
    at, i = damaged.surface, int(damaged.hot_spot[0])
    return [f"largest damage {_damage(at, i)}{_interval(at, i, ' (', ')')} at element {at.element[i]}"]


def damage_tables(damaged: Damaged | None, labels: Sequence[str]) -> tuple[Table, ...]:
    """Table of the hot spots of the surface and the virtual gauges."""
    if damaged is None:
        return ()
    withheld = all(np.isnan(at.damage).all() for _, at, _ in _places(damaged, labels))
    rows = []
    if damaged.surface is not None and damaged.hot_spot is not None:
        for number, i in enumerate(damaged.hot_spot.tolist(), start=1):
            rows.append((f"{number}, element {damaged.surface.element[i]}", *_row(damaged, damaged.surface, i)))
    if damaged.virtual is not None:
        rows += [(label, *_row(damaged, damaged.virtual, i)) for i, label in enumerate(labels)]
    columns = ("location", "x, y, z [m]", "damage", "95 % interval", "equivalent range", "life")
    title = (
        "damage of the smoothed strain history (without 95 % interval)"
        if withheld
        else "damage at hot spots and virtual gauges"
    )
    return (Table(title, columns, tuple(rows)),)


def _places(damaged: Damaged, labels: Sequence[str]) -> list[tuple[str, DamageAt, int]]:
    places: list[tuple[str, DamageAt, int]] = []
    if damaged.surface is not None and damaged.hot_spot is not None and len(damaged.hot_spot):
        places.append(("surface", damaged.surface, int(damaged.hot_spot[0])))
    if damaged.virtual is not None:
        places += [(label, damaged.virtual, i) for i, label in enumerate(labels)]
    return places


def _row(damaged: Damaged, at: DamageAt, i: int) -> tuple[str, ...]:
    where = ", ".join(f"{value:.4g}" for value in at.position[i])
    sampled = not np.isnan(at.damage[i])
    level, range_ = (at.damage[i], at.range[i]) if sampled else (at.of_mean[i], at.range_of_mean[i])
    life = f"{damaged.hours / level:.3g} h" if level > 0 else "no damage"
    if sampled and at.high[i] > 0:
        longest = f"{damaged.hours / at.low[i]:.2g}" if at.low[i] > 0 else "∞"
        life += f" ({damaged.hours / at.high[i]:.2g} to {longest})"
    return where, _damage(at, i), _interval(at, i) or "withheld", f"{range_ / 1e6:.4g} MPa", life


def _damage(at: DamageAt, i: int) -> str:
    return f"{at.of_mean[i] if np.isnan(at.damage[i]) else at.damage[i]:.3g}"


def _interval(at: DamageAt, i: int, before: str = "", after: str = "") -> str:
    return "" if np.isnan(at.damage[i]) else f"{before}{at.low[i]:.2g} to {at.high[i]:.2g}{after}"

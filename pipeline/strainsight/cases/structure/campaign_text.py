"""What the records of a test say, for people: a table over records, shared parameters, then record by record."""

from __future__ import annotations

import numpy as np

from strainsight.cases.hold_out import hold_out_numbers, hold_out_table, misfits_in_words
from strainsight.cases.structure.campaign import Campaign
from strainsight.cases.structure.damage_text import damage_in_words, damage_numbers, damage_tables
from strainsight.cases.structure.estimation import Estimation
from strainsight.cases.structure.estimation_text import channel_table, estimation_csv, rms, without_each
from strainsight.cases.structure.filtering import posterior_doubts, posterior_numbers
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.records.estimated import CampaignRecord
from strainsight.workflow.output import Scalar, Table

FITS, DOES_NOT, CONTRADICTS, APART = (
    "fits",
    "the noise does not fit",
    "contradicts the model",
    "contradicts other records",
)
"""Verdicts on a record."""


def campaign_record(found: Campaign) -> CampaignRecord:
    """What estimate.h5 has beside the records."""
    together = found.together
    assert together is not None  # of several records
    return CampaignRecord(
        name=tuple(found.records),
        alone=together.alone,
        gain=together.gain,
        posterior=found.posterior,
        damage=found.damage,
    )


def campaign_numbers(found: Campaign) -> dict[str, Scalar]:
    """Every number by its name; of one record with that behind it."""
    first, whole, together = _first(found), _verdict(found), found.together
    assert together is not None
    trusted = all(own.judgement.trusted for own in found.records.values())
    numbers: dict[str, Scalar] = {
        "records": len(found.records),
        "samples": sum(len(own.estimated.gauge.time) for own in found.records.values()),
        "channels": len(first.estimated.gauge.label),
        "verdict": whole.text,
        "innovation_ratio": whole.ratio,
        "consistent": whole.consistent,
        "trusted": trusted,
        "accepted": found.accepted and not trusted,
        "gain": together.gain,
    }
    if apart := _apart(found):
        numbers["apart"] = apart
    if faults := [f"{name}: {own.judgement.named}" for name, own in found.records.items() if own.judgement.named]:
        numbers["fault"] = "; ".join(faults)
    for name in first.unknowns.inputs:
        histories = [own.estimated.smoothed[name] for own in found.records.values()]
        stds = [own.estimated.smoothed_std[name] for own in found.records.values()]
        numbers[f"estimate.{name}"] = rms(np.concatenate(histories))
        if not found.withheld:
            numbers[f"std.{name}"] = rms(np.concatenate(stds))
    for name in first.unknowns.parameters:
        numbers[f"estimate.{name}"] = _shared(found, name)
        if not found.withheld:
            numbers[f"std.{name}"] = rms(first.estimated.smoothed_std[name])
        numbers |= {
            f"alone.{name}.{of}": float(value) for of, value in zip(found.records, together.alone[name], strict=True)
        }
    for of, own in found.records.items():
        numbers |= {f"innovation_ratio.{of}": own.verdict.ratio, f"trusted.{of}": own.judgement.trusted}
        for name in first.unknowns.inputs:
            numbers[f"estimate.{name}.{of}"] = rms(own.estimated.smoothed[name])
            if not found.withheld:
                numbers[f"std.{name}.{of}"] = rms(own.estimated.smoothed_std[name])
        numbers |= {f"{key}.{of}": value for key, value in hold_out_numbers(without_each(own.estimated)).items()}
    if found.withheld:
        numbers["withheld"] = found.withheld
    if found.undetectable:
        numbers["unobservable"] = found.undetectable
    return numbers | damage_numbers(found.damage, first.labels) | posterior_numbers(found.posterior)


def campaign_message(found: Campaign) -> str:
    """One line."""
    numbers, first, names = campaign_numbers(found), _first(found), ", ".join(found.records)
    parts = [found.withheld] if found.withheld else []
    if found.accepted and not numbers["trusted"]:
        wrong = {of: own.judgement.words for of, own in found.records.items()}
        each = "; ".join(f"{of}: {words}" for of, words in wrong.items() if words)
        parts.append(f"accepted: {_apart(found) or each}")
    parts.append(
        f"{numbers['samples']} samples of {numbers['channels']} channels in {len(found.records)} records ({names})"
    )
    for name in first.unknowns.names:
        what = " RMS" if name in first.unknowns.inputs else ""
        sigma = "" if found.withheld else f" ± {numbers[f'std.{name}']:.2g}"
        parts.append(f"{name} {numbers[f'estimate.{name}']:.4g}{sigma} {first.units[name]}{what}")
    for of, own in found.records.items():
        parts += [f"{of}: {words}" for words in misfits_in_words(without_each(own.estimated), "gauges")]
    if loud := [of for of, own in found.records.items() if own.judgement.trusted and not own.verdict.consistent]:
        parts.append(f"the noise does not fit the innovations of {', '.join(loud)}")
    parts += damage_in_words(found.damage)
    parts += posterior_doubts(found.posterior, first.units)
    return ", ".join(parts)


def campaign_tables(found: Campaign) -> tuple[Table, ...]:
    """The records, the parameters by all of them and by each alone, then what there is of each."""
    first = _first(found)
    tables = [records_table(found)]
    if first.unknowns.parameters:
        tables.append(_parameter_table(found))
    tables += damage_tables(found.damage, first.labels)
    notes: list[tuple[str, ...]] = []
    for of, own in found.records.items():
        if held := without_each(own.estimated):
            table = hold_out_table(held, own.channel_units, "gauge")
            tables.append(Table(f"{table.title}: {of}", table.columns, table.rows))
        table = channel_table(own.estimated, own.channel_units)
        tables.append(Table(f"{table.title}: {of}", table.columns, table.rows))
        notes += [(of, note) for note in filter(None, (*own.estimated.notes, own.innovations_in_words))]
    return (*tables, Table("measurements", ("record", ""), tuple(_once(notes, len(found.records)))))


def records_table(found: Campaign) -> Table:
    """A row a record: how long it is, peak and RMS of every load with σ, how large its innovations are, and the verdict."""
    first, rows = _first(found), []
    loads = first.unknowns.inputs
    for of, own in found.records.items():
        time, cells = own.estimated.time, []
        for name in loads:
            value, std = own.estimated.smoothed[name], own.estimated.smoothed_std[name]
            top = int(np.argmax(np.abs(value)))
            cells += [_with_sigma(float(value[top]), float(std[top])), _with_sigma(rms(value), rms(std))]
        whitened = own.estimated.whitened
        inside = float(np.mean(np.abs(whitened[np.isfinite(whitened)]) < 2)) if np.isfinite(whitened).any() else np.nan
        rows.append((of, f"{time[-1] - time[0]:.4g} s", *cells, f"{100 * inside:.3g} %", verdict_in_words(own)))
    heads = [f"{name} {what} [{first.units[name]}]" for name in loads for what in ("peak", "RMS")]
    return Table("records", ("record", "duration", *heads, "innovations within 2σ", "verdict"), tuple(rows))


def verdict_in_words(own: Estimation) -> str:
    """On one record of several."""
    if not own.judgement.trusted:
        return APART if own.judgement.apart else CONTRADICTS
    return FITS if own.verdict.consistent else DOES_NOT


def campaign_files(found: Campaign) -> dict[str, bytes]:
    """All time signals of every record as a table."""
    return {f"estimate-{of}.csv": estimation_csv(own) for of, own in found.records.items()}


def _parameter_table(found: Campaign) -> Table:
    first, together, rows = _first(found), found.together, []
    assert together is not None
    for name in first.unknowns.parameters:
        value, std = _shared(found, name), float(first.estimated.smoothed_std[name][-1])
        trusted = all(own.judgement.trusted for own in found.records.values())
        sigma = f"± {std:.3g} ({100 * std / value:.2g} %)"
        none = "withheld" if trusted else "not to be trusted"
        each = (f"{alone:.5g}" for alone in together.alone[name])
        rows.append((name, f"{value:.5g} {first.units[name]}", none if found.withheld else sigma, *each))
    some = 0 < len(_agreeing(found)) < len(found.records)
    by = "by those that agree" if some else "by all records"
    columns = ("parameter", by, "claimed σ", *(f"{of} alone" for of in found.records))
    return Table("parameters that all records share", columns, tuple(rows))


def _with_sigma(value: float, std: float) -> str:
    return f"{value:.4g}" if np.isnan(std) else f"{value:.4g} ± {std:.2g}"


def _once(notes: list[tuple[str, ...]], records: int) -> list[tuple[str, ...]]:
    """A note that is of all records once."""
    texts = [text for _, text in notes]
    found: list[tuple[str, ...]] = []
    for of, text in notes:
        row = ("all", text) if texts.count(text) == records else (of, text)
        if row not in found:
            found.append(row)
    return found


def _agreeing(found: Campaign) -> list[Estimation]:
    """The records whose parameters were estimated together."""
    records = found.records.values()
    return [own for own in records if found.accepted or own.judgement.trusted]


def _shared(found: Campaign, parameter: str) -> float:
    """A parameter by the records that agree with the model; where none does the most likely one of all."""
    assert found.together is not None
    for own in _agreeing(found):
        return float(np.mean(own.estimated.smoothed[parameter]))
    return found.together.shared[parameter]


def _first(found: Campaign) -> Estimation:
    return next(iter(found.records.values()))


def _apart(found: Campaign) -> str:
    """That records that agree with the model one by one contradict each other, where that is accepted; else empty."""
    together = found.together
    return together.words if together and all(own.judgement.apart for own in found.records.values()) else ""


def _verdict(found: Campaign) -> Verdict:
    return verdict(np.concatenate([own.estimated.whitened for own in found.records.values()]))

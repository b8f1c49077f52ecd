"""test: the page of a test, one for each of several records, and their content, which is read from the artefacts alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.decision import record_verdict
from strainsight.experiment.filters_compared import disagreements_in_words
from strainsight.experiment.structure.campaign_text import channel_table, damage_tables, innovations_inside
from strainsight.experiment.structure.filtering import posterior_doubts
from strainsight.experiment.structure.surface import virtual_labels
from strainsight.loads.histories import density, noise_density
from strainsight.pages.arrays import History, Reading
from strainsight.pages.picture.scene import drawn_or_why
from strainsight.pages.placement.page import TEST_PAGE
from strainsight.pages.tested.campaign import CampaignFindings, RecordRow, campaign_figures, page_of_campaign
from strainsight.pages.tested.data import File, Findings, Map, Moment, Spectrum, Unknown, peak_of
from strainsight.pages.tested.figures import figures_of_test
from strainsight.pages.tested.page import page_of_test, title_of, views_of
from strainsight.pages.text import capital
from strainsight.pages.view.viewing import exaggerated, screenshots
from strainsight.records.estimated import CampaignRecord, Damaged, Estimated, campaign_in, estimated_in
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, unit_of
from strainsight.records.training import Training
from strainsight.runner.output import Output, Table, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.sensors.candidates import UNITS
from strainsight.stages.pages.page import messages, provenance
from strainsight.stages.pages.page_layout import layout_of_test

MEGA, MICRO = 1e6, 1e6
STAGES = ("import", "rom", "train", "screen", "place", "estimate")
"""Of which the page shows what each came to."""


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the pages show and write each as one self-contained file: of a test of several records one over all of them,
    and one for each."""
    reports, campaign = findings_of(context)
    files: dict[str, bytes] = {}
    warnings = dict.fromkeys(text for report in reports.values() for text in report.warnings)
    pictured, drawn, problem = 0, 0, ""
    for i, (name, report) in enumerate(reports.items()):
        context.progress(f"pictures of {name}" if name else "pictures", (i + 0.1) / len(reports))
        views = views_of(report)
        pictures, problem = drawn_or_why(partial(screenshots, views)) if views else (None, "")
        context.progress("figures", (i + 0.5) / len(reports))
        drawings = figures_of_test(report)
        files[_page(name)] = page_of_test(report, drawings, tuple(pictures or ()), problem).encode()
        pictured, drawn = pictured + len(pictures or ()), drawn + len(drawings)
    if campaign is not None:
        over = campaign_figures(campaign)
        files = {TEST_PAGE: page_of_campaign(campaign, over).encode()} | files
        warnings, drawn = dict.fromkeys(campaign.warnings), drawn + len(over)
    size = f"{sum(map(len, files.values())) / 1024:.0f} KiB"
    return Output(
        datasets={},
        summary={"pictures": pictured, "figures": drawn, "warnings": len(warnings)},
        message=f"{', '.join(files)}, {size}" + (f"; no picture: {problem}" if problem else ""),
        tables=warnings_table(tuple(warnings)),
        files=files,
    )


def _page(record: str) -> str:
    return f"test-{record}.html" if record else TEST_PAGE


def findings_of(context: Context[PlacementConfig]) -> tuple[dict[str, Findings], CampaignFindings | None]:
    """What each page of a record shows, by the names of the records; what the page over them shows, None where there is one."""
    estimate = context.upstream["estimate"]
    campaign, records = campaign_in(estimate), estimated_in(estimate)
    reports = {name: _record_findings(context, name, records, campaign) for name in records}
    return reports, None if campaign is None else _campaign_findings(context, records, reports, campaign)


def _record_findings(
    context: Context[PlacementConfig], name: str, records: Mapping[str, Estimated], campaign: CampaignRecord | None
) -> Findings:
    up, config, record = context.upstream, context.config, records[name]
    summary, others = up["estimate"].summary, [("all records", TEST_PAGE)]
    others += [(other, _page(other)) for other in records if other != name]
    names = [str(unknown) for unknown in config.place.estimate]
    units = {unknown: unit_of(record, "estimate", unknown) for unknown in names}
    loads = [unknown for unknown in names if unknown in config.loads]
    layout, marks = layout_of_test(mesh_from(up["import"]), up, config.loads, record.gauge.label, record.gauge.channel)
    readings = _readings(record, marks, read(Training, up["train"]))
    doubts = posterior_doubts(record.posterior if campaign is None else campaign.posterior, units)
    noise = verdict(record.whitened)
    judged = record_verdict(record.trusted, "apart" in summary, noise.consistent)
    spectra = [_spectrum(load, units[load], record.time, record.smoothed[load]) for load in loads]
    residuals = [
        _spectrum(reading.label, reading.unit, reading.time, reading.residual, reading.noise_std)
        for reading in readings
    ]
    return Findings(
        name=config.name,
        title=title_of(f"{config.name}, record {name}" if name else config.name, tuple(names)),
        unknowns=tuple(
            _unknown(
                unknown,
                units[unknown],
                unknown in loads,
                record,
                summary,
                [text for text in doubts if f"{unknown} " in f"{text} "],
                f".{name}" if name and unknown in loads else "",
            )
            for unknown in names
        ),
        verdict=noise.text if record.trusted else f"the record is {judged}",
        consistent=record.trusted and noise.consistent,
        warnings=_warnings(record, summary, doubts, noise),
        notes=record.notes,
        layout=layout,
        histories=tuple(_history(unknown, units[unknown], unknown in loads, record) for unknown in names),
        file=_file(record),
        readings=readings,
        hold_out=_held_out(record, readings),
        checked=channel_table(record, [reading.unit for reading in readings]),
        damage=_damage(record.damage, config),
        residuals=tuple(filter(None, residuals)),
        resultants=tuple(
            History(one.place, "N", record.time, None, one.magnitude, one.std) for one in record.resultant.values()
        ),
        known=tuple(
            History(load, unit_of(record, "known", load), record.time, None, values, np.full(len(values), np.nan))
            for load, values in record.known.items()
        ),
        load_spectra=tuple(filter(None, spectra)),
        posteriors=record.posterior,
        filters=record.compared,
        budget={} if record.budget is None else record.budget.shares,
        moment=_moment(record, layout.points),
        facts=messages(up, STAGES),
        provenance=provenance(context),
        record=name,
        beside=tuple(others) if name else (),
    )


def _campaign_findings(
    context: Context[PlacementConfig],
    records: Mapping[str, Estimated],
    reports: Mapping[str, Findings],
    campaign: CampaignRecord,
) -> CampaignFindings:
    config, summary = context.config, context.upstream["estimate"].summary
    rows, apart = [], str(summary.get("apart", ""))
    for name, record in records.items():
        report, inside = reports[name], innovations_inside(record)
        rows.append(
            RecordRow(report, _page(name), inside, record_verdict(record.trusted, bool(apart), report.consistent))
        )
    texts = [str(summary.get("withheld", "")), apart]
    texts += [f"record {name}: {one.verdict}" for name, one in reports.items() if not (one.consistent or apart)]
    texts += _hidden(summary)
    return CampaignFindings(
        title=title_of(config.name, tuple(map(str, config.place.estimate))),
        records=tuple(rows),
        shared=campaign,
        warnings=tuple(capital(text) for text in texts if text),
        damage=_damage(campaign.damage, config),
    )


def _damage(found: Damaged | None, config: PlacementConfig) -> Table | None:
    assert config.estimate is not None
    return next(iter(damage_tables(found, virtual_labels(config.estimate.virtual))), None)


def _hidden(summary: Mapping[str, object]) -> list[str]:
    """What the channels cannot tell, as a sentence or none."""
    return [f"the channels cannot tell {hidden}" for hidden in [summary.get("unobservable")] if hidden]


def _warnings(own: Estimated, summary: Mapping[str, object], doubts: list[str], noise: Verdict) -> tuple[str, ...]:
    """What a reader has to know, the gravest first: why σ is withheld, what the record contradicts, what it cannot tell."""
    texts = [str(summary.get("withheld", ""))]
    # a record that is inconsistent with the model has its own warning, and the noise is not to blame
    if own.trusted and not noise.consistent:
        texts.append(noise.text)
    texts += [*_hidden(summary), *doubts, *disagreements_in_words(own.compared)]
    return tuple(capital(text) for text in texts if text)


def _unknown(
    name: str, unit: str, load: bool, own: Estimated, summary: Mapping[str, object], doubts: list[str], of: str
) -> Unknown:
    """of: what stands behind its name in the summary, of one record of several."""
    std, at = summary.get(f"std.{name}{of}"), int(np.argmax(np.abs(own.smoothed[name])))
    peak_std = float(own.smoothed_std[name][at])
    return Unknown(
        name=name,
        unit=unit,
        kind="load" if load else "parameter",
        estimate=float(str(summary[f"estimate.{name}{of}"])),
        std=None if std is None or not np.isfinite(float(str(std))) else float(str(std)),
        peak=peak_of(own.time, own.smoothed[name]) if load else None,
        doubts=tuple(doubts),
        peak_std=peak_std if load and np.isfinite(peak_std) else None,
    )


def _history(name: str, unit: str, load: bool, own: Estimated) -> History:
    """A load as smoothed; a parameter as it was filtered, and as smoothed."""
    if load:
        return History(name, unit, own.time, None, own.smoothed[name], own.smoothed_std[name])
    return History(
        name, unit, own.time, None, own.estimate[name], own.std[name], own.smoothed[name], own.smoothed_std[name]
    )


def _moment(own: Estimated, points: np.ndarray) -> Moment | None:
    then = own.moment
    if then is None:
        return None
    shift = then.displacement.astype(float)
    factor = exaggerated(points, shift)
    mises = Map(
        "von Mises stress",
        "MPa",
        then.von_mises.astype(float) / MEGA,
        None if then.von_mises_std is None else then.von_mises_std.astype(float) / MEGA,
    )
    strain = Map("principal strain of largest size", "µm/m", then.principal_strain.astype(float) * MICRO)
    return Moment(then.time, then.label, factor * shift, factor, (strain, mises))


def _file(own: Estimated) -> File:
    """The file with the rate, first instant and length of its samples."""
    time, samples = own.time, len(own.gauge.time)
    length = float(time[-1] - time[0])
    return File(own.source, 1 / (_step(own.gauge.time) if samples > 1 else length), float(time[0]), length, samples)


def _readings(own: Estimated, marks: tuple[int, ...], training: Training) -> tuple[Reading, ...]:
    """Of every channel, measured and as the model has it; marks: of their gauges on the page."""
    gauge, offsets = own.gauge, {}
    if own.bias is not None:
        offsets = {
            int(c): (float(m), float(s)) for c, m, s in zip(own.bias.channel, own.bias.mean, own.bias.std, strict=True)
        }
    shift = np.array([offsets[i][0] if i in offsets else 0.0 for i in range(len(gauge.label))])
    measured, estimated = gauge.measured - shift, gauge.estimated - shift
    return tuple(
        Reading(
            label,
            UNITS[int(training.candidates.quantity[gauge.channel[i]])],
            gauge.time,
            measured[:, i],
            estimated[:, i],
            gauge.std[:, i],
            marks[i],
            noise_std=float(gauge.noise_std[i]),
            offset=offsets.get(i),
        )
        for i, label in enumerate(gauge.label)
    )


def _held_out(own: Estimated, readings: tuple[Reading, ...]) -> tuple[Reading, ...]:
    """Of every channel that was left out, as the others predict it."""
    if own.hold_out is None:
        return ()
    return tuple(
        replace(
            reading,
            measured=own.gauge.measured[:, i],
            estimated=own.hold_out.predicted[:, i],
            std=own.hold_out.std[:, i],
        )
        for i, reading in enumerate(readings)
        if not own.hold_out.left_in[i]
    )


def _spectrum(
    name: str, unit: str, time: np.ndarray, values: np.ndarray, noise_std: float | None = None
) -> Spectrum | None:
    """Of a signal, beside that of its noise; None of a record that is too short."""
    step = _step(time)
    frequency, of_signal = density(values, step)
    level = None if noise_std is None else noise_density(noise_std, step)
    return Spectrum(name, unit, frequency, of_signal, level) if len(frequency) else None


def _step(time: np.ndarray) -> float:
    """Between samples [s]; 1 s where there is one sample."""
    return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 1.0


TEST = Stage(
    "test",
    version=8,
    reads=("name", "seed", "loads", "place.estimate", "estimate.virtual"),
    upstream=("import", "rom", "train", "screen", "place", "estimate"),
    files=(),
    run=run,
)

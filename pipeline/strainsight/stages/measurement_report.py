"""test: the page of a test, one for each of several records, and their content, which is read from the artefacts alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.estimation.consistency import check_innovations
from strainsight.estimation.decision import summarise_record
from strainsight.experiment.filters_compared import disagreements_in_words
from strainsight.experiment.structure.campaign_text import (
    channel_table,
    damage_tables,
    hold_out_in_words,
    innovations_inside,
)
from strainsight.experiment.structure.filtering import posterior_doubts
from strainsight.experiment.structure.surface import virtual_labels
from strainsight.loads.histories import density, noise_density
from strainsight.pages.arrays import History, Reading
from strainsight.pages.picture.scene import draw_or_explain
from strainsight.pages.placement.page import TEST_PAGE
from strainsight.pages.tested.campaign import CampaignFindings, campaign_figures, page_of_campaign
from strainsight.pages.tested.data import File, Findings, Map, Spectrum, SurfaceMoment, TestedUnknown, peak_of
from strainsight.pages.tested.figures import figures_of_test
from strainsight.pages.tested.page import page_of_test, title_of, views_of
from strainsight.pages.view.viewing import exaggerated, screenshots
from strainsight.records.estimated import CampaignRecord, Damaged, Estimated, campaign_in, estimated_in
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, unit_of
from strainsight.records.training import Training
from strainsight.runner.output import Output, Table, warnings_table
from strainsight.runner.stage import Context
from strainsight.sensors.candidates import UNITS
from strainsight.stages.pages.page import provenance
from strainsight.stages.pages.page_layout import layout_of_test
from strainsight.text import capital

MEGA, MICRO = 1e6, 1e6
STAGES = ("import", "rom", "train", "screen", "place", "estimate")
"""Stages with messages on the page."""


def pages_of(context: Context[PlacementConfig]) -> tuple[tuple[Findings, ...], CampaignFindings | None]:
    """Content of the page of each record, and of the overview page (None for a single record); from import, rom, train, screen,
    place and estimate."""
    estimate = context.upstream["estimate"]
    campaign, records = campaign_in(estimate), estimated_in(estimate)
    pages = {name: f"test-{name}.html" for name in records if name}
    findings = {name: _findings_of(context, name, record, campaign, pages) for name, record in records.items()}
    whole = None if campaign is None else _campaign_findings(context, findings, campaign)
    return tuple(findings.values()), whole


def _findings_of(
    context: Context[PlacementConfig],
    name: str,
    record: Estimated,
    campaign: CampaignRecord | None,
    pages: Mapping[str, str],
) -> Findings:
    up, config = context.upstream, context.config
    summary, names = up["estimate"].summary, [str(unknown) for unknown in config.place.estimate]
    units = {unknown: unit_of(record, "estimate", unknown) for unknown in names}
    loads = [unknown for unknown in names if unknown in config.loads]
    layout, marks = layout_of_test(mesh_from(up["import"]), up, config.loads, record.gauge.label, record.gauge.channel)
    readings = _readings(record, marks, read(Training, up["train"]))
    doubts = posterior_doubts(record.posterior if campaign is None else campaign.posterior, units)
    noise = check_innovations(record.whitened)
    result = summarise_record(record.trusted, "apart" in summary)
    # the most important first
    warnings = (*up["estimate"].warnings, *hold_out_in_words(record), _hidden(summary), *doubts)
    warnings += tuple(disagreements_in_words(record.compared))

    def history(unknown: str) -> History:
        """A load as smoothed; a parameter as it was filtered, and as smoothed."""
        smoothed = record.smoothed[unknown], record.smoothed_std[unknown]
        values = smoothed if unknown in loads else (record.estimate[unknown], record.std[unknown], *smoothed)
        return History(unknown, units[unknown], record.time, None, *values)

    def unknown_of(unknown: str) -> TestedUnknown:
        load, alone = unknown in loads, tuple(text for text in doubts if f"{unknown} " in f"{text} ")
        key = f"{unknown}.{name}" if name and load else unknown
        values, sigma = record.smoothed[unknown], record.smoothed_std[unknown]
        std, at_peak = summary.get(f"std.{key}"), float(sigma[np.argmax(np.abs(values))])
        return TestedUnknown(
            unknown,
            units[unknown],
            "load" if load else "parameter",
            float(str(summary[f"estimate.{key}"])),
            None if std is None or not np.isfinite(float(str(std))) else float(str(std)),
            peak_of(record.time, values) if load else None,
            alone,
            at_peak if load and np.isfinite(at_peak) else None,
        )

    return Findings(
        name=config.name,
        title=title_of(f"{config.name}, record {name}" if name else config.name, tuple(names)),
        unknowns=tuple(map(unknown_of, names)),
        innovations=noise.text * noise.consistent if record.trusted else f"the measurements are {result}",
        consistent=record.trusted,
        warnings=tuple(capital(text) for text in warnings if text),
        # in a consistent record the noise is advice, not a warning
        notes=(*record.notes, *(noise.text,) * (record.trusted and not noise.consistent)),
        layout=layout,
        histories=tuple(map(history, names)),
        file=_file(record),
        readings=readings,
        hold_out=_held_out(record, readings),
        checked=channel_table(record, [reading.unit for reading in readings]),
        damage=_damage(record.damage, config),
        residuals=tuple(
            spectrum
            for reading in readings
            for spectrum in _spectrum(reading.label, reading.unit, reading.time, reading.residual, reading.noise_std)
        ),
        resultants=tuple(
            History(total.place, "N", record.time, None, total.magnitude, total.std)
            for total in record.resultant.values()
        ),
        known=tuple(
            History(load, unit_of(record, "known", load), record.time, None, values, np.full(len(values), np.nan))
            for load, values in record.known.items()
        ),
        load_spectra=tuple(
            spectrum for load in loads for spectrum in _spectrum(load, units[load], record.time, record.smoothed[load])
        ),
        posteriors=record.posterior,
        filters=record.compared,
        budget={} if record.budget is None else record.budget.shares,
        moment=_moment(record, layout.points),
        facts={stage: up[stage].message for stage in STAGES},
        provenance=provenance(context),
        record=name,
        page=pages.get(name, TEST_PAGE),
        inside=innovations_inside(record),
        consistency=result,
        other_records=(("all records", TEST_PAGE), *(page for page in pages.items() if page[0] != name))
        if name
        else (),
    )


def _campaign_findings(
    context: Context[PlacementConfig], findings: Mapping[str, Findings], campaign: CampaignRecord
) -> CampaignFindings:
    config, estimate = context.config, context.upstream["estimate"]
    texts = [*estimate.warnings]
    for name, record in estimated_in(estimate).items():
        texts += [f"record {name}: {text}" for text in hold_out_in_words(record)]
    return CampaignFindings(
        title=title_of(config.name, tuple(map(str, config.place.estimate))),
        records=tuple(findings.values()),
        shared=campaign,
        warnings=tuple(capital(text) for text in (*texts, _hidden(estimate.summary)) if text),
        damage=_damage(campaign.damage, config),
    )


def _damage(damaged: Damaged | None, config: PlacementConfig) -> Table | None:
    assert config.estimate is not None
    return next(iter(damage_tables(damaged, virtual_labels(config.estimate.virtual))), None)


def _hidden(summary: Mapping[str, object]) -> str:
    """Note on unknowns that the channels cannot distinguish, or an empty text."""
    hidden = summary.get("unobservable")
    return f"the channels cannot determine the unknowns {hidden}" if hidden else ""


def _moment(record: Estimated, points: np.ndarray) -> SurfaceMoment | None:
    then = record.moment
    if then is None:
        return None
    shift = then.displacement.astype(float)
    factor, std = exaggerated(points, shift), then.von_mises_std
    sigma = None if std is None else std.astype(float) / MEGA
    mises = Map("von Mises stress", "MPa", then.von_mises.astype(float) / MEGA, sigma)
    strain = Map("principal strain of largest magnitude", "µm/m", then.principal_strain.astype(float) * MICRO)
    return SurfaceMoment(then.time, then.label, factor * shift, factor, (strain, mises))


def _file(record: Estimated) -> File:
    """The file with the rate, first instant and length of its samples."""
    time, samples = record.time, len(record.gauge.time)
    length = float(time[-1] - time[0])
    rate = 1 / (_step(record.gauge.time) if samples > 1 else length)
    return File(record.source, rate, float(time[0]), length, samples)


def _readings(record: Estimated, marks: tuple[int, ...], training: Training) -> tuple[Reading, ...]:
    """Measured and estimated readings of every channel; marks: of their gauges on the page."""
    gauge, bias = record.gauge, record.bias
    columns = () if bias is None else (bias.channel.tolist(), bias.mean.tolist(), bias.std.tolist())
    offsets = {channel: (mean, std) for channel, mean, std in zip(*columns, strict=True)}
    shift = np.array([offsets.get(i, (0.0, 0.0))[0] for i in range(len(gauge.label))])
    values = zip((gauge.measured - shift).T, (gauge.estimated - shift).T, gauge.std.T, marks, strict=True)
    units = [UNITS[int(kind)] for kind in training.candidates.quantity[gauge.channel]]
    return tuple(
        Reading(label, units[i], gauge.time, *signal, noise_std=float(gauge.noise_std[i]), offset=offsets.get(i))
        for i, (label, signal) in enumerate(zip(gauge.label, values, strict=True))
    )


def _held_out(record: Estimated, readings: tuple[Reading, ...]) -> tuple[Reading, ...]:
    """Prediction of every channel that was left out, from the others."""
    if (hold_out := record.hold_out) is None:
        return ()
    columns = zip(
        readings, record.gauge.measured.T, hold_out.predicted.T, hold_out.std.T, hold_out.left_in, strict=True
    )
    return tuple(
        replace(reading, measured=measured, estimated=predicted, std=std)
        for reading, measured, predicted, std, why in columns
        if not why
    )


def _spectrum(
    name: str, unit: str, time: np.ndarray, values: np.ndarray, noise: float | None = None
) -> tuple[Spectrum, ...]:
    """Spectrum of a signal, and of its noise [unit] if it is known; None for a record that is too short."""
    step = _step(time)
    frequency, spectrum = density(values, step)
    level = None if noise is None else noise_density(noise, step)
    return (Spectrum(name, unit, frequency, spectrum, level),) * bool(len(frequency))


def _step(time: np.ndarray) -> float:
    """Between samples [s]; 1 s where there is one sample."""
    return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 1.0


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the pages show and write each as one self-contained file: of a test of several records one over all of them,
    and one for each."""
    records, campaign = pages_of(context)
    files: dict[str, bytes] = {}
    warnings: dict[str, None] = {}
    pictured, figure_count, problem = 0, 0, ""
    for i, report in enumerate(records):
        context.progress(f"pictures of {report.record}" if report.record else "pictures", (i + 0.1) / len(records))
        views = views_of(report)
        pictures, problem = draw_or_explain(partial(screenshots, views)) if views else (None, "")
        context.progress("figures", (i + 0.5) / len(records))
        drawings = figures_of_test(report)
        files[report.page] = page_of_test(report, drawings, tuple(pictures or ()), problem).encode()
        warnings |= dict.fromkeys(report.warnings)
        pictured, figure_count = pictured + len(pictures or ()), figure_count + len(drawings)
    if campaign is not None:
        over = campaign_figures(campaign)
        files = {TEST_PAGE: page_of_campaign(campaign, over).encode()} | files
        warnings, figure_count = dict.fromkeys(campaign.warnings), figure_count + len(over)
    size = f"{sum(map(len, files.values())) / 1024:.0f} KiB"
    message = f"{', '.join(files)}, {size}" + (f"; no picture: {problem}" if problem else "")
    return Output(
        datasets={},
        summary={"pictures": pictured, "figures": figure_count, "warnings": len(warnings)},
        message=message,
        tables=warnings_table(tuple(warnings)),
        files=files,
    )

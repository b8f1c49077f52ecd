"""test: the page of a test, one for each of several records, and their content, which is read from the artefacts alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.decision import record_verdict
from strainsight.experiment.filters_compared import disagreements_in_words
from strainsight.experiment.structure.campaign_text import channel_table, damage_tables
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


@dataclass(frozen=True)
class PagesOfTest:
    """records: what each page of a record shows, one of a test that is one record; campaign: what the page over them shows, None
    where there is one record."""

    records: tuple[Findings, ...]
    campaign: CampaignFindings | None


def pages_of(context: Context[PlacementConfig]) -> PagesOfTest:
    """The pages' content, from import, rom, train, screen, place and estimate."""
    estimate = context.upstream["estimate"]
    campaign, records = campaign_in(estimate), estimated_in(estimate)
    pages = {name: f"test-{name}.html" for name in records if name}
    found = {name: _findings_of(context, name, own, campaign, pages) for name, own in records.items()}
    whole = None if campaign is None else _campaign_findings(context, records, found, campaign, pages)
    return PagesOfTest(tuple(found.values()), whole)


def _findings_of(
    context: Context[PlacementConfig],
    record: str,
    own: Estimated,
    campaign: CampaignRecord | None,
    pages: Mapping[str, str],
) -> Findings:
    up, config = context.upstream, context.config
    estimate = up["estimate"]
    summary = estimate.summary
    names = [str(name) for name in config.place.estimate]
    units = {name: unit_of(own, "estimate", name) for name in names}
    loads = [name for name in names if name in config.loads]
    mesh = mesh_from(up["import"])
    layout, marks = layout_of_test(mesh, up, config.loads, own.gauge.label, own.gauge.channel)
    readings = _readings(own, marks, read(Training, up["train"]))
    shared = own.posterior if campaign is None else campaign.posterior
    doubts = posterior_doubts(shared, units)
    noise = verdict(own.whitened)
    others = [(name, page) for name, page in pages.items() if name != record]
    judged = record_verdict(own.trusted, "apart" in summary, noise.consistent)
    return Findings(
        name=config.name,
        title=title_of(f"{config.name}, record {record}" if record else config.name, tuple(names)),
        unknowns=tuple(
            _unknown(
                name,
                units[name],
                name in loads,
                own,
                summary,
                [t for t in doubts if f"{name} " in f"{t} "],
                f".{record}" if record and name in loads else "",
            )
            for name in names
        ),
        verdict=noise.text if own.trusted else f"the record is {judged}",
        consistent=own.trusted and noise.consistent,
        warnings=_warnings(own, summary, doubts, noise),
        notes=own.notes,
        layout=layout,
        histories=tuple(_history(name, units[name], name in loads, own) for name in names),
        file=_file(own),
        readings=readings,
        hold_out=_held_out(own, readings),
        checked=channel_table(own, [reading.unit for reading in readings]),
        damage=_damage(own.damage, config),
        residuals=tuple(found for reading in readings if (found := _residual_spectrum(reading)) is not None),
        resultants=tuple(
            History(there.place, "N", own.time, None, there.magnitude, there.std) for there in own.resultant.values()
        ),
        known=tuple(
            History(name, unit_of(own, "known", name), own.time, None, values, np.full(len(values), np.nan))
            for name, values in own.known.items()
        ),
        load_spectra=tuple(found for name in loads if (found := _load_spectrum(name, units[name], own)) is not None),
        posteriors=own.posterior,
        filters=own.compared,
        budget={} if own.budget is None else own.budget.shares,
        moment=_moment(own, layout.points),
        facts=messages(up, STAGES),
        provenance=provenance(context),
        record=record,
        beside=(("all records", TEST_PAGE), *others) if record else (),
    )


def _campaign_findings(
    context: Context[PlacementConfig],
    records: Mapping[str, Estimated],
    found: Mapping[str, Findings],
    campaign: CampaignRecord,
    pages: Mapping[str, str],
) -> CampaignFindings:
    config, summary = context.config, context.upstream["estimate"].summary
    rows, apart = [], str(summary.get("apart", ""))
    for name, own in records.items():
        report, inside = found[name], own.whitened[np.isfinite(own.whitened)]
        share = float(np.mean(np.abs(inside) < 2)) if len(inside) else np.nan
        rows.append(RecordRow(report, pages[name], share, record_verdict(own.trusted, bool(apart), report.consistent)))
    texts = [str(summary.get("withheld", "")), apart]
    texts += [f"record {name}: {report.verdict}" for name, report in found.items() if not (report.consistent or apart)]
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


def _residual_spectrum(reading: Reading) -> Spectrum | None:
    """Of what is left of a channel, beside that of its noise; None of a record that is too short."""
    step = _step(reading.time)
    frequency, found = density(reading.residual, step)
    if not len(frequency):
        return None
    return Spectrum(reading.label, reading.unit, frequency, found, noise_density(reading.noise_std, step))


def _load_spectrum(name: str, unit: str, own: Estimated) -> Spectrum | None:
    """Of a load that was found; None of a record that is too short."""
    frequency, found = density(own.smoothed[name], _step(own.time))
    return Spectrum(name, unit, frequency, found) if len(frequency) else None


def _step(time: np.ndarray) -> float:
    """Between samples [s]; 1 s where there is one sample."""
    return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 1.0


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the pages show and write each as one self-contained file: of a test of several records one over all of them,
    and one for each."""
    found = pages_of(context)
    files: dict[str, bytes] = {}
    warnings: dict[str, None] = {}
    pictured, drawn, problem = 0, 0, ""
    for i, report in enumerate(found.records):
        context.progress(
            f"pictures of {report.record}" if report.record else "pictures", (i + 0.1) / len(found.records)
        )
        views = views_of(report)
        pictures, problem = drawn_or_why(partial(screenshots, views)) if views else (None, "")
        context.progress("figures", (i + 0.5) / len(found.records))
        drawings = figures_of_test(report)
        name = f"test-{report.record}.html" if report.record else TEST_PAGE
        files[name] = page_of_test(report, drawings, tuple(pictures or ()), problem).encode()
        warnings |= dict.fromkeys(report.warnings)
        pictured, drawn = pictured + len(pictures or ()), drawn + len(drawings)
    if (campaign := found.campaign) is not None:
        over = campaign_figures(campaign)
        files = {TEST_PAGE: page_of_campaign(campaign, over).encode()} | files
        warnings, drawn = dict.fromkeys(campaign.warnings), drawn + len(over)
    size = f"{sum(map(len, files.values())) / 1024:.0f} KiB"
    said = f"{', '.join(files)}, {size}" + (f"; no picture: {problem}" if problem else "")
    return Output(
        datasets={},
        summary={"pictures": pictured, "figures": drawn, "warnings": len(warnings)},
        message=said,
        tables=warnings_table(tuple(warnings)),
        files=files,
    )


TEST = Stage(
    "test",
    version=8,
    reads=("name", "seed", "loads", "place.estimate", "estimate.virtual"),
    upstream=("import", "rom", "train", "screen", "place", "estimate"),
    files=(),
    run=run,
)

"""Everything that the pages of a test show, gathered from the artefacts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from strainsight import __version__
from strainsight.cases.filters_compared import disagreements_in_words
from strainsight.cases.structure.campaign_text import channel_table, damage_tables
from strainsight.cases.structure.filtering import posterior_doubts
from strainsight.cases.structure.surface import virtual_labels
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.decision import record_verdict
from strainsight.records import estimated as recorded
from strainsight.records.damage import Damaged
from strainsight.records.estimated import CampaignRecord, Estimated, Source, campaign_in, estimated_in
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, unit_of
from strainsight.records.training import Training
from strainsight.report.arrays import History
from strainsight.report.page.listing import Listing
from strainsight.report.placement.page import TEST_PAGE
from strainsight.report.tested.campaign import CampaignFindings, RecordRow
from strainsight.report.tested.data import File, FileChannel, Findings, Map, Moment, Posterior, Unknown, peak_of
from strainsight.report.tested.first import title_of
from strainsight.report.text import capital
from strainsight.report.view.viewed import exaggerated
from strainsight.stages.pages.page_layout import layout_of_test
from strainsight.stages.pages.page_numbers import filters_of
from strainsight.stages.pages.tested_readings import held_out_of, load_spectrum, readings_of, residual_spectrum, step_of
from strainsight.workflow.output import Table
from strainsight.workflow.stage import Context

MEGA, MICRO = 1e6, 1e6
NOTHING = "nothing was done"


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
    readings = readings_of(own, marks, read(Training, up["train"]))
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
        file=file_of(own),
        readings=readings,
        hold_out=held_out_of(own, readings),
        checked=_listing((channel_table(own, [reading.unit for reading in readings]),), numeric=range(1, 5)),
        damage=_damage(own.damage, config),
        residuals=tuple(found for reading in readings if (found := residual_spectrum(reading)) is not None),
        resultants=tuple(
            History(there.place, "N", own.time, None, there.magnitude, there.std) for there in own.resultant.values()
        ),
        known=tuple(
            History(name, unit_of(own, "known", name), own.time, None, values, np.full(len(values), np.nan))
            for name, values in own.known.items()
        ),
        load_spectra=tuple(found for name in loads if (found := load_spectrum(name, units[name], own)) is not None),
        posteriors=_posteriors(own.posterior, units),
        filters=filters_of(own),
        budget={} if own.budget is None else own.budget.shares,
        moment=_moment(own, layout.points),
        facts=_facts(context),
        provenance=_provenance(context),
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
    names = tuple(str(name) for name in config.place.estimate)
    first = next(iter(found.values()))
    rows, apart = [], str(summary.get("apart", ""))
    for name, own in records.items():
        report, inside = found[name], own.whitened[np.isfinite(own.whitened)]
        rows.append(
            RecordRow(
                name=name,
                page=pages[name],
                file=report.file,
                loads=tuple(one for one in report.unknowns if one.kind == "load"),
                inside=float(np.mean(np.abs(inside) < 2)) if len(inside) else np.nan,
                verdict=record_verdict(own.trusted, bool(apart), report.consistent),
                fits=report.consistent,
            )
        )
    texts = [str(summary.get("withheld", "")), apart]
    texts += [f"record {name}: {report.verdict}" for name, report in found.items() if not (report.consistent or apart)]
    texts += [f"the channels cannot tell {hidden}" for hidden in [summary.get("unobservable")] if hidden]
    units = {one.name: one.unit for one in first.unknowns}
    return CampaignFindings(
        name=config.name,
        title=title_of(config.name, names),
        records=tuple(rows),
        parameters=tuple(one for one in first.unknowns if one.kind == "parameter"),
        alone={name: tuple(map(float, values)) for name, values in campaign.alone.items()},
        warnings=tuple(capital(text) for text in texts if text),
        posteriors=_posteriors(campaign.posterior, units),
        facts=_facts(context),
        provenance=_provenance(context),
        damage=_damage(campaign.damage, config),
    )


def _damage(found: Damaged | None, config: PlacementConfig) -> Listing | None:
    assert config.estimate is not None
    return _listing(damage_tables(found, virtual_labels(config.estimate.virtual)), numeric=(2, 4))


def _listing(tables: tuple[Table, ...], numeric: Iterable[int]) -> Listing | None:
    """A table of the console, None where there is none."""
    if not tables:
        return None
    (own,) = tables
    return Listing(own.title, own.columns, own.rows, tuple(numeric))


def _posteriors(found: Mapping[str, recorded.Posterior], units: Mapping[str, str]) -> tuple[Posterior, ...]:
    return tuple(Posterior(name, units[name], own.value, own.density, own.prior) for name, own in found.items())


def _facts(context: Context[PlacementConfig]) -> dict[str, str]:
    up = context.upstream
    return {stage: up[stage].message for stage in ("import", "rom", "train", "screen", "place", "estimate")}


def _provenance(context: Context[PlacementConfig]) -> dict[str, str]:
    own = {"strainsight": __version__, "seed": str(context.config.seed)}
    return own | {f"{stage} artefact": found.key[:16] for stage, found in context.upstream.items()}


def _warnings(own: Estimated, summary: Mapping[str, object], doubts: list[str], noise: Verdict) -> tuple[str, ...]:
    """What a reader has to know, the gravest first: why σ is withheld, what the record contradicts, what it cannot tell."""
    texts = [str(summary.get("withheld", ""))]
    # a record that is inconsistent with the model has its own warning, and the noise is not to blame
    if own.trusted and not noise.consistent:
        texts.append(noise.text)
    texts += [f"the channels cannot tell {hidden}" for hidden in [summary.get("unobservable")] if hidden]
    texts += [*doubts, *disagreements_in_words(own.compared)]
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


def file_of(own: Estimated) -> File:
    """Its name, hash, rate, length and channels with their calibration."""
    source, time = own.source, own.time
    step = step_of(own.gauge.time) if len(own.gauge.time) > 1 else float(time[-1] - time[0])
    return File(
        name=source.file,
        sha256=source.sha256,
        bytes=source.bytes,
        format=source.format,
        date=source.date,
        rate=1 / step,
        start=float(time[0]),
        duration=float(time[-1] - time[0]),
        samples=len(own.gauge.time),
        channels=tuple(
            FileChannel(name, source.measures[i], source.unit[i], calibration_in_words(source, i))
            for i, name in enumerate(source.channel)
        ),
    )


def calibration_in_words(source: Source, i: int) -> str:
    """What was done to channel i of the file, in the order in which it was done."""
    unit, parts = source.unit[i], []
    if source.offset[i]:
        parts.append(f"less {source.offset[i]:g} {unit}")
    if source.drift[i]:
        parts.append(f"less {source.drift[i]:g} {unit} a second")
    if np.isfinite(source.zero[i]).all():
        parts.append("less its mean from {:g} to {:g} s".format(*source.zero[i]))
    if source.sign[i] < 0:
        parts.append("sign turned")
    if source.bridge[i]:
        ratio = "" if np.isnan(source.poisson_ratio[i]) else f", ν {source.poisson_ratio[i]:g}"
        parts.append(f"{source.bridge[i]} bridge, gauge factor {source.gauge_factor[i]:g}{ratio}")
    if source.scale[i] != 1:
        parts.append(f"times {source.scale[i]:g}")
    if source.delay[i]:
        parts.append(f"moved by {abs(source.delay[i]):g} s, {'late' if source.delay[i] > 0 else 'early'} in the file")
    return "; ".join(parts) or NOTHING

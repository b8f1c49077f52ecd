"""Everything that the page shows, gathered from the artefacts of all stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from strainsight import __version__
from strainsight.config.loads import LoadSection
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.estimation.decision import benefit_of, claims_of, word_of
from strainsight.experiment.filters_compared import disagreements_in_words
from strainsight.experiment.layout.comparison import RULES
from strainsight.experiment.layout.gauge_list import channel_labels
from strainsight.experiment.layout.workshop import Workshop
from strainsight.experiment.structure.clearance import clearance_warning
from strainsight.experiment.structure.expectation import loud_noise, quiet_noise, unresolved_candidates
from strainsight.experiment.structure.filtering import posterior_doubts
from strainsight.experiment.structure.influence import INFLUENCE
from strainsight.experiment.structure.mesh import model_warnings
from strainsight.experiment.structure.mesh_tables import ASSUMES
from strainsight.experiment.structure.references import PARAMETER_UNITS, on_one_node
from strainsight.mesh.model import Mesh
from strainsight.pages.arrays import History, Reading, rms
from strainsight.pages.placement import data
from strainsight.placement.criteria import Criterion, criterion_of
from strainsight.records.placed import Observed, Placed, PlacedLayout, metric_key
from strainsight.records.record import read, unit_of
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.records.validated import RandomSetErrors as Drawn
from strainsight.records.validated import Validated
from strainsight.runner.artefact import Artefact
from strainsight.runner.stage import Context
from strainsight.stages.pages.page_layout import layout_of_page, listed_gauges, measured
from strainsight.text import capital, listed, number

STAGES = ("import", "rom", "train", "screen", "place", "validate")
"""Of which the page shows what each came to."""
NOT_VALIDATED = (
    "The estimates were not validated by a simulated test, because the config has no section `validate`: σ is that expected by "
    "the placement."
)


def placement_report(context: Context[PlacementConfig], mesh: Mesh, shop: Workshop) -> data.PlacementReport:
    """The page's content, from the artefacts; mesh of import.h5; shop: the layout as measured (`workshop_of_run`)."""
    up, config = context.upstream, context.config
    names = [str(name) for name in config.place.estimate]
    place = read(Placed, up["place"])
    word = "sensor" if set(listed_gauges(up).unit) - {"strain"} else "gauge"
    count = len(place.final.gauge)
    report = data.PlacementReport(
        name=config.name,
        title=f"{config.name}: {count} {word}{'s' * (count != 1)} for {listed(names)}",
        settings=config.report,
        unknowns=tuple(
            unknown_of(name, "input", config.loads[name].unit, up)
            if name in config.loads
            else unknown_of(name, "parameter", PARAMETER_UNITS[config.parameters[name].property], up)
            for name in names
        ),
        layout=measured(layout_of_page(mesh, up, config.loads), shop, config.gauges),
        trend=trend_of(up["place"]),
        frequencies=tuple(read(Reduced, up["rom"]).frequency.tolist()),
        metrics=metrics_of(up["place"]),
        criteria=criteria_of(names, up["place"]),
        cases=cases_of(up["observe"]),
        load_cases=place.by_case,
        budget={} if place.budget is None else place.budget.shares,
        advice=place.advice,
        influence=next((table for table in up["place"].tables if table.title.startswith(INFLUENCE)), None),
        frequency_response=place.frequency_response,
        observability={"condition": place.observability.condition},
        warnings=warnings_of(up, names, mesh, config.loads),
        not_tested=_not_tested(up["train"], config, place) if "validate" in up else (NOT_VALIDATED,),
        test=up["estimate"].message if "estimate" in up else "",
        facts={stage: up[stage].message for stage in STAGES if stage in up},
        seconds={stage: time for stage, artefact in up.items() if (time := artefact.header.seconds) is not None},
        provenance=provenance(context),
        assumes=tuple(row for table in up["import"].tables if table.title == ASSUMES for row in table.rows),
    )
    if (validate := up.get("validate")) is None:
        return report
    validated = read(Validated, validate)
    return replace(
        report,
        histories=tuple(history_of(name, validate) for name in names),
        posteriors=validated.posterior,
        gauge_signals=signals_of(up),
        random_sets=random_sets_of(names, validate),
        noise=noise_of(names, up),
        budget=report.budget if validated.budget is None else validated.budget.shares,
        truth_description=str(validate.summary["description"]),
        filters=validated.compared,
        consistency=checks_of(validate),
    )


def warnings_of(
    up: Mapping[str, Artefact], names: list[str], mesh: Mesh, loads: Mapping[str, LoadSection]
) -> tuple[str, ...]:
    """What a reader has to know: of the model, and once they were validated, of the estimates."""
    reduced = read(Reduced, up["rom"]) if "rom" in up else None
    ready = None if reduced is None else reduced.results or reduced.matrices
    # a reduced model is supported or intentionally free
    notes = [f"{text}." for text in (model_warnings(mesh, free="rom" in up) if ready is None else ready.notes)]
    notes += [f"{text}." for text in on_one_node(loads, mesh)]
    cards = [card for card in mesh.ignored if mesh.effect.get(card) != "none"]
    if cards:
        but = " (the imported matrices must include the effect of these cards)" * (ready is not None)
        notes.append(f"Ignored cards of the deck: {', '.join(cards)}{but}.")
    if "train" in up and "screen" in up:
        training, screened = read(Training, up["train"]), read(Screened, up["screen"])
        notes += filter(
            None, (unresolved_candidates(training), quiet_noise(training, screened), loud_noise(training, screened))
        )
        if screened.clearance is not None and (warning := clearance_warning(screened.clearance)):
            notes.append(warning)
    if "place" in up and (rests := str(up["place"].summary.get("rests_on_loads", ""))):
        notes.append(f"{capital(rests)}.")
    return (*notes, *(_doubts(up["validate"], names) if "validate" in up else ()))


def _doubts(validate: Artefact, names: list[str]) -> list[str]:
    summary, validated = validate.summary, read(Validated, validate)
    units = {name: unit_of(validated, "estimate", name) for name in names}
    out_of_range = str(summary.get("out_of_range", ""))
    notes = [capital(text) for text in (out_of_range, *posterior_doubts(validated.posterior, units)) if text]
    for name in names if not out_of_range else ():
        std, random = float(summary[f"std.{name}"]), validated.all.std[name]
        claims = claims_of(name, summary, repeated(name, validate))
        if claims and claims[0].overconfident:
            notes.append(f"{name} is {claims[0].words(number)}")
        if len(random) and np.nanmedian(random) < 0.9 * std:
            notes.append(
                f"Random layouts from all candidates before screening have a median σ of {100 * np.nanmedian(random):.2g} % "
                f"for {name}, this layout {100 * std:.2g} %: the screening removed better locations. Set screen.keep: all"
            )
    notes += map(capital, disagreements_in_words(validated.compared))
    if lost := int(summary["lost_runs"]):
        notes.append(f"Diverged repeated filter runs: {lost}; the medians exclude these runs")
    return [f"{note}." for note in notes]


def _not_tested(train: Artefact, config: PlacementConfig, place: Placed) -> tuple[str, ...]:
    notes = ["No test data: the measurements are simulated."]
    if place.by_case is not None:
        notes.append(
            "The measurements are simulated under the configured loads, not under the load cases of the placement."
        )
    if config.validation.truth.model == "rom":
        notes.append("The simulated test uses the model of the filter, so the effect of model errors was not tested.")
    elif config.validation.truth.model == "modes":
        notes.append(
            "The simulated test has no errors of damping, gauge installation and loads; "
            "to include these errors, set validate.truth.model: perturbed."
        )
    elif read(Training, train).strain_operator is not None:
        notes.append(
            "The simulated gauge positions are exact: imported rows of the strain operator cannot be moved or rotated."
        )
    errors = tolerances_of(config.tolerances)
    omitted = "temperature, " * (errors.temperature == 0) + "drift, " * (errors.drift == 0)
    notes.append(
        f"The simulated test omits {omitted}deformation of the supports and of the adhesive bond of the gauges."
    )
    return tuple(notes)


def unknown_of(name: str, kind: Any, unit: str, up: Mapping[str, Artefact]) -> data.Unknown:
    """An unknown with σ expected by the placement and with its validation, as far as these stages have run."""
    unknown = data.Unknown(name, unit, kind)
    if "place" in up:
        place = up["place"]
        cases = read(Placed, place).by_case
        unknown = replace(
            unknown,
            expected_std=float(place.summary[f"std.{name}"]),
            reference=float(place.attributes(f"/expected_std/{name}")["scale"]),
            worst_case="" if cases is None else cases.worst[name],
        )
    return _validated(unknown, up["validate"]) if "validate" in up else unknown


def _validated(unknown: data.Unknown, validate: Artefact) -> data.Unknown:
    name, summary, validated = unknown.name, validate.summary, read(Validated, validate)
    truth, out_of_range, repeats = validated.truth[name], "out_of_range" in summary, repeated(name, validate)
    number = {key: float(summary[f"{key}.{name}"]) for key in ("estimate", "error", "smoothed")}
    std, smoothed_std = (None if out_of_range else float(summary[f"{key}.{name}"]) for key in ("std", "smoothed_std"))
    identified = summary.get(f"identified.{name}") is not False
    return replace(
        unknown,
        truth=float(truth[-1]) if unknown.kind == "parameter" else rms(truth),
        estimate=number["estimate"],
        error=number["error"],
        std=std,
        smoothed_error=number["smoothed"],
        zero=bool(summary.get(f"zero.{name}", False)),
        smoothed_std=smoothed_std,
        claims=() if out_of_range else claims_of(name, summary, repeats),
        withheld=out_of_range,
        benefit=benefit_of(number["error"], validated.all.error[name]),
        repeats=data.Repeats(*repeats, identified) if len(repeats[0]) > 1 else None,
    )


def repeated(name: str, validate: Artefact) -> tuple[np.ndarray, np.ndarray]:
    """Error and claimed σ of every repeat, relative."""
    repeats = read(Validated, validate).repeats
    return repeats.error[name], repeats.std[name]


def trend_of(place: Artefact) -> data.Trend:
    summary, removals = place.summary, read(PlacedLayout, place).elimination
    criterion = criterion_of(str(summary["criterion"]))
    key, pool = metric_key(criterion.name), int(summary["pool"])
    value: np.ndarray = getattr(removals, key)
    bound, gap = (float(summary[name]) if name in summary else None for name in ("lower_bound", "gap"))
    return data.Trend(
        count=np.arange(pool, pool - len(value), -1),
        value=value,
        blocks=dict(zip(removals.unknowns, removals.blocks.T, strict=True)),
        final=float(summary[f"{key}_final"]),
        metric=_metric(criterion, place),
        lower_bound=bound,
        gap=gap,
    )


def history_of(name: str, validate: Artefact) -> History:
    record = read(Validated, validate)
    columns = (record.truth, record.estimate, record.std, record.smoothed, record.smoothed_std)
    return History(name, unit_of(record, "estimate", name), record.time, *(column[name] for column in columns))


def random_sets_of(names: list[str], validate: Artefact) -> tuple[data.RandomSetErrors, ...]:
    validated, summary = read(Validated, validate), validate.summary
    pools: tuple[tuple[Literal["all candidates", "screened"], Drawn], ...] = (
        ("all candidates", validated.all),
        ("screened", validated.screened),
    )
    return tuple(
        data.RandomSetErrors(name, label, sets.error[name], sets.estimate[name].T, float(summary[f"error.{name}"]))
        for name in names
        for label, sets in pools
        if len(sets.error[name])
    )


def signals_of(up: Mapping[str, Artefact]) -> tuple[Reading, ...]:
    channels, layout = read(Validated, up["validate"]).gauge, listed_gauges(up)
    gauges = layout.channels.gauge.tolist()
    columns = (channels.measured.T, channels.estimated.T, channels.std.T, gauges, channels.true.T)
    return tuple(
        Reading(label, layout.unit[signal[3]], channels.time, *signal)
        for label, *signal in zip(channel_labels(layout), *columns, strict=True)
    )


def metrics_of(place: Artefact) -> tuple[data.MetricWords, ...]:
    """Every criterion, that of the layout first."""
    return tuple(_metric(criterion_of(name), place) for name in read(PlacedLayout, place).criteria.name)


def _metric(criterion: Criterion, place: Artefact) -> data.MetricWords:
    """In words, with the unknowns that it covers where these are not all."""
    layout = read(PlacedLayout, place)
    names = layout.elimination.unknowns
    of = f", computed for the unknowns {' and '.join(names)} only" * (len(names) < len(layout.criteria.std))
    return data.MetricWords(criterion.symbol, criterion.meaning + of)


def criteria_of(names: list[str], place: Artefact) -> tuple[data.Criteria, ...]:
    """This layout, then the others by their metric; of the random sets the one in the middle."""
    rules = read(PlacedLayout, place).criteria
    random = sorted((i for i, rule in enumerate(rules.rule) if rule not in RULES), key=lambda i: rules.value[i, 0])
    shown = {i: RULES[rule] for i, rule in enumerate(rules.rule) if rule in RULES}
    if random:
        shown[random[(len(random) - 1) // 2]] = f"random layout (median of {len(random)} layouts)"
    return tuple(
        data.Criteria(words, tuple(rules.value[i].tolist()), {name: float(rules.std[name][i]) for name in names})
        for i, words in shown.items()
    )


def cases_of(observe: Artefact) -> tuple[data.ObservabilityCase, ...]:
    observed = read(Observed, observe)
    condition, raw = observed.condition.tolist(), observed.condition_raw.tolist()
    return tuple(
        data.ObservabilityCase(
            tuple(unknowns.split(", ")), excitation, condition[i][j], raw[i][j], str(observed.lost[i, j])
        )
        for j, unknowns in enumerate(observed.unknowns)
        for i, excitation in enumerate(observed.excitation)
    )


def noise_of(names: list[str], up: Mapping[str, Artefact]) -> data.Noise:
    """At the noise as configured, and at that of the study."""
    summary, study = up["validate"].summary, read(Validated, up["validate"]).noise
    level = float(up["screen"].summary["noise_std"]) / float(up["train"].summary["strongest_rms"])
    factor = np.append(1.0, study.factor)
    order = np.argsort(factor, kind="stable")
    error, std = (
        {name: np.append(float(summary.get(f"{key}.{name}", np.nan)), values[name])[order] for name in names}
        for key, values in (("error", study.error), ("std", study.std))
    )
    return data.Noise(level * factor[order], error, std)


def checks_of(validate: Artefact) -> tuple[data.Check, ...]:
    """NEES and NIS of the filter."""
    names = {"NEES, mean of the run (band of one instant)": "nees", "NIS of the gauges, mean of the run": "nis"}
    values = [float(validate.summary[key]) for key in names.values()]
    bands = read(Validated, validate).consistency.band.tolist()
    return tuple(data.Check(*row, word_of(*row[1:])) for row in zip(names, values, map(tuple, bands), strict=True))


def provenance(context: Context[Any]) -> dict[str, str]:
    """Version, seed, and what tells the artefacts from others."""
    keys = {f"{stage} artefact": artefact.key[:16] for stage, artefact in context.upstream.items()}
    return {"strainsight": __version__, "seed": str(context.config.seed)} | keys

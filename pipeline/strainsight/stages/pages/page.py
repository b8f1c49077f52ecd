"""Everything that the page shows, gathered from the artefacts of all stages."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.cases.filters_compared import disagreements_in_words
from strainsight.cases.layout.workshop import Workshop
from strainsight.cases.structure.clearance import clearance_warning
from strainsight.cases.structure.filtering import posterior_doubts
from strainsight.cases.structure.mesh import model_warnings
from strainsight.cases.structure.references import on_one_node
from strainsight.cases.structure.resolution import loud_noise, quiet_noise, unresolved_candidates
from strainsight.config.loads import Load
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.estimation.verdict import OVERCONFIDENT
from strainsight.gauges.candidates import STRAIN
from strainsight.mesh.model import Mesh
from strainsight.records.placed import Placed
from strainsight.records.record import read, unit_of
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated
from strainsight.report.placement.data import PlacementReport
from strainsight.report.placement.verdicts import claims_of, in_words
from strainsight.report.text import capital, listed
from strainsight.stages.pages.assumed import ASSUMES
from strainsight.stages.pages.page_layout import layout_of_page, measured
from strainsight.stages.pages.page_numbers import (
    cases_of,
    checks_of,
    criteria_of,
    history_of,
    messages,
    metrics_of,
    noise_rows,
    provenance,
    random_sets_of,
    repeated,
    repeats_of,
    signals_of,
    trend_of,
    unknown_of,
)
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.stage import Context

STAGES = ("import", "rom", "train", "screen", "place", "validate")
"""Of which the page shows what each came to."""


def placement_report(context: Context[PlacementConfig], mesh: Mesh, shop: Workshop) -> PlacementReport:
    """The page's content, from the artefacts; mesh of import.h5; shop: the layout as measured (`workshop_of_run`)."""
    up, config = context.upstream, context.config
    names = [str(name) for name in config.place.estimate]
    kinds = {name: "input" if name in config.loads else "parameter" for name in names}
    validate, place = up["validate"], read(Placed, up["place"])
    validated = read(Validated, validate)
    budget = validated.budget or place.budget
    return PlacementReport(
        name=context.config.name,
        title=f"{context.config.name}: {_number_of_gauges(up)} for {listed(names)}",
        unknowns=tuple(unknown_of(name, kinds[name], up) for name in names),
        layout=measured(layout_of_page(mesh, up, config.loads), shop, config.gauges),
        trend=trend_of(up["place"]),
        histories=tuple(history_of(name, validate) for name in names),
        posteriors=validated.posterior,
        gauge_signals=signals_of(up),
        random_sets=random_sets_of(names, validate),
        noise=noise_rows(names, up),
        repeats=repeats_of(names, validate),
        frequencies=tuple(read(Reduced, up["rom"]).frequency.tolist()),
        metrics=metrics_of(up["place"]),
        criteria=criteria_of(names, up["place"]),
        cases=cases_of(up["observe"]),
        load_cases=place.by_case,
        budget={} if budget is None else budget.shares,
        advice=place.advice,
        observability={"condition": place.observability.condition},
        truth_description=str(validate.summary["description"]),
        filters=validated.compared,
        consistency=checks_of(validate),
        warnings=warnings_of(up, names, mesh, config.loads),
        not_tested=_not_tested(up["train"], config, place),
        test=up["estimate"].message if "estimate" in up else "",
        facts=messages(up, STAGES),
        seconds={
            stage: artefact.header.seconds for stage, artefact in up.items() if artefact.header.seconds is not None
        },
        provenance=provenance(context),
        assumes=tuple(row for table in up["import"].tables if table.title == ASSUMES for row in table.rows),
    )


def warnings_of(up: Mapping[str, Artefact], names: list[str], mesh: Mesh, loads: Mapping[str, Load]) -> tuple[str, ...]:
    """What a reader has to know: of the model, and once they were validated, of the estimates."""
    reduced = read(Reduced, up["rom"]) if "rom" in up else None
    ready = None if reduced is None else reduced.results or reduced.matrices
    # what was reduced is held, or free on purpose: else `rom` had ended with an error
    notes = [f"{text}." for text in (model_warnings(mesh, free="rom" in up) if ready is None else ready.notes)]
    notes += [f"{text}." for text in on_one_node(loads, mesh)]
    cards = [card for card in mesh.ignored if mesh.effect.get(card) != "none"]
    if cards:
        but = ": what they add must be in the matrices" * (ready is not None)
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
    summary, own = validate.summary, read(Validated, validate)
    units = {name: unit_of(own, "estimate", name) for name in names}
    beyond = str(summary.get("out_of_range", ""))
    notes = [f"{capital(text)}." for text in (*filter(None, (beyond,)), *posterior_doubts(own.posterior, units))]
    for name in names if not beyond else ():
        std = float(summary[f"std.{name}"])
        claims = claims_of(name, summary, repeated(name, validate))
        if claims and claims[0].verdict == OVERCONFIDENT:
            notes.append(f"{name} is {in_words(claims[0])}.")
        random = own.all.std[name]
        if len(random) and np.nanmedian(random) < 0.9 * std:
            notes.append(
                f"Random sets from all candidates claim {100 * np.nanmedian(random):.2g} % for {name} in the median, "
                f"the chosen set {100 * std:.2g} %: the screening has dropped better places. Try screen.keep: all."
            )
    notes += [f"{capital(text)}." for text in disagreements_in_words(own.compared)]
    if lost := int(summary["lost_runs"]):
        notes.append(f"{lost} runs of the studies diverged and are left out of the medians.")
    return notes


def _not_tested(train: Artefact, config: PlacementConfig, place: Placed) -> tuple[str, ...]:
    notes = ["No measured data: the truth is simulated."]
    if place.by_case is not None:
        notes.append("The load cases: the truth is simulated under the loads as stated.")
    if config.validation.truth.model == "rom":
        notes.append("The truth is the filter's own model: no model error was tested.")
    elif config.validation.truth.model == "modes":
        notes.append("Damping, gauges and loads are exact in this truth; choose truth model rich to test them.")
    elif read(Training, train).given is not None:
        notes.append("The gauges are exactly in place: given strain rows cannot be moved or turned.")
    own = tolerances_of(config.tolerances)
    outside = "temperature" * (own.temperature == 0), "drift" * (own.drift == 0), "supports that give"
    notes.append(f"{', '.join(filter(None, outside)).capitalize()} and the bond are outside this model.")
    return tuple(notes)


def _number_of_gauges(up: Mapping[str, Artefact]) -> str:
    """As "4 gauges", or "1 sensor" where some of the layout are no gauges."""
    final = read(Placed, up["place"]).final
    count, quantity = len(final.gauge), read(Training, up["train"]).candidates.quantity
    word = "gauge" if np.all(quantity[final.channel[:, 0]] == STRAIN) else "sensor"
    return f"{count} {word}{'s' * (count != 1)}"

"""Everything that the page shows, gathered from the artefacts of all stages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from strainsight import __version__
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.suspicions import only_control, suspicions
from strainsight.report.data import (
    Consistency,
    Gauge,
    GaugeSignal,
    History,
    Layout,
    Load,
    NoiseRow,
    PlacementReport,
    RandomSets,
    Repeats,
    Trend,
    Unknown,
)
from strainsight.stages.records.gauges import given_from
from strainsight.stages.records.mesh import mesh_from
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.stage import Context

POOLS: tuple[tuple[str, Literal["all candidates", "screened"]], ...] = (
    ("all", "all candidates"),
    ("screened", "screened"),
)


def placement_report(context: Context) -> PlacementReport:
    """The page's content, from the artefacts of all stages."""
    up, config = context.upstream, context.config
    names = [str(name) for name in config.place.estimate]
    kinds = {name: "input" if name in config.loads else "parameter" for name in names}
    validate = up["validate"]
    mesh = mesh_from(up["import"])
    return PlacementReport(
        name=context.name,
        title=f"{context.name}: {len(up['place']['/selected/final/gauge'])} gauges for {' and '.join(names)}",
        unknowns=tuple(_unknown(name, kinds[name], up) for name in names),
        layout=_layout(mesh, up, config.loads),
        trend=_trend(up["place"]),
        histories=tuple(_history(name, validate) for name in names),
        gauge_signals=_gauge_signals(validate, up["place"]),
        random_sets=tuple(
            RandomSets(
                name,
                label,
                validate[f"/random_sets/{key}/error/{name}"],
                validate[f"/random_sets/{key}/estimate/{name}"].T,
                float(validate.summary[f"error.{name}"]),
            )
            for name in names
            for key, label in POOLS
            if len(validate[f"/random_sets/{key}/error/{name}"])
        ),
        noise=_noise(names, up),
        repeats=tuple(
            Repeats(
                name,
                validate[f"/repeats/error/{name}"],
                validate[f"/repeats/std/{name}"],
                "identified" if validate.summary[f"identified.{name}"] else "not identified",
            )
            for name in names
            if f"identified.{name}" in validate.summary
        ),
        frequencies=tuple(up["rom"]["/frequency"].tolist()),
        baselines={name: float(value) for name, value in up["place"].children("/baseline").items()},
        observability={
            name: float(value) for name, value in up["place"].children("/observability").items() if np.ndim(value) == 0
        },
        truth_description=str(validate.summary["description"]),
        consistency=_consistency(validate),
        warnings=_warnings(up, names, mesh),
        not_tested=_not_tested(up["train"], config),
        facts=_facts(up),
        provenance={"strainsight": __version__, "seed": str(context.seed)}
        | {f"{stage} artefact": up[stage].key[:16] for stage in up},
    )


def _unknown(name: str, kind: Any, up: Mapping[str, Artefact]) -> Unknown:
    validate, place = up["validate"], up["place"]
    units = validate.attributes(f"/estimate/{name}")["units"]
    summary = validate.summary
    truth = validate[f"/truth/{name}"]
    return Unknown(
        name=name,
        unit=str(units),
        kind=kind,
        guess=float(place.attributes(f"/expected_std/{name}")["scale"]),
        truth=float(truth[-1]) if kind == "parameter" else float(np.sqrt(np.mean(truth**2))),
        estimate=float(summary[f"estimate.{name}"]),
        error=float(summary[f"error.{name}"]),
        std=float(summary[f"std.{name}"]),
        smoothed_error=float(summary[f"smoothed.{name}"]),
        expected_std=float(place[f"/expected_std/{name}"]) / _size(name, validate),
    )


def _size(name: str, validate: Artefact) -> float:
    """What errors are relative to: a parameter's true value, the RMS of an input's true history."""
    return float(np.sqrt(np.mean(validate[f"/truth/{name}"] ** 2)))


def _layout(mesh: Mesh, up: Mapping[str, Artefact], loads: Mapping[str, Any]) -> Layout:
    place, train = up["place"], up["train"]
    faces = exterior_facets(mesh).nodes if mesh.blocks else np.full((0, 8), -1)
    candidate = place["/pool/candidate"]
    final = place["/selected/final/gauge"]
    chosen = candidate[final]
    columns = {
        key: train[f"/gauges/{key}"][chosen]
        for key in ("element", "facet", "position", "direction", "normal", "angle", "nodes")
    }
    # place.h5 has them relative to amplitude and guess, the page shows everything relative to the truth.
    without = {
        name: values * float(place.attributes(f"/expected_std/{name}")["scale"]) / _size(name, up["validate"])
        for name, values in place.children("/without").items()
    }
    gauges = tuple(
        Gauge(
            label=f"G{i + 1}",
            element=int(columns["element"][i]),
            facet=int(columns["facet"][i]),
            position=columns["position"][i],
            direction=columns["direction"][i],
            normal=columns["normal"][i],
            angle=float(columns["angle"][i]),
            without={name: float(values[i]) for name, values in without.items()},
            nodes=tuple(int(mesh.node_ids[n]) for n in columns["nodes"][i] if n >= 0),
        )
        for i in range(len(chosen))
    )
    return Layout(
        points=mesh.position,
        faces=faces,
        pool=train["/gauges/position"][candidate],
        gauges=gauges,
        loads=tuple(Load(name, *_point_and_direction(mesh, entry), bool(entry.known)) for name, entry in loads.items()),
        fixed=mesh.position[np.unique(mesh.fixed[:, 0])],
        loose=_loose(mesh) if _is_ready(up["rom"]) else np.empty((0, 3)),
    )


def _is_ready(rom: Artefact) -> bool:
    """Whether the model came as matrices."""
    return "/matrices/notes" in rom


def _loose(mesh: Mesh) -> np.ndarray:
    """Nodes that no solid has (l, 3) [m]: of shells and beams, which only the matrices know."""
    alone = np.ones(len(mesh.position), dtype=bool)
    for block in mesh.blocks:
        alone[block.nodes] = False
    return mesh.position[alone]


def _point_and_direction(mesh: Mesh, entry: Any) -> tuple[np.ndarray, np.ndarray]:
    """Where a load is drawn and along what: a load of the deck at the mean of its nodes, weighted by their forces."""
    if entry.get("deck_load") is not None:
        forces = mesh.loads[entry.deck_load]
        size = np.linalg.norm(forces.force, axis=1)
        return size @ mesh.position[forces.nodes] / size.sum(), forces.force.sum(axis=0)
    direction = np.array(entry.direction, float)
    if entry.get("node") is not None:
        return mesh.position[mesh.node_index(int(entry.node))], direction
    members = mesh.node_sets[entry.set]
    return mesh.position[np.isin(mesh.node_ids, members)].mean(axis=0), direction


def _trend(place: Artefact) -> Trend:
    trace = place["/elimination/trace"]
    blocks = place["/elimination/blocks"]
    summary = place.summary
    certified = "lower_bound" in summary
    return Trend(
        count=np.arange(int(summary["pool"]), int(summary["pool"]) - len(trace), -1),
        trace=trace,
        blocks={str(name): blocks[:, i] for i, name in enumerate(place["/elimination/unknowns"])},
        final_trace=float(summary["trace_final"]),
        lower_bound=float(summary["lower_bound"]) if certified else None,
        gap=float(summary["gap"]) if certified else None,
    )


def _history(name: str, validate: Artefact) -> History:
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


def _gauge_signals(validate: Artefact, place: Artefact) -> tuple[GaugeSignal, ...]:
    time = validate["/gauge/time"]
    measured, true, estimated, std = (validate[f"/gauge/{key}"] for key in ("measured", "true", "estimated", "std"))
    return tuple(
        GaugeSignal(f"G{i + 1}", time, measured[:, i], true[:, i], estimated[:, i], std[:, i])
        for i in range(len(place["/selected/final/gauge"]))
    )


def _noise(names: list[str], up: Mapping[str, Artefact]) -> tuple[NoiseRow, ...]:
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


def _consistency(validate: Artefact) -> Consistency:
    nees_band, nis_band = ((float(low), float(high)) for low, high in validate["/consistency/band"])
    return Consistency(float(validate.summary["nees"]), nees_band, float(validate.summary["nis"]), nis_band)


def _warnings(up: Mapping[str, Artefact], names: list[str], mesh: Mesh) -> tuple[str, ...]:
    ready = _is_ready(up["rom"])
    said = [f"{text}." for text in (up["rom"]["/matrices/notes"] if ready else suspicions(mesh))]
    cards = [card for card in map(str, up["import"]["/ignored/card"]) if not only_control(card)]
    if cards:
        but = ": what they add must be in the matrices" * ready
        said.append(f"Not taken over from the deck: {', '.join(cards)}{but}.")
    summary = up["validate"].summary
    for name in names:
        if summary.get(f"identified.{name}") is False:
            said.append(f"{name} is not identified: other starting values end more than 3 σ apart.")
        error, std = float(summary[f"error.{name}"]), float(summary[f"std.{name}"])
        if error > 3 * std:
            said.append(
                f"{name} is off by {100 * error:.2g} %, more than three times the {100 * std:.2g} % that the filter claims."
            )
        random = up["validate"][f"/random_sets/all/std/{name}"]
        if len(random) and np.nanmedian(random) < 0.9 * std:
            said.append(
                f"Random sets from all candidates claim {100 * np.nanmedian(random):.2g} % for {name} in the median, "
                f"the chosen set {100 * std:.2g} %: the screening has dropped better places. Try screen.keep: all."
            )
    if lost := int(summary["lost_runs"]):
        said.append(f"{lost} runs of the studies diverged and are left out of the medians.")
    return tuple(said)


def _not_tested(train: Artefact, config: Any) -> tuple[str, ...]:
    said = ["No measured data: the truth is simulated."]
    if config.validate.truth.model == "rom":
        said.append("The truth is the filter's own model: no model error was tested.")
    elif config.validate.truth.model == "modes":
        said.append("Damping and gauge positions are exact in this truth; choose truth model rich to test them.")
    elif given_from(train) is not None:
        said.append("The gauges are exactly in place: given strain rows cannot be moved or turned.")
    said.append("Temperature, gauge factor, drift and glue are outside this model.")
    return tuple(said)


def _facts(up: Mapping[str, Artefact]) -> dict[str, str]:
    return {stage: up[stage].message for stage in ("import", "rom", "train", "screen", "place", "validate")}

"""Modes and static responses that a config names, gathered from their files onto the nodes of the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strainsight.config.loads import Load
from strainsight.config.mesh import MeshFile, ModesOfResults, ResponseOfLoad, Step
from strainsight.config.mesh import Results as Stated
from strainsight.errors import DeckError, UserError, blame
from strainsight.experiment.structure.references import load_shapes
from strainsight.fem.affine import Parameter, of_stiffness
from strainsight.fem.by_region import density_of, modulus_of, regions_of
from strainsight.fem.model import FullModel
from strainsight.foreign.of_results import GivenMotion, Results, check_positions, given_motion, results_model
from strainsight.foreign.results.reader import read_responses
from strainsight.foreign.results.response import Response
from strainsight.foreign.second_results import KEY as SECOND
from strainsight.foreign.second_results import Change, model_of_two
from strainsight.mesh.model import IdTable, Mesh
from strainsight.mesh.units import length_factor, mass_factor


@dataclass
class Wanted:
    """A step of a file that a key of the config asks for, and what was found of it, in the order of the file."""

    key: str
    kind: str
    step: Step | None
    found: list[Response] = field(default_factory=list)
    motion: list[np.ndarray] = field(default_factory=list)


def model_of_results(
    config: MeshFile,
    mesh: Mesh,
    parameters: Sequence[Parameter],
    files: Mapping[str, Path],
    loads: Mapping[str, Load] | None,
) -> FullModel:
    """The model of `mesh.results`; loads: those of the config, None for the modes alone.

    Raises UserError with the key and the step for what the files lack or contradict.
    """
    stated = config.results
    assert stated is not None
    first = _set_of(
        config, SetOfResults("mesh.results", stated.modes, {} if loads is None else stated.loads), mesh, files, loads
    )
    names, notes = tuple(loads or ()), first.notes
    forces = None if loads is None else lambda model: load_shapes(model, loads)
    change = _change(stated, mesh, parameters)
    whole = [own for own in parameters if change is None or own != change.parameter]
    scaled = _proportional(stated, mesh, whole)
    with blame("mesh.results"), mesh.located():
        if change is None:
            built = results_model(mesh, first.motion, first.results, forces, names, scaled)
        else:
            assert stated.second is not None
            of_loads = _loads_of_second(stated) if loads is not None else {}
            asked = SetOfResults(SECOND, stated.second.modes, of_loads)
            second = _set_of(config, asked, mesh, files, loads)
            notes += second.notes
            sets = (first.motion, second.motion), (first.results, second.results)
            built = model_of_two(mesh, *sets, forces, names, scaled, change)
    return replace(built, notes=tuple(dict.fromkeys((*notes, *built.notes))))


@dataclass(frozen=True)
class SetOfResults:
    """A section of the config that asks for modes and responses, and its key."""

    key: str
    modes: ModesOfResults
    loads: Mapping[str, ResponseOfLoad]


@dataclass(frozen=True)
class Gathered:
    """motion on the rows of the mesh, of the modes and then of the responses; sentences on the files."""

    motion: GivenMotion
    results: Results
    notes: list[str]


def _set_of(
    config: MeshFile, asked: SetOfResults, mesh: Mesh, files: Mapping[str, Path], loads: Mapping[str, Load] | None
) -> Gathered:
    """Modes in the order of their frequencies, responses in that of the config; SI units."""
    stated = config.results
    assert stated is not None
    modes = Wanted(f"{asked.key}.modes", "mode", asked.modes.step)
    static = {name: Wanted(f"{asked.key}.loads.{name}", "static", own.step) for name, own in asked.loads.items()}
    L, M = length_factor(config.length_unit), mass_factor(config.mass_unit)
    notes = _gather([modes, *static.values()], f"{asked.key}.file", mesh, L, files)
    order = sorted(range(len(modes.found)), key=lambda i: modes.found[i].frequency)
    responses = [modes.found[i] for i in order] + [own.found[0] for own in static.values()]
    size = [1.0] * len(order) + [asked.loads[name].applied for name in static]
    motion = [modes.motion[i] for i in order] + [own.motion[0] for own in static.values()]
    for own in (modes, *static.values()):
        own.motion.clear()
    names = tuple(loads or ())
    results = Results(
        frequency=np.array([own.frequency for own in responses[: len(order)]]),
        load=np.array([names.index(name) for name in static], dtype=np.int64),
        modal_mass=_modal_mass(stated, responses[: len(order)], M * L**2),
        rounding=max(own.rounding for own in responses),
        where=tuple(own.where for own in responses),
    )
    with blame(asked.key), mesh.located():
        return Gathered(given_motion(mesh, _stacked(motion, size, L)), results, notes)


def _loads_of_second(stated: Stated) -> Mapping[str, ResponseOfLoad]:
    assert stated.second is not None
    return stated.loads if stated.second.loads is None else stated.second.loads


def _change(stated: Stated, mesh: Mesh, parameters: Sequence[Parameter]) -> Change | None:
    """The parameter of the second set and its two values; None without a second set."""
    if stated.second is None:
        return None
    own = next(own for own in parameters if own.name == stated.second.parameter)
    return Change(own, _made_with(stated, mesh, own), stated.second.at)


def _gather(wanted: list[Wanted], default: str, mesh: Mesh, length: float, files: Mapping[str, Path]) -> list[str]:
    """Read every file once, and put what is wanted of it on the nodes of the mesh; default: the key of the file of all that
    name none; length: the unit of the files [m]."""
    by_file: dict[tuple[str, Path], list[Wanted]] = {}
    for own in wanted:
        key = f"{own.key}.file" if f"{own.key}.file" in files else default
        path = files[key]
        key = next((k for k, known in by_file if known == path), key)
        by_file.setdefault((key, path), []).append(own)
    nodes, notes = IdTable(mesh.node_ids[: mesh.own_nodes]), []
    for (key, path), here in by_file.items():
        known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        steps: dict[str, None] = {}
        scalar_points = 0
        with blame(key):
            for response in read_responses(path):
                steps.setdefault(_step_in_words(response), None)
                takers = [own for own in here if _fits(own, response)]
                if not takers:
                    continue
                scalar_points = max(scalar_points, response.scalar_points)
                if known is None or not np.array_equal(known[0], response.node_ids):
                    rows, missing = nodes.rows(response.node_ids)
                    known = response.node_ids, rows, ~missing
                    if missing.all():
                        raise DeckError(
                            f"none of its {len(rows)} nodes is in the mesh",
                            where=response.where,
                            remedy="give the mesh that the results are of",
                        )
                    if response.position is not None:
                        check_positions(
                            mesh,
                            rows[~missing],
                            length * response.position[~missing],
                            response.rounding,
                            response.where,
                        )
                placed = on_nodes(mesh, response, known[1], known[2])
                for own in takers:
                    own.found.append(replace(response, motion=np.zeros((0, 3))))  # which would be there twice
                    own.motion.append(placed)
        if known is not None and not known[2].all():
            notes.append(f"{path.name} has {int((~known[2]).sum())} nodes that the mesh lacks, which are left out")
        if scalar_points:
            notes.append(f"{path.name} has {scalar_points} scalar or fluid points, which are left out")
        for own in here:
            _check_found(own, path, list(steps))
    return notes


def _fits(own: Wanted, response: Response) -> bool:
    if response.kind != own.kind:
        return False
    return own.step is None or own.step == (response.label if isinstance(own.step, str) else response.step)


def on_nodes(mesh: Mesh, response: Response, rows: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Motion (n, 3 or 6) along the basic axes, NaN of nodes without."""
    found = np.full((len(mesh.position), response.motion.shape[1]), np.nan)
    found[rows[there]] = response.motion[there]
    if response.along_node_axes:
        for node, axes in mesh.axes.items():
            for start in range(0, found.shape[1], 3):
                found[node, start : start + 3] = axes @ found[node, start : start + 3]
    return found


def _step_in_words(response: Response) -> str:
    what = "modes" if response.kind == "mode" else "static"
    return f"step {response.step} ({what}{f', {response.label!r}' if response.label else ''})"


def _check_found(own: Wanted, path: Path, steps: list[str]) -> None:
    asked = "" if own.step is None else f"{'titled' if isinstance(own.step, str) else 'step'} {own.step!r} "
    what = "modes" if own.kind == "mode" else "static response"
    if not own.found:
        raise DeckError(
            f"no {what} {asked}in the file".replace("  ", " "),
            where=str(path),
            key=own.key,
            remedy=f"it has {', '.join(steps[:8]) or 'neither modes nor static responses'}{', …' if len(steps) > 8 else ''}",
        )
    several = sorted({response.step for response in own.found})
    if len(several) > 1:
        raise DeckError(
            f"several steps have {what}s: {', '.join(map(str, several[:8]))}".replace("modess", "modes"),
            where=str(path),
            key=own.key,
            remedy=f"state {own.key}.step",
        )
    if own.kind == "static" and len(own.found) > 1:
        raise DeckError(
            f"step {several[0]} has {len(own.found)} static responses, increments of one load",
            where=str(path),
            key=own.key,
            remedy="write a linear step, of one increment",
        )


def _stacked(motion: list[np.ndarray], size: list[float], length: float) -> np.ndarray:
    """(k, n, 3 or 6): translations in m per unit of the load, rotations in rad; the arrays of the list are let go."""
    width = max(own.shape[1] for own in motion)
    found = np.full((len(motion), len(motion[0]), width), np.nan)
    for i in range(len(size)):
        own = motion.pop(0)
        found[i, :, : own.shape[1]] = own / size[i]
    found[:, :, :3] *= length
    return found


def _modal_mass(stated: Stated, modes: list[Response], unit: float) -> np.ndarray | None:
    """ΦᵀMΦ (m,) [kg m²]; unit: one of the file [kg m²]."""
    if stated.modal_mass == "mesh":
        return None
    if stated.modal_mass == "unit":
        return np.full(len(modes), unit)
    known = [own.modal_mass for own in modes if own.modal_mass is not None]
    return unit * np.array(known) if len(known) == len(modes) else None


def _proportional(stated: Stated, mesh: Mesh, parameters: Sequence[Parameter]) -> dict[str, tuple[str, float]]:
    """What is proportional to which parameter, and the value that the results were made with.

    Raises UserError for a property of a part alone, and where that value is not known.
    """
    found = {}
    for own in parameters:
        kind = "stiffness" if of_stiffness(own.property) else "mass"
        beside = {"stiffness": mesh.springs, "mass": mesh.point_masses}[kind]
        if set(regions_of(mesh.elements)) - set(own.regions) or beside:
            but = "springs" if kind == "stiffness" else "point masses"
            part = f"the {but} of the deck have none" if beside else "it is of some regions only"
            raise UserError(
                f"{part}, and modes and responses at one value say how they change with all {kind} alone: what a part adds to it "
                "is not in them",
                key=f"parameters.{own.name}",
                remedy="free a property of all regions, or a stiffness_factor of all; or give a second set that was made with "
                "another value of it (mesh.results.second), the deck itself, or mesh.matrices",
            )
        found[kind] = own.name, _made_with(stated, mesh, own)
    return found


def _made_with(stated: Stated, mesh: Mesh, own: Parameter) -> float:
    if own.name in stated.at:
        return stated.at[own.name]
    if own.property == "stiffness_factor":
        return 1.0
    lacking = [number for number in own.regions if mesh.material_of(number) is None]
    read = modulus_of if own.property == "youngs_modulus" else density_of
    values = set() if lacking else {read(mesh, number) for number in own.regions}
    if len(values) != 1:
        what = f"the regions have {len(values)} values of it" if values else "the mesh does not state it"
        raise UserError(
            f"with which {own.property} were the results made? {what}",
            key="mesh.results.at",
            remedy=f"state it, at: {{{own.name}: …}}; of parts that differ, free a stiffness_factor of all",
        )
    return values.pop()

"""Import of modes and static responses of another program onto the nodes of the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strainsight.config.imported import ModesOfResults, ResponseOfLoad, ResultsSection, Step
from strainsight.config.loads import LoadSection
from strainsight.config.mesh import MeshFile
from strainsight.errors import DeckError, UserError, blame
from strainsight.experiment.structure.references import load_shapes
from strainsight.fem.affine import Parameter, of_stiffness
from strainsight.fem.by_region import density_of, modulus_of, regions_of
from strainsight.fem.model import FullModel
from strainsight.foreign.imported_modes import ImportedMotion, Results, check_positions, extend_motion, results_model
from strainsight.foreign.results.reader import read_responses
from strainsight.foreign.results.response import Response
from strainsight.foreign.two_result_sets import KEY as SECOND
from strainsight.foreign.two_result_sets import Change, build_two_set_model
from strainsight.mesh.model import IdTable, Mesh
from strainsight.mesh.units import length_factor, mass_factor


@dataclass
class WantedResult:
    """A step of a file requested by a config key, with its responses in the order of the file and their motion."""

    key: str
    kind: str
    step: Step | None
    responses: list[Response] = field(default_factory=list)
    motion: list[np.ndarray] = field(default_factory=list)

    def includes(self, response: Response) -> bool:
        """Whether a response is of this kind and step."""
        step = response.label if isinstance(self.step, str) else response.step
        return response.kind == self.kind and self.step in (None, step)


def model_of_results(
    config: MeshFile,
    mesh: Mesh,
    parameters: Sequence[Parameter],
    files: Mapping[str, Path],
    loads: Mapping[str, LoadSection] | None,
) -> FullModel:
    """Build the model of `mesh.results`; loads: of the config, None for the modes only.

    Raises UserError with key and step for missing or inconsistent results."""
    settings = config.results
    assert settings is not None
    names = tuple(loads or ())

    def set_of(
        key: str, modes: ModesOfResults, responses: Mapping[str, ResponseOfLoad]
    ) -> tuple[ImportedMotion, Results, list[str]]:
        return _set_of(config, key, modes, {} if loads is None else responses, mesh, files, names)

    motion, results, notes = set_of("mesh.results", settings.modes, settings.loads)
    forces = None if loads is None else lambda model: load_shapes(model, loads)
    change = _change(settings, mesh, parameters)
    whole = [parameter for parameter in parameters if change is None or parameter != change.parameter]
    scaled = _proportional(settings, mesh, whole)
    with blame("mesh.results"), mesh.located():
        if change is None:
            built = results_model(mesh, motion, results, forces, names, scaled)
        else:
            assert settings.second is not None
            of_loads = settings.loads if settings.second.loads is None else settings.second.loads
            other_motion, other_results, more = set_of(SECOND, settings.second.modes, of_loads)
            notes += more
            sets = (motion, other_motion), (results, other_results)
            built = build_two_set_model(mesh, *sets, forces, names, scaled, change)
    return replace(built, notes=tuple(dict.fromkeys((*notes, *built.notes))))


def _set_of(
    config: MeshFile,
    key: str,
    section: ModesOfResults,
    loads: Mapping[str, ResponseOfLoad],
    mesh: Mesh,
    files: Mapping[str, Path],
    names: tuple[str, ...],
) -> tuple[ImportedMotion, Results, list[str]]:
    """Motion on the nodes of the mesh in SI units (modes by frequency, then responses in the order of the config), results, and
    notes. key: config section; names: of all loads."""
    settings = config.results
    assert settings is not None
    modes = WantedResult(f"{key}.modes", "mode", section.step)
    static = {name: WantedResult(f"{key}.loads.{name}", "static", load.step) for name, load in loads.items()}
    L, M = length_factor(config.length_unit), mass_factor(config.mass_unit)
    notes = _gather([modes, *static.values()], f"{key}.file", mesh, L, files)
    order = sorted(range(len(modes.responses)), key=lambda i: modes.responses[i].frequency)
    responses = [modes.responses[i] for i in order] + [wanted.responses[0] for wanted in static.values()]
    size = [1.0] * len(order) + [load.magnitude for load in loads.values()]
    motion = [modes.motion[i] for i in order] + [wanted.motion[0] for wanted in static.values()]
    for wanted in (modes, *static.values()):
        wanted.motion.clear()
    results = Results(
        frequency=np.array([mode.frequency for mode in responses[: len(order)]]),
        load=np.array([names.index(name) for name in static], dtype=np.int64),
        modal_mass=_modal_mass(settings, responses[: len(order)], M * L**2),
        rounding=max(response.rounding for response in responses),
        where=tuple(response.where for response in responses),
    )
    with blame(key), mesh.located():
        return extend_motion(mesh, _stacked(motion, size, L)), results, notes


def _change(settings: ResultsSection, mesh: Mesh, parameters: Sequence[Parameter]) -> Change | None:
    """Parameter of the second set and its two values; None without a second set."""
    if settings.second is None:
        return None
    parameter = next(one for one in parameters if one.name == settings.second.parameter)
    return Change(parameter, _made_with(settings, mesh, parameter), settings.second.at)


def _gather(
    wanted: list[WantedResult], default: str, mesh: Mesh, length: float, files: Mapping[str, Path]
) -> list[str]:
    """Read every file once and map the requested results onto the nodes of the mesh; default: key of the default file; length:
    unit of the files [m]."""
    by_file: dict[Path, tuple[str, list[WantedResult]]] = {}
    for one in wanted:
        key = f"{one.key}.file" if f"{one.key}.file" in files else default
        by_file.setdefault(files[key], (key, []))[1].append(one)
    nodes, notes = IdTable(mesh.node_ids[: mesh.own_nodes]), []
    for path, (key, of_file) in by_file.items():
        node_ids: np.ndarray | None = None
        rows, missing = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
        steps: dict[str, None] = {}
        scalar_points = 0
        with blame(key):
            for response in read_responses(path):
                title = f", {response.label!r}" if response.label else ""
                steps[f"step {response.step} ({'modes' if response.kind == 'mode' else 'static'}{title})"] = None
                takers = [one for one in of_file if one.includes(response)]
                if not takers:
                    continue
                scalar_points = max(scalar_points, response.scalar_points)
                if node_ids is None or not np.array_equal(node_ids, response.node_ids):
                    node_ids = response.node_ids
                    rows, missing = nodes.rows(node_ids)
                    if missing.all():
                        raise DeckError(
                            f"none of the {len(rows)} nodes of the results is in the mesh",
                            where=response.where,
                            remedy="Use the mesh that belongs to these results.",
                        )
                    if response.position is not None:
                        position = length * response.position[~missing]
                        check_positions(mesh, rows[~missing], position, response.rounding, response.where)
                motion = on_nodes(mesh, response, rows, ~missing)
                for one in takers:
                    one.responses.append(replace(response, motion=np.zeros((0, 3))))  # stored in `motion` below
                    one.motion.append(motion)
        if missing.any():
            notes.append(f"nodes of {path.name} that are not in the mesh and are omitted: {int(missing.sum())}")
        if scalar_points:
            notes.append(f"scalar or fluid points of {path.name} are omitted ({scalar_points} in total)")
        for one in of_file:
            _check_responses(one, path, list(steps))
    return notes


def on_nodes(mesh: Mesh, response: Response, rows: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Motion (n, 3 or 6) along the basic axes, NaN for nodes without results."""
    motion = np.full((len(mesh.position), response.motion.shape[1]), np.nan)
    motion[rows[present]] = response.motion[present]
    if response.along_node_axes:
        for node, axes in mesh.axes.items():
            for start in range(0, motion.shape[1], 3):
                motion[node, start : start + 3] = axes @ motion[node, start : start + 3]
    return motion


def _check_responses(wanted: WantedResult, path: Path, steps: list[str]) -> None:
    of_step = (
        "" if wanted.step is None else f" of {'title' if isinstance(wanted.step, str) else 'step'} {wanted.step!r}"
    )
    modes, several = wanted.kind == "mode", sorted({response.step for response in wanted.responses})
    if not several:
        listed = ", ".join(steps[:8]) or "no results"
        raise DeckError(
            f"no {'modes' if modes else 'static response'}{of_step} in the file",
            where=str(path),
            key=wanted.key,
            remedy=f"Choose another step or file. The file contains {listed}{', …' if len(steps) > 8 else ''}.",
        )
    if len(several) > 1:
        raise DeckError(
            f"several steps have {'modes' if modes else 'static responses'}: {', '.join(map(str, several[:8]))}",
            where=str(path),
            key=wanted.key,
            remedy=f"Set {wanted.key}.step to one of these steps.",
        )
    if not modes and len(wanted.responses) > 1:
        raise DeckError(
            f"step {several[0]} has {len(wanted.responses)} static responses (load increments)",
            where=str(path),
            key=wanted.key,
            remedy="Export results of a linear step with one increment.",
        )


def _stacked(motion: list[np.ndarray], size: list[float], length: float) -> np.ndarray:
    """Stack to (k, n, 3 or 6): translations in m per unit of the load, rotations in rad. Empties the list to save memory."""
    stack = np.full((len(motion), len(motion[0]), max(each.shape[1] for each in motion)), np.nan)
    for i in range(len(size)):
        each = motion.pop(0)
        stack[i, :, : each.shape[1]] = each / size[i]
    stack[:, :, :3] *= length
    return stack


def _modal_mass(settings: ResultsSection, modes: list[Response], unit: float) -> np.ndarray | None:
    """Modal masses ΦᵀMΦ (m,) [kg m²]; unit: of the file [kg m²]."""
    if settings.modal_mass == "mesh":
        return None
    if settings.modal_mass == "unit":
        return np.full(len(modes), unit)
    known = [mode.modal_mass for mode in modes if mode.modal_mass is not None]
    return unit * np.array(known) if len(known) == len(modes) else None


def _proportional(entry: ResultsSection, mesh: Mesh, parameters: Sequence[Parameter]) -> dict[str, tuple[str, float]]:
    """Map "stiffness" or "mass" to the parameter that scales it, and the value at which the results were computed.
    Raises UserError for a property of only a part of the model, and if that value is unknown."""
    scaled = {}
    for parameter in parameters:
        stiffness = of_stiffness(parameter.property)
        kind, others = ("stiffness", "springs") if stiffness else ("mass", "point masses")
        elsewhere = mesh.springs if stiffness else mesh.point_masses
        if set(regions_of(mesh.elements)) - set(parameter.regions) or elsewhere:
            part = f"{parameter.name} does not scale {f'the {others} of the deck' if elsewhere else 'all regions'}"
            raise UserError(
                f"a single set of results (mesh.results) supports only parameters that scale the whole {kind}, but {part}",
                key=f"parameters.{parameter.name}",
                remedy="Estimate a property or a stiffness_factor of all regions, or import a second set of results at another "
                "value (mesh.results.second), or use the deck or mesh.matrices.",
            )
        scaled[kind] = parameter.name, _made_with(entry, mesh, parameter)
    return scaled


def _made_with(settings: ResultsSection, mesh: Mesh, parameter: Parameter) -> float:
    if parameter.name in settings.at:
        return settings.at[parameter.name]
    if parameter.property == "stiffness_factor":
        return 1.0
    read = modulus_of if parameter.property == "youngs_modulus" else density_of
    known = all(mesh.material_of(number) is not None for number in parameter.regions)
    values = {read(mesh, number) for number in parameter.regions} if known else set()
    if len(values) != 1:
        what = f"the regions have {len(values)} different values" if values else "the mesh does not define any value"
        raise UserError(
            f"the {parameter.property} of the imported results is unknown: {what}",
            key="mesh.results.at",
            remedy=f"Set mesh.results.at: {{{parameter.name}: …}}, or for different values estimate a "
            "stiffness_factor of all regions.",
        )
    return values.pop()

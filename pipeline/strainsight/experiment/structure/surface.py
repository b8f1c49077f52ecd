"""Strain and stress without gauges: virtual gauges, the surface in a test, and the surface at the guess under each load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.estimate import Field3D
from strainsight.config.gauges import NamedGauge
from strainsight.config.loads import LoadSection
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, DeckError, blame
from strainsight.estimation.model import FilterModel, surface_reading, theta_of
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed, WantedCovariances
from strainsight.experiment.structure.candidates import rows_along
from strainsight.experiment.structure.record_filter import RecordFilter
from strainsight.experiment.structure.references import parameters_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.tolerated_loads import field_beyond
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.recovery import (
    SurfaceModel,
    SurfaceState,
    facet_strain,
    principal,
    strain_matrix,
    surface_model,
    surface_state,
)
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import THICKNESS
from strainsight.mesh.vtkhdf import VtkHdf, facet_cells, unstructured_grid
from strainsight.records.estimated import DamageAt, Resultant, SurfaceMoment, VirtualStrain
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.strain_operator import channel_rows

SHOWN = ("strain", "strain_std", "stress", "von_mises", "von_mises_std", "principal")
FRAMES = 100
"""Default number of frames of the surface."""


@dataclass(frozen=True)
class Displaced:
    """Displacement basis (3 nodes, n + f) of n coordinates and f smoother states z, the static residuals of misaligned loads."""

    basis: np.ndarray
    coordinates: int

    def states(self, mean: np.ndarray) -> np.ndarray:
        """Indices (n + f,) of coordinates and z among the states (..., n* + f) of a smoother."""
        f = self.basis.shape[1] - self.coordinates
        return np.concatenate([np.arange(self.coordinates), np.arange(mean.shape[-1] - f, mean.shape[-1])])


def virtual_labels(entries: Sequence[NamedGauge]) -> tuple[str, ...]:
    """Labels of all grids of `estimate.virtual`: names, or "V1", "V2 45°"."""
    labels = [entry.name or f"V{i + 1}" for i, entry in enumerate(entries)]
    return tuple(
        label if len(entry.angles) == 1 else f"{label} {angle:g}°"
        for label, entry in zip(labels, entries, strict=True)
        for angle in entry.angles
    )


@dataclass(frozen=True)
class Virtual:
    """Virtual gauges of g grids: strain operator rows (g, n + f) on coordinates and z of `Displaced` at the reference parameters,
    and its change (g, n + f) with an estimated thickness."""

    pool: Candidates
    rows: np.ndarray
    change: AffineOperator
    coordinates: int

    def read(self, model: FilterModel, x: np.ndarray, states: int) -> tuple[np.ndarray, np.ndarray]:
        """Strains at the smoother states x (T + 1, n* + …), and their operator on all `states` (g, states), or (T + 1, g,
        states) if it depends on θ and the motion."""
        n, size, (g, width) = self.coordinates, model.size, self.rows.shape
        rows = np.zeros((g, states))
        rows[:, :n], rows[:, states - width + n :] = self.rows[:, :n], self.rows[:, n:]
        if not self.change.terms:
            return x @ rows[:, : x.shape[1]].T, rows
        change = self.change.of_terms(lambda X: X[:, :n])
        strain, J = surface_reading(model, rows[:, : model.model.size], change, x[:, :size])
        whole = np.array(np.broadcast_to(rows, (len(x), *rows.shape)))
        whole[..., :size] = J
        return strain + x[:, size:] @ rows[:, size : x.shape[1]].T, whole

    def smoothed(self, model: FilterModel, run: FilterRun, smoothed: Smoothed) -> VirtualStrain:
        """Smoothed strains with σ; run: of the filter, at which the smoother has linearised."""
        states = smoothed.mean.shape[-1]
        return VirtualStrain(
            strain=self.read(model, smoothed.mean[:, 0], states)[0],
            std=smoothed.std_of(self.read(model, run.mean[:, 0], states)[1]),
            position=self.pool.position,
            direction=self.pool.direction,
        )


@blame("estimate.virtual")
def virtual_of(structure: Structure, field: Displaced) -> Virtual | None:
    """Virtual gauges of `estimate.virtual`, each at the nearest point of the surface, None without any. Raises UserError for a
    gauge off the surface."""
    config, mesh, gauges = structure.config, structure.mesh, structure.config.gauges
    entries = () if config.estimate is None else config.estimate.virtual
    if not entries:
        return None
    facets = structure.skin.facets
    bonded_entries = [
        BondedEntry(e.position, e.direction, gauges.grid_length if e.length is None else e.length, e.angles)
        for e in entries
    ]
    pool = bonded(mesh, facets, bonded_entries, gauges.snap_tolerance, key="estimate.virtual")[0]
    rows, change = rows_along(
        mesh,
        structure.free_thicknesses,
        lambda at: channel_rows(mesh.position, pool, field.basis, facets=facets, thickness=at),
    )
    return Virtual(pool, rows, change, field.coordinates)


@dataclass(frozen=True)
class Skin:
    """Surface of a reduced model; model: strain and stress at the facet centres; free: estimated thicknesses."""

    mesh: Mesh
    field: Displaced
    facets: Facets
    model: SurfaceModel
    free: tuple[Parameter, ...] = ()


def skin_of(mesh: Mesh, field: Displaced, parameters: Sequence[Parameter]) -> Skin:
    """Build the surface. Raises DeckError if a region of it has no material."""
    facets, free = exterior_facets(mesh), tuple(one for one in parameters if one.property == THICKNESS)
    with mesh.located():
        rows = facet_strain(mesh, facets, parameters)
        model = surface_model(mesh, rows, field.basis, parameters)
        if free:
            strain, change = rows_along(mesh, free, lambda at: strain_matrix(mesh, facets, rows.laws, at) @ field.basis)
            shape = model.strain.shape
            model = replace(model, strain=strain.reshape(shape), change=change.of_terms(lambda X: X.reshape(shape)))
        return Skin(mesh, field, facets, model, free)


def _state(skin: Skin, model: FilterModel, smoothed: Smoothed, k: int) -> SurfaceState:
    """Strain and stress of every exterior facet at instant k, with σ unless withheld."""
    free, x = model.unknowns.parameters, smoothed.mean[k, 0]
    displacing = skin.field.states(x)
    at = np.concatenate([displacing, np.arange(model.parameter_states.start, model.size)])
    theta = {name: float(value) for name, value in theta_of(model, x[: model.size]).items()}
    # θ = guess exp(p), so dθ = θ dp
    scale = np.concatenate([np.ones(len(displacing)), [theta[name] for name in free]])
    P = smoothed.covariance_at(k)[np.ix_(at, at)] * np.outer(scale, scale)
    return surface_state(skin.model, theta, x[displacing], P if np.isfinite(P).all() else None, free)


def surface_grid(
    skin: Skin, model: FilterModel, smoothed: Smoothed, settings: Field3D | None, damage: DamageAt | None = None
) -> VtkHdf | None:
    """Surface grid with fields in time and damage, None without either.

    settings: of the fields (displacement, strain and stress of every exterior facet, with σ unless withheld); damage: of
    the facets. Stress and its σ are linearised in the coordinates and the estimated moduli."""
    if settings is None:
        return None if damage is None else damage_grid(skin, damage)
    displacing = skin.field.states(smoothed.mean)
    used, blocks, order = facet_cells(skin.facets)
    frames = frames_of(settings, smoothed.time)
    data: dict[str, list[np.ndarray]] = {}
    for k in frames:
        state = _state(skin, model, smoothed, int(k))
        for name in SHOWN:
            if (shown := getattr(state, name)) is not None:
                data.setdefault(name, []).append(shown[order].astype(np.float32))
    shapes = skin.field.basis.reshape(len(skin.mesh.position), 3, -1)[used]
    displacement = np.stack([(shapes @ smoothed.mean[k, 0, displacing]).astype(np.float32) for k in frames])
    return unstructured_grid(
        skin.mesh.position[used],
        blocks,
        point_data={"displacement": displacement},
        cell_data={name: np.stack(values) for name, values in data.items()} | _damage_shown(damage, order),
        steps=smoothed.time[frames],
    )


def frames_of(settings: Field3D, time: np.ndarray) -> np.ndarray:
    """Indices of the frames among the smoother's instants (T + 1,) [s]; FRAMES by default."""
    step = settings.every or time[-1] / FRAMES
    frames = np.unique(np.round(np.arange(0, time[-1] + 0.5 * step, step) / (time[1] - time[0])).astype(int))
    return frames[frames < len(time)]


def damage_grid(skin: Skin, damage: DamageAt) -> VtkHdf:
    """Grid of damage and equivalent range of every exterior facet."""
    used, blocks, order = facet_cells(skin.facets)
    return unstructured_grid(skin.mesh.position[used], blocks, cell_data=_damage_shown(damage, order))


def _damage_shown(damage: DamageAt | None, order: np.ndarray) -> dict[str, np.ndarray]:
    """Damage arrays in the order of cells, without withheld ones."""
    if damage is None:
        return {}
    names = {
        "damage": damage.damage,
        "damage_low": damage.low,
        "damage_high": damage.high,
        "damage_of_mean": damage.of_mean,
        "equivalent_range": damage.range,
        "equivalent_range_of_mean": damage.range_of_mean,
    }
    return {name: values[order] for name, values in names.items() if not np.isnan(values).all()}


def moment_of(skin: Skin, record: RecordFilter, run: FilterRun, smoothed: Smoothed) -> SurfaceMoment:
    """Surface at the instant of the largest reading, whose covariance `wanted_of` has kept."""
    k, channel = largest(record, run.mean[-1, 0])
    then, test = (k + 1) * record.test.every, record.test
    state = _state(skin, record.model, smoothed, then)
    shapes = skin.field.basis.reshape(len(skin.mesh.position), 3, -1)
    return SurfaceMoment(
        time=float(test.time[k + 1]),
        label=test.labels[channel],
        displacement=(shapes @ smoothed.mean[then, 0, skin.field.states(smoothed.mean)]).astype(np.float32),
        strain=state.strain.astype(np.float32),
        principal_strain=largest_principal(state.strain).astype(np.float32),
        von_mises=state.von_mises.astype(np.float32),
        von_mises_std=None if state.von_mises_std is None else state.von_mises_std.astype(np.float32),
    )


def largest_principal(strain: np.ndarray) -> np.ndarray:
    """Signed principal strain of largest magnitude (p,) from strain (p, 6) with engineering shears."""
    three = principal(np.concatenate([strain[:, :3], 0.5 * strain[:, 3:]], axis=1))
    return np.where(np.abs(three[:, 0]) >= np.abs(three[:, 2]), three[:, 0], three[:, 2])


def largest(record: RecordFilter, last: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest reading, among strains if there are any, else relative to the noise; last (n,): final
    states with channel offsets."""
    test, model = record.test, record.model
    offset = np.zeros(len(test.labels))
    offset[record.biased] = last[model.size :]
    kinds = np.broadcast_to(STRAIN if model.quantity is None else model.quantity, offset.shape)
    scale = np.where(kinds == STRAIN, 1.0, np.inf) if np.any(kinds == STRAIN) else record.noise_std
    return largest_reading(test.values, offset, scale)


def largest_reading(values: np.ndarray, offset: np.ndarray, scale: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest |reading − offset|/scale, the first of equals, (0, 0) without samples.

    values (T, m), NaN if missing; offset, scale (m,)."""
    size = np.abs(values - offset) / scale
    size = np.where(np.isfinite(size), size, -1.0)
    k, channel = np.unravel_index(int(np.argmax(size)), size.shape)
    return int(k), int(channel)


def resultants_of(
    loads: Mapping[str, LoadSection], inputs: Sequence[str], model: FilterModel, smoothed: Smoothed
) -> dict[str, Resultant]:
    """ "0", "1", … → resultant of every place with more than one unknown load of `inputs`.

    F = Σ dᵢ uᵢ over unit directions d;  σ of |F| to first order: e·D P Dᵀ·e with e = F/|F|.
    """
    resultants = {}
    for number, (place, index) in enumerate(places_of(loads, inputs)):
        d = np.array([loads[inputs[i]].direction for i in index], dtype=float)
        D = (d / np.linalg.norm(d, axis=1)[:, None]).T * model.amplitude[index]
        at = model.position[index]
        force = smoothed.mean[:, 0, at] @ D.T
        magnitude = np.linalg.norm(force, axis=1)
        along = force / np.where(magnitude > 0, magnitude, 1.0)[:, None] @ D
        variance = np.einsum("ti,tij,tj->t", along, smoothed.covariance_of(at), along)
        std = np.sqrt(np.maximum(variance, 0.0))
        resultants[str(number)] = Resultant(place=place, force=force, magnitude=magnitude, std=std)
    return resultants


def places_of(loads: Mapping[str, LoadSection], inputs: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Places with more than one unknown load, and their indices (k,) in `inputs`."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(inputs):
        load = loads[name]
        if load.direction is not None:
            places.setdefault(f"node {load.node}" if load.node is not None else f"set {load.set}", []).append(i)
    return [(where, np.array(index)) for where, index in places.items() if len(index) > 1]


def displaced(reduced: Reduced, record: RecordFilter) -> Displaced:
    """Displacement basis of a record, for the parameter grid filter with the static residuals of misaligned loads."""
    basis, n = reduced.basis, reduced.basis.shape[1]
    if record.problem.method == "grid":
        basis = np.hstack([basis, field_beyond(record.tolerances.loads, record.model, reduced)])
    return Displaced(basis, n)


def skin_in_test(structure: Structure, field: Displaced) -> tuple[Skin | None, tuple[str, ...]]:
    """Surface, or None with the reason if it is not available.

    Raises ConfigError if a result on the surface is configured and the mesh has no surface, DeckError if it has no material."""
    config, mesh, settings = structure.config, structure.mesh, structure.config.estimate
    assert settings is not None
    keys = [f"estimate.{name}" for name in ("field", "damage") if getattr(settings, name) is not None]
    if not mesh.has_surface:
        if keys:
            raise ConfigError(
                "the mesh has no surface, because it has no solids, shells or beams with a cross-section",
                key=keys[0],
                remedy="Remove this key, or use a mesh with such elements.",
            )
        return None, ()
    try:
        return skin_of(mesh, field, parameters_of(config.parameters, mesh, structure.files, config.mesh)), ()
    except DeckError as error:
        # imported matrices need no materials otherwise
        if keys:
            raise
        return None, (f"strain and stress of the surface are not available: {error.what}",)


def wanted_of(
    config: PlacementConfig, record: RecordFilter, virtual: Virtual | None, run: FilterRun
) -> WantedCovariances:
    """Covariances needed from the smoother: of virtual gauges, of loads at one place, and of surface frames; run: of the
    filter."""
    assert config.estimate is not None
    residuals = len(record.considered.load) if record.problem.method == "grid" else 0  # z
    states, field = len(record.covariance) + residuals, config.estimate.field
    frames = np.zeros(0) if field is None else frames_of(field, run.time)
    most = (largest(record, run.mean[-1, 0])[0] + 1) * record.test.every
    together = [index for _, index in places_of(config.loads, record.problem.unknowns.inputs)]
    return WantedCovariances(
        np.zeros((0, states)) if virtual is None else virtual.read(record.model, run.mean[:, 0], states)[1],
        record.model.position[np.unique(np.concatenate([np.zeros(0, int), *together]))],
        np.unique([*frames, most]).astype(int),
    )


LEAST_STRAIN = 1e-6
"""Smallest strain under a unit load; otherwise the load is multiplied by thousands."""
MOST_LOAD = 10.0**9
"""Load, in its unit, from which it is considered to cause no strain."""


@dataclass(frozen=True)
class SurfaceStrain:
    """Signed principal strain of largest magnitude at every exterior facet centre (f,).

    load: single load, "" for all of a training simulation; size [unit]: of that load; case: load case, "" for the
    configured loads; instant [s]: of that run; free: whether the structure is free."""

    strain: np.ndarray
    load: str = ""
    size: float = 1.0
    unit: str = ""
    case: str = ""
    instant: float = 0.0
    free: bool = False


def surface_strains(
    mesh: Mesh, reduced: Reduced, training: Training, loads: Mapping[str, LoadSection], free: bool = False
) -> tuple[SurfaceStrain, ...]:
    """Strain ε = B Ψ q at the guess under every single load and in every training simulation; empty without a surface.

    Single load: q = K⁻¹ S u, u = 1 unit or a power of 1000 that reaches 1 µm/m, with inertia relief for a `free` structure.
    Training simulation: at the instant of the largest strain energy ½ qᵀKq."""
    if not mesh.has_surface:
        return ()
    try:
        rows = facet_strain(mesh, exterior_facets(mesh)).matrix @ reduced.basis
    except DeckError:  # imported matrices without the Poisson ratio that incompatible modes need
        return ()
    model = reduced.model
    K = model.stiffness.at(model.reference)

    def at(q: np.ndarray) -> np.ndarray:
        return largest_principal((rows @ q).reshape(-1, 6))

    strains = []
    for name, q in zip(model.inputs, _at_rest(K, model.input_shape), strict=False):
        strain, size = at(q), 1.0
        while size < MOST_LOAD and size * np.abs(strain).max(initial=0.0) < LEAST_STRAIN:
            size *= 1000.0
        if size < MOST_LOAD:
            strains.append(SurfaceStrain(size * strain, name, size, loads[name].unit, free=free))
    for case in sorted(training.cases) or [""]:
        run = training.motion_in(case)
        k = int(np.argmax(np.einsum("ti,ij,tj->t", run.coordinate, K, run.coordinate, optimize=True)))
        strains.append(SurfaceStrain(at(run.coordinate[k]), case=case, instant=float(run.time[k])))
    return tuple(strains)


def _at_rest(K: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Static response q (inputs, r) to each single load, empty if K is singular."""
    if np.linalg.cond(K) > 1 / np.finfo(float).eps:
        return np.empty((0, len(K)))
    return np.linalg.solve(K, shape).T

"""Strain and stress where no gauge is: virtual gauges, the surface in a test, and the surface at the guess under each load."""

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
from strainsight.sensors.rows import channel_rows

SHOWN = ("strain", "strain_std", "stress", "von_mises", "von_mises_std", "principal")
FRAMES = 100
"""Pictures of the surface where no time between them is stated."""


@dataclass(frozen=True)
class Displaced:
    """Displacement basis (3 nodes, n + f) of n coordinates and, behind them, of the z of the smoother: what misaligned loads
    displace beyond the coordinates."""

    basis: np.ndarray
    coordinates: int

    def states(self, mean: np.ndarray) -> np.ndarray:
        """Where coordinates and z (n + f,) stand among the states (..., n* + f) of a smoother."""
        f = self.basis.shape[1] - self.coordinates
        return np.concatenate([np.arange(self.coordinates), np.arange(mean.shape[-1] - f, mean.shape[-1])])


def virtual_labels(entries: Sequence[NamedGauge]) -> tuple[str, ...]:
    """Names, or "V1", "V2 45°": every grid of `estimate.virtual`."""
    labels = [entry.name or f"V{i + 1}" for i, entry in enumerate(entries)]
    return tuple(
        label if len(entry.angles) == 1 else f"{label} {angle:g}°"
        for label, entry in zip(labels, entries, strict=True)
        for angle in entry.angles
    )


@dataclass(frozen=True)
class Virtual:
    """Grids of gauges that are not there; by coordinates and z, as those of `Displaced`: rows (g, n + f) of their strain at the
    references, and change (g, n + f), what a free thickness adds to them."""

    pool: Candidates
    rows: np.ndarray
    change: AffineOperator
    coordinates: int

    def read(self, model: FilterModel, x: np.ndarray, states: int) -> tuple[np.ndarray, np.ndarray]:
        """What they read at the first of `states` states of the smoother (T + 1, n* + …), and rows of its errors (g, states), or
        (T + 1, g, states) where they change with θ and the motion."""
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
        """What they would have read; run: of the filter, along which the smoother has kept σ."""
        states = smoothed.mean.shape[-1]
        return VirtualStrain(
            strain=self.read(model, smoothed.mean[:, 0], states)[0],
            std=smoothed.std_of(self.read(model, run.mean[:, 0], states)[1]),
            position=self.pool.position,
            direction=self.pool.direction,
        )


@blame("estimate.virtual")
def virtual_of(structure: Structure, field: Displaced) -> Virtual | None:
    """The gauges of `estimate.virtual`, each at the nearest point of the whole surface; None without one. Raises UserError for
    one off the surface."""
    config, mesh, gauges = structure.config, structure.mesh, structure.config.gauges
    entries = () if config.estimate is None else config.estimate.virtual
    if not entries:
        return None
    facets = structure.skin.facets
    stated = [
        BondedEntry(e.position, e.direction, gauges.grid_length if e.length is None else e.length, e.angles)
        for e in entries
    ]
    pool = bonded(mesh, facets, stated, gauges.snap_tolerance, key="estimate.virtual")[0]
    rows, change = rows_along(
        mesh,
        structure.free_thicknesses,
        lambda at: channel_rows(mesh.position, pool, field.basis, facets=facets, thickness=at),
    )
    return Virtual(pool, rows, change, field.coordinates)


@dataclass(frozen=True)
class Skin:
    """The surface of a reduced model: mesh, field of displacement, exterior facets, strain and stress at their middles, and the
    thicknesses that are free."""

    mesh: Mesh
    field: Displaced
    facets: Facets
    model: SurfaceModel
    free: tuple[Parameter, ...] = ()


def skin_of(mesh: Mesh, field: Displaced, parameters: Sequence[Parameter]) -> Skin:
    """Raises DeckError where a region of the surface has no material."""
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
    """Strain and stress of every exterior facet at instant k, with claimed σ where it is given."""
    free, x = model.unknowns.parameters, smoothed.mean[k, 0]
    displacing = skin.field.states(x)
    at = np.concatenate([displacing, np.arange(model.parameter_states.start, model.size)])
    theta = {name: float(value) for name, value in theta_of(model, x[: model.size]).items()}
    # θ = guess exp(p): to first order its covariance is that of p times θ.
    scale = np.concatenate([np.ones(len(displacing)), [theta[name] for name in free]])
    P = smoothed.covariance_at(k)[np.ix_(at, at)] * np.outer(scale, scale)
    return surface_state(skin.model, theta, x[displacing], P if np.isfinite(P).all() else None, free)


def surface_grid(
    skin: Skin, model: FilterModel, smoothed: Smoothed, stated: Field3D | None, damage: DamageAt | None = None
) -> VtkHdf | None:
    """The surface as a grid; None where neither pictures in time nor damage are asked for.

    stated: pictures in time of displacement, strain and stress of every exterior facet, with claimed σ where it is given;
    damage: of the facets, which all pictures show. Stress and its σ to first order in the coordinates and the estimated moduli.
    """
    if stated is None:
        return None if damage is None else damage_grid(skin, damage)
    displacing = skin.field.states(smoothed.mean)
    used, blocks, order = facet_cells(skin.facets)
    frames = frames_of(stated, smoothed.time)
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


def frames_of(stated: Field3D, time: np.ndarray) -> np.ndarray:
    """The instants of the pictures of the surface in time, of those of the smoother (T + 1,) [s]; a hundred where no time between
    them is stated."""
    step = stated.every or time[-1] / FRAMES
    frames = np.unique(np.round(np.arange(0, time[-1] + 0.5 * step, step) / (time[1] - time[0])).astype(int))
    return frames[frames < len(time)]


def damage_grid(skin: Skin, damage: DamageAt) -> VtkHdf:
    """Damage and equivalent range of every exterior facet, as a grid."""
    used, blocks, order = facet_cells(skin.facets)
    return unstructured_grid(skin.mesh.position[used], blocks, cell_data=_damage_shown(damage, order))


def _damage_shown(damage: DamageAt | None, order: np.ndarray) -> dict[str, np.ndarray]:
    """Of facets in the order of cells, without what is withheld."""
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
    """The surface when a channel reads most, by the offsets of the filter: the instant whose covariance `wanted_of` has kept."""
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
    """The principal strain of largest size with its sign: strain (p, 6), shears γ → (p,)."""
    tensors = np.concatenate([strain[:, :3], 0.5 * strain[:, 3:]], axis=1)
    three = principal(tensors)
    return np.where(np.abs(three[:, 0]) >= np.abs(three[:, 2]), three[:, 0], three[:, 2])


def largest(record: RecordFilter, last: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest reading: strains are looked at alone where there are any, else each channel beside its
    noise. last (n,): the states at the end, offsets of channels among them."""
    test, model = record.test, record.model
    offset = np.zeros(len(test.labels))
    offset[record.biased] = last[model.size :]
    kinds = np.broadcast_to(STRAIN if model.quantity is None else model.quantity, offset.shape)
    scale = np.where(kinds == STRAIN, 1.0, np.inf) if np.any(kinds == STRAIN) else record.noise_std
    return largest_reading(test.values, offset, scale)


def largest_reading(values: np.ndarray, offset: np.ndarray, scale: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest |reading − offset| over the scale of its channel, the first of equals.

    values (T, m), NaN where missing; offset, scale (m,). (0, 0) where there is no sample.
    """
    size = np.abs(values - offset) / scale
    size = np.where(np.isfinite(size), size, -1.0)
    k, channel = np.unravel_index(int(np.argmax(size)), size.shape)
    return int(k), int(channel)


def resultants_of(
    loads: Mapping[str, LoadSection], inputs: Sequence[str], model: FilterModel, smoothed: Smoothed
) -> dict[str, Resultant]:
    """ "0", "1", … → resultant of every place with more than one of the unknown loads, `inputs`.

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
    """Places with more than one of the unknown loads, and which of `inputs` these are (k,)."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(inputs):
        load = loads[name]
        if load.direction is not None:
            places.setdefault(f"node {load.node}" if load.node is not None else f"set {load.set}", []).append(i)
    return [(where, np.array(index)) for where, index in places.items() if len(index) > 1]


def displaced(reduced: Reduced, record: RecordFilter) -> Displaced:
    """By the coordinates of a filter, and by what misaligned loads add where it is a grid filter, which has z behind its
    states."""
    basis, n = reduced.basis, reduced.basis.shape[1]
    if record.problem.method == "bank":
        basis = np.hstack([basis, field_beyond(record.tolerances.loads, record.model, reduced)])
    return Displaced(basis, n)


def skin_in_test(structure: Structure, field: Displaced) -> tuple[Skin | None, tuple[str, ...]]:
    """The surface, or None where nothing is solid or no stress known, with the reason.

    Raises ConfigError where something of the surface is asked for and the mesh has no solids, DeckError
    where they have no material.
    """
    config, mesh, settings = structure.config, structure.mesh, structure.config.estimate
    assert settings is not None
    asked = [f"estimate.{name}" for name in ("field", "damage") if getattr(settings, name) is not None]
    if not mesh.has_surface:
        if asked:
            raise ConfigError(
                "the mesh has no solids, shells or sides of beams, and so no surface",
                key=asked[0],
                remedy="remove the key",
            )
        return None, ()
    try:
        return skin_of(mesh, field, parameters_of(config.parameters, mesh, structure.files, config.mesh)), ()
    except DeckError as error:
        # A model that came as matrices needs no materials, but for this.
        if asked:
            raise
        return None, (f"no strain and stress of the surface: {error.what}",)


def wanted_of(
    config: PlacementConfig, record: RecordFilter, virtual: Virtual | None, run: FilterRun
) -> WantedCovariances:
    """Covariances that the results of a test need of the smoother: of virtual gauges, of loads at one place, of the surface in
    its pictures; run: of the filter."""
    assert config.estimate is not None
    beyond = len(record.considered.load) if record.problem.method == "bank" else 0  # z of a grid filter's smoother
    states, field = len(record.covariance) + beyond, config.estimate.field
    frames = np.zeros(0) if field is None else frames_of(field, run.time)
    most = (largest(record, run.mean[-1, 0])[0] + 1) * record.test.every
    together = [index for _, index in places_of(config.loads, record.problem.unknowns.inputs)]
    return WantedCovariances(
        np.zeros((0, states)) if virtual is None else virtual.read(record.model, run.mean[:, 0], states)[1],
        record.model.position[np.unique(np.concatenate([np.zeros(0, int), *together]))],
        np.unique([*frames, most]).astype(int),
    )


LEAST_STRAIN = 1e-6
"""Strain that a unit load is made to reach, by thousands of its unit."""
MOST_LOAD = 10.0**9
"""Of its unit: beyond it a load strains nothing."""


@dataclass(frozen=True)
class SurfaceStrain:
    """Principal strain of largest size, with its sign, of every exterior facet at its middle (f,).

    load: the one that acts alone, "" : all of a training run; size [unit]: of that load; case: the load case of that run, "" as
    stated; instant [s] of that run; free: of a structure that the load accelerates as a whole.
    """

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
    """ε = B Ψ q at the guess, of every load alone and of every training run at one instant; none where nothing is solid.

    A load alone: q = K⁻¹ S u at rest, u one of its unit, or as many thousands of it as reach 1 µm/m; of a `free` structure
    (mesh.free) with the inertia of its rigid acceleration, of matrices that leave it loose none.
    A run: its coordinates at the instant of its largest strain energy ½ qᵀKq.
    """
    if not mesh.has_surface:
        return ()
    try:
        rows = facet_strain(mesh, exterior_facets(mesh)).matrix @ reduced.basis
    except DeckError:  # elements whose own modes need a Poisson ratio, of a model that came as matrices
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
    """q (inputs, r) under each load alone; none where K is singular."""
    if np.linalg.cond(K) > 1 / np.finfo(float).eps:
        return np.empty((0, len(K)))
    return np.linalg.solve(K, shape).T

"""What the estimate says of places that no gauge measured: virtual gauges, the strain and stress of the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.config.estimate import Estimate, Field3D
from strainsight.config.gauges import Gauges, NamedGauge
from strainsight.config.loads import Load
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, DeckError
from strainsight.estimation.model import FilterModel, surface_reading, theta_of
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed, WantedCovariances
from strainsight.experiment.structure.candidates import rows_along
from strainsight.experiment.structure.filtered_test import Filtering
from strainsight.experiment.structure.nuisances import Tolerated
from strainsight.experiment.structure.references import parameters_of
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
from strainsight.records.estimated import DamageAt, Moment, Resultant, VirtualStrain
from strainsight.records.reduced import Reduced
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.rows import channel_rows


def virtual_labels(entries: Sequence[NamedGauge]) -> tuple[str, ...]:
    """Names, or "V1", "V2 45°": every grid of `estimate.virtual`."""
    labels = [entry.name or f"V{i + 1}" for i, entry in enumerate(entries)]
    return tuple(
        label if len(entry.angles) == 1 else f"{label} {angle:g}°"
        for label, entry in zip(labels, entries, strict=True)
        for angle in entry.angles
    )


def virtual_strain(
    mesh: Mesh,
    field: Displaced,
    entries: Sequence[NamedGauge],
    gauges: Gauges,
    states: int,
    free: Sequence[Parameter] = (),
) -> Virtual | None:
    """Gauges that are not there, each at the nearest point of the surface; None without one.

    entries of `estimate.virtual`; gauges of the config: grid length and snapping tolerance; states: how many the filter has, with
    offsets; free: thicknesses of shells. Raises UserError for one off the surface.
    """
    if not entries:
        return None
    facets = exterior_facets(mesh)
    pool = virtual_pool(mesh, facets, entries, gauges)
    own, change = rows_along(
        mesh, free, lambda at: channel_rows(mesh.position, pool, field.basis, facets=facets, thickness=at)
    )
    n = field.coordinates
    rows = np.zeros((len(own), states + own.shape[1] - n))
    rows[:, :n], rows[:, states:] = own[:, :n], own[:, n:]
    return Virtual(pool, rows, change.of_terms(lambda X: X[:, :n]))


@dataclass(frozen=True)
class Virtual:
    """Grids of gauges that are not there; rows (g, n* + f) of their strain on the states of the smoother, at the references, and
    change (g, n): what a free thickness adds to them on the coordinates."""

    pool: Candidates
    rows: np.ndarray
    change: AffineOperator

    def read(self, model: FilterModel, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What they read at states (T + 1, n* + …), of which those that are there count, and rows of its errors (g, n* + f), or
        (T + 1, g, n* + f) where they change with θ and the motion."""
        rows, there = self.rows, x.shape[1]
        if not self.change.terms:
            return x @ rows[:, :there].T, rows
        n, size = model.model.size, model.size
        strain, J = surface_reading(model, rows[:, :n], self.change, x[:, :size])
        whole = np.array(np.broadcast_to(rows, (len(x), *rows.shape)))
        whole[..., :size] = J
        return strain + x[:, size:] @ rows[:, size:there].T, whole

    def smoothed(self, model: FilterModel, run: FilterRun, found: Smoothed) -> VirtualStrain:
        """What they would have read; run: what the filter found, along which the smoother has kept σ."""
        return VirtualStrain(
            strain=self.read(model, found.mean[:, 0])[0],
            std=found.std_of(self.read(model, run.mean[:, 0])[1]),
            position=self.pool.position,
            direction=self.pool.direction,
        )


def virtual_pool(mesh: Mesh, facets: Facets, entries: Sequence[NamedGauge], gauges: Gauges) -> Candidates:
    """The grids of `estimate.virtual` on the facets of the whole surface."""
    stated = [
        BondedEntry(e.position, e.direction, gauges.grid_length if e.length is None else e.length, e.angles)
        for e in entries
    ]
    return bonded(mesh, facets, stated, gauges.snap_tolerance, key="estimate.virtual")[0]


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
    facets, free = exterior_facets(mesh), tuple(own for own in parameters if own.property == THICKNESS)
    with mesh.located():
        rows = facet_strain(mesh, facets, parameters)
        model = surface_model(mesh, rows, field.basis, parameters)
        if free:
            strain, change = rows_along(mesh, free, lambda at: strain_matrix(mesh, facets, rows.laws, at) @ field.basis)
            shape = model.strain.shape
            model = replace(model, strain=strain.reshape(shape), change=change.of_terms(lambda own: own.reshape(shape)))
        return Skin(mesh, field, facets, model, free)


def _state(skin: Skin, model: FilterModel, smoothed: Smoothed, k: int) -> SurfaceState:
    """Strain and stress of every exterior facet at instant k, with claimed σ where it is given."""
    free, x = model.unknowns.parameters, smoothed.mean[k, 0]
    own = skin.field.states(x)
    at = np.concatenate([own, np.arange(model.parameter_states.start, model.size)])
    theta = {name: float(value) for name, value in theta_of(model, x[: model.size]).items()}
    # θ = guess exp(p): to first order its covariance is that of p times θ.
    scale = np.concatenate([np.ones(len(own)), [theta[name] for name in free]])
    P = smoothed.covariance_at(k)[np.ix_(at, at)] * np.outer(scale, scale)
    return surface_state(skin.model, theta, x[own], P if np.isfinite(P).all() else None, free)


def surface_in_time(
    skin: Skin, model: FilterModel, smoothed: Smoothed, stated: Field3D, damage: DamageAt | None = None
) -> VtkHdf:
    """Displacement, strain and stress of every exterior facet in time, as a grid with steps; with claimed σ where it is given.

    stated: the time between pictures, a hundred of them where it says none; damage: of the facets, which all pictures show.
    Stress and its σ to first order in the coordinates and the estimated moduli.
    """
    mesh, own = skin.mesh, skin.field.states(smoothed.mean)
    used, blocks, order = facet_cells(skin.facets)
    frames = frames_of(stated, smoothed.time)
    data: dict[str, list[np.ndarray]] = {}
    for k in frames:
        state = _state(skin, model, smoothed, int(k))
        for name in SHOWN:
            if (shown := getattr(state, name)) is not None:
                data.setdefault(name, []).append(shown[order].astype(np.float32))
    shapes = skin.field.basis.reshape(len(mesh.position), 3, -1)[used]
    displacement = np.stack([(shapes @ smoothed.mean[k, 0, own]).astype(np.float32) for k in frames])
    return unstructured_grid(
        mesh.position[used],
        blocks,
        point_data={"displacement": displacement},
        cell_data={name: np.stack(values) for name, values in data.items()} | _damage_shown(damage, order),
        steps=smoothed.time[frames],
    )


def frames_of(stated: Field3D, time: np.ndarray) -> np.ndarray:
    """The instants of the pictures of the surface in time, of those of the smoother (T + 1,) [s]."""
    step = stated.every or time[-1] / FRAMES
    frames = np.unique(np.round(np.arange(0, time[-1] + 0.5 * step, step) / (time[1] - time[0])).astype(int))
    return frames[frames < len(time)]


def damage_on_surface(skin: Skin, damage: DamageAt) -> VtkHdf:
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
    return {name: own[order] for name, own in names.items() if not np.isnan(own).all()}


def surface_then(skin: Skin, model: FilterModel, smoothed: Smoothed, k: int, time: float, label: str) -> Moment:
    """The surface at instant k of the smoother: `time` [s] on the clock of the file, when channel `label` reads most."""
    state, own = _state(skin, model, smoothed, k), skin.field.states(smoothed.mean)
    shapes = skin.field.basis.reshape(len(skin.mesh.position), 3, -1)
    return Moment(
        time=time,
        label=label,
        displacement=(shapes @ smoothed.mean[k, 0, own]).astype(np.float32),
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


def largest_reading(values: np.ndarray, offset: np.ndarray, scale: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest |reading − offset| over the scale of its channel, the first of equals.

    values (T, m), NaN where missing; offset, scale (m,). (0, 0) where there is no sample.
    """
    size = np.abs(values - offset) / scale
    size = np.where(np.isfinite(size), size, -1.0)
    k, channel = np.unravel_index(int(np.argmax(size)), size.shape)
    return int(k), int(channel)


def resultants_of(
    loads: Mapping[str, Load], inputs: Sequence[str], model: FilterModel, smoothed: Smoothed
) -> dict[str, Resultant]:
    """Place ("node 2") → resultant, for every place with more than one of the unknown loads, `inputs`.

    F = Σ dᵢ uᵢ over unit directions d;  σ of |F| to first order: e·D P Dᵀ·e with e = F/|F|.
    """
    found = {}
    for where, index in places_of(loads, inputs):
        d = np.array([loads[inputs[i]].direction for i in index], dtype=float)
        D = (d / np.linalg.norm(d, axis=1)[:, None]).T * model.amplitude[index]
        at = model.position[index]
        force = smoothed.mean[:, 0, at] @ D.T
        magnitude = np.linalg.norm(force, axis=1)
        e = force / np.where(magnitude > 0, magnitude, 1.0)[:, None]
        P = smoothed.covariance_of(at)
        along = e @ D
        std = np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", along, P, along), 0.0))
        found[where] = Resultant(place=where, force=force, magnitude=magnitude, std=std)
    return found


def places_of(loads: Mapping[str, Load], inputs: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Places with more than one of the unknown loads, and which of `inputs` these are (k,)."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(inputs):
        load = loads[name]
        if load.direction is not None:
            places.setdefault(f"node {load.node}" if load.node is not None else f"set {load.set}", []).append(i)
    return [(where, np.array(index)) for where, index in places.items() if len(index) > 1]


def displaced(reduced: Reduced, tolerances: Tolerated, given: Filtering) -> Displaced:
    """By the coordinates of a filter, and by what misaligned loads add where it is a bank, which has z behind its states."""
    basis, n = reduced.basis, reduced.basis.shape[1]
    if given.problem.method == "bank":
        basis = np.hstack([basis, field_beyond(tolerances.loads, given.model, reduced)])
    return Displaced(basis, n)


def skin_in_test(
    config: PlacementConfig, settings: Estimate, mesh: Mesh, field: Displaced, files: Mapping[str, Path]
) -> tuple[Skin | None, tuple[str, ...]]:
    """The surface, or None where nothing is solid or no stress known, with the reason.

    Raises ConfigError where something of the surface is asked for and the mesh has no solids, DeckError
    where they have no material.
    """
    keys = {"estimate.field": settings.field, "estimate.damage": settings.damage}
    asked = [key for key, stated in keys.items() if stated is not None]
    if not mesh.has_surface:
        if asked:
            raise ConfigError(
                "the mesh has no solids, shells or sides of beams, and so no surface",
                key=asked[0],
                remedy="remove the key",
            )
        return None, ()
    try:
        return skin_of(mesh, field, parameters_of(config.parameters, mesh, files, config.mesh)), ()
    except DeckError as error:
        # A model that came as matrices needs no materials, but for this.
        if asked:
            raise
        return None, (f"no strain and stress of the surface: {error.what}",)


def grid_of(
    settings: Estimate, skin: Skin | None, given: Filtering, smoothed: Smoothed, damage: DamageAt | None
) -> VtkHdf | None:
    """The surface as a grid, with steps where it is asked for in time; None where neither that nor damage is."""
    if skin is None or (settings.field is None and damage is None):
        return None
    if settings.field is not None:
        return surface_in_time(skin, given.model, smoothed, settings.field, damage)
    assert damage is not None
    return damage_on_surface(skin, damage)


def moment_of(skin: Skin, given: Filtering, run: FilterRun, smoothed: Smoothed) -> Moment:
    """The surface when a channel reads most, by the offsets of the filter: the instant whose covariance `wanted_of` has kept."""
    k, channel = largest(given, run.mean[-1, 0])
    then, test = (k + 1) * given.test.every, given.test
    return surface_then(skin, given.model, smoothed, then, float(test.time[k + 1]), test.labels[channel])


def largest(given: Filtering, last: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest reading: strains are looked at alone where there are any, else each channel beside its
    noise. last (n,): the states at the end, offsets of channels among them."""
    test, model = given.test, given.model
    offset = np.zeros(len(test.labels))
    offset[given.biased] = last[model.size :]
    kinds = STRAIN if model.quantity is None else np.asarray(model.quantity)
    noise = np.sqrt(model.noise.reshape(-1, len(test.labels)).mean(axis=0))
    scale = np.where(kinds == STRAIN, 1.0, np.inf) if np.any(kinds == STRAIN) else noise
    return largest_reading(test.values, offset, np.broadcast_to(scale, noise.shape))


def wanted_of(
    settings: Estimate, loads: Mapping[str, Load], given: Filtering, virtual: Virtual | None, run: FilterRun
) -> WantedCovariances:
    """Covariances that the results of a test need of the smoother: of virtual gauges, of loads at one place, of the surface in
    its pictures. run: what the filter found."""
    field = np.zeros(0) if settings.field is None else frames_of(settings.field, run.time)
    most = (largest(given, run.mean[-1, 0])[0] + 1) * given.test.every
    together = [at for _, at in places_of(loads, given.problem.unknowns.inputs)]
    return WantedCovariances(
        np.zeros((0, given.smoothed_states)) if virtual is None else virtual.read(given.model, run.mean[:, 0])[1],
        given.model.position[np.unique(np.concatenate([np.zeros(0, int), *together]))],
        np.unique([*field, most]).astype(int),
    )

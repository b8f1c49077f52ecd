"""Reduction of flexible bodies of a bench (thesis 1.8-1.17), and strain and stress of their surface in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from strainsight.config.bench.bench import BenchConfig, SurfaceField
from strainsight.config.bench.bodies import FlexibleBodySection, FrameSection, Modulus
from strainsight.errors import ConfigError, InfeasibleError, blame
from strainsight.experiment.recorded import damping_of, named_regions
from strainsight.experiment.system import Resources
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.model import FiniteElementModel, build_model, nodal
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.mesh.additions import region_ids
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import facet_cells, unstructured_grid
from strainsight.multibody.bodies import RIGID
from strainsight.ordering import index_of_largest
from strainsight.records.bench import ReducedBodies, ReducedBody, SurfaceHistory
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import written
from strainsight.rom.craig_bampton import (
    CraigBampton,
    craig_bampton,
    floating_basis,
    motion_rows,
    reach,
    rigid_motions,
    rows_of,
)
from strainsight.rom.inertia import inertia_invariants
from strainsight.rom.model import Damping
from strainsight.runner.output import Output, Scalar, Table

USUAL_MODES = 10
FIXED_INTERFACE = 2.0
"""Fixed-interface modes are kept up to this factor times the cut-off, for an error of 0.5 % (test_craig_bampton.py)."""


def reduce_output(config: BenchConfig, meshes: Mapping[str, Mesh], using: Resources) -> Output:
    """Output of the reduction: reduced bodies and their natural frequencies."""
    reduced: dict[str, ReducedBody] = {}
    summary: dict[str, Scalar] = {}
    text, tables = [], []
    for i, (name, entry) in enumerate(config.flexible.items()):
        using.progress(name, i / len(config.flexible))
        with blame(f"bodies.{name}"):
            body, freedoms, frequency = _reduction(name, entry, config.frames, meshes[name])
        reduced[name], first, size = body, float(frequency[0]), len(body.mass)
        summary |= {f"unknowns.{name}": freedoms, f"coordinates.{name}": size, f"first_frequency.{name}": first}
        text.append(
            f"{name} {freedoms} degrees of freedom → {size} coordinates, first mode {first:.4g} Hz, first omitted "
            f"mode {body.cut:.4g} Hz"
        )
        text += [
            f"the reduced model of {name} is valid for the modulus {key} from {low:.4g} to {high:.4g} Pa"
            for key, (low, high) in body.reach.items()
            if np.isfinite(high)
        ]
        rows = tuple((str(k), f"{f:.4g}") for k, f in enumerate(frequency[:12], start=1))
        tables.append(Table(f"natural frequencies of {name} with free interfaces", ("mode", "Hz"), rows))
    return Output(
        datasets=written(ReducedBodies(bodies=reduced)),
        summary=summary,
        message="; ".join(text) or "the bench has no flexible bodies",
        tables=tuple(tables),
    )


def _reduction(
    name: str, entry: FlexibleBodySection, frames: Mapping[str, FrameSection], mesh: Mesh
) -> tuple[ReducedBody, int, np.ndarray]:
    """Craig-Bampton reduction in the floating frame; also returns the number of finite-element unknowns and the elastic
    frequencies [Hz] with free interfaces."""
    model = build_model(mesh, moduli_of(name, entry.moduli, mesh), supported=False)
    loose = rigid_motions(model).shape[1]
    if loose not in (0, 6):
        raise ConfigError(
            f"the supports leave {loose} of the six rigid-body motions free",
            key=f"bodies.{name}.mesh.supports",
            remedy="Support the body completely, or remove all supports and use joints.",
        )
    nodes = _interface(name, frames, model)
    reference = {key: modulus.value for key, modulus in entry.moduli.items()}
    modes = None if entry.cutoff is not None else USUAL_MODES if entry.modes is None else entry.modes
    cutoff = None if entry.cutoff is None else FIXED_INTERFACE * entry.cutoff
    body = craig_bampton(model, nodes, modes=modes, cutoff=cutoff, reference=reference)
    good = reach(model, body, nodes, reference)
    damping = body_damping(body, damping_of(entry.damping), reference, loose)
    lam = eigh(body.stiffness.at(reference), body.mass, eigvals_only=True)
    if loose:
        stay = np.flatnonzero(~rows_of(body, nodes[0]).any(axis=0))
        damping = damping.of_all(lambda matrix: matrix[np.ix_(stay, stay)])
        body = floating_basis(body, nodes[0])
    reduced = ReducedBody(
        clamped=loose == 0,
        frequency=body.frequency,
        cut=body.cut,
        reach={key: np.array(ends) for key, ends in good.items()},
        mass=body.mass,
        stiffness=body.stiffness,
        damping=damping,
        basis=nodal(model, body.basis),
        interface={str(node): rows for node, rows in body.interface.items()},
        inertia=inertia_invariants(model, body.basis),
    )
    return reduced, model.size, np.sqrt(np.maximum(lam, 0.0))[loose:] / (2 * np.pi)


def moduli_of(name: str, moduli: Mapping[str, Modulus], mesh: Mesh) -> tuple[Parameter, ...]:
    """Parametric Young's moduli of a body, with the ids of their regions."""
    parameters = []
    for key, modulus in moduli.items():
        with blame(f"bodies.{name}.moduli.{key}.region"):
            regions = region_ids(mesh, named_regions(modulus.region))
        parameters.append(Parameter(key, "youngs_modulus", regions, modulus.value))
    return tuple(parameters)


def _interface(name: str, frames: Mapping[str, FrameSection], model: FiniteElementModel) -> list[int]:
    """Interface nodes of the body's frames, ascending."""
    nodes = set()
    for key, frame in frames.items():
        if frame.body == name and frame.node is not None:
            with blame(f"frames.{key}.node"):
                motion_rows(model, frame.node)
            nodes.add(frame.node)
    if not nodes:
        raise ConfigError(
            f"the flexible body '{name}' has no frame at a node",
            key=f"bodies.{name}",
            remedy="Add a frame with `body` and `node` to `frames`.",
        )
    return sorted(nodes)


def body_damping(body: CraigBampton, law: Damping, reference: Mapping[str, float], loose: int) -> AffineOperator:
    """C = αM̃ + βK(θ), or  M Φ diag(2ζω) Φᵀ M  with the modes at the reference, the first `loose` rigid and undamped:

    M̃ = M Φ_e Φ_eᵀ M,  Φ_e elastic modes: structural damping does not act on rigid-body motion
    """
    lam, Phi = eigh(body.stiffness.at(reference), body.mass)
    # by count, because a relative threshold would also catch slow elastic modes
    lam[:loose] = 0.0
    omega = np.sqrt(lam)
    MPhi = body.mass @ Phi
    if law.kind == "rayleigh":
        elastic = (MPhi * (omega > 0)) @ MPhi.T
        slope = body.stiffness.of_all(lambda X: law.beta * X)
        return replace(slope, constant=law.alpha * elastic + slope.constant)
    return AffineOperator((MPhi * (2 * law.ratio * omega)) @ MPhi.T, {})


PICTURES = 50


@dataclass(frozen=True)
class BodyMotion:
    """time (T,) [s]; q (T, coordinates of the body); moduli (T,) [Pa]: estimated ones."""

    time: np.ndarray
    q: np.ndarray
    moduli: Mapping[str, np.ndarray]


def field_output(config: BenchConfig, mesh: Mesh, reduced: ReducedBody, motion: BodyMotion, using: Resources) -> Output:
    """Surface fields at some instants: displacement and strain in body axes, stress with the moduli of these instants."""
    settings = config.field
    assert settings is not None
    time, q, modes = motion.time, motion.q, len(reduced.mass)
    at = instants(len(time), settings)
    if not np.isfinite(q[at]).all():
        lost = time[at][~np.isfinite(q[at]).all(axis=1)][0]
        raise InfeasibleError(
            f"the estimate diverged before t = {lost:g} s, so strain and stress at later times are not available",
            key="field.of",
            remedy="Correct the estimate, or set field.of: simulate.",
        )
    parameters = moduli_of(settings.body, config.flexible[settings.body].moduli, mesh)
    theta = {p.name: motion.moduli.get(p.name, np.full(len(time), p.reference))[at] for p in parameters}
    facets = exterior_facets(mesh)
    with mesh.located():
        surface = surface_model(mesh, facet_strain(mesh, facets), reduced.basis, parameters)
    used, blocks, order = facet_cells(facets)
    data: dict[str, list[np.ndarray]] = {key: [] for key in ("strain", "stress", "von_mises", "principal")}
    for i, k in enumerate(at):
        using.progress("frames", i / len(at))
        now = {key: float(values[i]) for key, values in theta.items()}
        state = surface_state(surface, now, q[k, q.shape[1] - modes :])
        for key, values in data.items():
            values.append(getattr(state, key)[order].astype(np.float32))
    shapes = reduced.basis.reshape(len(mesh.position), 3, -1)[used]
    surface_grid = unstructured_grid(
        mesh.position[used],
        blocks,
        point_data=points(mesh.position[used], shapes, q[at], modes),
        cell_data={key: np.stack(values) for key, values in data.items()},
        steps=time[at],
    )
    mises = np.stack(data["von_mises"])
    worst, where = np.unravel_index(index_of_largest(mises.astype(float).ravel()), mises.shape)
    element, largest, instant = int(facets.element_id[order][where]), float(mises.max()), float(time[at][worst])
    grid, attributes = vtkhdf_datasets(surface_grid)
    return Output(
        datasets=grid | written(SurfaceHistory(time=time[at], von_mises=mises.max(axis=1), moduli=theta)),
        attributes=attributes,
        summary={"pictures": len(at), "facets": len(order), "von_mises": largest, "time": instant, "element": element},
        message=f"{settings.body} at {len(at)} instants, {len(order)} facets, largest von Mises stress "
        f"{largest / 1e6:.4g} MPa at t = {instant:.4g} s in element {element}",
    )


def instants(count: int, settings: SurfaceField) -> np.ndarray:
    """Indices of the frames among `count` steps."""
    if settings.every is not None:
        return np.arange(0, count, settings.every)
    wanted = PICTURES if settings.instants is None else settings.instants
    return np.unique(np.linspace(0, count - 1, wanted).astype(int))


def points(x: np.ndarray, shapes: np.ndarray, q: np.ndarray, modes: int) -> dict[str, np.ndarray]:
    """Displacement Φη in body axes, and motion p − x = r + R(x + Φη) − x in global axes: frames × points × xyz.

    x (n, 3) [m]; shapes Φ (n, 3, modes); q (frames, coordinates of the body)."""
    u = np.einsum("nck,tk->tnc", shapes, q[:, q.shape[1] - modes :])
    moved = {"displacement": u.astype(np.float32)}
    if q.shape[1] > modes:
        R = q[:, 3:RIGID].reshape(-1, 3, 3)  # transposed
        moved["motion"] = (q[:, None, :3] + np.einsum("tnc,tcd->tnd", x + u, R) - x).astype(np.float32)
    return moved

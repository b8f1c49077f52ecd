"""reduce: every flexible body to the motions of its interface nodes and a few modes (thesis 1.8-1.17)."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigh

from strainsight.cases.structure.settings import damping_of, named_regions
from strainsight.errors import ConfigError, blame
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.model import FiniteElementModel, build_model, nodal
from strainsight.mesh.additions import region_ids
from strainsight.mesh.model import Mesh
from strainsight.records.bodies import body_datasets
from strainsight.records.mesh import mesh_from
from strainsight.rom.craig_bampton import (
    CraigBampton,
    craig_bampton,
    floating_basis,
    motion_rows,
    rigid_motions,
    rows_of,
)
from strainsight.rom.inertia import inertia_invariants
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

USUAL_MODES = 10
HELD = 2.0
"""Modes with held interfaces are kept up to so many times the cut-off: frequencies of the body below it are then right to
0.5 % (test_craig_bampton.py)."""


def run(context: Context) -> Output:
    """Assemble, constrain, reduce after Craig and Bampton; the inertia of the body in its floating frame."""
    datasets: dict[str, Dataset] = {}
    summary: dict[str, Scalar] = {}
    tables, said = [], []
    flexible = {name: body for name, body in context.config.bodies.items() if body.type == "flexible"}
    for i, (name, entry) in enumerate(flexible.items()):
        context.progress(name, i / len(flexible))
        mesh = mesh_from(context.upstream["import"], f"/bodies/{name}")
        with blame(f"bodies.{name}"):
            model = build_model(mesh, moduli_of(name, entry.moduli, mesh), supported=False)
            loose = rigid_motions(model).shape[1]
            if loose not in (0, 6):
                raise ConfigError(
                    f"the supports leave {loose} of the six rigid motions",
                    key=f"bodies.{name}.mesh.supports",
                    remedy="hold the body altogether, or not at all and let joints carry it",
                )
            nodes = _interface(name, context.config.frames, model)
            reference = {key: float(modulus.value) for key, modulus in entry.moduli.items()}
            modes = None if entry.cutoff is not None else USUAL_MODES if entry.modes is None else int(entry.modes)
            cutoff = None if entry.cutoff is None else HELD * float(entry.cutoff)
            body = craig_bampton(model, nodes, modes=modes, cutoff=cutoff, reference=reference)
            damping = _damping(body, entry.damping, reference, loose)
            frequency = _frequencies(body, reference)[loose:]
            if loose:
                stay = np.flatnonzero(~rows_of(body, nodes[0]).any(axis=0))
                damping = _cut(damping, stay)
                body = floating_basis(body, nodes[0])
            inertia = inertia_invariants(model, body.basis)
        datasets |= body_datasets(name, body, inertia, damping, nodal(model, body.basis), loose == 0)
        summary |= {
            f"unknowns.{name}": model.size,
            f"coordinates.{name}": body.size,
            f"first_frequency.{name}": frequency[0],
        }
        said.append(
            f"{name} {model.size} unknowns → {body.size}, first mode {frequency[0]:.4g} Hz, cut {body.cut:.4g} Hz"
        )
        rows = tuple((str(k), f"{f:.4g}") for k, f in enumerate(frequency[:12], start=1))
        tables.append(Table(f"natural frequencies of {name}, its interfaces free", ("mode", "Hz"), rows))
    return Output(
        datasets=datasets, summary=summary, message="; ".join(said) or "no flexible body", tables=tuple(tables)
    )


def moduli_of(name: str, moduli: Any, mesh: Mesh) -> tuple[Parameter, ...]:
    """The Young's moduli of a body that stay free, each with the ids of its regions."""
    found = []
    for key, modulus in moduli.items():
        with blame(f"bodies.{name}.moduli.{key}.region"):
            regions = region_ids(mesh, named_regions(modulus.region))
        found.append(Parameter(key, "youngs_modulus", regions, float(modulus.value)))
    return tuple(found)


def _interface(name: str, frames: Any, model: FiniteElementModel) -> list[int]:
    """Interface nodes: those of the body's frames, ascending, because the order of frames in a config is none."""
    nodes = []
    for key, frame in frames.items():
        if frame.body == name:
            with blame(f"frames.{key}.node"):
                motion_rows(model, int(frame.node))
            nodes.append(int(frame.node))
    if not nodes:
        raise ConfigError(
            f"no frame is on '{name}'", key=f"bodies.{name}", remedy="give a frame at the node that carries it"
        )
    return sorted(set(nodes))


def _damping(body: CraigBampton, law: Any, reference: dict[str, float], loose: int) -> AffineOperator:
    """C = αM̃ + βK(θ), or  M Φ diag(2ζω) Φᵀ M  of the body's own modes at the reference, the first `loose` rigid and undamped:

    M̃ = M Φ_e Φ_eᵀ M,  Φ_e the modes that deform the body: a law of the structure brakes no rigid motion
    """
    damping = damping_of(law)
    lam, Phi = eigh(body.stiffness.at(reference), body.mass)
    # counted: a share of the largest eigenvalue would take slow modes beside stiff residual vectors for rigid ones
    lam[:loose] = 0.0
    omega = np.sqrt(lam)
    MPhi = body.mass @ Phi
    if damping.kind == "rayleigh":
        terms = {key: damping.beta * X for key, X in body.stiffness.terms.items()}
        elastic = (MPhi * (omega > 0)) @ MPhi.T
        return AffineOperator(damping.alpha * elastic + damping.beta * body.stiffness.constant, terms)
    return AffineOperator((MPhi * (2 * damping.ratio * omega)) @ MPhi.T, {})


def _cut(X: AffineOperator, stay: np.ndarray) -> AffineOperator:
    square = np.ix_(stay, stay)
    return AffineOperator(X.constant[square], {key: term[square] for key, term in X.terms.items()})


def _frequencies(body: CraigBampton, reference: dict[str, float]) -> list[float]:
    lam = eigh(body.stiffness.at(reference), body.mass, eigvals_only=True)
    return (np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi)).tolist()


REDUCE = Stage(
    "reduce",
    version=3,
    reads=(
        "bodies.*.type",
        "bodies.*.modes",
        "bodies.*.cutoff",
        "bodies.*.damping",
        "bodies.*.moduli",
        "frames.*.body",
        "frames.*.node",
    ),
    upstream=("import",),
    files=(),
    run=run,
)

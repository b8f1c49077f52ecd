"""What really happens in a validation: a model that is not the filter's, its motion, and what its gauges read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.errors import blame
from strainsight.fem.affine import Parameter
from strainsight.fem.model import nodal
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.rows import strain_rows
from strainsight.mesh.model import Mesh
from strainsight.rom.modal_step import simulate
from strainsight.rom.reduction import modal_model
from strainsight.stages.case.full_model import full_model
from strainsight.stages.case.problem import Problem
from strainsight.stages.case.settings import load_shapes, parameters_of
from strainsight.stages.records.gauges import given_from
from strainsight.workflow.stage import Context


@dataclass(frozen=True)
class Truth:
    """theta: true parameter values [SI]; q (T + 1, r) coordinates; field (3 nodes, r) displacement per coordinate;
    offset [m] and rotation [deg]: how far every gauge is glued from where it was meant; rows (m, r): strain per coordinate
    of gauges given by their strain rows, which cannot be misplaced; description for people."""

    theta: Mapping[str, float]
    q: np.ndarray
    field: np.ndarray
    offset: float
    rotation: float
    description: str
    rows: np.ndarray | None = None

    def strain(self, mesh: Mesh, pool: Candidates, seed: int) -> np.ndarray:
        """True strain (T + 1, m) of gauges that are off by `offset` in a random direction and turned by ± `rotation`."""
        if self.rows is not None:
            return self.q @ self.rows.T
        rng = np.random.default_rng(seed)
        heading = rng.uniform(0, 2 * np.pi, len(pool.element))
        offset = self.offset * np.column_stack([np.cos(heading), np.sin(heading)])
        rotation = self.rotation * rng.choice([-1.0, 1.0], len(pool.element))
        return self.q @ strain_rows(mesh.position, pool, self.field, offset=offset, rotation=rotation).T


def truth_of(context: Context, problem: Problem, mesh: Mesh, u: np.ndarray, h: float) -> Truth:
    """Simulate the truth that the config asks for under the held loads u (T, HOLD, n_u) at step h [s]:

    rom    the filter's own model at the true parameters: an inverse crime, and said so (the thesis's case)
    modes  `modes` modes with their static terms at the true parameters
    rich   that, with other damping and gauges off their places
    """
    stated = context.config.validate.truth
    theta = {**problem.model.reference, **{name: float(value) for name, value in stated.parameters.items()}}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in stated.parameters.items())
    if stated.model == "rom":
        x = simulate(problem.model, theta, u, h)
        description = f"the filter's own reduced model with {values or 'the same parameters'} (an inverse crime)"
        rom, train = context.upstream["rom"], context.upstream["train"]
        rows = train["/gauges/row"] if given_from(train) is not None else None
        return Truth(theta, x[:, : problem.model.size], rom["/basis"], 0.0, 0.0, description, rows)
    parameters = _at(theta, parameters_of(context.config.parameters, mesh, context.files, context.config.mesh.matrices))
    built = full_model(context.config, mesh, parameters, context.files)
    full, given = built.model, given_from(context.upstream["train"])
    with blame("validate.truth"):
        S = load_shapes(full, {name: context.config.loads[name] for name in problem.model.inputs})
        rich = stated.model == "rich"
        damping = problem.model.damping.scaled(stated.damping_factor if rich else 1.0)
    with blame("validate.truth.modes"):
        model, basis = modal_model(full, S, problem.model.inputs, theta, stated.modes, damping)
    x = simulate(model, model.reference, u, h)
    description = f"{stated.modes} modes of the full model with static terms, {values or 'the same parameters'}"
    if rich:
        description += f", damping × {stated.damping_factor:g}"
    if rich and given is not None:
        description += ", gauges exactly in place, because given strain rows cannot be moved or turned"
    elif rich:
        description += f", gauges off by {1e3 * stated.gauge_offset:g} mm and {stated.gauge_rotation:g}°"
    return Truth(
        theta,
        x[:, : model.size],
        nodal(full, basis),
        stated.gauge_offset if rich else 0.0,
        stated.gauge_rotation if rich else 0.0,
        description,
        None if given is None else given @ (built.motion @ basis),
    )


def _at(theta: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    return tuple(Parameter(p.name, p.property, p.regions, theta[p.name]) for p in parameters)

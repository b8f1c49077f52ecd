"""How far gauges of a bench that are not quite where and what they are taken for are off in its run, pose by pose."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.installed import std_of
from strainsight.experiment.bench.inverse.unknowns import asked
from strainsight.experiment.bench.loads import loads_of
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.multibody.inverse.start import static_response
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.sensitivity import SECOND, sensitivity_rows

AT_A_TIME = 4000
"""Gauges whose sensitivities are held in memory."""
INSTANTS = 200
"""Of a run, at which its loads are asked."""


def installation_offs(
    config: BenchConfig,
    body: str,
    bench: Bench,
    files: Mapping[str, Path],
    mesh: Mesh,
    basis: np.ndarray,
    gauges: Candidates,
    time: np.ndarray,
    poses: list[tuple[np.ndarray, np.ndarray]],
    zero: np.ndarray,
) -> np.ndarray:
    """√v (poses, m) [strain] of gauges on a body, by `estimate.tolerances`, to first order as the filter has them:

        vⱼ = Σₖ σₖ² mean_t (sₖⱼ (η − η₀))²,     η = η_pose + ∂η/∂u (u(t) − u_pose)

    over as much of the run as is nearest to the pose, quasi-static: what is off with the motion of its modes is left out.
    time (poses,) [s] and poses (q, u); zero (r,): η₀ of gauges that are zeroed, else none. Zeros without tolerances.
    """
    sigma = {name: value for name, value in std_of(config).by_name.items() if value > 0 and name not in SECOND}
    v = np.zeros((len(poses), len(gauges)))
    if not sigma:
        return v
    modal = bench.system.modal(body)
    run = np.linspace(0.0, float(asked(config).duration or config.simulate.duration), INSTANTS)
    loads, nearest = loads_of(config, bench, files)(run), np.abs(run[:, None] - time).argmin(axis=1)
    second: list[np.ndarray] = []
    for k, (q, u) in enumerate(poses):
        change = loads[nearest == k] - u if np.any(nearest == k) else np.zeros((1, len(u)))
        change[:, bench.system.drives.at :] = 0.0  # poses have them
        eta = (q + change @ static_response(bench.system, q, u, bench.theta)[0].T)[:, modal] - zero
        second.append(eta.T @ eta / len(eta))
    skin = exterior_facets(mesh)
    for own in np.array_split(np.arange(len(gauges)), len(gauges) // AT_A_TIME + 1):
        felt = sensitivity_rows(mesh.position, gauges.take(own), basis, std_of(config).position, facets=skin)
        for name, value in sigma.items():
            s = value * getattr(felt, name)
            v[:, own] += [np.einsum("mi,ij,mj->m", s, C, s, optimize=True) for C in second]
    return np.asarray(np.sqrt(v))

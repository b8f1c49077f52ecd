"""The masses of `chain` under a known and an unknown load, with constants that no filter knows of; a step by the textbook."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, expm

from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.model import FilterModel
from strainsight.loads.input_models import Unknowns

from .chain import MASSES, RATIO, REFERENCE, ROWS, STIFFNESS, H

STEPS = 50
NOISE, LOAD = 5e-4, 4.0
GAIN, OFFSET, DRIFT, DAMPING, STIFFER = 0.02, 4e-4, 4e-4, 0.3, 0.01
SHARE = np.arange(1, STEPS + 1)[:, None] / STEPS
"""Of the record (STEPS, 1), at the end of every step."""


def chain(parameters=(), kappa=0.3):
    """Two masses on two springs, a known force on the second and an unknown one, a random walk, on the first."""
    fixed = {name: value for name, value in REFERENCE.items() if name not in parameters}
    rows = np.hstack([ROWS, np.zeros((2, 3 + len(parameters)))])
    Q = np.diag([0, 0, 1e-6, 1e-6, kappa, *[0.0] * len(parameters)])
    unknowns = Unknowns(("unknown",), parameters, {"unknown": LOAD}, REFERENCE, frequency={"unknown": kappa})
    return FilterModel(MASSES, unknowns, ("known",), fixed, rows, Q, np.full(2, NOISE**2 * H), H)


def start(size=5):
    return np.diag([1e-8, 1e-8, 1e-6, 1e-6, 0.05, 0.2**2, 0.2**2][:size])


def forces():
    """Both held constant within every step (T, HOLD, 2)."""
    held = np.zeros((STEPS, 3, 2))
    held[:, 0, 0], held[:, 0, 1] = 3 * np.sin(0.7 * np.arange(STEPS)) + 2, LOAD
    return held


def steps_of(factors, stiffer=1.0, values=REFERENCE):
    """A (N, 4, 4) and B (N, 4, 2) of a step, by the textbook; factors (N, 2) on the damping of the modes."""
    lam, Phi = eigh(stiffer * sum(value * STIFFNESS[name] for name, value in values.items()))
    C = (Phi * (factors * 2 * RATIO * np.sqrt(lam))[:, None]) @ Phi.T
    F = np.zeros((len(factors), 6, 6))
    F[:, :2, 2:4] = np.eye(2)
    F[:, 2:4, :2], F[:, 2:4, 2:4] = -(Phi * lam) @ Phi.T, -C
    F[:, 2:4, 4:] = [[0.0, 1.0], [1.0, 0.0]]
    whole = expm(F * H)
    return whole[:, :4, :4], whole[:, :4, 4:]


def motion(A, B):
    """From rest (T + 1, N, 4) without any noise."""
    x = np.zeros((STEPS + 1, len(A), 4))
    for k, u in enumerate(forces()[:, 0]):
        x[k + 1] = (A @ x[k][..., None])[..., 0] + B @ u
    return x


def nominal():
    return motion(*steps_of(np.ones((1, 2))))[:, 0]


def moved(damping=(0.0, 0.0), stiffer=0.0, **logs):
    """The motion (T + 1, 4) with constants of so many σ, and parameters so far from their guess."""
    values = {name: value * np.exp(logs.get(name, 0.0)) for name, value in REFERENCE.items()}
    return motion(*steps_of(np.exp(DAMPING * np.array([damping])), np.exp(STIFFER * stiffer), values))[:, 0]


def readings(x, gain=(0, 0), offset=(0, 0), drift=(0, 0)):
    """What both gauges read (T, 2) of a motion (T + 1, ≥ 4), with constants of so many σ."""
    return x[1:, :2] @ ROWS.T * (1 + GAIN * np.array(gain)) + OFFSET * np.array(offset) + DRIFT * SHARE * drift


def constants(model):
    states = model.parameter_states.start
    D, E, offset = np.zeros((6, 2, states)), np.zeros((6, 2, 2)), np.zeros((6, 2))
    D[[0, 1], [0, 1], :2] = GAIN * ROWS
    offset[[2, 3], [0, 1]] = OFFSET
    E[[4, 5], [0, 1], 1] = DRIFT
    source = ("gain", "gain", "offset", "offset", "drift", "drift")
    return ConsideredParameters(source, D, E, offset, damping=DAMPING, stiffness=STIFFER)


def believed(model):
    """The mean the filter begins with: at rest under the constant load."""
    mean = np.zeros(model.size)
    mean[4] = 1.0
    return mean

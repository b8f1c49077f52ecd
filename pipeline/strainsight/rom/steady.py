"""The periodic motion of the reduced model under tones, as the simulation itself steps it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.rom.modal_step import modal_step
from strainsight.rom.model import ReducedModel

RESONANT = 1e-9
"""Share of the stiffness below which the dynamic stiffness of a mode is none."""


def steady_start(
    model: ReducedModel, theta: Mapping[str, float], h: float, frequency: np.ndarray, amplitude: np.ndarray
) -> np.ndarray:
    """x(0) of the motion that `simulate` has under u(t) = Σ Re U exp(iωt) when nothing of its beginning is left.

    Of one tone the quadratic hold is  uⱼ(kh) = Re cⱼ U zᵏ,  z = exp(iωh),  and so

        x(kh) = Re X zᵏ,    (zI − A) X = Σⱼ Bⱼ cⱼ U                  of every mode for itself

    with c of `hold_of_tones` and A, B of `modal_step`: the motion of the held load, periodic to rounding, not that of the sine.
    The two differ by the error of the hold, (ωh)³ω₀h/720; as h goes to 0 both are (K − ω²M + iωC) q = S U.
    theta: all parameters [SI]; h [s]; frequency ω (k,) [rad/s]; amplitude U (k, n_u) complex [N]. Returns x (2n,) = [q, q̇].
    Raises InfeasibleError where an undamped mode has the frequency of a tone.
    """
    step, n = modal_step(model, theta, h), model.size
    forces = amplitude @ (step.modes.T @ step.shape).T
    stiffness = (
        step.eigenvalue
        - frequency[:, None] ** 2
        + 1j * frequency[:, None] * model.damping.at(theta).viscous(step.eigenvalue)[0]
    )
    resonant, still = np.abs(stiffness) <= RESONANT * step.eigenvalue, forces == 0
    if (resonant & ~still).any():
        tone, mode = np.argwhere(resonant & ~still)[0]
        raise InfeasibleError(
            f"a load of {frequency[tone] / (2 * np.pi):.6g} Hz at the undamped mode {mode + 1}: no motion is periodic",
            remedy="give damping, or train.settle: none for a start from rest",
        )
    z = np.exp(1j * frequency * h)
    A = np.moveaxis(step.table[:, :2], -1, 0)
    drive = np.einsum("ijm,kj,km->kmi", step.table[:, 2:], hold_of_tones(frequency, h), forces)
    # an undamped mode at the frequency of a load that does not reach it stays at rest
    lhs = np.where(still[..., None, None], np.eye(2), z[:, None, None, None] * np.eye(2) - A)
    X = np.linalg.solve(lhs, drive[..., None])[..., 0]
    motion = X.real.sum(axis=0).reshape(n, 2)
    return np.concatenate([step.modes @ motion[:, 0], step.modes @ motion[:, 1]])


def hold_of_tones(frequency: np.ndarray, h: float) -> np.ndarray:
    """c (k, HOLD) = (1, −3 + 4√z − z, 2 − 4√z + 2z), z = exp(iωh): the quadratic hold of exp(iωt) over a step of h [s];
    frequency ω (k,) [rad/s]."""
    half = np.exp(0.5j * frequency * h)
    z = half**2
    return np.stack([np.ones_like(z), -3 + 4 * half - z, 2 - 4 * half + 2 * z], axis=1)

"""Models for a filter: the protocol, the reduced parametric model under known loads, and channel offsets."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from strainsight.estimation.interpolated_step import MOST, InterpolatedStep
from strainsight.estimation.model import FilterModel, measure, step
from strainsight.estimation.update import apply
from strainsight.rom.modal_step import HOLD, acceleration_map, modal_step

LOST = 10.0
"""A run diverges when a parameter deviates from its guess by a factor of exp(LOST)."""


class StepModel(Protocol):
    """xₖ₊₁ = f(xₖ + w⁻) + w,   w⁻ ~ N(0, before), w ~ N(0, process);     yₖ₊₁ = h(xₖ₊₁) + v,   v ~ N(0, noise)

    for steps k = 0, 1, … of length h [s]; yₖ₊₁ stands at the end of step k. The reduced parametric model is one
    (`DrivenModel`). An implicit step with constraints is another: its x holds a generalised force that f sets
    to zero and `before` draws anew, so that a disturbed state still fulfils the constraints.

    size n; channels m; h [s]; sets: how many covariances the model asks for by itself (1, or B where channels or noise
    differ from run to run); linear: A and J are the same at every x and in every step, so that runs share one covariance;
    position: indices of the states whose joint covariance is recorded; loss: what it means that a run has diverged, in words.
    """

    @property
    def size(self) -> int: ...
    @property
    def channels(self) -> int: ...
    @property
    def h(self) -> float: ...
    @property
    def sets(self) -> int: ...
    @property
    def linear(self) -> bool: ...
    @property
    def position(self) -> np.ndarray: ...
    @property
    def loss(self) -> str: ...

    def begin(self, x: np.ndarray, k: int) -> None:
        """Start step k at x (B, n): preparations for all trials and the noise of this step."""

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """f(x) and A = ∂f/∂x in step k: x (B, n) → (B, n) and (B or 1, n, n). A failed step gives NaN in its run."""

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """h(x) and J = ∂h/∂x at the end of step k: x (B, n) → (B, m) and (B or 1, m, n)."""

    def process(self, k: int) -> np.ndarray:
        """Covariance (n, n) or (B, n, n) added after step k."""

    def before(self, k: int) -> np.ndarray | None:
        """Covariance (n, n) or (B, n, n) added before step k; None for none."""

    def noise(self, k: int) -> np.ndarray:
        """Variances (m,) or (B, m) of the measurement at the end of step k."""

    def lost(self, x: np.ndarray) -> np.ndarray:
        """Mask (B,) of runs outside the range of the model, x (B, n)."""


@dataclass(frozen=True)
class DrivenModel:
    """`StepModel` of a FilterModel: known (T, HOLD, n_known) hold coefficients [N] of its known inputs. Where no parameter is
    estimated, the step and the measurement are linear: their matrices are built once and the known loads become a term a
    step."""

    model: FilterModel
    known: np.ndarray

    @property
    def size(self) -> int:
        return self.model.size

    @property
    def channels(self) -> int:
        return self.model.H.shape[-2]

    @property
    def h(self) -> float:
        return self.model.h

    @property
    def sets(self) -> int:
        return self.model.sets

    @property
    def linear(self) -> bool:
        return not self.model.unknowns.parameters

    @property
    def position(self) -> np.ndarray:
        return self.model.position

    @property
    def loss(self) -> str:
        names = " or ".join(self.model.unknowns.parameters)
        large = f"the estimate of {names} deviated from the guess by more than a factor of {np.exp(LOST):.0f}"
        return large if names else "the state is not finite"

    def begin(self, x: np.ndarray, k: int) -> None:
        pass

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        if self.linear:
            A, drive = self._linear_step
            return x @ A[0].T + drive[k], A
        if len(self.model.unknowns.parameters) > MOST:
            return step(self.model, x, self.known[k])
        return self._interpolated_step(x, k)

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        if self.linear:
            J, feed = self._linear_measurement
            y = apply(J, x)
            return (y if feed is None else y + feed[k]), J
        return measure(self.model, x, self.known[k].sum(axis=-2))

    def process(self, k: int) -> np.ndarray:
        return self.model.process

    def before(self, k: int) -> np.ndarray | None:
        return None

    def noise(self, k: int) -> np.ndarray:
        R = self.model.noise
        return R[k] if R.ndim == 3 else R

    def lost(self, x: np.ndarray) -> np.ndarray:
        finite = np.isfinite(x.sum(axis=1))
        return ~finite if self.linear else ~(finite & np.all(np.abs(x[:, self.model.parameter_states]) <= LOST, axis=1))

    def _interpolated_step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """`step` with interpolated matrices of motion and loads."""
        model, (known, hold, constant) = self.model, self._constants
        motion, inputs, parameters = model.motion, model.input_states, model.parameter_states
        matrices = self._interpolation.at(x[:, parameters])
        driven = np.concatenate([x[:, motion], known[k] + x[:, inputs] @ hold.T], axis=1)
        moved, ahead, J = (matrices @ driven[:, None, :, None])[..., 0], x.copy(), np.empty((len(x), *constant.shape))
        ahead[:, motion], ahead[:, inputs] = moved[:, 0], x[:, inputs] @ model.transition.T
        J[:] = constant
        J[:, motion, motion] = matrices[:, 0, :, : motion.stop]
        J[:, motion, inputs] = matrices[:, 0, :, motion.stop :] @ hold
        J[:, motion, parameters] = np.swapaxes(moved[:, 1:], 1, 2)
        return ahead, J

    @cached_property
    def _interpolation(self) -> InterpolatedStep:
        return InterpolatedStep(self.model)

    @cached_property
    def _constants(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Known loads as hold coefficients of all inputs (T, HOLD n_u), those of ζ as rows (HOLD n_u, k), and the constant rows
        of A* (n*, n*)."""
        model, loads = self.model, len(self.model.model.inputs)
        unknown, known = model.columns
        u, hold = np.zeros((*self.known.shape[:2], loads)), np.zeros((HOLD, loads, len(model.transition)))
        u[..., known], hold[:, unknown] = self.known, model.hold
        J = np.eye(model.size)
        J[model.input_states, model.input_states] = model.transition
        return u.reshape(len(u), -1), hold.reshape(HOLD * loads, -1), J

    @cached_property
    def _linear_step(self) -> tuple[np.ndarray, np.ndarray]:
        """A* (1, n*, n*) and what the known loads add in every step (T, n*)."""
        model, rest = self.model, np.zeros((len(self.known), self.model.size))
        drive, A = step(model, rest, self.known, modal_step(model.model, model.fixed, model.h, model.scheme))
        return A, drive

    @cached_property
    def _linear_measurement(self) -> tuple[np.ndarray, np.ndarray | None]:
        """J (b, m, n*) and what the known loads add to accelerometers in every step (T, b, m)."""
        model = self.model
        sensed = None if model.accelerometers is None else acceleration_map(model.model, model.fixed)
        J = measure(model, np.zeros((1, model.size)), np.zeros(self.known.shape[-1]), sensed)[1]
        if sensed is None or not self.known.size:
            return J, None
        end = self.known.sum(axis=1)[:, None]
        return J, measure(model, np.zeros((*end.shape[:2], model.size)), end, sensed)[0]


@dataclass(frozen=True)
class Biased:
    """y = h(x) + E b with a constant b for some channels: the `StepModel` of [x, b]. base: the model without; at (k,): the
    channels that have an offset; walk (k,): variances of what it changes by in a step, None for a constant. An offset that
    walks takes the slow part of the signal for itself: on a structure none does."""

    base: StepModel
    at: np.ndarray
    walk: np.ndarray | None = None
    size: int = field(init=False)
    channels: int = field(init=False)
    h: float = field(init=False)
    sets: int = field(init=False)
    linear: bool = field(init=False)
    position: np.ndarray = field(init=False)
    loss: str = field(init=False)

    def __post_init__(self) -> None:
        for name in ("channels", "h", "sets", "linear", "position", "loss"):
            object.__setattr__(self, name, getattr(self.base, name))
        object.__setattr__(self, "size", self.base.size + len(self.at))

    def begin(self, x: np.ndarray, k: int) -> None:
        self.base.begin(x[:, : self.base.size], k)

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        ahead, A = self.base.step(x[:, : self.base.size], k)
        return np.hstack([ahead, x[:, self.base.size :]]), bordered(A, np.eye(len(self.at)))

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        y, J = self.base.measure(x[:, : self.base.size], k)
        read = np.array(np.broadcast_to(y, (len(x), self.channels)))
        read[:, self.at] += x[:, self.base.size :]
        E = np.zeros((*J.shape[:-1], len(self.at)))
        E[..., self.at, range(len(self.at))] = 1.0
        return read, np.concatenate([J, E], axis=-1)

    def process(self, k: int) -> np.ndarray:
        walk = np.zeros(len(self.at)) if self.walk is None else self.walk
        return bordered(self.base.process(k), np.diag(walk))

    def before(self, k: int) -> np.ndarray | None:
        added = self.base.before(k)
        return None if added is None else bordered(added, np.zeros((len(self.at), len(self.at))))

    def noise(self, k: int) -> np.ndarray:
        return self.base.noise(k)

    def lost(self, x: np.ndarray) -> np.ndarray:
        return self.base.lost(x[:, : self.base.size])


def driven_with_offsets(model: FilterModel, known: np.ndarray, biased: np.ndarray | None = None) -> StepModel:
    """The reduced model under known loads (T, HOLD, n_known) [N]; biased (b,): channels with an offset, or None."""
    driven = DrivenModel(model, known)
    return driven if biased is None or not len(biased) else Biased(driven, biased)


def bordered(A: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """[[A, 0], [0, corner]] for A (..., n, n)."""
    n, k = A.shape[-1], len(corner)
    whole = np.zeros((*A.shape[:-2], n + k, n + k))
    whole[..., :n, :n], whole[..., n:, n:] = A, corner
    return whole

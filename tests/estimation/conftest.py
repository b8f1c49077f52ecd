"""A cantilever of Hermite beam elements in modal coordinates, and filters on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import LinearModels
from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import InputModel, Unknowns, input_intensity
from strainsight.rom.model import Damping, ReducedModel
from strainsight.sensors.candidates import ACCELERATION, STRAIN

from ..structures import beam_curvature, beam_matrices, clamped_beam
from .truth import draw_truth, plain_motion

LENGTH, WIDTH, HEIGHT, E, RHO = 2.0, 0.2, 0.195, 2.1e11, 7850.0
ELEMENTS = 16


@dataclass(frozen=True)
class Beam:
    """The model, with the strain of its upper face and the load it is built for."""

    model: ReducedModel
    shapes: np.ndarray

    def rows(self, *positions: float) -> np.ndarray:
        """Strain rows (m, n) at distances from the root [m]: ε = −(HEIGHT/2) w''."""
        return -0.5 * HEIGHT * beam_curvature(np.array(positions), ELEMENTS, LENGTH) @ self.shapes


def make_beam(
    modes: int = 10, ratio: float = 0.01, graded: bool = False, load_nodes: tuple[int, ...] = (ELEMENTS,)
) -> Beam:
    """E and rho belong to the whole beam, or (graded) to its root half, so that they change the mode shapes."""
    halves = (np.arange(ELEMENTS) >= ELEMENTS // 2) == np.arange(2)[:, None] if graded else np.array([[True], [False]])
    K, M = (
        np.array([clamped_beam(own[:, None, None] * blocks) for own in halves])
        for blocks in beam_matrices(ELEMENTS, LENGTH, WIDTH * HEIGHT**3 / 12, WIDTH * HEIGHT)
    )
    shapes = eigh(E * K.sum(axis=0), RHO * M.sum(axis=0), subset_by_index=(0, modes - 1))[1]
    S = np.zeros((2 * ELEMENTS + 2, len(load_nodes)))
    for column, node in enumerate(load_nodes):
        S[2 * node, column] = 1.0
    model = ReducedModel(
        mass=AffineOperator(RHO * M[1], {"rho": M[0]}).project(shapes),
        stiffness=AffineOperator(E * K[1], {"E": K[0]}).project(shapes),
        input_shape=shapes.T @ S[2:],
        inputs=("tip", "middle")[: len(load_nodes)],
        reference={"E": E, "rho": RHO},
        damping=Damping(ratio=ratio),
    )
    return Beam(model, shapes)


def make_filter(
    beam: Beam,
    inputs: tuple[str, ...] = (),
    parameters: tuple[str, ...] = (),
    known: tuple[str, ...] = (),
    h: float = 5e-4,
    strain_noise: float = 1e-6,
    noise_step: float = 5e-4,
    q_input: float = 0.1 * 2 * np.pi * 20,
    q_parameter: float = 0.05**2,
    q_velocity: float = 0.0,
    gauges: tuple[float, ...] = (0.05, 0.3, 0.9, 1.5),
    fixed: dict[str, float] | None = None,
    models: dict[str, InputModel] | None = None,
    accelerometers: int = 0,
    acceleration_noise: float = 0.5,
    **more: object,
) -> FilterModel:
    """`accelerometers` read q̈ where the first loads of the beam act; `more` goes to FilterModel."""
    unknowns = Unknowns(inputs, parameters, dict.fromkeys(inputs, 1e4), {"E": E, "rho": RHO}, models or {})
    n = beam.model.size
    own = [np.diag(input_intensity(unknowns.model_of(name), q_input)) for name in inputs]
    q = np.concatenate([np.zeros(n), np.full(n, q_velocity), *own, np.full(len(parameters), q_parameter)])
    rows = np.vstack([beam.rows(*gauges), beam.model.input_shape.T[:accelerometers]])
    H = np.hstack([rows, np.zeros((len(rows), len(q) - n))])
    r = np.full(len(rows), strain_noise**2 * noise_step)
    quantity = np.repeat([STRAIN, ACCELERATION], [len(gauges), accelerometers])
    r[quantity == ACCELERATION] = acceleration_noise**2 * noise_step
    return FilterModel(
        beam.model, unknowns, known, fixed or {"E": E, "rho": RHO}, H, np.diag(q), r, h, quantity, **more,
    )  # fmt: skip


def sine(t: np.ndarray, h: float, amplitude: float, hertz: float) -> np.ndarray:
    """Quadratic hold coefficients (T, 3, 1) of a sine through the ends and the middle of every step."""
    start, middle, end = (amplitude * np.sin(2 * np.pi * hertz * (t + shift)) for shift in (0, h / 2, h))
    return np.stack([start, 4 * middle - 3 * start - end, 2 * start + 2 * end - 4 * middle], axis=1)[..., None]


def plain_models(A, Q, H, D=None, A_nu=None) -> LinearModels:
    """One filter, nothing known; nuisances by D (d, m, n) of the readings and A_nu (e, n, n) of the step."""
    (m, n), D = H.shape, np.zeros((0, *H.shape)) if D is None else D
    A_nu = np.zeros((0, n, n)) if A_nu is None else A_nu
    d, e = len(D), len(A_nu)
    motion = plain_motion(A[None], np.zeros((1, n, 0)), A_nu[None], np.zeros((1, e, n, 0)))
    return LinearModels(
        motion, Q[None], H[None], np.zeros((1, m, 0)), D, np.zeros((d, m, 0)), np.zeros((d, m)), np.zeros((d, m, 0)),
        np.zeros((0, n)), np.zeros((0, 0)), np.zeros(d), np.zeros((1, d)), np.zeros(d, dtype=bool),
    )  # fmt: skip


class StepToy:
    """What a `StepModel` has beside its step, readings and noise."""

    h, sets, linear, loss = 0.1, 1, False, "it broke"

    def begin(self, x, k):
        pass

    def before(self, k):
        return None

    def lost(self, x):
        return ~np.isfinite(x).all(axis=1)


def prior(model, std=0.1):
    P = np.zeros((model.size, model.size))
    unknown = range(2 * model.model.size, model.size)
    P[unknown, unknown] = std**2
    return P


def drawn(make_filter, beam, sine, inputs, parameters, steps=60, runs=3, **options):
    """A model with its prior, known load and measurements of its own."""
    known = () if inputs else ("tip",)
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=known, **options)
    u = sine(model.h * np.arange(steps), model.h, 1e4, 20.0)[:, :, : len(known)]
    mean, P = np.zeros(model.size), prior(model)
    truth, y = draw_truth(model, mean, P, u, range(runs))
    return model, mean, P, u, truth, y

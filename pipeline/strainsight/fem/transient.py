"""Time integration of the full model: M(θ)z̈ + Cż + K(θ)z = S u(t), without a reduction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from math import ceil, comb, factorial

import numpy as np
from scipy import sparse

from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import BLOCK, Factor, factorise, factorise_complex
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import modes as lowest_modes


@dataclass(frozen=True)
class ViscousDamping:
    """C = αM + βK + Σ_i c_i (Mφ_i)(Mφ_i)ᵀ.

    alpha α [1/s]; beta β [s]; frequency ω (N,) [rad/s] and shapes φ (n_free, N) [1/√kg] of the lowest modes, at the same
    parameters as K and M; rate c (N,) [1/s]."""

    alpha: float = 0.0
    beta: float = 0.0
    frequency: np.ndarray = field(default_factory=lambda: np.zeros(0))
    shapes: np.ndarray | None = None
    rate: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def share(self, s: complex | np.ndarray) -> np.ndarray:
        """s cᵢ/(aᵢ + s cᵢ) (..., N), aᵢ = s² + s α + (1 + s β) ωᵢ²: the share that c_i removes from the motion φᵢ of a solution
        at s (Woodbury). The shapes are eigenvectors, (K + …)⁻¹Mφ = φ/a without a further solve."""
        damping = s * self.rate
        return np.asarray(damping / (s * s + s * self.alpha + (1 + s * self.beta) * self.frequency**2 + damping))


def modal_damping(
    K: sparse.csr_array, M: sparse.csr_array, ratio: float, modes: int, rigid: np.ndarray | None = None
) -> ViscousDamping:
    """Damping with the ratio ζ in each of the lowest N modes. Above them it grows as ζω/ω_N, because no sparse C has one ratio
    for all modes; static responses are unchanged:

        β = 2ζ/ω_N,  c_i = 2ζω_i − βω_i²

    K, M (n, n); modes N ≥ 1; rigid (n, k): the rigid-body modes of a free structure, which are not damped. Raises the errors of
    `fem.modes.modes`."""
    frequency, shapes = lowest_modes(K, M, modes, rigid=rigid)
    omega = 2 * np.pi * frequency
    beta = 2 * ratio / omega[-1]
    return ViscousDamping(0.0, beta, omega, shapes, 2 * ratio * omega - beta * omega**2)


FIRST_MODES = 4
LOAD_SHARE = 0.999
BAND = 1 / 2.56
"""Usable band of a measuring chain as a share of its sampling rate, below the transition band of its filter."""
DEGREES = (2, 4, 6)
RADIUS = 0.95
TOLERANCE = 1e-4
"""Largest relative error of the period, and largest added damping ratio, of a mode that a scheme resolves."""


@dataclass(frozen=True)
class Transient:
    """Readings at T + 1 instants: reading (T + 1, m), rows · z; acceleration (T + 1, a), acceleration rows · z̈; end
    (2, n_free), z and ż at the last one. highest [Hz]: up to it periods have an error of at most 1e-4, and no mode gains more
    damping than 1e-4."""

    reading: np.ndarray
    acceleration: np.ndarray
    end: np.ndarray
    highest: float


def transient(
    model: FiniteElementModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    damping: ViscousDamping,
    load_coefficients: np.ndarray,
    h: float,
    rows: sparse.csr_array | np.ndarray,
    acceleration_rows: sparse.csr_array | np.ndarray | None = None,
    *,
    highest: float | None = None,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Transient:
    """Integrate with x = [z, ż], x⁺ = R(hA)x + …, R a rational approximation of the exponential with poles p_k (`fem.pade`):

        (K + s_kC + s_k²M) w_k = (Kz/s_k − Mż − f_k)/h,     s_k = p_k/h,     f_k = Σⱼ j! h p_k^{−j−1} S uⱼ
        z⁺ = z + Σ_k 2 Re c_k w_k,        ż⁺ = R∞ż + Σ_k 2 Re c_k s_k w_k

    A force that is a polynomial within the step enters as in the exact variation of constants with R in place of the
    exponential, so that the response to a polynomial force is exact for modes of any frequency. The modal damping has low
    rank and is added to every solution (Woodbury).
    S (n_free, n_u) [-]; theta [SI]; load_coefficients (T, J, n_u): polynomial coefficients of the load in τ/h, J ≤ 3; h [s]
    between instants; rows (m, n_free) and acceleration_rows (a, n_free) of the readings, sparse or dense (`free_rows`
    computes them from rows of nodes); start: initial z and ż (n_free,), default rest; progress is called with the share done.
    highest [Hz]: up to it the period of every mode has an error of at most 1e-4; degree and substeps follow from it. Default:
    the band of the loads (99.9 % of their power) or the fourth mode, whichever is higher; with accelerations, which fast
    modes govern, at least 1/2.56 of the sampling rate.
    Memory: the factors, and about 32 instants of the motion. Raises UserError for accelerations of a model with massless
    unknowns, NumericalError where the motion is not finite, and the errors of `factorise` and `modes`.
    Source: Song, Eisenträger and Zhang (2022), in partial fractions."""
    K, M = model.stiffness.at(theta), model.mass.at(theta)
    mass = None
    if acceleration_rows is not None and acceleration_rows.shape[0]:
        if not np.all(M.diagonal() > 0):
            raise UserError(
                "the model has degrees of freedom without mass, so accelerations are undefined",
                remedy="Specify a density for all materials, or remove the accelerometers.",
            )
        mass = factorise(M)
    reach = highest
    if reach is None:
        reach = max(_reach(K, M, damping, load_coefficients, h, model.rigid), 0.0 if mass is None else BAND / h)
    scheme, substeps = choose(2 * np.pi * reach * h)
    step = _TransientStep(K, M, sparse.csr_array(S), damping, scheme, h, substeps, load_coefficients.shape[1])
    z, v = (np.zeros(K.shape[0]),) * 2 if start is None else start
    motion = np.stack([z, v]).astype(float)
    recorder = _Recorder(step, rows, acceleration_rows, mass, len(load_coefficients) + 1)
    for i in range(len(load_coefficients) + 1):
        u = load_coefficients[i, 0] if i < len(load_coefficients) else load_coefficients[-1].sum(axis=0)
        recorder.take(motion, u)
        if i < len(load_coefficients):
            motion = step.advance(motion, load_coefficients[i])
        if progress is not None and i % BLOCK == 0:
            progress(i / max(1, len(load_coefficients)))
    recorder.flush()
    if not np.all(np.isfinite(motion)):
        raise NumericalError("the motion of the full model is not finite", remedy="Check the loads and the materials.")
    return Transient(recorder.reading, recorder.acceleration, motion, scheme.reach * substeps / (2 * np.pi * h))


def free_rows(model: FiniteElementModel, rows: sparse.csr_array) -> sparse.csr_array:
    """Rows (m, 3n) of displacements of the nodes → rows (m, n_free) of the free motions."""
    return sparse.csr_array(rows @ model.constraint.transform[: 3 * len(model.mesh.position)])


class _TransientStep:
    """One step of length h in `substeps` parts, with the factors that it needs."""

    def __init__(
        self,
        K: sparse.csr_array,
        M: sparse.csr_array,
        S: sparse.csr_array,
        damping: ViscousDamping,
        scheme: Scheme,
        h: float,
        substeps: int,
        coefficients: int,
    ):
        self.K, self.M, self.S, self.damping, self.scheme = K, M, S, damping, scheme
        self.part = h / substeps
        self.s = scheme.pole / self.part
        self.weight = self.part * scheme.load_weights(coefficients, substeps)
        alpha, beta = damping.alpha, damping.beta
        self.solve = [factorise_complex((1 + s * beta) * K + (s * s + s * alpha) * M) for s in self.s]
        self.modal = damping.shapes is not None and bool(np.any(damping.rate))
        if self.modal:
            self.gain = damping.share(self.s[:, None])
            self.shapes = np.asarray(damping.shapes)
            self.M_shapes = M @ self.shapes

    def advance(self, motion: np.ndarray, load_coefficients: np.ndarray) -> np.ndarray:
        """[z, ż] (2, n) one step later; load_coefficients (J, n_u)."""
        z, v = motion
        for weight in self.weight:
            Kz, Mv = self.K @ z, self.M @ v
            force = (weight @ load_coefficients).T
            pair = np.zeros((2, len(z)))
            low = np.zeros((2, self.M_shapes.shape[1])) if self.modal else None
            for k, (s, c) in enumerate(zip(self.s, self.scheme.residue, strict=True)):
                w = self.solve[k]((Kz / s - Mv - self.S @ force[:, k]) / self.part)
                pair[0] += 2 * (c * w).real
                pair[1] += 2 * (c * s * w).real
                if low is not None:
                    share = self.gain[k] * _real_times(self.M_shapes, w)
                    low[0] += 2 * (c * share).real
                    low[1] += 2 * (c * s * share).real
            if low is not None:
                pair -= low @ self.shapes.T
            z, v = z + pair[0], self.scheme.infinity * v + pair[1]
        return np.stack([z, v])

    def damping_force(self, v: np.ndarray) -> np.ndarray:
        """C ż; (n, b) → (n, b)."""
        force = self.damping.alpha * (self.M @ v) + self.damping.beta * (self.K @ v)
        if self.modal:
            force += self.M_shapes @ (self.damping.rate[:, None] * (self.M_shapes.T @ v))
        return force


class _Recorder:
    """Records the readings in blocks of instants: one product with the rows and one solution with the mass a block."""

    def __init__(
        self,
        step: _TransientStep,
        rows: sparse.csr_array | np.ndarray,
        acceleration_rows: sparse.csr_array | np.ndarray | None,
        mass: Factor | None,
        instants: int,
    ):
        self.step, self.rows, self.acceleration_rows, self.mass = step, rows, acceleration_rows, mass
        count = 0 if acceleration_rows is None else acceleration_rows.shape[0]
        self.reading, self.acceleration = np.zeros((instants, rows.shape[0])), np.zeros((instants, count))
        self.motions: list[np.ndarray] = []
        self.loads: list[np.ndarray] = []
        self.done = 0

    def take(self, motion: np.ndarray, u: np.ndarray) -> None:
        self.motions.append(motion)
        self.loads.append(u)
        if len(self.motions) == BLOCK:
            self.flush()

    def flush(self) -> None:
        if not self.motions:
            return
        z, v = (np.ascontiguousarray(part.T) for part in np.stack(self.motions, axis=1))
        here = slice(self.done, self.done + len(self.motions))
        self.reading[here] = (self.rows @ z).T
        if self.mass is not None and self.acceleration_rows is not None:
            force = self.step.S @ np.array(self.loads).T - self.step.K @ z - self.step.damping_force(v)
            self.acceleration[here] = (self.acceleration_rows @ self.mass.solve(force)).T
        self.done = here.stop
        self.motions, self.loads = [], []


def _real_times(X: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Xᵀw for real X (n, N) and complex w (n,), without a complex copy of X."""
    real, imaginary = w.view(float).reshape(-1, 2).T @ X
    return real + 1j * imaginary


def _reach(
    K: sparse.csr_array,
    M: sparse.csr_array,
    damping: ViscousDamping,
    load_coefficients: np.ndarray,
    h: float,
    rigid: np.ndarray | None,
) -> float:
    """Frequency [Hz] up to which periods must be accurate: LOAD_SHARE of the load power, and the first modes."""
    count = min(FIRST_MODES, int(np.count_nonzero(M.diagonal() > 0)))
    known = damping.frequency[:count] / (2 * np.pi)
    first = known[-1] if len(known) == count else lowest_modes(K, M, count, rigid=rigid)[0][-1]
    u = load_coefficients[:, 0] * np.hanning(len(load_coefficients) + 2)[1:-1, None]
    power = (np.abs(np.fft.rfft(u, axis=0)) ** 2).sum(axis=1)
    total = np.cumsum(power)
    frequency = np.fft.rfftfreq(len(load_coefficients), h)
    reached = frequency[np.searchsorted(total, LOAD_SHARE * total[-1])] if total[-1] > 0 else 0.0
    return float(max(first, reached))


@dataclass(frozen=True)
class Scheme:
    """e^z ≈ R(z) = R∞ + Σ_k 2 Re c_k/(z − p_k), for real z; every pole represents itself and its conjugate.

    degree s: R agrees with e^z up to z^(2s−1). pole p (s/2,), all with Re p > 0; residue c (s/2,); infinity R∞;
    reach: largest y for which R(iy) is within TOLERANCE."""

    degree: int
    pole: np.ndarray
    residue: np.ndarray
    infinity: float
    reach: float

    def at(self, z: np.ndarray) -> np.ndarray:
        """R(z), z (...) complex."""
        z = np.asarray(z, dtype=complex)[..., None]
        pairs = self.residue / (z - self.pole) + self.residue.conj() / (z - self.pole.conj())
        return self.infinity + pairs.sum(axis=-1)

    def errors(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R(iy) = e^{−ζ'y + iy/(1 + e)} of an undamped mode, y = ωh (...) from near 0 on in small steps: e and ζ'."""
        y = np.asarray(y, dtype=float)
        R = self.at(1j * y)
        return y / np.unwrap(np.angle(R)) - 1, -np.log(np.abs(R)) / y

    def load_weights(self, coefficients: int, substeps: int) -> np.ndarray:
        """W_ikj = Σ_l l! p_k^{−l−1} [coefficient of σˡ in τʲ],  τ = (i + σ)/substeps: weight of pole k in substep i for a force
        τʲ over the whole step. Returns (substeps, s/2, coefficients)."""
        shift = np.zeros((substeps, coefficients, coefficients))
        for j in range(coefficients):
            for low in range(j + 1):
                # (i + σ)ʲ / substepsʲ
                shift[:, low, j] = comb(j, low) * np.arange(substeps) ** float(j - low) / float(substeps) ** j
        moments = np.array([[factorial(low) / p ** (low + 1) for low in range(coefficients)] for p in self.pole])
        return np.einsum("kl,ilj->ikj", moments, shift)


@cache
def pade(degree: int) -> Scheme:
    """The Padé approximations (s, s) and (s − 1, s), mixed as  P = ρP₁ + (1 − ρ)P₂,  Q = ρQ₁ + (1 − ρ)Q₂,  ρ = RADIUS:

    order 2s − 1, |R(iy)| ≤ 1, and |R∞| < 1, so that motions far too fast for the step decay within some tens of steps.
    Source: Song, Eisenträger and Zhang, Computer Methods in Applied Mechanics and Engineering 390 (2022) 114436."""
    over = RADIUS * _numerator(degree, degree) + (1 - RADIUS) * np.append(_numerator(degree - 1, degree), 0.0)
    under = RADIUS * _denominator(degree, degree) + (1 - RADIUS) * _denominator(degree - 1, degree)
    P, Q = (np.polynomial.Polynomial(power.astype(np.clongdouble)) for power in (over, under))
    slope = Q.deriv()
    pole = np.polynomial.Polynomial(under).roots().astype(np.clongdouble)
    pole = pole[pole.imag > 0]
    # the residues of degree 6 are of the order of thousands, so the poles need full precision
    for _ in range(3):
        pole = pole - Q(pole) / slope(pole)
    residue = (P(pole) / slope(pole)).astype(complex)
    scheme = Scheme(degree, pole.astype(complex), residue, float((P.coef[-1] / Q.coef[-1]).real), 0.0)
    y = np.linspace(0.05, 2.0 * degree, 2000)
    period, damping = scheme.errors(y)
    bad = np.flatnonzero((np.abs(period) > TOLERANCE) | (np.abs(damping) > TOLERANCE))
    return replace(scheme, reach=float(y[bad[0] - 1]))


def choose(y: float) -> tuple[Scheme, int]:
    """The scheme and the number of substeps that resolve ωh = y with the fewest solves; if equal, the highest degree."""
    plans = [(pade(degree), max(1, ceil(y / pade(degree).reach))) for degree in DEGREES]
    return min(plans, key=lambda plan: (plan[1] * plan[0].degree, plan[1]))


def _numerator(j: int, k: int) -> np.ndarray:
    """Numerator of the Padé approximation of degrees j over k, lowest power first."""
    terms = [factorial(j) * factorial(j + k - i) / (factorial(i) * factorial(j - i)) for i in range(j + 1)]
    return np.array(terms) / factorial(j + k)


def _denominator(j: int, k: int) -> np.ndarray:
    return _numerator(k, j) * (-1.0) ** np.arange(k + 1)


CORRECTIONS = 4
LEAST_RESIDUAL = 1e-9
"""Largest residual over load, in the largest entry, of a solution; the factor is not pivoted and needs corrections."""


def steady_state(
    K: sparse.csr_array,
    M: sparse.csr_array,
    S: np.ndarray,
    damping: ViscousDamping,
    frequency: np.ndarray,
    amplitude: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """z(0) = Σ Re Z and ż(0) = Σ Re iωZ of u(t) = Σ Re U exp(iωt), with a factor for every tone; modal damping by Woodbury:

        Z = Z₀ − Σᵢ φᵢ iωcᵢ (Mφᵢ)ᵀZ₀ / (aᵢ + iωcᵢ),    aᵢ = (1 + iωβ)ωᵢ² + iωα − ω²,    Z₀ = (K − ω²M + iω(αM + βK))⁻¹ S U

    K, M (n, n); S (n, n_u) [-]; frequency ω (k,) [rad/s]; amplitude U (k, n_u) complex [N]. Returns z [m], ż [m/s] (n,).
    `transient` continues this motion with the error of its scheme and of the held load, which appears as free vibration.
    Raises NumericalError if an undamped mode has the frequency of a tone, and the errors of `factorise_complex`."""
    z, v = np.zeros(K.shape[0]), np.zeros(K.shape[0])
    for omega, tone in zip(frequency, amplitude, strict=True):
        if np.any(tone):
            Z = _response(K, M, S @ tone, damping, float(omega))
            z += Z.real
            v += (1j * omega * Z).real
    return z, v


def _response(
    K: sparse.csr_array, M: sparse.csr_array, force: np.ndarray, damping: ViscousDamping, omega: float
) -> np.ndarray:
    s = 1j * omega
    A = sparse.csr_array((1 + s * damping.beta) * K + (s * s + s * damping.alpha) * M)
    solve = factorise_complex(A)
    Z, residual = np.zeros(len(force), dtype=complex), force.astype(complex)
    for _ in range(CORRECTIONS):
        Z += solve(residual)
        residual = force - A @ Z
        if np.abs(residual).max() <= LEAST_RESIDUAL * np.abs(force).max():
            break
    else:
        raise NumericalError(
            f"the steady state at {omega / (2 * np.pi):.6g} Hz has the relative residual "
            f"{np.abs(residual).max() / np.abs(force).max():.2g} (limit {LEAST_RESIDUAL:g})",
            key="train.settle",
            remedy="Specify a settling time in seconds, or increase the damping.",
        )
    if damping.shapes is None:
        return Z
    return Z - damping.shapes @ (damping.share(s) * (damping.shapes.T @ (M @ Z)))

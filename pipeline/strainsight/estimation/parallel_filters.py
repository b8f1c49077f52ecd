"""Parallel linear Kalman filters, each with its own model, on one measurement: the inner loop of the grid filter."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from strainsight.parallel import threads


@dataclass(frozen=True)
class ModalMotion:
    """A step of B models of n states, and its derivatives in e constants ν, in coordinates z of x = T z in which q modes
    decouple:

        z⁺ₐ = p₀ₐ zₐ + p₁ₐ z_{q+a} + …,   z⁺_{q+a} = p₂ₐ zₐ + p₃ₐ z_{q+a} + …,   a < q

    The rows of `augmented` are the effects of the other s = n − 2q states on all states. A step needs a tenth of the products
    of a full matrix. basis T and its inverse (B, n, n); pairs p (B, 4, q); augmented (B, s, n); fed (B, n, p): known inputs;
    slopes in ν: pairs_nu (B, e, 4, q), augmented_nu (B, e, s, n), fed_nu (B, e, n, p)."""

    basis: np.ndarray
    inverse: np.ndarray
    pairs: np.ndarray
    augmented: np.ndarray
    fed: np.ndarray
    pairs_nu: np.ndarray
    augmented_nu: np.ndarray
    fed_nu: np.ndarray

    def __post_init__(self) -> None:
        (B, n, p), q, e = self.fed.shape, self.pairs.shape[-1], self.pairs_nu.shape[1]
        sizes = {"B": B, "n": n, "p": p, "q": q, "e": e, "s": n - 2 * q, "4": 4}
        check_shapes(self, sizes, basis="Bnn", inverse="Bnn", pairs="B4q", augmented="Bsn")
        check_shapes(self, sizes, pairs_nu="Be4q", augmented_nu="Besn", fed_nu="Benp")

    def of(self, points: slice) -> ModalMotion:
        """Selected models."""
        return ModalMotion(*(getattr(self, entry.name)[points] for entry in fields(self)))

    def about(self, nu: np.ndarray) -> ModalMotion:
        """The motion at ν (e,), in which it is linear."""
        slopes = {"pairs": self.pairs_nu, "augmented": self.augmented_nu, "fed": self.fed_nu}
        moved = {name: getattr(self, name) + np.tensordot(slope, nu, (1, 0)) for name, slope in slopes.items()}
        return replace(self, **moved)

    def with_constants(self, count: int) -> ModalMotion:
        """Add `count` constant states."""
        if count == 0:
            return self

        basis, inverse, augmented = (
            pad_zeros(each, count, -1, -2) for each in (self.basis, self.inverse, self.augmented)
        )
        constants = range(-count, 0)
        for each in (basis, inverse, augmented):
            each[:, constants, constants] = 1.0
        augmented_nu, fed_nu = pad_zeros(self.augmented_nu, count, -1, -2), pad_zeros(self.fed_nu, count, -2)
        return ModalMotion(
            basis, inverse, self.pairs, augmented, pad_zeros(self.fed, count, -2), self.pairs_nu, augmented_nu, fed_nu
        )


def _full_matrix(pairs: np.ndarray, augmented: np.ndarray) -> np.ndarray:
    """Full matrix (..., n, n) in modal coordinates."""
    q, n = pairs.shape[-1], augmented.shape[-1]
    full, a = np.zeros((*augmented.shape[:-2], n, n)), np.arange(q)
    for k, (i, j) in enumerate(((0, 0), (0, q), (q, 0), (q, q))):
        full[..., i + a, j + a] = pairs[..., k, :]
    full[..., 2 * q :] = np.swapaxes(augmented, -1, -2)
    return full


def pad_zeros(array: np.ndarray, count: int, *axes: int) -> np.ndarray:
    """Append `count` zeros along some axes, numbered from the last."""
    return np.pad(array, [(0, count if axis - array.ndim in axes else 0) for axis in range(array.ndim)])


@dataclass(frozen=True)
class LinearModels:
    """B models  x⁺ = A x + G w + Σₖ νₖ(Aₖx + Gₖw) + noise,   y = H x + F w₁ + Σₖ νₖ(Dₖx + Eₖw₁ + oₖ + Bₖz) + noise

    of one size. ν are d considered constants of mean zero and variance one; the first e of them change the motion. motion: A
    (B, n, n); G (B, n, p) of the known inputs w (T, p); A_ν (B, e, n, n), G_ν (B, e, n, p). Q (B, n, n): covariance of a
    step; H (B, m, n); F (B, m, p₁) of the known inputs w₁ (T, p₁) at its end; D (d, m, n), E (d, m, p₁), o (d, m). B (d, m,
    f) on zⱼ = νⱼ(Uⱼx + Wⱼw₁) of the last f ν that change the motion, U (f, n), W (f, p₁). about (d,): reference of ν, plus
    `shift` (B, d) for each model, so that its mean is −about − shift; fixed_slope (d,): whether slopes are those at the
    reference, not at ν̂; directions Q (all, d): these ν are directions of others, None if they are all (`in_directions`)."""

    SHARED: ClassVar = ("D", "E", "offset", "B", "U", "W", "about", "fixed_slope", "directions")
    """Arrays without a row for every model."""

    motion: ModalMotion
    Q: np.ndarray
    H: np.ndarray
    F: np.ndarray
    D: np.ndarray
    E: np.ndarray
    offset: np.ndarray
    B: np.ndarray
    U: np.ndarray
    W: np.ndarray
    about: np.ndarray
    shift: np.ndarray
    fixed_slope: np.ndarray
    directions: np.ndarray | None = None

    def __post_init__(self) -> None:
        (B, m, n), p1 = self.H.shape, self.F.shape[-1]
        d, f = len(self.D), len(self.U)
        sizes = {"B": B, "m": m, "n": n, "p": p1, "d": d, "f": f}
        check_shapes(self.motion, sizes, basis="Bnn")
        check_shapes(self, sizes, Q="Bnn", F="Bmp", D="dmn", E="dmp", offset="dm", B="dmf", U="fn", W="fp")
        check_shapes(self, sizes, about="d", shift="Bd", fixed_slope="d")

    @cached_property
    def A(self) -> np.ndarray:
        return np.asarray(
            self.motion.basis @ _full_matrix(self.motion.pairs, self.motion.augmented) @ self.motion.inverse
        )

    @cached_property
    def G(self) -> np.ndarray:
        return np.asarray(self.motion.basis @ self.motion.fed)

    @cached_property
    def A_nu(self) -> np.ndarray:
        basis, inverse = self.motion.basis[:, None], self.motion.inverse[:, None]
        return np.asarray(basis @ _full_matrix(self.motion.pairs_nu, self.motion.augmented_nu) @ inverse)

    @cached_property
    def G_nu(self) -> np.ndarray:
        return np.asarray(self.motion.basis[:, None] @ self.motion.fed_nu)

    @property
    def count(self) -> int:
        return len(self.H)

    @property
    def considered_count(self) -> int:
        return len(self.D)

    @property
    def moving(self) -> int:
        """Number of ν that change the motion."""
        return self.motion.pairs_nu.shape[1]

    @property
    def kept_a_step(self) -> int:
        """Number of values of the filter states at one instant."""
        n, d = self.H.shape[-1], self.considered_count
        return self.count * (n * (n + 1 + d) + d**2)

    def of(self, points: slice) -> LinearModels:
        """Selected models."""
        by_model = {name: getattr(self, name)[points] for name in ("Q", "H", "F", "shift")}
        return replace(self, motion=self.motion.of(points), **by_model)

    def in_directions(self, Q: np.ndarray) -> LinearModels:
        """The models with ν = Q ζ, Q (d, r) from `distinguished_directions`; ν across Q stay at their prior."""
        moves = Q[: self.moving, Q[: self.moving].any(axis=0)]
        slopes = {name: getattr(self.motion, name) for name in ("pairs_nu", "augmented_nu", "fed_nu")}
        slopes = {name: np.einsum("be...,er->br...", slope, moves) for name, slope in slopes.items()}
        rows = {name: np.tensordot(Q.T, getattr(self, name), 1) for name in ("D", "E", "offset", "B", "about")}
        fixed = Q[self.fixed_slope].any(axis=0)
        motion = replace(self.motion, **slopes)
        return replace(self, motion=motion, **rows, shift=self.shift @ Q, fixed_slope=fixed, directions=Q)

    @cached_property
    def compiled(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Arguments of `take_steps`: motion, readings, and truncated displacements."""
        modal, acts = self.motion, (self.D != 0).any(axis=2) | (self.E != 0).any(axis=2)
        motion = (
            modal.pairs,
            modal.augmented,
            modal.fed,
            modal.inverse @ self.Q @ np.swapaxes(modal.inverse, 1, 2),
            np.moveaxis(modal.pairs_nu, 1, -1),
            modal.augmented_nu.transpose(0, 3, 2, 1),
            np.moveaxis(modal.fed_nu, 1, -1),
            modal.basis,
        )
        reading = self.H @ modal.basis, self.F, self.D, self.E, self.offset, acts
        truncation = self.B, self.U, self.W, self.fixed_slope.astype(float)

        return compilable(*motion), compilable(*reading), compilable(*truncation)


def compilable(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Contiguous writable arrays: other kinds would compile the loops again, which takes seconds."""
    return tuple(np.require(each, requirements=("C", "W")) for each in arrays)


def check_shapes(arrays: Any, sizes: dict[str, int], **shapes: str) -> None:
    """Raise ValueError for inconsistent shapes, specified as name="letters" with the size of each letter: compiled loops do not
    check bounds."""
    for name, letters in shapes.items():
        actual, shape = getattr(arrays, name).shape, tuple(sizes[letter] for letter in letters)
        if actual != shape:
            raise ValueError(f"the array {name} of the parallel filters has the shape {actual}, expected {shape}")


KEPT = 4_000_000
"""Values of the filters stored at a time."""
APART = 2000
"""Steps of a filter that justify a thread: starting one takes as long as a few hundred steps of microseconds each."""


@dataclass(frozen=True)
class Filters:
    """State of B filters in the coordinates z of `ModalMotion`; `advance` updates it. x (B, n), P (B, n, n); V (B, d, n):
    error x̂ − x per unit ν; gain (B, m, n), variance (B, m) of each channel in the last sequential update, and S (B, m, m)
    before it; calm (B,): steady steps; nu (B, d), left (B, d, d): mean and covariance of ν given the samples so far; x_c,
    P_c, V_c: the same with gains that consider ν, or empty; basis T (B, n, n)."""

    x: np.ndarray
    P: np.ndarray
    V: np.ndarray
    gain: np.ndarray
    variance: np.ndarray
    S: np.ndarray
    calm: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    x_c: np.ndarray
    P_c: np.ndarray
    V_c: np.ndarray
    basis: np.ndarray

    @property
    def states(self) -> States:
        """The current states; with gains that consider ν, if any."""
        parts = (self.x_c, self.P_c, self.V_c) if self.x_c.size else (self.x, self.P, self.V)
        x, P, V = _to_states(self.basis, *(each[:, None] for each in parts))
        return States(x, P, V, self.nu[:, None].copy(), self.left[:, None].copy())

    def copy(self) -> Filters:
        """Copy of the filters."""
        return Filters(*(getattr(self, entry.name).copy() for entry in fields(self)))


R = TypeVar("R")


def concatenate(parts: Sequence[R], axis: int = 0) -> R:
    """Concatenate the arrays of several parts along an axis, or the AXIS of their class; `SHARED` fields are taken from the
    first part."""
    first: Any = parts[0]
    axis = getattr(first, "AXIS", axis)

    def one(name: str) -> Any:
        values = [getattr(part, name) for part in parts]
        if values[0] is None:
            return None
        return concatenate(values, axis) if is_dataclass(values[0]) else np.concatenate(values, axis=axis)

    shared = getattr(first, "SHARED", ())
    return replace(first, **{entry.name: one(entry.name) for entry in fields(first) if entry.name not in shared})


def _to_states(
    basis: np.ndarray, x: np.ndarray, P: np.ndarray, V: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x = T z (B, L, n), P (B, L, n, n) and V (B, L, d, n) of the states, from modal coordinates."""
    B, L, d, n = V.shape
    T = np.swapaxes(basis, 1, 2)
    half = (P.reshape(B, L * n, n) @ T).reshape(P.shape)
    P = basis[:, None] @ half
    return x @ T, 0.5 * (P + np.swapaxes(P, 2, 3)), (V.reshape(B, L * d, n) @ T).reshape(V.shape)


@dataclass(frozen=True)
class States:
    """B filters at L instants: x (B, L, n), P (B, L, n, n), V (B, L, d, n), nu (B, L, d), left (B, L, d, d); see `Filters`."""

    x: np.ndarray
    P: np.ndarray
    V: np.ndarray
    nu: np.ndarray
    left: np.ndarray

    def first(self, count: int) -> States:
        """The first instants."""
        return States(*(each[:, :count] for each in (self.x, self.P, self.V, self.nu, self.left)))

    def of_all(self, Q: np.ndarray) -> States:
        """The states with all ν = Q ζ, from those with ζ; ν across Q (d, r) have their prior covariance."""
        left = np.eye(len(Q)) - Q @ (np.eye(Q.shape[1]) - self.left) @ Q.T
        return States(self.x, self.P, Q @ self.V, self.nu @ Q.T, left)


@dataclass(frozen=True)
class Data:
    """Inputs of L steps: known (L, p) and known_end (L, p₁) at the end; samples (L, m), NaN if missing; variances noise (L, m)
    and discrepancy (m,)."""

    known: np.ndarray
    known_end: np.ndarray
    samples: np.ndarray
    noise: np.ndarray
    discrepancy: np.ndarray

    def of(self, span: slice) -> Data:
        """Selected steps."""
        return Data(self.known[span], self.known_end[span], self.samples[span], self.noise[span], self.discrepancy)


@dataclass(frozen=True)
class Passage:
    """Result of B filters for L steps. fit (B, L): log-likelihood of the samples, ν integrated out. If stored: states after
    each update; expected (B, L, m) and S (B, L, m, m) of the samples at ν = 0, and slope (B, L, m, d) of the innovations in
    ν."""

    fit: np.ndarray
    states: States
    expected: np.ndarray
    S: np.ndarray
    slope: np.ndarray


def build_filters(
    models: LinearModels, x: np.ndarray, covariance: np.ndarray, V: np.ndarray, consider: bool = False
) -> Filters:
    """B filters with x (B, n), V (B, d, n) and one covariance (n, n); consider: also with gains that consider ν."""
    (B, m, n), second = models.H.shape, models.count if consider else 0
    inverse = models.motion.inverse
    T = np.swapaxes(inverse, 1, 2)
    x, P, V = (x[:, None] @ T)[:, 0], inverse @ covariance @ T, V @ T
    gain, variance, S, calm = np.zeros((B, m, n)), np.zeros((B, m)), np.zeros((B, m, m)), np.zeros(B, dtype=np.int64)
    nu, left = -models.about - models.shift, np.tile(np.eye(models.considered_count), (B, 1, 1))
    x_c, P_c, V_c = (each[:second].copy() for each in (x, P, V))
    return Filters(x, P, V, gain, variance, S, calm, nu, left, x_c, P_c, V_c, models.motion.basis)


def advance(
    models: LinearModels, filters: Filters, data: Data, keep: bool, states: bool = True, less: np.ndarray | None = None
) -> Passage:
    """Advance the filters by L steps, each a prediction and an update by all channels with a sample (1.57-1.60):

        V⁻ = A V − (A_ν x̃ + G_ν w),   ε = D x̃⁻ + E w₁ + o + B z̃ − H V⁻,   V = V⁻ + K ε,   x̃ = x̂ − V ν̂

    with x̂ in place of x̃ in the motion by ν of a fixed slope. V is the error per unit ν in a filter that ignores ν. Its
    innovations are e = ε ν + white noise. Least squares on them yield mean ν̂ and covariance of ν (Friedland's separate-bias
    filter), and the likelihood with ν integrated out. The linearisation about the predicted motion is independent of the
    innovations, so noise causes no bias. If `filters` contains second filters, the stored states have the Schmidt-Kalman gains:

        K = (P⁻Hᵀ − V⁻εᵀ)(H P⁻Hᵀ + ε εᵀ + R)⁻¹,   P = (I − K H)P⁻(I − K H)ᵀ + K R Kᵀ

    keep: whether to return states, with S excluding the discrepancy; states: whether to return more than mean and covariance
    of ν; less (B, L, d): information on ν subtracted in each step (`noise_alone`). Changes `filters` in place. Sources:
    Friedland, IEEE Trans. Automatic Control 14 (1969); Schmidt, Advances in Control Systems 3 (1966)."""
    B, m, n = models.H.shape
    less = np.zeros((0, 0, models.considered_count)) if less is None else less
    L, d, second = len(data.samples), models.considered_count, len(filters.x_c)
    saved, whole = L if keep else 0, L if keep and states else 0
    sizes = {"B": B, "c": B if second else 0, "d": d, "m": m, "n": n, "L": L, "p": models.motion.fed.shape[-1]}
    check_shapes(filters, sizes, x="Bn", P="Bnn", V="Bdn", x_c="cn", P_c="cnn", V_c="cdn")
    sizes["e"] = models.F.shape[-1]
    check_shapes(data, sizes, known="Lp", known_end="Le", samples="Lm", noise="Lm", discrepancy="m")
    if len(less) and less.shape != (B, L, d):
        raise ValueError(
            f"the information matrix of the considered parameters has the shape {less.shape}, expected {(B, L, d)}"
        )
    x, P, V = np.zeros((B, whole, n)), np.zeros((B, whole, n, n)), np.zeros((B, whole, d, n))
    nu, left, fit = np.zeros((B, saved, d)), np.zeros((B, saved, d, d)), np.zeros((B, L))
    ahead = np.zeros((B, whole, m)), np.zeros((B, whole, m, m)), np.zeros((B, whole, m, d))
    *arrays, _ = (getattr(filters, entry.name) for entry in fields(filters))
    state, considering = tuple(arrays[:-3]), tuple(arrays[-3:])
    read = compilable(data.known, data.known_end, data.samples, data.noise, data.discrepancy, less)
    out = fit, nu, left, x, P, V
    from strainsight.estimation.compiled.filters import take_steps  # not before: numba takes a second to import

    def part(span: np.ndarray) -> None:
        take_steps(span, *models.compiled, state, considering, read, (saved > 0, whole > 0), out, ahead)  # type: ignore[no-untyped-call]

    count = min(threads(), max(1, B * L // APART))
    spans = [span for span in np.array_split(np.arange(B), count) if len(span)]
    if len(spans) == 1:
        part(spans[0])
    else:
        with ThreadPoolExecutor(len(spans)) as pool:
            list(pool.map(part, spans))
    if whole:
        x, P, V = _to_states(models.motion.basis, x, P, V)
    return Passage(fit, States(x, P, V, nu, left), *ahead)

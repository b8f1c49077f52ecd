"""Linear models side by side, as filters of a bank take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Motion:
    """How B models of n states move in a step, and what e constants ν change of it, in coordinates z of the states x = T z in
    which q modes are apart:

        z⁺ₐ = p₀ₐ zₐ + p₁ₐ z_{q+a} + …,   z⁺_{q+a} = p₂ₐ zₐ + p₃ₐ z_{q+a} + …,   a < q

    and what the other s = n − 2q do, to all of them and to each other, is the rows of `beside`. A step takes a tenth of the
    products that it takes of a full matrix.
    basis T and its inverse (B, n, n); pairs p (B, 4, q); beside (B, s, n); fed (B, n, p) by what is known; slopes in ν:
    pairs_nu (B, e, 4, q), beside_nu (B, e, s, n), fed_nu (B, e, n, p).
    """

    basis: np.ndarray
    inverse: np.ndarray
    pairs: np.ndarray
    beside: np.ndarray
    fed: np.ndarray
    pairs_nu: np.ndarray
    beside_nu: np.ndarray
    fed_nu: np.ndarray

    def __post_init__(self) -> None:
        (B, n, p), q, e = self.fed.shape, self.pairs.shape[-1], self.pairs_nu.shape[1]
        agree(
            (self.basis, (B, n, n)),
            (self.inverse, (B, n, n)),
            (self.pairs, (B, 4, q)),
            (self.beside, (B, n - 2 * q, n)),
            (self.pairs_nu, (B, e, 4, q)),
            (self.beside_nu, (B, e, n - 2 * q, n)),
            (self.fed_nu, (B, e, n, p)),
        )

    def of(self, points: slice) -> Motion:
        """Of some of the models."""
        return Motion(*(getattr(self, entry.name)[points] for entry in fields(self)))

    def about(self, nu: np.ndarray) -> Motion:
        """That at ν (e,), in which it is linear."""

        def there(own: np.ndarray, slope: np.ndarray) -> np.ndarray:
            return np.asarray(own + np.tensordot(slope, nu, (1, 0)))

        return replace(
            self,
            pairs=there(self.pairs, self.pairs_nu),
            beside=there(self.beside, self.beside_nu),
            fed=there(self.fed, self.fed_nu),
        )

    def with_constants(self, count: int) -> Motion:
        """With as many more states that stay as they are."""
        if count == 0:
            return self

        def wider(own: np.ndarray, *axes: int) -> np.ndarray:
            return np.pad(own, [(0, count if axis - own.ndim in axes else 0) for axis in range(own.ndim)])

        basis, inverse = wider(self.basis, -1, -2), wider(self.inverse, -1, -2)
        beside, own = wider(self.beside, -1, -2), range(-count, 0)
        for each in (basis, inverse, beside):
            each[:, own, own] = 1.0
        return Motion(
            basis,
            inverse,
            self.pairs,
            beside,
            wider(self.fed, -2),
            self.pairs_nu,
            wider(self.beside_nu, -1, -2),
            wider(self.fed_nu, -2),
        )

    @cached_property
    def transition(self) -> np.ndarray:
        """A (B, n, n) of the states."""
        return np.asarray(self.basis @ _full(self.pairs, self.beside) @ self.inverse)

    @cached_property
    def input(self) -> np.ndarray:
        """G (B, n, p) of what is known."""
        return np.asarray(self.basis @ self.fed)

    @cached_property
    def transition_nu(self) -> np.ndarray:
        """A_ν (B, e, n, n)."""
        return np.asarray(self.basis[:, None] @ _full(self.pairs_nu, self.beside_nu) @ self.inverse[:, None])

    @cached_property
    def input_nu(self) -> np.ndarray:
        """G_ν (B, e, n, p)."""
        return np.asarray(self.basis[:, None] @ self.fed_nu)


def _full(pairs: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """(..., n, n) in the coordinates of the modes."""
    q, n = pairs.shape[-1], beside.shape[-1]
    full, a = np.zeros((*beside.shape[:-2], n, n)), np.arange(q)
    for k, (i, j) in enumerate(((0, 0), (0, q), (q, 0), (q, q))):
        full[..., i + a, j + a] = pairs[..., k, :]
    full[..., 2 * q :] = np.swapaxes(beside, -1, -2)
    return full


def plain_motion(A: np.ndarray, G: np.ndarray, A_nu: np.ndarray, G_nu: np.ndarray) -> Motion:
    """Of full matrices A (B, n, n), G (B, n, p), A_ν (B, e, n, n) and G_ν (B, e, n, p), no mode apart."""
    own = np.tile(np.eye(A.shape[-1]), (len(A), 1, 1))
    return Motion(
        own,
        own,
        np.zeros((len(A), 4, 0)),
        np.swapaxes(A, -1, -2),
        G,
        np.zeros((*A_nu.shape[:2], 4, 0)),
        np.swapaxes(A_nu, -1, -2),
        G_nu,
    )


BY_MODEL = ("Q", "H", "F", "shift")
"""Arrays of `LinearModels` with a row for every model."""


@dataclass(frozen=True)
class LinearModels:
    """B models  x⁺ = A x + G w + Σₖ νₖ(Aₖx + Gₖw) + noise,   y = H x + F w₁ + Σₖ νₖ(Dₖx + Eₖw₁ + oₖ + Bₖz) + noise

    of one size. ν are d constants that no filter estimates, of mean zero and variance one; the first e of them change the motion.
    motion: A (B, n, n); G (B, n, p) of what is known, w (T, p) in a step; A_ν (B, e, n, n), G_ν (B, e, n, p). Q (B, n, n)
    covariance of a step; H (B, m, n); F (B, m, p₁) of what is known at its end, w₁ (T, p₁);
    D (d, m, n), E (d, m, p₁), o (d, m). B (d, m, f) on
    zⱼ = νⱼ(Uⱼx + Wⱼw₁) of the last f of those that change the motion, U (f, n), W (f, p₁).
    about (d,): ν is counted from there, and of every model from `shift` (B, d) beyond, so that its mean is −about − shift;
    held (d,): whether slopes are those there.
    """

    motion: Motion
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
    held: np.ndarray

    def __post_init__(self) -> None:
        (B, m, n), p1 = self.H.shape, self.F.shape[-1]
        d, f = len(self.D), len(self.U)
        agree(
            (self.motion.basis, (B, n, n)),
            (self.Q, (B, n, n)),
            (self.F, (B, m, p1)),
            (self.D, (d, m, n)),
            (self.E, (d, m, p1)),
            (self.offset, (d, m)),
            (self.B, (d, m, f)),
            (self.U, (f, n)),
            (self.W, (f, p1)),
            (self.about, (d,)),
            (self.shift, (B, d)),
            (self.held, (d,)),
        )

    @property
    def A(self) -> np.ndarray:
        return self.motion.transition

    @property
    def G(self) -> np.ndarray:
        return self.motion.input

    @property
    def A_nu(self) -> np.ndarray:
        return self.motion.transition_nu

    @property
    def G_nu(self) -> np.ndarray:
        return self.motion.input_nu

    @property
    def count(self) -> int:
        return len(self.H)

    @property
    def nuisances(self) -> int:
        return len(self.D)

    @property
    def moving(self) -> int:
        """How many ν change the motion."""
        return self.motion.pairs_nu.shape[1]

    @property
    def kept_a_step(self) -> int:
        """How many numbers the states of the filters are at one instant."""
        n, d = self.H.shape[-1], self.nuisances
        return self.count * (n * (n + 1 + d) + d**2)

    def of(self, points: slice) -> LinearModels:
        """Some of them."""
        by_model = {name: getattr(self, name)[points] for name in BY_MODEL}
        return replace(self, motion=self.motion.of(points), **by_model)

    @cached_property
    def compiled(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """As `take_steps` takes them: motion, readings, and what is beyond the coordinates."""
        own, acts = self.motion, (self.D != 0).any(axis=2) | (self.E != 0).any(axis=2)
        Q = own.inverse @ self.Q @ np.swapaxes(own.inverse, 1, 2)
        motion = own.pairs, own.beside, own.fed, Q, own.pairs_nu, own.beside_nu, own.fed_nu, own.basis
        reading = self.H @ own.basis, self.F, self.D, self.E, self.offset, acts
        beyond = self.B, self.U, self.W, self.held.astype(float)

        return compilable(*motion), compilable(*reading), compilable(*beyond)


def compilable(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """One behind the other in memory and writable: loops are compiled once more, for seconds, for arrays of another kind."""
    return tuple(np.require(each, requirements=("C", "W")) for each in arrays)


def joined_models(parts: Sequence[LinearModels]) -> LinearModels:
    """Models of the same ν, one behind the other."""

    def all_of(of: Sequence[Any], name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in of])

    motion = Motion(*(all_of([own.motion for own in parts], entry.name) for entry in fields(Motion)))
    return replace(parts[0], motion=motion, **{name: all_of(parts, name) for name in BY_MODEL})


def agree(*sized: tuple[np.ndarray, tuple[int, ...]]) -> None:
    """Raises ValueError where an array has not the shape that it should have: compiled loops do not look where they write."""
    wrong = [f"{array.shape} in place of {shape}" for array, shape in sized if array.shape != shape]
    if wrong:
        raise ValueError(f"arrays of filters side by side do not fit: {', '.join(wrong)}")

"""Modes and static responses of the full model: what a reduction basis is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.fem.factorisation import Factorise
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import modes as lowest_modes
from strainsight.fem.relief import factorise_free, relief_of


@dataclass(frozen=True)
class Snapshots:
    """frequency (m,) [Hz] and shapes (n_free, m) [1/√kg] of the lowest modes; static (n_free, n_u) [m/N]: K⁻¹S."""

    frequency: np.ndarray
    shapes: np.ndarray
    static: np.ndarray

    @property
    def vectors(self) -> np.ndarray:
        """[Φ, K⁻¹S] (n_free, m + n_u)."""
        return np.hstack([self.shapes, self.static])

    def lowest(self, modes: int) -> Snapshots:
        """With this many modes only."""
        return Snapshots(self.frequency[:modes], self.shapes[:, :modes], self.static)


def snapshots(
    full: FiniteElementModel,
    S: np.ndarray,
    theta: Mapping[str, float],
    modes: int,
    known: tuple[np.ndarray, np.ndarray] | None = None,
) -> Snapshots:
    """K(θ)φ = ω²M(θ)φ and K(θ)⁻¹S, from one factorisation; of a free structure elastic modes and K⁺S, by inertia relief.

    S (n_free, n_u) [-] input shapes; theta [SI]; known: frequency and shapes at this θ where they have been found already, at
    least `modes` of them. Raises the errors of `modes` and `factorise`.
    """
    return snapshots_at(shared_by_all(full, S, modes), theta, known)


Shared = tuple[AffineOperator, AffineOperator, np.ndarray | None, np.ndarray, int, Factorise, np.ndarray | None]


def shared_by_all(full: FiniteElementModel, S: np.ndarray, modes: int, near: np.ndarray | None = None) -> Shared:
    """What every task of a sweep over θ needs; near (n_free, r): vectors whose span holds the modes nearly, as of `modes`."""
    return full.stiffness, full.mass, full.rigid, S, modes, full.factorise, near


def snapshots_at(
    shared: Shared,
    theta: Mapping[str, float],
    known: tuple[np.ndarray, np.ndarray] | None = None,
) -> Snapshots:
    """The same as a task of a sweep: shared are stiffness, mass, rigid motions, S, the number of modes, who factorises,
    and vectors near the modes."""
    stiffness, mass, rigid, S, modes, factorise, near = shared
    K = stiffness.at(theta)
    factor = factorise(K) if rigid is None else factorise_free(K, relief_of(mass.at(theta), rigid), factorise)
    if known is None:
        known = lowest_modes(K, mass.at(theta), modes, factor=factor, rigid=rigid, near=near)
    frequency, shapes = known
    return Snapshots(frequency[:modes], shapes[:, :modes], factor.solve(S))


def scaled(
    full: FiniteElementModel, known: Snapshots, at: Mapping[str, float], theta: Mapping[str, float]
) -> Snapshots:
    """Snapshots at θ of a model that `only_scales`, from those at another θ:  K = a K₀, M = b M₀:  ω₀√(a/b), Φ₀/√b, z₀/a."""
    a, b = (X.at(theta).diagonal().sum() / X.at(at).diagonal().sum() for X in (full.stiffness, full.mass))
    return Snapshots(known.frequency * np.sqrt(a / b), known.shapes / np.sqrt(b), known.static / a)


def only_scales(full: FiniteElementModel) -> bool:
    """K(θ) and M(θ) each a number times one matrix: modes and static responses keep their shapes over the whole box."""

    def one_matrix(X: AffineOperator) -> bool:
        return not X.terms or (len(X.terms) == 1 and abs(X.constant).sum() == 0)

    return one_matrix(full.stiffness) and one_matrix(full.mass)

"""Composite solids: elements with layers of several materials, one on the other within each element."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from strainsight.columns import Column
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.thin import FloatArray

STACKED: dict[str, tuple[int, ...]] = {"hex8": (0, 1, 2), "hex20": (0, 1, 2), "wedge6": (2,), "wedge15": (2,)}
"""Kinds that may have layers → directions of their reference domain, from −1 to 1, along which these may lie."""


@dataclass(frozen=True)
class Layer:
    """Of an isotropic material, or of an anisotropic one with the orientation of its axes."""

    material: Annotated[int, Column("1", "", "id of its material, from ξ = −1 on")]
    thickness: Annotated[float, Column("1", "", "relative to the others")]
    orientation: Orientation


@dataclass(frozen=True)
class CompositeSolid:
    """Layers of a region of solids, which share the extent of each element along direction 0, 1 or 2 of its reference domain in
    proportion to their thickness, the first at ξ = −1."""

    layers: Annotated[tuple[Layer, ...], Column("", "layer", "layers")]
    direction: Annotated[
        int, Column("1", "", "along which of its reference directions the layers of an element lie: 0, 1 or 2")
    ] = 2

    @property
    def shares(self) -> FloatArray:
        """Of the extent of an element (l,) [-], in the sum 1."""
        thickness = np.array([own.thickness for own in self.layers])
        return thickness / thickness.sum()

    @property
    def ends(self) -> FloatArray:
        """ξ between the layers (l + 1,), from −1 to 1."""
        ends = np.concatenate([[0.0], np.cumsum(self.shares)])
        return np.asarray(2 * ends / ends[-1] - 1)

    def layer_at(self, xi: FloatArray) -> np.ndarray:
        """Number (q,) of the layer at points ξ (q, 3), where two meet the first of them."""
        return np.clip(np.searchsorted(self.ends, xi[:, self.direction]) - 1, 0, len(self.layers) - 1)

    def between(self, low: float, high: float) -> CompositeSolid:
        """What of it lies between two ξ, as layers of an element of its own."""
        cut = np.diff(np.clip(self.ends, low, high))
        parts = zip(self.layers, cut.tolist(), strict=True)
        return replace(self, layers=tuple(replace(own, thickness=share) for own, share in parts if share > 1e-12))

    def resized(self, length: float) -> CompositeSolid:
        """In other units of length, or of another size about the origin; thicknesses are relative, and stay."""
        layers = (replace(own, orientation=own.orientation.resized(length)) for own in self.layers)
        return replace(self, layers=tuple(layers))

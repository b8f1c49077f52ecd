"""Loads that a file states."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from strainsight.mesh.thin import FloatArray, IntArray


@dataclass(frozen=True)
class BodyForce:
    """What pulls at every mass dm: dm factor a(x),  a = g + (ω × (x − c)) × ω.

    acceleration g (3,) [m/s²], rotation ω (3,) [rad/s] about the point centre c (3,) [m]; elements: ids of the solids and point
    masses that it acts on, None for all.
    """

    acceleration: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.zeros(3))
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    elements: IntArray | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class NodalForces:
    """A load of the file (what one set holds): force (k, 3) [N] and moment (k, 3) [N m], None for none, along the basic axes on
    nodes (k,) (indices); body: forces on its masses that are not among them yet; regions: ids of those whose mass has made some
    of the forces, which are proportional to their density."""

    nodes: IntArray
    force: FloatArray
    moment: FloatArray | None = None
    body: tuple[BodyForce, ...] = ()
    regions: tuple[int, ...] = ()

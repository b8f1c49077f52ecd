"""Loads that a file states."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from strainsight.columns import Column
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
    """A load of the file (what one set holds), along the basic axes; body: forces on its masses that are not among them yet. The
    forces that the mass of regions makes are proportional to their density."""

    nodes: Annotated[IntArray, Column("1", "loaded node", "loaded node indices")]
    force: Annotated[FloatArray, Column("N", "loaded node × 3", "forces")]
    moment: Annotated[
        FloatArray | None,
        Column("N m", "loaded node × 3", "moments, 0 where there are none", offset="force_offset"),
    ] = None
    body: tuple[BodyForce, ...] = ()
    regions: Annotated[
        tuple[int, ...], Column("1", "region", "ids of regions whose mass makes some of the forces")
    ] = ()

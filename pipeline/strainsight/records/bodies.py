"""reduce.h5: every flexible body of a bench by the motions of its interface nodes and a few modes (thesis 1.8-1.17)."""

from __future__ import annotations

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.records.record import dataset, group, record
from strainsight.records.reduced import AffineTerms
from strainsight.rom.inertia import InertiaInvariants

SQUARE = "coordinate × coordinate"


@record
class ReducedBody:
    """One body; interface: id of the node, as text → its six motions."""

    clamped: bool = dataset("1", "", "whether supports hold the body on the ground")
    frequency: np.ndarray = dataset("Hz", "mode", "modes with the interfaces held")
    cut: float = dataset("Hz", "", "first of these modes that was left out")
    reach: dict[str, np.ndarray] = dataset(
        "Pa", "2", "lowest and highest value of modulus <name> at which statics are right to 1 %"
    )
    mass: np.ndarray = dataset("kg per unit^2", SQUARE, "reduced mass")
    stiffness: AffineOperator = group(AffineTerms, "N/m per unit^2", "reduced stiffness")
    damping: AffineOperator = group(AffineTerms, "N s/m per unit^2", "reduced damping")
    basis: np.ndarray = dataset("m per unit", "3 nodes × coordinate", "displacement of the nodes (3 node + component)")
    interface: dict[str, np.ndarray] = dataset(
        "m or rad per unit", "6 × coordinate", "three translations and three rotations of node <name>"
    )
    inertia: InertiaInvariants = group()


@record
class ReducedBodies:
    """reduce.h5."""

    bodies: dict[str, ReducedBody] = group()

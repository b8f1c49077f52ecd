"""A reduced body as datasets of an artefact, and back as a body of the multibody system."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bodies import FlexibleBody
from strainsight.records.below import Below, below
from strainsight.rom.craig_bampton import CraigBampton
from strainsight.rom.inertia import InertiaInvariants
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset

INERTIA_UNITS = {
    "mass": "kg",
    "first": "kg m",
    "first_modal": "kg per unit",
    "second": "kg m^2",
    "second_modal": "kg m per unit",
    "second_modal2": "kg per unit^2",
    "coupling": "kg m per unit",
    "coupling_modal": "kg per unit^2",
    "modal": "kg per unit^2",
}


@dataclass(frozen=True)
class ReducedBody:
    """body; basis (3 nodes, n): displacement of every node per coordinate; interface: node id → six motions (6, n)."""

    body: FlexibleBody
    basis: np.ndarray
    interface: dict[int, np.ndarray]


def body_datasets(
    name: str,
    reduced: CraigBampton,
    inertia: InertiaInvariants,
    damping: AffineOperator,
    basis: np.ndarray,
    clamped: bool,
) -> dict[str, Dataset]:
    """Everything of a reduced body, below /bodies/<name>."""
    record = {
        "/clamped": Dataset(np.array(clamped), "1", "whether supports hold the body on the ground"),
        "/frequency": Dataset(reduced.frequency, "Hz", "modes with the interfaces held"),
        "/cut": Dataset(np.array(reduced.cut), "Hz", "first of these modes that was left out"),
        "/mass": Dataset(reduced.mass, "kg per unit^2", "reduced mass (coordinate × coordinate)"),
        "/basis": Dataset(basis, "m per unit", "displacement of the nodes (3 node + component × coordinate)"),
    }
    for kind, operator, unit in (
        ("stiffness", reduced.stiffness, "N/m per unit^2"),
        ("damping", damping, "N s/m per unit^2"),
    ):
        record[f"/{kind}/constant"] = Dataset(operator.constant, unit, f"reduced {kind}: constant term")
        for key, term in operator.terms.items():
            record[f"/{kind}/terms/{key}"] = Dataset(term, f"{unit} per Pa", f"reduced {kind}: slope in {key}")
    for node, rows in reduced.interface.items():
        record[f"/interface/{node}"] = Dataset(
            rows, "m or rad per unit", "three translations and three rotations of that node (motion × coordinate)"
        )
    for field in fields(inertia):
        record[f"/inertia/{field.name}"] = Dataset(
            np.asarray(getattr(inertia, field.name)),
            INERTIA_UNITS[field.name],
            f"inertia in the floating frame: {field.name}",
        )
    return below(f"/bodies/{name}", record)


def body_from(artefact: Artefact, name: str) -> ReducedBody:
    """The reduced body that `body_datasets` wrote."""
    part = Below(artefact, f"/bodies/{name}")

    def operator(kind: str) -> AffineOperator:
        terms = part.children(f"/{kind}/terms") if f"/{kind}/terms" in part else {}
        return AffineOperator(part[f"/{kind}/constant"], terms)

    values: dict[str, Any] = part.children("/inertia")
    values["mass"] = float(values["mass"])
    body = FlexibleBody(
        name,
        bool(part["/clamped"]),
        operator("stiffness"),
        part["/mass"],
        operator("damping"),
        InertiaInvariants(**values),
    )
    return ReducedBody(body, part["/basis"], {int(node): rows for node, rows in part.children("/interface").items()})

"""A `ReducedModel` as datasets of an artefact, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.rom.model import Damping, ReducedModel, damping_derivative, damping_matrix
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset

GROUP = "/reduced"


def model_datasets(model: ReducedModel) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """The reduced model (5.3) and the attributes that hold its damping law.

    The damping matrix and its slopes are those at the reference: the law itself, in the attributes of its group, is what
    holds along the parameters.
    """
    record = {
        f"{GROUP}/input_shape": Dataset(
            model.input_shape, "kg^-1/2", "input shape S (coordinate × input)", ("", f"{GROUP}/inputs")
        ),
        f"{GROUP}/inputs": Dataset(np.array(model.inputs, dtype=np.str_), "1", "name of every input"),
        f"{GROUP}/parameters": Dataset(np.array(model.parameters, dtype=np.str_), "1", "name of every parameter"),
        f"{GROUP}/reference": Dataset(
            np.array(list(model.reference.values()), dtype=float),
            "SI",
            "parameter values at which the coordinates are modal",
            (f"{GROUP}/parameters",),
        ),
    }
    damping = AffineOperator(
        damping_matrix(model, model.reference),
        {name: damping_derivative(model, model.reference, name) for name in model.parameters},
    )
    for kind, operator, unit in (
        ("mass", model.mass, "1"),
        ("stiffness", model.stiffness, "1/s^2"),
        ("damping", damping, "1/s"),
    ):
        constant = "value at the reference" if kind == "damping" else "constant term"
        record[f"{GROUP}/{kind}/constant"] = Dataset(operator.constant, unit, f"reduced {kind}: {constant}")
        for name, term in operator.terms.items():
            record[f"{GROUP}/{kind}/{name}"] = Dataset(term, f"{unit} per SI unit", f"reduced {kind}: slope in {name}")
    law = model.damping
    return record, {f"{GROUP}/damping": {"kind": law.kind, "ratio": law.ratio, "alpha": law.alpha, "beta": law.beta}}


def model_from(artefact: Artefact) -> ReducedModel:
    """The reduced model that `model_datasets` wrote."""

    def operator(kind: str) -> AffineOperator:
        parts = artefact.children(f"{GROUP}/{kind}")
        return AffineOperator(parts["constant"], {name: part for name, part in parts.items() if name != "constant"})

    law = artefact.attributes(f"{GROUP}/damping")
    names = [str(name) for name in artefact[f"{GROUP}/parameters"]]
    return ReducedModel(
        mass=operator("mass"),
        stiffness=operator("stiffness"),
        input_shape=artefact[f"{GROUP}/input_shape"],
        inputs=tuple(str(name) for name in artefact[f"{GROUP}/inputs"]),
        reference=dict(zip(names, artefact[f"{GROUP}/reference"].tolist(), strict=True)),
        damping=Damping(str(law["kind"]), float(law["ratio"]), float(law["alpha"]), float(law["beta"])),  # type: ignore[arg-type]
    )

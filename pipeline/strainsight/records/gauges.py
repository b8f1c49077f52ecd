"""Candidate gauges as datasets of an artefact, and back."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.gauges.candidates import Candidates
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset

GROUP = "/gauges"
COLUMNS = {
    "element": ("1", "element id of every candidate"),
    "facet": ("1", "facet number within the element, from 1, in the order of docs/artefacts.md"),
    "kind": ("1", "kind of the facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8"),
    "nodes": ("1", "node indices of the facet, −1 where it has fewer (candidate × 8)"),
    "position": ("m", "where it sits, of a candidate the facet's centre (candidate × xyz)"),
    "normal": ("1", "outward normal (candidate × xyz)"),
    "direction": ("1", "measuring direction, of strain in the facet's plane (candidate × xyz)"),
    "angle": ("deg", "from the projected axis, right-handed about the outward normal"),
    "local": ("1", "local coordinates on the facet (candidate × 2)"),
    "length": ("m", "length of the grid that the strain is averaged over, 0: at the point"),
    "quantity": ("1", "0 strain, 1 acceleration, 2 displacement"),
    "gauge": ("1", "number of the gauge that the channel belongs to"),
    "array": ("1", "0 gauges, then the motion_sensors of the config in their order"),
    "glued": ("1", "1 where the gauge is in place already"),
}


def candidate_datasets(pool: Candidates) -> dict[str, Dataset]:
    """Every column of the candidates."""
    return {f"{GROUP}/{name}": Dataset(getattr(pool, name), unit, what) for name, (unit, what) in COLUMNS.items()}


def candidates_from(artefact: Artefact) -> Candidates:
    """The candidates that `candidate_datasets` wrote."""
    return Candidates(**{name: artefact[f"{GROUP}/{name}"] for name in COLUMNS})


GIVEN = f"{GROUP}/given"


def given_datasets(rows: sparse.csr_array) -> dict[str, Dataset]:
    """Given strain rows (candidate × row of the matrices), as the three arrays of a CSR matrix."""
    return {
        f"{GIVEN}/value": Dataset(rows.data, "1/m or 1/rad", "given strain per motion of a row of the matrices"),
        f"{GIVEN}/size": Dataset(np.array(rows.shape[1]), "1", "rows of the matrices"),
        f"{GIVEN}/column": Dataset(rows.indices.astype("int64"), "1", "row of the matrices of every value"),
        f"{GIVEN}/offset": Dataset(
            rows.indptr.astype("int64"), "1", "values of candidate i are [offset[i], offset[i + 1])"
        ),
    }


def given_from(artefact: Artefact) -> sparse.csr_array | None:
    """The rows (m, r) that `given_datasets` wrote; None where the candidates lie on the mesh."""
    if f"{GIVEN}/value" not in artefact:
        return None
    value, column, offset = (artefact[f"{GIVEN}/{name}"] for name in ("value", "column", "offset"))
    return sparse.csr_array((value, column, offset), shape=(len(offset) - 1, int(artefact[f"{GIVEN}/size"])))

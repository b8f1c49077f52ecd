"""*ELASTIC of anisotropic solids: TYPE=ENGINEERING CONSTANTS, ORTHOTROPIC, ANISOTROPIC."""

from __future__ import annotations

import numpy as np

from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.mesh.anisotropic import constants_fault, orthotropic, stiffness_fault
from strainsight.mesh.model import FloatArray

OURS = [0, 1, 2, 3, 5, 4]
"""Place in 11 22 33 12 13 23, the order of Abaqus, of ours, 11 22 33 12 23 31."""
LINES = {"ENGINEERINGCONSTANTS": 2, "ORTHOTROPIC": 2, "ANISOTROPIC": 3}
"""TYPE → data lines for each temperature, of eight entries each."""
_CONSTANTS = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")


def anisotropic_type(elastic: Keyword | None) -> str:
    """TYPE of an *ELASTIC of anisotropic solids, one of `LINES`; "" of another. CalculiX shortens the names."""
    if elastic is None:
        return ""
    own = elastic.parameters.get("TYPE", "").upper().replace(" ", "")
    return next((name for name in LINES if own == name or (own in ("ORTHO", "ANISO") and name.startswith(own))), "")


def solid_stiffness(elastic: Keyword) -> FloatArray:
    """C (6, 6) along the axes of the material in our order, 11 22 33 12 23 31.

    ORTHOTROPIC states D₁₁₁₁, D₁₁₂₂, D₂₂₂₂, D₁₁₃₃, D₂₂₃₃, D₃₃₃₃, D₁₂₁₂, D₁₃₁₃, D₂₃₂₃, ANISOTROPIC the upper triangle of D by
    columns in the order 11 22 33 12 13 23. Raises DeckError for one that is not positive definite, with its least eigenvalue.
    """
    kind, rows = anisotropic_type(elastic), elastic.rows()
    if kind == "ENGINEERINGCONSTANTS":
        values = _values(elastic, rows, _CONSTANTS)
        triples = values[:3].tolist(), values[3:6].tolist(), values[6:].tolist()
        if fault := constants_fault(*triples):
            raise rows[0].error(*fault)
        return orthotropic(*triples)
    pairs = [(i, j) for j in range(6) for i in range(j + 1)]
    if kind == "ORTHOTROPIC":
        pairs = [(i, j) for i, j in pairs if j < 3 or i == j]
    D = np.zeros((6, 6))
    i, j = np.array(pairs).T
    D[i, j] = D[j, i] = _values(elastic, rows, [f"{_named(a)}{_named(b)}" for a, b in pairs])
    C = D[np.ix_(OURS, OURS)]
    if fault := stiffness_fault(C):
        raise rows[0].error(*fault)
    return C


def _named(i: int) -> str:
    return ("11", "22", "33", "12", "13", "23")[i]


def _values(elastic: Keyword, rows: list[Row], names: tuple[str, ...] | list[str]) -> FloatArray:
    """The named values, eight a line."""
    if len(rows) < -(-len(names) // 8):
        raise elastic.error(
            f"{len(rows)} lines, and {len(names)} constants need {-(-len(names) // 8)} of eight entries",
            f"give {', '.join(names[:4])}, … {names[-1]}",
        )
    return np.array([rows[k // 8].real(k % 8, name) for k, name in enumerate(names)])

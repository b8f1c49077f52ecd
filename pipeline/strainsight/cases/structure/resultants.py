"""The vector sum of several unknown loads at one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.config.loads import Load
from strainsight.estimation.model import FilterModel
from strainsight.estimation.smoothed import Smoothed
from strainsight.records.estimated import Resultant


def resultants_of(
    loads: Mapping[str, Load], inputs: Sequence[str], model: FilterModel, smoothed: Smoothed
) -> dict[str, Resultant]:
    """Place ("node 2") → resultant, for every place with more than one of the unknown loads, `inputs`.

    F = Σ dᵢ uᵢ over unit directions d;  σ of |F| to first order: e·D P Dᵀ·e with e = F/|F|.
    """
    found = {}
    for where, index in places_of(loads, inputs):
        d = np.array([loads[inputs[i]].direction for i in index], dtype=float)
        D = (d / np.linalg.norm(d, axis=1)[:, None]).T * model.amplitude[index]
        at = model.position[index]
        force = smoothed.mean[:, 0, at] @ D.T
        magnitude = np.linalg.norm(force, axis=1)
        e = force / np.where(magnitude > 0, magnitude, 1.0)[:, None]
        P = smoothed.covariance_of(at)
        along = e @ D
        std = np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", along, P, along), 0.0))
        found[where] = Resultant(place=where, force=force, magnitude=magnitude, std=std)
    return found


def places_of(loads: Mapping[str, Load], inputs: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """Places with more than one of the unknown loads, and which of `inputs` these are (k,)."""
    places: dict[str, list[int]] = {}
    for i, name in enumerate(inputs):
        load = loads[name]
        if load.direction is not None:
            places.setdefault(f"node {load.node}" if load.node is not None else f"set {load.set}", []).append(i)
    return [(where, np.array(index)) for where, index in places.items() if len(index) > 1]

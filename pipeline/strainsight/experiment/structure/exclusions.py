"""Places that carry no sensor unless `allow` names them: enclosed surfaces, bores, and loaded faces."""

from __future__ import annotations

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.experiment.structure.clearance import lies_on, loaded_nodes
from strainsight.experiment.structure.references import families
from strainsight.experiment.structure.structure import Structure
from strainsight.records.training import Screened
from strainsight.sensors.access import on_bores
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.enclosure import all_directions, ray_tree, sees_outside
from strainsight.sensors.faces import faces_of
from strainsight.sensors.screening import BORE, ENCLOSED, LOADED

IN_WORDS = {BORE: "in bores", ENCLOSED: "on enclosed surfaces", LOADED: "on loaded faces"}
ALLOWED = {BORE: "bores", ENCLOSED: "enclosed", LOADED: "loaded"}
"""Entries of the key `allow`."""


def excluded_gauges(structure: Structure) -> np.ndarray:
    """Why sensors that are not bonded yet are excluded (gauges,), "" for the others. A facet has one reason:

    - BORE: on a bore that is narrow, or holds a pin or a bolt (`on_bores`);
    - ENCLOSED: the view factor of the outside is too small (`sees_outside`);
    - LOADED: all its nodes carry a load that is no pressure, so that another part lies there.

    Raises InfeasibleError if all sensors of a kind are excluded."""
    config, mesh, pool = structure.config, structure.mesh, structure.pool
    reason = np.full(pool.gauges, "", dtype="<U9")
    if structure.training.strain_operator is not None or pool.bonded.all():
        return reason
    skin, facets = structure.skin, structure.skin.facets
    loaded = loaded_nodes(config, mesh, facets, pressures=False)
    bore = on_bores(mesh, facets, faces_of(mesh.position, facets), loaded)
    used = np.unique(skin.index_of(pool.grids.element, pool.grids.facet))
    sees = np.ones(len(bore), dtype=bool)
    tree = ray_tree(mesh.position, facets)
    sees[used] = sees_outside(tree, used, tree.centre[used], skin.normal[used], all_directions())
    below = np.isin(facets.nodes, loaded) | (facets.nodes < 0)
    rules = {BORE: bore, ENCLOSED: ~bore & ~sees, LOADED: ~bore & sees & below.all(axis=1)}
    lying = {code: lies_on(pool, facets, mask) for code, mask in rules.items()}
    first = pool.first
    for array, (key, sensors) in enumerate(families(config).items()):
        free = (pool.array[first] == array) & ~pool.bonded[first]
        for code, channels in lying.items():
            if ALLOWED[code] not in sensors.allow:
                reason[free & (np.bincount(pool.gauge, channels) > 0) & (reason == "")] = code
        if free.any() and np.all(reason[free] != ""):
            raise InfeasibleError(
                f"no candidate remains: {_counts(reason[free])}",
                key=f"{key}.allow",
                remedy=f"If sensors can be installed there, set {key}.allow: [{', '.join(_entries(reason[free]))}].",
            )
    return reason


def exclusions_in_words(screened: Screened, pool: Candidates) -> str:
    """How many candidates each rule removed, and the key that brings them back; empty without any."""
    removed = np.isin(screened.reason, list(IN_WORDS))
    if not removed.any():
        return ""
    keys = [
        f"{'motion_sensors.' * (array > 0)}{screened.family[array]}.allow"
        for array in np.unique(pool.array[pool.first][removed]).tolist()
    ]
    entries = ", ".join(_entries(screened.reason))
    return f"inaccessible: {_counts(screened.reason)} ({' and '.join(keys)}: [{entries}] keeps them)"


def _counts(reason: np.ndarray) -> str:
    return ", ".join(f"{n} {words}" for code, words in IN_WORDS.items() if (n := np.count_nonzero(reason == code)))


def _entries(reason: np.ndarray) -> list[str]:
    return [entry for code, entry in ALLOWED.items() if code in reason]

"""Faces where gauges may sit though something probably lies on them: in words for an import, of each gauge for a layout."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import InfeasibleError
from strainsight.experiment.layout.zones import zone_of
from strainsight.mesh.facets import Facets, facet_key
from strainsight.mesh.model import Mesh
from strainsight.sensors.admissible import admissible
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.contact import contact_faces
from strainsight.sensors.faces import Faces, faces_of, pointed_at


def contact_warnings(config: PlacementConfig, mesh: Mesh, facets: Facets, faces: Faces) -> Iterator[str]:
    """A sentence for each face that probably lies on something though gauges may sit on it, with what leaves it out."""
    own = config.gauges
    if own.given is not None:
        return
    include, exclude = ([zone_of(entry) for entry in zones] for zones in (own.include, own.exclude))
    free = np.zeros(0, dtype=int)
    with suppress(InfeasibleError):  # no facet at all: `train` names that
        free, _, _ = admissible(mesh, facets, surface=own.surface, include=include, exclude=exclude)
    found = contact_faces(mesh, facets, faces)
    named = {name: {*facet_key(*own.T).tolist()} for name, own in mesh.faces.items()}
    for i, face in enumerate(found.face):
        if not (faces.of[free] == face).any():
            continue
        keys = {*facets.key[faces.of == face].tolist()}
        name = next((name for name, its in named.items() if its == keys), "")
        lines = f"gauges.exclude: [{name or 'seat'}]"
        if not name:
            lines = f"mesh.faces: {{seat: {{{pointed_at(int(face), faces, mesh.position, facets)}}}}} and {lines}"
        yield (
            f"the flat face of {faces.area[face]:.3g} m² about {_point(faces.centre[face])} is {found.in_words(i)}: if it "
            f"lies on something, no gauge can sit there; leave it out with {lines}"
        )


def held_below(mesh: Mesh, facets: Facets, grids: Candidates) -> tuple[str, ...]:
    """For every grid (g,) on a face that probably lies on something, where that is and what holds it; "" for the others.

    facets: the exterior ones.
    """
    faces = faces_of(mesh.position, facets)
    found = contact_faces(mesh, facets, faces)
    of = dict(zip(facets.key.tolist(), faces.of.tolist(), strict=True))
    words = {
        int(face): f"the face about {_point(faces.centre[face])} is {found.in_words(i)}"
        for i, face in enumerate(found.face)
    }
    return tuple(words.get(of.get(key, -1), "") for key in facet_key(grids.element, grids.facet).tolist())


def _point(x: np.ndarray) -> str:
    return "({:.3g}, {:.3g}, {:.3g}) m".format(*(x.round(6) + 0.0))

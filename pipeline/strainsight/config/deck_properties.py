"""Properties of a deck and answers of its user, for `strainsight init`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Kind = Literal["deck_load", "node", "set", "face"]


@dataclass(frozen=True)
class CandidateLocation:
    """A possible location of a load or support.

    kind, name   load or set of the deck, id of a node, or point of a face, "[x, y, z]" in m
    what         description in words: size, direction and place of a load, number and centre of nodes, area of a face
    supported    whether the location already has a support
    force        [N] resultant of a load; 1 with factor
    factor       the signal is a factor on the load of the deck: without resultant, or on all mass
    body         the load acts on all mass: gravity or rotation
    lies_on      reason why a face is probably in contact with another part
    picked       criterion for `mesh.faces`, "near: [x, y, z]"
    instead_of   point of an equally likely location: the other side of the same bores
    """

    kind: Kind
    name: str
    what: str
    supported: bool = False
    force: float | None = None
    factor: bool = False
    body: bool = False
    lies_on: str = ""
    picked: str = ""
    instead_of: str = ""


@dataclass(frozen=True)
class MissingMaterial:
    """Regions (ids) without material, or, in a deck without mass, without density; youngs_modulus [Pa] and poisson_ratio if
    known."""

    regions: tuple[int, ...]
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None


@dataclass(frozen=True)
class Suggestion:
    """Properties of a deck that determine its config.

    length_unit, mass_unit   units that give plausible material data; empty if no units do, with the reason in `odd`
    region           id of the largest region; several_moduli: it is a laminate or anisotropic; youngs_modulus [Pa] or None
    lacking          missing material data
    supports         whether the deck has supports
    no_surface       why no gauge can be placed, with the remedy; empty for a deck with a surface
    support_sets     ids of support sets, or numbers of steps (support_key), if the deck does not select one
    unsupported      entities that change the model: name for `mesh.ignore`, number, file:line of the first
    places           possible locations of loads and supports, the most likely first; set_names: names of sets of the deck
    gauge_type       suitable type for the largest face
    thin             names of regions of triangles and quadrangles, for a deck without solids and sections
    pairs            contact pairs, "A on B"; contact: possible values of mesh.contact
    matrices         whether CalculiX wrote .sti, .mas and .dof files
    nodes, facets    number of nodes, and of facets of the surface
    face_at          point in `places` of the face at a point, or the point itself
    facts            size, materials and supports in words: (item, detail)
    """

    length_unit: str = "m"
    mass_unit: str = "kg"
    odd: str = ""
    region: int = 1
    several_moduli: bool = False
    youngs_modulus: float | None = 2.0e11
    lacking: tuple[MissingMaterial, ...] = ()
    supports: bool = True
    no_surface: str = ""
    support_sets: tuple[int, ...] = ()
    support_key: Literal["spc", "step"] = "spc"
    unsupported: tuple[tuple[str, int, str], ...] = ()
    places: tuple[CandidateLocation, ...] = ()
    set_names: tuple[str, ...] = ()
    gauge_type: str | None = "3/350"
    thin: tuple[str, ...] = ()
    contact: Literal["bonded", "open"] | None = None
    pairs: tuple[str, ...] = ()
    matrices: bool = False
    nodes: int = 0
    facets: int = 1000
    face_at: Callable[[str], str] = str
    facts: tuple[tuple[str, str], ...] = ()

    @property
    def loads(self) -> list[CandidateLocation]:
        """Loads of the deck."""
        return [place for place in self.places if place.kind == "deck_load"]

    def free(self, name: str) -> str:
        """The name, with a suffix if a set of the deck already has it."""
        while name in self.set_names:
            name += "-face"
        return name


@dataclass(frozen=True)
class LoadAnswer:
    """A load: location, direction "[x, y, z]", amplitude [N], lowest and highest frequency [Hz]; None is not answered."""

    place: CandidateLocation | None = None
    direction: str | None = None
    amplitude: float | None = None
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Answers:
    """Answers of the user; None is left blank in the config, or replaced by a default.

    material   E [Pa], ν, ρ [kg/m³], if the deck lacks them
    support    location of the support, for a deck without supports
    loads      the loads; one without a location, if it is not answered
    find       unknown: the modulus with measured loads, or the loads
    axis       direction of the gauges "[x, y, z]"; None: principal strain
    keep       number of gauges; None: one more than the unknowns, at least four
    spc        active support set
    """

    material: tuple[float, float, float] | None = None
    support: CandidateLocation | None = None
    loads: tuple[LoadAnswer, ...] = (LoadAnswer(),)
    find: Literal["modulus", "load"] = "modulus"
    axis: str | None = None
    keep: int | None = None
    spc: int | None = None


MATERIALS = {"steel": (2.1e11, 0.3, 7850.0), "aluminium": (7.0e10, 0.33, 2700.0), "titanium": (1.14e11, 0.34, 4430.0)}
"""E [Pa], ν, ρ [kg/m³] by name: typical values."""
NONE = Answers()

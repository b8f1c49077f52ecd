"""What a deck says about its config, and what its user does, for `strainsight init`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Kind = Literal["deck_load", "node", "set", "face"]


@dataclass(frozen=True)
class DeckPlace:
    """Where a load or a support may be: name of a load or set of the deck, id of a node, or a point of a face, "[x, y, z]" in
    m; what it is, in words; whether it is held already; force [N] of a load; of_mass: a load on all mass, whose force says how
    often it acts; lies_on: what holds a face that probably lies on something; picked: what `mesh.faces` picks
    that by, "near: [x, y, z]"; instead_of: the point of another of which it is as likely, the other side of the same bores."""

    kind: Kind
    name: str
    what: str
    held: bool = False
    force: float | None = None
    of_mass: bool = False
    lies_on: str = ""
    picked: str = ""
    instead_of: str = ""


@dataclass(frozen=True)
class Lacking:
    """Regions (ids) whose material the deck does not state, or, in a deck without any mass, without a density; youngs_modulus
    [Pa] and poisson_ratio as it states them."""

    regions: tuple[int, ...]
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None


@dataclass(frozen=True)
class Suggestion:
    """What a deck says about its config.

    length_unit, mass_unit: in which its materials make sense, empty where they make sense in none, and odd says why; region: id
    of the largest one, whether it has several moduli (a laminate, an anisotropic material), and its modulus [Pa], None where it
    has none; lacking: what materials lack; supports, solids: whether the deck has any; support_sets: ids of its sets of
    supports, or numbers of its steps (support_key), where it does not say which counts; unsupported: name for `mesh.ignore`,
    number, and file:line of the first, of what the model is not the same without; places: where its loads and supports may be,
    the likely ones first; taken: names of its sets; gauge_type: that suits its largest face; thin: names of its regions of
    triangles and quadrangles, where it has no solids and no sections; pairs: its surfaces in contact, "A on B"; contact: what
    mesh.contact may be for them; matrices: CalculiX has written .sti, .mas and .dof beside it; face_at: the point by which
    `places` has the face that a point is on, or the point again where there is none.
    """

    length_unit: str = "m"
    mass_unit: str = "kg"
    odd: str = ""
    region: int = 1
    several_moduli: bool = False
    youngs_modulus: float | None = 2.0e11
    lacking: tuple[Lacking, ...] = ()
    supports: bool = True
    solids: bool = True
    support_sets: tuple[int, ...] = ()
    support_key: Literal["spc", "step"] = "spc"
    unsupported: tuple[tuple[str, int, str], ...] = ()
    places: tuple[DeckPlace, ...] = ()
    taken: tuple[str, ...] = ()
    gauge_type: str | None = "3/350"
    thin: tuple[str, ...] = ()
    contact: Literal["bonded", "open"] | None = None
    pairs: tuple[str, ...] = ()
    matrices: bool = False
    face_at: Callable[[str], str] = str

    def free(self, name: str) -> str:
        """The name, or one like it that no set of the deck has."""
        while name in self.taken:
            name += "-face"
        return name


@dataclass(frozen=True)
class Answers:
    """What only the user knows; None is left blank in the config.

    material: E [Pa], ν, ρ [kg/m³], for what the deck does not state; held: where, for a deck without supports; load: where it
    acts; direction: "[x, y, z]"; amplitude [N]; frequency [Hz]; find: the modulus from a load that is measured, or the load
    itself; axis: along which gauges point, "[x, y, z]", None: the direction that strains most; spc: set of supports that holds.
    """

    material: tuple[float, float, float] | None = None
    held: DeckPlace | None = None
    load: DeckPlace | None = None
    direction: str | None = None
    amplitude: float | None = None
    frequency: float | None = None
    find: Literal["modulus", "load"] = "modulus"
    axis: str | None = None
    keep: int = 4
    spc: int | None = None


MATERIALS = {"steel": (2.1e11, 0.3, 7850.0), "aluminium": (7.0e10, 0.33, 2700.0), "titanium": (1.14e11, 0.34, 4430.0)}
"""E [Pa], ν, ρ [kg/m³] by name; typical values, the part's own are in its certificate."""
NONE = Answers()

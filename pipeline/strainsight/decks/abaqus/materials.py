"""Materials of an Abaqus deck: those that its sections refer to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.abaqus.parts import normal, orthonormal
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row, split
from strainsight.decks.faults import OR_CONFIG, elastic_fault, lamina_fault
from strainsight.decks.text import parse_real
from strainsight.mesh.anisotropic import Anisotropic, Orientation, constants_fault, orthotropic, stiffness_fault
from strainsight.mesh.coordinates import BASIC, CoordinateSystem, rotation
from strainsight.mesh.model import MATERIAL_FIELDS, FloatArray, Material, Properties
from strainsight.mesh.thin import Lamina

OURS = [0, 1, 2, 3, 5, 4]
"""Place in 11 22 33 12 13 23, the order of Abaqus, of ours, 11 22 33 12 23 31."""
LINES = {"ENGINEERINGCONSTANTS": 2, "ORTHOTROPIC": 2, "ANISOTROPIC": 3}
"""TYPE → data lines for each temperature, of eight entries each."""
_CONSTANTS = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")


@dataclass
class Definition:
    """A *MATERIAL and its *ELASTIC, *DENSITY and other options."""

    keyword: Keyword
    options: dict[str, Keyword] = field(default_factory=dict)


@dataclass
class Materials:
    """definitions: NAME → material of the deck; stated: each that a section names has to be there and elastic; properties: where
    the materials are put, numbered in the order in which sections name them."""

    definitions: dict[str, Definition]
    stated: bool
    notes: list[str]
    properties: Properties
    _numbers: dict[str, int] = field(default_factory=dict)

    def _add(self, name: str, make: Callable[[Definition, int, list[str]], Material | Lamina | Anisotropic]) -> int:
        """The number of one more."""
        number = self.properties.free_material()
        made = make(self.definitions[name], number, self.notes)
        getattr(self.properties, MATERIAL_FIELDS[type(made)])[number] = made
        self._numbers[name] = number
        return number

    def number(self, keyword: Keyword) -> int:
        """Number of the material that a section names; 0 where there is none and none has to be stated.

        Raises DeckError for one that is not there, or not linear and elastic, or of shells and beams not isotropic.
        """
        name = keyword.needs("MATERIAL").upper()
        if name not in self.definitions and self.stated:
            raise keyword.error(
                f"material {keyword.parameters['MATERIAL']!r} is not in the deck",
                f"add the *MATERIAL, or correct the name{OR_CONFIG}",
            )
        if name not in self.definitions or not (self.stated or "ELASTIC" in self.definitions[name].options):
            return 0
        solid = self.anisotropic(keyword)
        if name in self._numbers and (solid or self._numbers[name] in self.properties.materials):
            return self._numbers[name]
        return self._add(name, _anisotropic if solid else _material)

    def orthotropic(self, keyword: Keyword) -> bool:
        """Whether the material that a section names is TYPE=LAMINA."""
        own = self.definitions.get(keyword.word("MATERIAL"))
        return own is not None and _type(own) == "LAMINA"

    def anisotropic(self, keyword: Keyword) -> bool:
        """Whether the material that a section of solids names is one of `elastic.LINES`."""
        own = self.definitions.get(keyword.word("MATERIAL"))
        solid = keyword.name == "SOLIDSECTION"
        return own is not None and solid and bool(anisotropic_type(own.options.get("ELASTIC")))

    def of_ply(self, name: str, keyword: Keyword) -> int:
        """Number of the material of a ply. Raises DeckError for one that is not there, or not elastic."""
        make = _lamina if _type(self._require(name, keyword)) == "LAMINA" else _material
        return self._numbers.get(name.upper()) or self._add(name.upper(), make)

    def of_layer(self, name: str, row: Row) -> int:
        """Number of the material of a layer of solids, isotropic or anisotropic. Raises DeckError for one that is not there, or
        of plane stress."""
        own = self._require(name, row)
        if _type(own) == "LAMINA":
            raise row.error(
                f"material {name!r} is TYPE=LAMINA, which does not say what solids resist across",
                "give it TYPE=ENGINEERING CONSTANTS",
            )
        make = _anisotropic if anisotropic_type(own.options.get("ELASTIC")) else _material
        return self._numbers.get(name.upper()) or self._add(name.upper(), make)

    def _require(self, name: str, by: Keyword | Row) -> Definition:
        if name.upper() not in self.definitions:
            raise by.error(f"material {name!r} is not in the deck", "add the *MATERIAL, or correct the name")
        return self.definitions[name.upper()]

    def of_section(self, name: str, E: float, nu: float, rho: float) -> int:
        """Number of a material that a section states itself."""
        number = self.properties.free_material()
        self.properties.materials[number] = Material(number, E, nu, rho, name)
        return number

    @property
    def unused(self) -> int:
        """How many no section names."""
        return len(self.definitions) - len(self._numbers)


def definitions(keywords: list[Keyword]) -> dict[str, Definition]:
    """NAME → material; its options are what follows until the next *MATERIAL."""
    found: dict[str, Definition] = {}
    current: Definition | None = None
    for keyword in keywords:
        if keyword.name == "MATERIAL":
            name = keyword.needs("NAME").upper()
            if name in found:
                raise keyword.error(
                    f"{keyword.parameters['NAME']!r} stands twice (first at {found[name].keyword.where})",
                    "give every material its own name",
                )
            current = found[name] = Definition(keyword)
        elif keyword.name in ("ELASTIC", "DENSITY"):
            if current is None:
                raise keyword.error("stands before any *MATERIAL", "put it after its *MATERIAL")
            if keyword.name in current.options:
                raise keyword.error(
                    f"stands twice in the material (first at {current.options[keyword.name].where})",
                    "remove one of them",
                )
            current.options[keyword.name] = keyword
    return found


def by_temperature(keywords: Sequence[Keyword]) -> bool:
    """Whether a material states its *ELASTIC for several temperatures, and not the same for all."""
    return any(k.name == "ELASTIC" and _varies(k) for k in keywords)


def _varies(elastic: Keyword) -> bool:
    if kind := anisotropic_type(elastic):
        return len(elastic.texts) > LINES[kind]
    constants = 6 if elastic.word("TYPE") == "LAMINA" else 2
    return len({tuple(parse_real(entry) for entry in split(text)[:constants]) for text in elastic.texts}) > 1


def _type(definition: Definition) -> str:
    elastic = definition.options.get("ELASTIC")
    return "" if elastic is None else elastic.word("TYPE", "ISO")


def _material(definition: Definition, number: int, notes: list[str]) -> Material:
    name = definition.keyword.parameters["NAME"]
    elastic = definition.options.get("ELASTIC")
    if elastic is None:
        raise definition.keyword.error(
            f"material {name!r} of a section has no *ELASTIC",
            f"give its Young's modulus and Poisson's ratio{OR_CONFIG}",
        )
    if (kind := _type(definition)) not in ("ISO", "ISOTROPIC"):
        raise elastic.error(
            f"TYPE={kind}: of shells and beams only isotropic materials are supported, and TYPE=LAMINA in shells",
            "give the material TYPE=ISO, or that of plies TYPE=LAMINA; solids may have TYPE=ENGINEERING CONSTANTS, "
            "ORTHOTROPIC or ANISOTROPIC",
        )
    row = elastic.rows()[0]
    E, nu = row.real(0, "Young's modulus"), row.real(1, "Poisson's ratio", 0.0)
    if fault := elastic_fault(E, nu):
        raise row.error(*fault)
    return Material(number, E, nu, _density(definition, notes), f"material {name}")


def _lamina(definition: Definition, number: int, notes: list[str]) -> Lamina:
    """E1, E2, ν12, G12, G13, G23."""
    name, elastic = definition.keyword.parameters["NAME"], definition.options["ELASTIC"]
    row = elastic.rows()[0]
    names = ("E1", "E2", "nu12", "G12", "G13", "G23")
    constants = dict(zip(names, (row.real(i, each) for i, each in enumerate(names)), strict=True))
    nu12 = constants.pop("nu12")
    if fault := lamina_fault(constants, nu12, "nu12"):
        raise row.error(*fault)
    e1, e2, g12, g13, g23 = constants.values()
    return Lamina(number, e1, e2, nu12, g12, g13, g23, _density(definition, notes), f"material {name}")


def _anisotropic(definition: Definition, number: int, notes: list[str]) -> Anisotropic:
    name, elastic = definition.keyword.parameters["NAME"], definition.options["ELASTIC"]
    lines = LINES[anisotropic_type(elastic)]
    return Anisotropic(number, solid_stiffness(elastic), _density(definition, notes, lines), f"material {name}")


def _density(definition: Definition, notes: list[str], lines: int = 1) -> float:
    """ρ; 0 with a note where the material states none. A note, too, of lines by temperature, of *ELASTIC so many for each."""
    name = definition.keyword.parameters["NAME"]
    elastic, density = definition.options.get("ELASTIC"), definition.options.get("DENSITY")
    rho = 0.0
    if density is None:
        notes.append(f"material {name} has no *DENSITY: taken as 0")
    else:
        rho = density.rows()[0].not_negative(0, "the density")
    for keyword in (elastic, density):
        each = lines if keyword is elastic else 1
        if keyword is not None and len(keyword.texts) > each:
            counts = "the first" if each == 1 else f"the first {each}"
            notes.append(
                f"material {name}: {counts} of {len(keyword.texts)} lines of {keyword.title} "
                f"{'counts' if each == 1 else 'count'}, whatever the temperature"
            )
    return rho


def anisotropic_type(elastic: Keyword | None) -> str:
    """TYPE of an *ELASTIC of anisotropic solids, one of `LINES`; "" of another. CalculiX shortens the names."""
    if elastic is None:
        return ""
    own = elastic.word("TYPE").replace(" ", "")
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


SYSTEMS = ("RECTANGULAR", "ZRECTANGULAR", "CYLINDRICAL")


@dataclass(frozen=True)
class SolidAxes:
    """How the axes of a material of solids lie; about: which of them, 1, 2 or 3, the second line of the *ORIENTATION names, None
    where it names none; where it stands."""

    orientation: Orientation
    about: int | None
    where: str


def named_orientation(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> Keyword | None:
    """The *ORIENTATION of this name that a section or its line refers to, of its part or of the assembly; None for ""."""
    if not name:
        return None
    for within in (scope, assembly.scopes[""]):
        for own in within.part.keywords:
            if own.name == "ORIENTATION" and own.word("NAME") == name.upper():
                return own
    raise by.error(f"orientation {name.upper()!r} is not in the deck", "add the *ORIENTATION, or correct the name")


def rectangular_axes(row: Row) -> FloatArray:
    """Axes (3, 3), one in a column, of the points a on x, b in the plane of x and y, and the origin c."""
    points = np.array([row.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    x, b = points[:2] - points[2]
    return orthonormal(x, normal(x, b), row)


def solid_orientation(assembly: Assembly, scope: Scope, keyword: Keyword) -> Orientation:
    """Of a section of solids of an anisotropic material, see `solid_axes`; without one the basic axes.

    Raises DeckError for an instance that is turned without one."""
    own = solid_axes(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    if own is None and not np.allclose(scope.rotation, np.eye(3)):
        raise keyword.error(
            "anisotropic solids of an instance that is turned have no ORIENTATION", "give the section one"
        )
    return Orientation(BASIC, np.eye(3)) if own is None else own.orientation


def solid_axes(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> SolidAxes | None:
    """Axes of an anisotropic material of solids, its instance turned with it: RECTANGULAR (a on x, b in the plane xy),
    Z RECTANGULAR (a on z, b in the plane xz) or CYLINDRICAL (a and b on the axis; 1 radial, 2 around, 3 along), by coordinates;
    then turned by an angle [deg] about its axis 1, 2 or 3, as the second line says. None for no name.

    Raises DeckError for one that is not there, for distributions, and other systems and definitions.
    """
    own = named_orientation(assembly, scope, by, name)
    if own is None:
        return None
    system = own.word("SYSTEM", "RECTANGULAR").replace(" ", "")
    definition = own.word("DEFINITION", "COORDINATES")
    if system not in SYSTEMS or definition not in ("COORDINATES", ""):
        raise own.error(
            f"SYSTEM={system}, DEFINITION={definition} is not supported for anisotropic solids",
            "give a rectangular or cylindrical one by coordinates",
        )
    rows = own.rows()
    first = rows[0]
    if parse_real(first.text(0)) is None:
        raise first.error(
            f"{first.text(0)!r} is a distribution, which is not supported for anisotropic solids",
            "give each group of elements a section with an orientation of its own, by coordinates",
        )
    points = np.array([first.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    if system == "CYLINDRICAL":
        origin, z = points[0], points[1] - points[0]
        aside = np.eye(3)[np.argmin(np.abs(z))]
        y = np.cross(z, aside)
        axes, kind = orthonormal(np.cross(y, z), z, first), "cylindrical"
    else:
        origin, kind = points[2], "rectangular"
        axes = rectangular_axes(first)
        if system == "ZRECTANGULAR":
            z, x, y = axes.T  # what a rectangular one calls x, y and z
            axes = np.column_stack([x, y, z])
    moved = CoordinateSystem(kind, scope.rotation @ origin + scope.translation, scope.rotation @ axes)
    if len(rows) < 2:
        return SolidAxes(Orientation(moved, np.eye(3)), None, own.where)
    about = rows[1].integer(0, "the axis", 1)
    if about not in (1, 2, 3):
        raise rows[1].error(f"axis {about}", "give the axis about which the others turn, 1, 2 or 3")
    turn = turned_about(about, rows[1].real(1, "the angle", 0.0))
    return SolidAxes(Orientation(moved, turn), about if rows[1].text(0) else None, own.where)


def turned_about(about: int, degrees: float) -> FloatArray:
    """Axes (3, 3), one in a column, that are turned by an angle [deg] about one of them, 1, 2 or 3."""
    return rotation(np.eye(3)[about - 1], np.radians(degrees))

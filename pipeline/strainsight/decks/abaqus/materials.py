"""Materials of an Abaqus deck that its sections refer to."""

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
"""Our order 11 22 33 12 23 31 as positions in the order of Abaqus, 11 22 33 12 13 23."""
LINES = {"ENGINEERINGCONSTANTS": 2, "ORTHOTROPIC": 2, "ANISOTROPIC": 3}
"""TYPE → data lines for each temperature, with eight entries each."""
_CONSTANTS = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")


@dataclass
class Definition:
    """A *MATERIAL and its *ELASTIC, *DENSITY and other options."""

    keyword: Keyword
    options: dict[str, Keyword] = field(default_factory=dict)


@dataclass
class Materials:
    """definitions: NAME → material of the deck; required: each material of a section must exist and be elastic;
    properties: receives the materials, numbered in the order of first use."""

    definitions: dict[str, Definition]
    required: bool
    notes: list[str]
    properties: Properties
    _numbers: dict[str, int] = field(default_factory=dict)

    def _add(self, name: str, make: Callable[[Definition, int, list[str]], Material | Lamina | Anisotropic]) -> int:
        """Add a material and return its number."""
        number = self.properties.free_material()
        material = make(self.definitions[name], number, self.notes)
        getattr(self.properties, MATERIAL_FIELDS[type(material)])[number] = material
        self._numbers[name] = number
        return number

    def number(self, keyword: Keyword) -> int:
        """Number of the material of a section; 0 if it is missing and not required. Raises DeckError for a missing material, one
        that is not linear elastic, and one of shells and beams that is not isotropic."""
        name = keyword.needs("MATERIAL").upper()
        if name not in self.definitions and self.required:
            raise keyword.error(
                f"material {keyword.parameters['MATERIAL']!r} is not in the deck",
                f"add a *MATERIAL with this name, or correct the name in the section{OR_CONFIG}",
            )
        if name not in self.definitions or not (self.required or "ELASTIC" in self.definitions[name].options):
            return 0
        solid = self.anisotropic(keyword)
        if name in self._numbers and (solid or self._numbers[name] in self.properties.materials):
            return self._numbers[name]
        return self._add(name, _anisotropic if solid else _material)

    def orthotropic(self, keyword: Keyword) -> bool:
        """Whether the material of a section is TYPE=LAMINA."""
        definition = self.definitions.get(keyword.word("MATERIAL"))
        return definition is not None and _type(definition) == "LAMINA"

    def anisotropic(self, keyword: Keyword) -> bool:
        """Whether the material of a section of solids has a type in `elastic.LINES`."""
        definition = self.definitions.get(keyword.word("MATERIAL"))
        solid = keyword.name == "SOLIDSECTION"
        return definition is not None and solid and bool(anisotropic_type(definition.options.get("ELASTIC")))

    def of_ply(self, name: str, keyword: Keyword) -> int:
        """Number of the material of a ply. Raises DeckError for one that is missing or not elastic."""
        make = _lamina if _type(self._require(name, keyword)) == "LAMINA" else _material
        return self._numbers.get(name.upper()) or self._add(name.upper(), make)

    def of_layer(self, name: str, row: Row) -> int:
        """Number of the material of a layer of solids, isotropic or anisotropic. Raises DeckError for one that is
        missing or plane-stress only."""
        definition = self._require(name, row)
        if _type(definition) == "LAMINA":
            raise row.error(
                f"material {name!r} has TYPE=LAMINA, which does not define the stiffness of solids through their thickness",
                "in the *ELASTIC of this material, use TYPE=ENGINEERING CONSTANTS",
            )
        make = _anisotropic if anisotropic_type(definition.options.get("ELASTIC")) else _material
        return self._numbers.get(name.upper()) or self._add(name.upper(), make)

    def _require(self, name: str, by: Keyword | Row) -> Definition:
        if name.upper() not in self.definitions:
            raise by.error(
                f"material {name!r} is not in the deck",
                "add a *MATERIAL with this name, or correct the name in the section",
            )
        return self.definitions[name.upper()]

    def of_section(self, name: str, E: float, nu: float, rho: float) -> int:
        """Add a material that a section defines, and return its number."""
        number = self.properties.free_material()
        self.properties.materials[number] = Material(number, E, nu, rho, name)
        return number

    @property
    def unused(self) -> int:
        """Number of materials without a section."""
        return len(self.definitions) - len(self._numbers)


def definitions(keywords: list[Keyword]) -> dict[str, Definition]:
    """NAME → material; its options are the keywords up to the next *MATERIAL."""
    materials: dict[str, Definition] = {}
    current: Definition | None = None
    for keyword in keywords:
        if keyword.name == "MATERIAL":
            name = keyword.needs("NAME").upper()
            if name in materials:
                raise keyword.error(
                    f"material {keyword.parameters['NAME']!r} is defined twice (first at {materials[name].keyword.where})",
                    "use a unique name for every material",
                )
            current = materials[name] = Definition(keyword)
        elif keyword.name in ("ELASTIC", "DENSITY"):
            if current is None:
                raise keyword.error(
                    "there is no *MATERIAL before this keyword",
                    "move the keyword below the *MATERIAL to which it belongs",
                )
            if keyword.name in current.options:
                raise keyword.error(
                    f"the material has two {keyword.title} (first at {current.options[keyword.name].where})",
                    f"remove one {keyword.title}",
                )
            current.options[keyword.name] = keyword
    return materials


def by_temperature(keywords: Sequence[Keyword]) -> bool:
    """Whether the *ELASTIC of a material differs between temperatures."""
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
    if (elastic := definition.options.get("ELASTIC")) is None:
        raise definition.keyword.error(
            f"a section refers to material {name!r}, but this material has no *ELASTIC",
            f"add an *ELASTIC with Young's modulus and Poisson's ratio{OR_CONFIG}",
        )
    if (kind := _type(definition)) not in ("ISO", "ISOTROPIC"):
        raise elastic.error(
            f"TYPE={kind} is not supported: beams need an isotropic material, shells an isotropic material or LAMINA",
            "use TYPE=ISO, or TYPE=LAMINA for plies; solids also allow TYPE=ENGINEERING CONSTANTS, ORTHOTROPIC "
            "or ANISOTROPIC",
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
    """Density ρ; 0 with a note if it is missing. Adds a note if there are several temperatures; lines: number of
    *ELASTIC lines for each."""
    name = definition.keyword.parameters["NAME"]
    elastic, density = definition.options.get("ELASTIC"), definition.options.get("DENSITY")
    rho = 0.0
    if density is None:
        notes.append(f"material {name} has no *DENSITY, so its density is set to 0")
    else:
        rho = density.rows()[0].not_negative(0, "the density")
    for keyword in (elastic, density):
        each = lines if keyword is elastic else 1
        if keyword is not None and len(keyword.texts) > each:
            notes.append(
                f"material {name} has {len(keyword.texts)} data lines of {keyword.title}; the values of the first "
                "temperature are used for all temperatures"
            )
    return rho


def anisotropic_type(elastic: Keyword | None) -> str:
    """TYPE of an *ELASTIC of anisotropic solids, one of `LINES`; "" otherwise. CalculiX shortens the names."""
    if elastic is None:
        return ""
    type_ = elastic.word("TYPE").replace(" ", "")
    return next(
        (name for name in LINES if type_ == name or (type_ in ("ORTHO", "ANISO") and name.startswith(type_))), ""
    )


def solid_stiffness(elastic: Keyword) -> FloatArray:
    """C (6, 6) along the axes of the material in our order, 11 22 33 12 23 31.

    ORTHOTROPIC lists D₁₁₁₁, D₁₁₂₂, D₂₂₂₂, D₁₁₃₃, D₂₂₃₃, D₃₃₃₃, D₁₂₁₂, D₁₃₁₃, D₂₃₂₃, ANISOTROPIC the upper triangle of D by
    columns in the order 11 22 33 12 13 23. Raises DeckError if C is not positive definite, with its smallest eigenvalue."""
    kind, rows = anisotropic_type(elastic), elastic.rows()
    if kind == "ENGINEERINGCONSTANTS":
        values = _values(elastic, rows, _CONSTANTS)
        triples = values[:3].tolist(), values[3:6].tolist(), values[6:].tolist()
        if fault := constants_fault(*triples):
            raise rows[0].error(*fault)
        return orthotropic(*triples)
    pairs = [(i, j) for j in range(6) for i in range(j + 1)]
    name = ("11", "22", "33", "12", "13", "23")
    if kind == "ORTHOTROPIC":
        pairs = [(i, j) for i, j in pairs if j < 3 or i == j]
    D = np.zeros((6, 6))
    i, j = np.array(pairs).T
    D[i, j] = D[j, i] = _values(elastic, rows, [f"{name[a]}{name[b]}" for a, b in pairs])
    C = D[np.ix_(OURS, OURS)]
    if fault := stiffness_fault(C):
        raise rows[0].error(*fault)
    return C


def _values(elastic: Keyword, rows: list[Row], names: tuple[str, ...] | list[str]) -> FloatArray:
    """Values of the constants `names`, eight a line."""
    if len(rows) < -(-len(names) // 8):
        raise elastic.error(
            f"{len(names)} constants are required, eight on each data line, but the number of data lines is {len(rows)}",
            f"write the constants in the order {', '.join(names)}",
        )
    return np.array([rows[k // 8].real(k % 8, name) for k, name in enumerate(names)])


SYSTEMS = ("RECTANGULAR", "ZRECTANGULAR", "CYLINDRICAL")


@dataclass(frozen=True)
class SolidAxes:
    """Axes of a material of solids; about: the axis, 1, 2 or 3, in the second line of the *ORIENTATION, None if not
    specified; place in the file."""

    orientation: Orientation
    about: int | None
    where: str


def named_orientation(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> Keyword | None:
    """The *ORIENTATION of this name in the part or the assembly; None for ""."""
    if not name:
        return None
    for within in (scope, assembly.scopes[""]):
        for keyword in within.part.keywords:
            if keyword.name == "ORIENTATION" and keyword.word("NAME") == name.upper():
                return keyword
    raise by.error(
        f"orientation {name.upper()!r} is not in the deck",
        "add an *ORIENTATION with this name, or correct the name in the section",
    )


def rectangular_axes(row: Row) -> FloatArray:
    """Axes (3, 3), one in a column, of the points a on x, b in the xy plane, and the origin c."""
    points = np.array([row.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    x, b = points[:2] - points[2]
    return orthonormal(x, normal(x, b), row)


def solid_orientation(assembly: Assembly, scope: Scope, keyword: Keyword) -> Orientation:
    """Orientation of a section of anisotropic solids, see `solid_axes`; the basic axes by default. Raises DeckError for a
    rotated instance without orientation."""
    axes = solid_axes(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    if axes is None and not np.allclose(scope.rotation, np.eye(3)):
        raise keyword.error(
            "anisotropic solids of a rotated instance need an ORIENTATION", "add ORIENTATION=… to the *SOLID SECTION"
        )
    return Orientation(BASIC, np.eye(3)) if axes is None else axes.orientation


def solid_axes(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> SolidAxes | None:
    """Axes of an anisotropic material of solids, rotated with its instance: RECTANGULAR (a on x, b in the plane xy), Z
    RECTANGULAR (a on z, b in the plane xz) or CYLINDRICAL (a and b on the axis; 1 radial, 2 circumferential, 3 axial), defined
    by coordinates; then rotated by an angle [deg] about axis 1, 2 or 3 of the second line. None without a name.

    Raises DeckError for a missing orientation, distributions, and other systems and definitions."""
    if (orientation := named_orientation(assembly, scope, by, name)) is None:
        return None
    system = orientation.word("SYSTEM", "RECTANGULAR").replace(" ", "")
    definition = orientation.word("DEFINITION", "COORDINATES")
    if system not in SYSTEMS or definition not in ("COORDINATES", ""):
        raise orientation.error(
            f"SYSTEM={system}, DEFINITION={definition} is not supported for anisotropic solids",
            "use SYSTEM=RECTANGULAR, Z RECTANGULAR or CYLINDRICAL, with DEFINITION=COORDINATES",
        )
    rows = orientation.rows()
    first = rows[0]
    if parse_real(first.text(0)) is None:
        raise first.error(
            f"the distribution {first.text(0)!r} is not supported for the axes of anisotropic solids",
            "for each group of elements with equal axes, define one section and one *ORIENTATION with DEFINITION=COORDINATES",
        )
    points = np.array([first.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    if system == "CYLINDRICAL":
        origin, z = points[0], points[1] - points[0]
        y = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        axes, kind = orthonormal(np.cross(y, z), z, first), "cylindrical"
    else:
        origin, kind = points[2], "rectangular"
        axes = rectangular_axes(first)
        if system == "ZRECTANGULAR":
            z, x, y = axes.T  # x, y and z of the rectangular system
            axes = np.column_stack([x, y, z])
    moved = CoordinateSystem(kind, scope.rotation @ origin + scope.translation, scope.rotation @ axes)
    if len(rows) < 2:
        return SolidAxes(Orientation(moved, np.eye(3)), None, orientation.where)
    about = rows[1].integer(0, "the rotation axis of the *ORIENTATION", 1)
    if about not in (1, 2, 3):
        raise rows[1].error(
            f"the rotation axis of the *ORIENTATION is {about}, not 1, 2 or 3", "correct the first entry of this line"
        )
    turn = rotation(np.eye(3)[about - 1], np.radians(rows[1].real(1, "the angle", 0.0)))
    return SolidAxes(Orientation(moved, turn), about if rows[1].text(0) else None, orientation.where)

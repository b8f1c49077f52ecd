"""The finite-element model of a config: its file, and what the file does not say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from strainsight.config.base import (
    DENSITY,
    MODULUS,
    STIFFNESS,
    AxesSection,
    DirectionVector,
    Id,
    Name,
    NotNegative,
    ParameterValue,
    Plausible,
    Point,
    Positive,
    Problem,
    Section,
    Size,
    Text,
    Vector,
    YoungsModulus,
    box_problem,
    exactly_one,
    expert,
)

Component = Literal[1, 2, 3, 4, 5, 6]
Components = Annotated[tuple[Component, ...], Field(min_length=1, max_length=6)]
RegionKey = Id | Text
NodeId = Annotated[Id, Field(ge=1)]
SetId = NodeId


class MaterialAxes(AxesSection):
    """Where the axes 1, 2, 3 of an orthotropic material lie."""

    system: Literal["rectangular", "cylindrical", "spherical"] = expert(
        "rectangular",
        description="Of z = x × y through `origin`. rectangular: 1, 2, 3 are x, y, z; cylindrical: radial, tangential, along z; "
        "spherical: radial, away from z, around z. Of the last two they are those at each point of integration.",
    )


Moduli = tuple[Positive, Positive, Positive]


class OfRegions(Section):
    """What holds for some regions."""

    regions: Annotated[tuple[RegionKey, ...], Field(min_length=1)] | Literal["all"] = Field(
        description="Ids or names of the regions (PSOLID, PSHELL, element set, physical group), or 'all', of a section all that "
        "have such elements."
    )


class MaterialSection(OfRegions):
    """A linear elastic material, for regions whose material the file does not state, or in place of the file's: isotropic, or of
    solids orthotropic, with three of each constant."""

    youngs_modulus: YoungsModulus | Moduli = Field(
        description="Young's modulus [Pa], or [E1, E2, E3] of an orthotropic material."
    )
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] | Vector = Field(
        description="Poisson's ratio [-], or [ν12, ν13, ν23] of an orthotropic material, ν_ij = −ε_j/ε_i under a stress along i."
    )
    shear_modulus: Annotated[Moduli | None, MODULUS] = expert(
        None, description="[G12, G13, G23] of an orthotropic material [Pa]."
    )
    density: Annotated[NotNegative, DENSITY] = Field(description="Density [kg/m³].")
    axes: MaterialAxes | None = expert(
        None, description="Axes of an orthotropic material; null: x, y and z of the mesh."
    )

    def problems(self) -> Iterator[Problem]:
        """Three of each constant, or one E and ν."""
        three = {
            "youngs_modulus": isinstance(self.youngs_modulus, tuple),
            "poisson_ratio": isinstance(self.poisson_ratio, tuple),
            "shear_modulus": self.shear_modulus is not None,
        }
        if any(three.values()) and not all(three.values()):
            stated, lacking = (
                ", ".join(name for name, is_set in three.items() if is_set == which) for which in (True, False)
            )
            remedy = "give [E1, E2, E3], [ν12, ν13, ν23] and [G12, G13, G23], or one E and ν and no shear_modulus"
            yield Problem("", f"{stated} of an orthotropic material, and not {lacking}", remedy, at_key=True)
        elif self.axes is not None and not all(three.values()):
            yield Problem("axes", "an isotropic material has no axes", "remove the key", at_key=True)


class ElementSection(OfRegions):
    """What makes elements solid that are no solids: with a thickness triangles and quadrangles are shells, with an area lines
    are beams, or rods where they have no moments of area. A deck of Nastran or Abaqus states this itself."""

    thickness: Annotated[Positive | None, Plausible(1e-5, 2.0, "m", share=1.0)] = Field(
        None, description="Thickness of shells [m]."
    )
    offset: Annotated[float, Plausible(0.0, 10.0, "m", share=1.0)] = expert(
        0.0,
        description="Of the middle of shells from their nodes [m], along the normal by the right-hand rule about the order of "
        "nodes.",
    )
    area: Annotated[Positive | None, Plausible(1e-8, 10.0, "m²")] = Field(
        None, description="Area of the section of beams or rods [m²]."
    )
    second_moments: Annotated[
        tuple[Positive, Positive] | tuple[Positive, Positive, float] | None, Plausible(1e-16, 10.0, "m⁴")
    ] = Field(
        None,
        description="Second moments of area of beams about the centroid [m⁴]: [∫y² dA, ∫z² dA] or [∫y² dA, ∫z² dA, ∫yz dA]. The "
        "first resists bending in the plane of the beam and `direction`, the second across it. Null: rods.",
    )
    torsion: Annotated[NotNegative | None, Plausible(1e-16, 10.0, "m⁴")] = Field(
        None, description="Torsion constant J of beams [m⁴], ∫r² dA of a circle; of rods may be null for 0."
    )
    direction: DirectionVector | None = Field(
        None,
        description="Vector towards which y of beams points [-]; x runs from their first node to their second.",
    )
    size: Annotated[tuple[Positive, Positive] | None, Plausible(1e-5, 10.0, "m", share=1.0)] = expert(
        None,
        description="Of the section of beams along y and z [m]: how far apart its sides are, on which gauges sit; null: a square "
        "of its area.",
    )

    def problems(self) -> Iterator[Problem]:
        """The section of shells, or that of beams or rods."""
        yield from exactly_one("", {"thickness": self.thickness, "area": self.area})
        of_beams = [n for n in ("second_moments", "torsion", "direction", "size") if getattr(self, n) is not None]
        if self.area is None:
            for name in of_beams:
                yield Problem(name, "is of beams, which have an area", "remove the key", at_key=True)
        elif self.offset:
            yield Problem("offset", "is of shells, which have a thickness", "remove the key", at_key=True)
        elif self.second_moments is None:
            for name in (name for name in ("direction", "size") if name in of_beams):
                what = "is of beams, which have second_moments; this is a rod"
                yield Problem(name, what, "give second_moments, or remove the key", at_key=True)
        else:
            yy, zz, yz = (*self.second_moments, 0.0)[:3]
            if yz**2 >= yy * zz:
                what = f"∫yz dA of {yz:g} m⁴ is too large for ∫y² dA and ∫z² dA, {yy:g} and {zz:g} m⁴"
                yield Problem("second_moments", what, "its square is below their product in every section")
            for name, remedy in (("torsion", "give J [m⁴]"), ("direction", "give a vector such as [0, 0, 1]")):
                if name not in of_beams:
                    yield Problem(name, "missing: beams need it beside second_moments", remedy, at_key=True)


class Support(Section):
    """Components that are held at zero, or springs to the ground, beside those of the file."""

    node: NodeId | None = Field(None, description="Id of a node.")
    set: Text | None = Field(None, description="Name of a node set or a face instead of a node.")
    components: Components = Field((1, 2, 3), description="1-3 translations, 4-6 rotations of a reference node.")
    stiffness: Annotated[NotNegative | Vector | None, STIFFNESS] = Field(
        None,
        description="Stiffness of springs to the ground in place of a hold [N/m, of rotations N m/rad]: a number for each of the "
        "components, or three along x, y and z. It is that of the whole support: in equal parts on the nodes of a set, evenly "
        "over the area of a face. It is no part of a modulus that is estimated.",
    )

    def problems(self) -> Iterator[Problem]:
        yield from exactly_one("", {"node": self.node, "set": self.set})
        if self.stiffness is None:
            return
        values = self.stiffness if isinstance(self.stiffness, tuple) else (self.stiffness,)
        if min(values) < 0 or max(values) == 0:
            yield Problem("stiffness", "no positive stiffness", "give one in N/m; without `stiffness` it is held")
        if len(values) > 1 and self.components != (1, 2, 3):
            yield Problem("components", "three stiffnesses are those along x, y and z", "remove the key", at_key=True)
        if len({component > 3 for component in self.components}) > 1:
            yield Problem("components", "one stiffness for [N/m] and [N m/rad]", "make two supports of it")


class Face(Section):
    """A face of the surface, or several, under one name; all that is given has to hold."""

    near: Point | Annotated[tuple[Point, ...], Field(min_length=1)] | None = Field(
        None,
        description="A point [m], or a list of points: the face nearest to each. A face ends where it turns by more than "
        "30°, or begins to bend. The middle of a bore means the bore. `import` lists a point of every face.",
    )
    normal: DirectionVector | None = Field(None, description="Outward normal [-]: facets that face this way.")
    angle: float = expert(10.0, gt=0, le=90, description="Largest angle between a facet's normal and `normal` [deg].")
    box: tuple[Point, Point] | None = Field(
        None, description="[[x, y, z], [x, y, z]]: lower and upper corner [m]; facets whose centre lies between them."
    )
    radius: Size | None = Field(None, description="Bores and cylinders of this radius [m], to 2 %.")

    def problems(self) -> Iterator[Problem]:
        if not (self.near or self.normal or self.box or self.radius):
            yield Problem("", "says of no face which it is", "give near, normal, box or radius", at_key=True)
        if self.box is not None:
            yield from box_problem("box", self.box)


class Tie(Section):
    """A reference node that leads (rigid, RBE2) or follows (averaging, RBE3) the nodes of a set; or nodes that follow the surface
    on which they lie (surface)."""

    type: Literal["rigid", "averaging", "surface"] = Field(
        description="rigid: nodes follow the reference; averaging: it follows their mean motion; surface: the nodes "
        "follow the facets of solids that they lie on, by the shape functions of these: a fine mesh on a coarse one."
    )
    reference: NodeId | None = Field(
        None, description="Id of the reference node; a new one where `at` is given. Not of a surface."
    )
    at: Point | None = Field(None, description="Position of a new reference node [m].")
    set: Text = Field(description="Name of the node set or face; of a surface the finer side.")
    to: Text | None = Field(
        None, description="surface: name of the node set or face that they follow, the coarser side."
    )
    within: Annotated[Positive, Plausible(1e-9, 0.1, "m", share=0.1)] = expert(
        1e-4, description="surface: how far the nodes may lie from it [m]."
    )
    components: Components | None = expert(
        None, description="rigid: of the nodes, default [1, 2, 3]; averaging: of the reference, default all six."
    )

    @model_validator(mode="after")
    def _of_its_type(self) -> Tie:
        if self.type == "surface" and self.to is None:
            raise ValueError("a surface needs `to`, the face that the nodes of `set` follow")
        if self.type == "surface" and (self.reference, self.at, self.components) != (None, None, None):
            raise ValueError(
                "a surface has no reference node and no components: remove `reference`, `at` and `components`"
            )
        if self.type != "surface" and self.reference is None:
            raise ValueError(f"{self.type} needs `reference`, the id of the reference node")
        return self


class MatrixTerm(Section):
    """One term of the stiffness or mass, from a file: X(θ) = Σ X_i, or X_i θ/at where it belongs to a parameter."""

    file: Text = Field(
        description="OP4 (.op4), Matrix Market (.mtx), NumPy/SciPy (.npz) or CalculiX (.sti, .mas) file, in the deck's units."
    )
    name: Text | None = Field(None, description="Which matrix of a file that holds several.")
    parameter: Name | None = Field(None, description="Name of the parameter that this term is proportional to.")
    at: ParameterValue | None = Field(
        None, description="Value of the parameter that the matrix was made with [Pa, kg/m³ or 1]; null: 1, a unit term."
    )


class Matrices(Section):
    """Stiffness and mass from another program, in place of those this package assembles from the solids."""

    numbering: Text = Field(
        description="CSV file, one line a row of the matrices: node id, component 1-6; first line: node,component. Or a .dof of "
        "CalculiX."
    )
    stiffness: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(description="Terms of the stiffness.")
    mass: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(description="Terms of the mass.")


Step = Annotated[Id, Field(ge=0)] | Text


class InResults(Section):
    """Where something stands in results of another program."""

    file: Text | None = Field(None, description="File of results with it; null: that of mesh.results.file.")
    step: Step | None = Field(
        None,
        description="Number or title of its step or subcase, for a response that in which this load acted alone; null: the only "
        "one of the file that has modes, or the only static one.",
    )


class ModesOfResults(InResults):
    """Where the modes stand."""


class ResponseOfLoad(InResults):
    """Where the static response to one load stands."""

    applied: Annotated[float, Plausible(1e-9, 1e12, "unit of the load")] = Field(
        1.0,
        description="How large the load was there, in the unit of the load [N, N m, Pa …]: of 500 N along the load's direction "
        "500, against it -500.",
    )


class ResultsFile(Section):
    """A file of results and the modes in it."""

    file: Text = Field(
        description="File of results of this mesh, in the units of the mesh: .frd of CalculiX, .op2 or .pch of Nastran, "
        "universal (.unv, .uff), .rst of Ansys, .vtu or .vtk. Modes and responses of all loads are taken from it but where they "
        "name another."
    )
    modes: ModesOfResults = expert(default_factory=ModesOfResults, description="Natural frequencies and mode shapes.")


class SecondResults(ResultsFile):
    """Modes and static responses at another value of one parameter: what its regions add to the whole."""

    parameter: Name = Field(
        description="Which parameter: a youngs_modulus, stiffness_factor or density of some regions."
    )
    at: ParameterValue = Field(
        description="Its value when this set was made [Pa, kg/m³ or 1]; that of the first one is in mesh.results.at, or the "
        "mesh's."
    )
    loads: dict[Name, ResponseOfLoad] | None = expert(
        None, description="As mesh.results.loads, of this set; null: the same steps of this file, and the same sizes."
    )


class ResultsSection(ResultsFile):
    """Modes and static responses of another program, in place of stiffness and mass."""

    loads: dict[Name, ResponseOfLoad] = Field(
        {},
        description="By the name of a load (`loads`), the static response to it alone. What the modes do not carry of a load is "
        "in its static response: of a load without one the strain near it is too small.",
    )
    modal_mass: Literal["auto", "unit", "mesh"] = expert(
        "auto",
        description="ΦᵀMΦ of the shapes. unit: 1 in the units of the mesh; mesh: by its densities; auto: as the file states, "
        "else by the densities.",
    )
    at: dict[Name, ParameterValue] = Field(
        {},
        description="By the name of a parameter, its value when the results were made [Pa, kg/m³ or 1]; left out: that of the "
        "mesh's materials, 1 of a stiffness_factor.",
    )
    second: SecondResults | None = Field(
        None,
        description="A second set of results, made with another value of a parameter of some regions, which may then be free.",
    )


class MeshFile(Section):
    """The finite-element model."""

    file: Text = Field(
        description="Nastran (.bdf, .nas, .dat), Abaqus (.inp), gmsh (.msh), results of CalculiX (.frd), VTU/VTK or another mesh "
        "that meshio reads, also packed (.gz) where it is text; the path starts from the config's folder."
    )
    format: Literal["auto", "nastran", "abaqus", "gmsh", "frd", "meshio"] = expert(
        "auto", description="Which reader; auto goes by the name's ending."
    )
    length_unit: Literal["m", "mm", "cm", "km", "in", "ft"] = Field("m", description="Unit of length in the file.")
    mass_unit: Literal["kg", "t", "g", "lb", "slug", "lbf*s2/in"] = Field(
        "kg",
        description="Unit of mass in the file; the time unit is s, so N and mm go with t, lbf and in with lbf*s2/in.",
    )
    region_data: Text | None = expert(
        None, description="Cell data array that holds the region ids (VTU, VTK and the like); null: by its usual names."
    )
    ignore: tuple[Text, ...] = Field(
        (),
        description="Cards (CQUAD4, MPC), keywords (TIE, DLOAD) and types of elements (S4R) of the deck that are left out, "
        "though the model would need their stiffness, mass, tie or load. Elements, ties and loads that are not supported have "
        "to be named here.",
    )
    contact: Literal["bonded", "open"] | None = Field(
        None,
        description="What becomes of surfaces of a deck that are in contact (*CONTACT PAIR). bonded: nodes of the first surface "
        "that lie on the second follow it, the stiffest that a contact can be; open: nothing connects them. Null: a deck with "
        "contact is an error, but for pairs that it ties itself, which are bonded always.",
    )
    mass: Literal["consistent", "lumped"] | None = expert(
        None,
        description="Mass of solids: consistent, ∫ ρ N_a N_b dV, or lumped, its diagonal scaled to the mass of each element, as "
        "programs have it whose frequencies are compared. Null: lumped where a Nastran deck of solids says so "
        "(PARAM,COUPMASS,-1), else consistent.",
    )
    spc: SetId | None = expert(
        None,
        description="Number of the set of supports (SPC, SPC1, SPCADD) of a Nastran deck that holds; null: the one that its case "
        "control selects.",
    )
    step: SetId | None = expert(
        None,
        description="Number, from 1, of the step of an Abaqus or CalculiX deck whose supports (*BOUNDARY) and elements (*MODEL "
        "CHANGE) count; null: the one of its frequency analysis, or all, which then have to agree.",
    )
    include_dirs: tuple[Text, ...] = Field(
        (),
        description="Folders from which a deck may include files (INCLUDE, *INCLUDE, INPUT=) beside its own folder and those "
        "below it; paths start from the config's folder. Links are followed before it is decided where a file lies.",
    )
    merge: Annotated[Positive | None, Plausible(1e-9, 0.01, "m", share=0.1)] = Field(
        None,
        description="Nodes of elements that are this near to each other [m] become one, that of the lowest id; 1e-6 of meshes "
        "whose parts share places and no nodes. Nodes that a tie or spring joins in their place stay. Null: none.",
    )
    faces: dict[Name, Face] = Field(
        {},
        description="Names for faces of the surface, which the file need not know: a name is a set of nodes, for loads, "
        "supports, ties, zones and `gauges.surface`.",
    )
    materials: dict[Name, MaterialSection] = Field(
        {}, description="Materials that the file lacks, in SI units, by name."
    )
    sections: dict[Name, ElementSection] = Field(
        {},
        description="Sections that make shells, beams and rods of triangles, quadrangles and lines of a gmsh, VTU or other file, "
        "which are the surface of its solids otherwise; by name.",
    )
    supports: tuple[Support, ...] = Field((), description="Supports that the file lacks.")
    free: bool = Field(
        False,
        description="Whether the structure is free: nothing has to hold it. Its rigid motions strain nothing, and are left out; "
        "its modes are the elastic ones, static responses those with the inertia of the rigid acceleration (inertia relief). For "
        "gauges only: accelerometers and displacement sensors want `supports` on soft springs.",
    )
    ties: tuple[Tie, ...] = Field((), description="Rigid and averaging elements that the file lacks.")
    matrices: Matrices | None = Field(None, description="Stiffness and mass from another program.")
    results: ResultsSection | None = Field(
        None,
        description="Modes and static responses from another program, in place of stiffness and mass: supports and materials of "
        "the mesh are then not needed.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.sections and self.matrices is not None:
            yield Problem("sections", "stiffness and mass are those of mesh.matrices", "remove the key", at_key=True)
        for i, support in enumerate(self.supports):
            if support.stiffness is not None and max(support.components) > 3 and support.set in self.faces:
                what = "a face has no rotations"
                yield Problem(f"supports.{i}.components", what, "give the stiffness of translations, or a node")
            if support.stiffness is not None and self.matrices is not None:
                what = "the stiffness is that of mesh.matrices"
                yield Problem(f"supports.{i}.stiffness", what, "put the spring there", at_key=True)
        claimed: dict[object, str] = {}
        for name, material in self.materials.items():
            for region in ("all",) if isinstance(material.regions, str) else material.regions:
                if (other := claimed.setdefault(region, name)) != name:
                    yield Problem(
                        f"materials.{name}.regions", f"region {region} is of material {other} too", "keep one"
                    )
        if len(self.materials) > 1 and "all" in claimed:
            yield Problem(f"materials.{claimed['all']}.regions", "'all' beside other materials", "name the regions")

"""The finite-element model of a config: mesh file, and properties that the file lacks."""

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
    """Orientation of the axes 1, 2, 3 of an orthotropic material."""

    system: Literal["rectangular", "cylindrical", "spherical"] = expert(
        "rectangular",
        description="Kind of coordinate system, with z = x × y through `origin`. With `rectangular`: 1, 2, 3 are x, y, z. "
        "With `cylindrical`: radial, tangential, axial along z. With `spherical`: radial, polar (away from z), azimuthal "
        "(around z). Cylindrical and spherical axes are evaluated at each integration point.",
    )


Moduli = tuple[Positive, Positive, Positive]


class RegionProperty(Section):
    """A property of some regions."""

    regions: Annotated[tuple[RegionKey, ...], Field(min_length=1)] | Literal["all"] = Field(
        description="Ids or names of the regions (PSOLID, PSHELL, element set, physical group). 'all': every region; "
        "in a section, every region with elements of this kind."
    )


class MaterialSection(RegionProperty):
    """A linear elastic material that adds to or replaces the materials of the mesh file: isotropic, or for solids orthotropic,
    with three values of each constant."""

    youngs_modulus: YoungsModulus | Moduli = Field(
        description="Young's modulus [Pa], or [E1, E2, E3] of an orthotropic material."
    )
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] | Vector = Field(
        description="Poisson's ratio [-], or [ν12, ν13, ν23] of an orthotropic material, with ν_ij = −ε_j/ε_i under uniaxial "
        "stress along i."
    )
    shear_modulus: Annotated[Moduli | None, MODULUS] = expert(
        None, description="Shear moduli [G12, G13, G23] of an orthotropic material [Pa]."
    )
    density: Annotated[NotNegative, DENSITY] = Field(description="Density [kg/m³].")
    axes: MaterialAxes | None = expert(
        None, description="Material axes of an orthotropic material; null: x, y and z of the mesh."
    )

    def problems(self) -> Iterator[Problem]:
        """Check for three values of each constant, or one E and one ν."""
        three = {
            "youngs_modulus": isinstance(self.youngs_modulus, tuple),
            "poisson_ratio": isinstance(self.poisson_ratio, tuple),
            "shear_modulus": self.shear_modulus is not None,
        }
        if any(three.values()) and not all(three.values()):
            anisotropic, lacking = (
                " and ".join(names) + (" is" if len(names) == 1 else " are")
                for names in ([name for name, is_set in three.items() if is_set == which] for which in (True, False))
            )
            remedy = "set [E1, E2, E3], [ν12, ν13, ν23] and [G12, G13, G23]; or one E and one ν without shear_modulus"
            yield Problem("", f"{anisotropic} orthotropic, but {lacking} not", remedy, at_key=True)
        elif self.axes is not None and not all(three.values()):
            yield Problem("axes", "an isotropic material does not need axes", "remove the key", at_key=True)


class ElementSection(RegionProperty):
    """A section for shells, beams or rods. Triangles and quadrangles with a thickness are shells; lines with an area are beams,
    or rods without second moments of area. Nastran and Abaqus decks already contain these data."""

    thickness: Annotated[Positive | None, Plausible(1e-5, 2.0, "m", share=1.0)] = Field(
        None, description="Thickness of shells [m]."
    )
    offset: Annotated[float, Plausible(0.0, 10.0, "m", share=1.0)] = expert(
        0.0,
        description="Offset of the shell midsurface from the nodes [m], along the normal (right-hand rule on the node order).",
    )
    area: Annotated[Positive | None, Plausible(1e-8, 10.0, "m²")] = Field(
        None, description="Cross-sectional area of beams or rods [m²]."
    )
    second_moments: Annotated[
        tuple[Positive, Positive] | tuple[Positive, Positive, float] | None, Plausible(1e-16, 10.0, "m⁴")
    ] = Field(
        None,
        description="Second moments of area of beams about the centroid [m⁴]: [∫y² dA, ∫z² dA] or [∫y² dA, ∫z² dA, ∫yz dA]. "
        "The first resists bending in the plane of the beam and `direction`, the second bending across it. Null: rods.",
    )
    torsion: Annotated[NotNegative | None, Plausible(1e-16, 10.0, "m⁴")] = Field(
        None, description="Torsion constant J of beams [m⁴], ∫r² dA for a circle. Null: 0, for rods only."
    )
    direction: DirectionVector | None = Field(
        None,
        description="Vector towards the y axis of beams [-]; x runs from the first to the second node.",
    )
    size: Annotated[tuple[Positive, Positive] | None, Plausible(1e-5, 10.0, "m", share=1.0)] = expert(
        None,
        description="Outer dimensions of the beam section along y and z [m]; gauges are bonded to its sides. Null: a square "
        "with the area of the section.",
    )

    def problems(self) -> Iterator[Problem]:
        """Check that the section is that of shells, or of beams or rods."""
        yield from exactly_one("", {"thickness": self.thickness, "area": self.area})
        of_beams = [n for n in ("second_moments", "torsion", "direction", "size") if getattr(self, n) is not None]
        if self.area is None:
            for name in of_beams:
                yield Problem(
                    name, "applies to beams only, and this section has a thickness", "remove the key", at_key=True
                )
        elif self.offset:
            yield Problem(
                "offset", "applies to shells only, and this section has an area", "remove the key", at_key=True
            )
        elif self.second_moments is None:
            for name in (name for name in ("direction", "size") if name in of_beams):
                what = "applies to beams only; without second_moments this is a rod"
                yield Problem(name, what, "set second_moments, or remove the key", at_key=True)
        else:
            yy, zz, yz = (*self.second_moments, 0.0)[:3]
            if yz**2 >= yy * zz:
                what = f"∫yz dA of {yz:g} m⁴ is too large for ∫y² dA = {yy:g} m⁴ and ∫z² dA = {zz:g} m⁴"
                yield Problem("second_moments", what, "use |∫yz dA| below √(∫y² dA · ∫z² dA)")
            for name, remedy in (("torsion", "set J [m⁴]"), ("direction", "use a vector such as [0, 0, 1]")):
                if name not in of_beams:
                    yield Problem(name, "missing, but required for beams with second_moments", remedy, at_key=True)


class Support(Section):
    """A fixed support, or springs to the ground, in addition to the supports of the mesh file."""

    node: NodeId | None = Field(None, description="Id of the supported node.")
    set: Text | None = Field(None, description="Name of a node set or face, instead of a node.")
    components: Components = Field(
        (1, 2, 3), description="Supported components: 1-3 are translations, 4-6 rotations of a reference node."
    )
    stiffness: Annotated[NotNegative | Vector | None, STIFFNESS] = Field(
        None,
        description="Stiffness of springs to the ground, instead of a fixed support [N/m, for rotations N m/rad]. Either one "
        "value for every component, or three values along x, y and z. The value is that of the whole support: it is shared "
        "equally by the nodes of a set, and distributed over the area of a face. An estimated modulus does not scale it.",
    )

    def problems(self) -> Iterator[Problem]:
        yield from exactly_one("", {"node": self.node, "set": self.set})
        if self.stiffness is None:
            return
        values = self.stiffness if isinstance(self.stiffness, tuple) else (self.stiffness,)
        if min(values) < 0 or max(values) == 0:
            what = "the stiffness is not positive"
            remedy = "use a positive stiffness in N/m, or remove `stiffness` for a fixed support"
            yield Problem("stiffness", what, remedy)
        if len(values) > 1 and self.components != (1, 2, 3):
            yield Problem("components", "three stiffness values apply along x, y and z", "remove the key", at_key=True)
        if len({component > 3 for component in self.components}) > 1:
            what = "one stiffness cannot be both in [N/m] and in [N m/rad]"
            yield Problem("components", what, "define two supports, one for translations and one for rotations")


class Face(Section):
    """A named part of the surface: the facets that satisfy all criteria."""

    near: Point | Annotated[tuple[Point, ...], Field(min_length=1)] | None = Field(
        None,
        description="A point or a list of points [m]; selects the face nearest to each point. A face ends where its "
        "normal turns by more than 30° or where its curvature begins. A point on the axis of a bore selects the "
        "bore. `import` lists a point of every face.",
    )
    normal: DirectionVector | None = Field(None, description="Outward normal [-]; selects the facets with this normal.")
    angle: float = expert(
        10.0, gt=0, le=90, description="Largest angle between the normal of a facet and `normal` [deg]."
    )
    box: tuple[Point, Point] | None = Field(
        None,
        description="Lower and upper corner [[x, y, z], [x, y, z]] [m]; selects the facets with their centre in the box.",
    )
    radius: Size | None = Field(None, description="Radius of bores and cylinders to select [m], within 2 %.")

    def problems(self) -> Iterator[Problem]:
        if not (self.near or self.normal or self.box or self.radius):
            yield Problem("", "does not select any face", "set near, normal, box or radius", at_key=True)
        if self.box is not None:
            yield from box_problem("box", self.box)


class Tie(Section):
    """A rigid element (rigid, RBE2), an averaging element (averaging, RBE3), or nodes that follow the surface they lie on
    (surface)."""

    type: Literal["rigid", "averaging", "surface"] = Field(
        description="Kind of constraint. With `rigid`: the nodes follow the reference node. With `averaging`: the "
        "reference node follows the mean motion of the nodes. With `surface`: each node follows the solid facet "
        "below it, by the shape functions of the facet, to tie a fine mesh to a coarse mesh."
    )
    reference: NodeId | None = Field(
        None, description="Id of the reference node; a new id if `at` is set. Not used with `surface`."
    )
    at: Point | None = Field(None, description="Position of a new reference node [m].")
    set: Text = Field(description="Name of the node set or face with the tied nodes; with `surface`, the finer side.")
    to: Text | None = Field(None, description="`surface`: name of the node set or face on the coarser side.")
    within: Annotated[Positive, Plausible(1e-9, 0.1, "m", share=0.1)] = expert(
        1e-4, description="`surface`: largest distance of the nodes from the coarser side [m]."
    )
    components: Components | None = expert(
        None,
        description="Constrained components. With `rigid`: of the nodes, default [1, 2, 3]. With `averaging`: of the "
        "reference node, default all six.",
    )

    @model_validator(mode="after")
    def _of_its_type(self) -> Tie:
        if self.type == "surface" and self.to is None:
            raise ValueError("a surface tie needs `to`, the face that the nodes of `set` follow")
        if self.type == "surface" and (self.reference, self.at, self.components) != (None, None, None):
            raise ValueError(
                "a surface tie has no reference node and no components; remove `reference`, `at` and `components`"
            )
        if self.type != "surface" and self.reference is None:
            raise ValueError(f"a tie of type {self.type} needs `reference`, the id of the reference node")
        return self


class MatrixTerm(Section):
    """One term of the stiffness or mass matrix, from a file: X(θ) = Σ X_i, or X_i θ/at if it is proportional to a parameter."""

    file: Text = Field(
        description="OP4 (.op4), Matrix Market (.mtx), NumPy/SciPy (.npz) or CalculiX (.sti, .mas) file, in the units of the "
        "deck."
    )
    name: Text | None = Field(None, description="Name of the matrix, if the file contains several.")
    parameter: Name | None = Field(None, description="Parameter that this term is proportional to.")
    at: ParameterValue | None = Field(
        None, description="Parameter value used when the matrix was written [Pa, kg/m³ or 1]; null: 1, a unit term."
    )


class Matrices(Section):
    """Stiffness and mass matrices from another program, instead of matrices assembled here."""

    numbering: Text = Field(
        description="CSV file with one line for each matrix row: node id, component 1-6; the header is node,component. Or a "
        "CalculiX .dof file."
    )
    stiffness: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(
        description="Terms of the stiffness matrix."
    )
    mass: Annotated[tuple[MatrixTerm, ...], Field(min_length=1)] = Field(description="Terms of the mass matrix.")


Step = Annotated[Id, Field(ge=0)] | Text


class InResults(Section):
    """Location of a result in the results of another program."""

    file: Text | None = Field(None, description="Results file; null: mesh.results.file.")
    step: Step | None = Field(
        None,
        description="Number or title of the step or subcase; for a response, the step with this load alone. Null: the only "
        "step with modes, or the only static step.",
    )


class ModesOfResults(InResults):
    """Location of the modes."""


class ResponseOfLoad(InResults):
    """Location of the static response to one load."""

    magnitude: Annotated[float, Plausible(1e-9, 1e12, "unit of the load")] = Field(
        1.0,
        description="Load magnitude in that step, in the unit of the load [N, N m, Pa …]. Example: 500 for 500 N along the "
        "direction of the load, −500 for the opposite direction.",
    )


class ResultsFile(Section):
    """A results file and the location of its modes."""

    file: Text = Field(
        description="Results file of this mesh, in the units of the mesh: .frd (CalculiX), .op2 or .pch (Nastran), .unv or .uff "
        "(universal), .rst (Ansys), .vtu or .vtk. Modes and responses without `file` are read from this file."
    )
    modes: ModesOfResults = expert(default_factory=ModesOfResults, description="Natural frequencies and mode shapes.")


class SecondResults(ResultsFile):
    """Modes and static responses at another value of one parameter, to separate the stiffness or mass of its regions from the
    rest."""

    parameter: Name = Field(
        description="Name of the parameter: a youngs_modulus, stiffness_factor or density of some regions."
    )
    at: ParameterValue = Field(
        description="Parameter value of this set [Pa, kg/m³ or 1]; that of the first set is in mesh.results.at, or in the mesh."
    )
    loads: dict[Name, ResponseOfLoad] | None = expert(
        None,
        description="Same as mesh.results.loads, for this set; null: the same steps of this file, with the same magnitudes.",
    )


class ResultsSection(ResultsFile):
    """Modes and static responses from another program, instead of stiffness and mass matrices."""

    loads: dict[Name, ResponseOfLoad] = Field(
        {},
        description="Static response to each load alone, by load name (`loads`). It contains the local deformation that the "
        "modes cannot represent: without this response, the strain near the load is too small.",
    )
    modal_mass: Literal["auto", "unit", "mesh"] = expert(
        "auto",
        description="Normalisation ΦᵀMΦ of the mode shapes. With `unit`: 1 in the units of the mesh. With `mesh`: from its "
        "densities. With `auto`: as stated in the file, otherwise from the densities.",
    )
    at: dict[Name, ParameterValue] = Field(
        {},
        description="Parameter values used for the results, by parameter name [Pa, kg/m³ or 1]. Default: the materials of "
        "the mesh, and 1 for a stiffness_factor.",
    )
    second: SecondResults | None = Field(
        None,
        description="A second set of results at another value of one parameter of some regions. This parameter can "
        "then be a free parameter.",
    )


class MeshFile(Section):
    """The finite-element model."""

    file: Text = Field(
        description="Mesh file: Nastran (.bdf, .nas, .dat), Abaqus (.inp), gmsh (.msh), CalculiX results (.frd), VTU/VTK, or "
        "another format of meshio. Text files may be compressed (.gz). The path is relative to the folder of the config."
    )
    format: Literal["auto", "nastran", "abaqus", "gmsh", "frd", "meshio"] = expert(
        "auto", description="File format; `auto`: by the file extension."
    )
    length_unit: Literal["m", "mm", "cm", "km", "in", "ft"] = Field("m", description="Length unit of the file.")
    mass_unit: Literal["kg", "t", "g", "lb", "slug", "lbf*s2/in"] = Field(
        "kg",
        description="Mass unit of the file. The time unit is s: use t with N and mm, and lbf*s2/in with lbf and in.",
    )
    region_data: Text | None = expert(
        None, description="Cell data array with the region ids (VTU, VTK and similar); null: the usual names."
    )
    ignore: tuple[Text, ...] = Field(
        (),
        description="Cards (CQUAD4, MPC), keywords (TIE, DLOAD) and element types (S4R) of the deck to ignore although they "
        "affect stiffness, mass or loads. Unsupported elements, ties and loads have to be listed here.",
    )
    contact: Literal["bonded", "open"] | None = Field(
        None,
        description="Treatment of contact pairs of the deck (*CONTACT PAIR). With `bonded`: nodes of the first surface that "
        "lie on the second follow it, which is the upper bound of the contact stiffness. With `open`: the surfaces are not "
        "connected. Null: a deck with contact is an error; pairs that the deck ties itself are always bonded.",
    )
    mass: Literal["consistent", "lumped"] | None = expert(
        None,
        description="Mass matrix of solids. With `consistent`: ∫ ρ N_a N_b dV. With `lumped`: its diagonal scaled to the "
        "mass of each element, for a comparison with the frequencies of programs that use it. Null: lumped if a Nastran "
        "deck of solids requests it (PARAM,COUPMASS,-1), otherwise consistent.",
    )
    spc: SetId | None = expert(
        None,
        description="Id of the active support set (SPC, SPC1, SPCADD) of a Nastran deck; null: the set selected in the case "
        "control section.",
    )
    step: SetId | None = expert(
        None,
        description="Number, from 1, of the step of an Abaqus or CalculiX deck with the active supports (*BOUNDARY) and "
        "elements (*MODEL CHANGE). Null: the frequency step; or all steps, which then have to agree.",
    )
    include_dirs: tuple[Text, ...] = Field(
        (),
        description="Additional folders for included files (INCLUDE, *INCLUDE, INPUT=), apart from the folder of the deck "
        "and its subfolders. Paths are relative to the folder of the config; symbolic links are resolved first.",
    )
    merge: Annotated[Positive | None, Plausible(1e-9, 0.01, "m", share=0.1)] = Field(
        None,
        description="Distance below which nodes of elements are merged into the node with the lowest id [m]; use 1e-6 for "
        "parts with coincident but separate nodes. Nodes connected by a tie or spring are not merged. Null: no merging.",
    )
    faces: dict[Name, Face] = Field(
        {},
        description="Named faces of the surface, defined here instead of in the mesh file. Each name is a node set for "
        "loads, supports, ties, zones and `gauges.surface`.",
    )
    materials: dict[Name, MaterialSection] = Field(
        {}, description="Materials that the mesh file lacks, in SI units, by name."
    )
    sections: dict[Name, ElementSection] = Field(
        {},
        description="Sections of shells, beams and rods in a gmsh, VTU or similar file, by name. Without a section, "
        "triangles, quadrangles and lines are the surface of the solids.",
    )
    supports: tuple[Support, ...] = Field((), description="Supports in addition to those of the mesh file.")
    free: bool = Field(
        False,
        description="`true`: the structure is free and needs no supports. Rigid-body modes produce no strain and are omitted; "
        "static responses include the inertia of the rigid-body acceleration (inertia relief). Only strain gauges are "
        "possible: accelerometers and displacement sensors need `supports` on soft springs instead.",
    )
    ties: tuple[Tie, ...] = Field((), description="Rigid and averaging elements in addition to those of the mesh file.")
    matrices: Matrices | None = Field(None, description="Stiffness and mass matrices from another program.")
    results: ResultsSection | None = Field(
        None,
        description="Modes and static responses from another program, instead of stiffness and mass matrices. The mesh then "
        "needs no supports and no materials.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.sections and self.matrices is not None:
            yield Problem("sections", "stiffness and mass come from mesh.matrices", "remove the key", at_key=True)
        for i, support in enumerate(self.supports):
            if support.stiffness is not None and max(support.components) > 3 and support.set in self.faces:
                what = "a face has no rotational components"
                yield Problem(f"supports.{i}.components", what, "set the stiffness of translations, or use a node")
            if support.stiffness is not None and self.matrices is not None:
                what = "the stiffness comes from mesh.matrices"
                yield Problem(f"supports.{i}.stiffness", what, "include the spring in these matrices", at_key=True)
        claimed: dict[object, str] = {}
        for name, material in self.materials.items():
            for region in ("all",) if isinstance(material.regions, str) else material.regions:
                if (other := claimed.setdefault(region, name)) != name:
                    what = f"region {region} is also assigned to material {other}"
                    yield Problem(f"materials.{name}.regions", what, "assign the region to one material only")
        if len(self.materials) > 1 and "all" in claimed:
            what = "'all' cannot be combined with other materials"
            yield Problem(f"materials.{claimed['all']}.regions", what, "list the regions of each material")

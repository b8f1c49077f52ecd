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
from strainsight.config.imported import Matrices, ResultsSection

Components = Annotated[tuple[Literal[1, 2, 3, 4, 5, 6], ...], Field(min_length=1, max_length=6)]
RegionKey = Id | Text
NodeId = Annotated[Id, Field(ge=1)]
Moduli = tuple[Positive, Positive, Positive]


class MaterialAxes(AxesSection):
    """Orientation of the axes 1, 2, 3 of an orthotropic material."""

    system: Literal["rectangular", "cylindrical", "spherical"] = expert(
        "rectangular",
        description="Kind of coordinate system, with z = x × y through `origin`. With `rectangular`: axes 1, 2, 3 are x, y, z. "
        "With `cylindrical`: 1 radial, 2 tangential, 3 axial along z. With `spherical`: 1 radial, 2 polar (away from z), 3 "
        "azimuthal (around z). Cylindrical and spherical axes are evaluated at each integration point.",
    )


class RegionProperty(Section):
    """A material or section of some regions."""

    regions: Annotated[tuple[RegionKey, ...], Field(min_length=1)] | Literal["all"] = Field(
        description="Ids or names of the regions with this material or section (PSOLID, PSHELL, element set, physical group). "
        "With 'all': every region; for a section, every region with shells (`thickness`) or lines (`area`)."
    )


class MaterialSection(RegionProperty):
    """A linear elastic material in addition to the materials of the mesh file, or instead of them. The material is isotropic; for
    solids, it may be orthotropic, with three values of each constant."""

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
    density: Annotated[NotNegative, DENSITY] = Field(description="Density of the material [kg/m³].")
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
                " and ".join(name for name, is_set in three.items() if is_set == which) for which in (True, False)
            )
            remedy = (
                "set youngs_modulus: [E1, E2, E3], poisson_ratio: [ν12, ν13, ν23] and shear_modulus: [G12, G13, G23]; or set "
                "one youngs_modulus and one poisson_ratio without shear_modulus"
            )
            yield Problem("", f"three orthotropic values in {anisotropic}, but not in {lacking}", remedy, at_key=True)
        elif self.axes is not None and not all(three.values()):
            yield Problem("axes", "an isotropic material does not need axes", "remove `axes`", at_key=True)


class ElementSection(RegionProperty):
    """A section for shells, beams or rods. Triangles and quadrangles with a thickness are shells. Lines with an area are beams;
    without second moments of area, they are rods. Nastran and Abaqus decks already contain these data."""

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
        description="Second moments of area of beams about the centroid [m⁴]: [∫y² dA, ∫z² dA] or [∫y² dA, ∫z² dA, ∫yz dA]. The "
        "first value resists bending in the plane of the beam axis and `direction`, the second value bending perpendicular "
        "to this plane. Null: the section is a rod.",
    )
    torsion: Annotated[NotNegative | None, Plausible(1e-16, 10.0, "m⁴")] = Field(
        None, description="Torsion constant J of beams [m⁴], ∫r² dA for a circle. Null: 0, permitted for rods only."
    )
    direction: DirectionVector | None = Field(
        None,
        description="Vector in the x-y plane of beams towards positive y [-]; the x axis runs from the first to the second node "
        "of a beam.",
    )
    size: Annotated[tuple[Positive, Positive] | None, Plausible(1e-5, 10.0, "m", share=1.0)] = expert(
        None,
        description="Outer dimensions of the beam section along y and z [m]; gauges are placed on the sides of this rectangle. "
        "Null: a square with the area of the section.",
    )

    def problems(self) -> Iterator[Problem]:
        """Check that the section is that of shells, or of beams or rods."""
        yield from exactly_one({"thickness": self.thickness, "area": self.area})
        of_beams = [n for n in ("second_moments", "torsion", "direction", "size") if getattr(self, n) is not None]
        if self.area is None:
            for name in of_beams:
                what = f"`{name}` applies to beams only, but this section has a thickness"
                yield Problem(name, what, f"remove `{name}`", at_key=True)
        elif self.offset:
            what = "`offset` applies to shells only, but this section has an area"
            yield Problem("offset", what, "remove `offset`", at_key=True)
        elif self.second_moments is None:
            for name in (name for name in ("direction", "size") if name in of_beams):
                what = f"`{name}` applies to beams only, but this section has no second_moments and is a rod"
                yield Problem(name, what, f"set `second_moments`, or remove `{name}`", at_key=True)
        else:
            yy, zz, yz = (*self.second_moments, 0.0)[:3]
            if yz**2 >= yy * zz:
                what = f"∫yz dA of {yz:g} m⁴ is too large for ∫y² dA = {yy:g} m⁴ and ∫z² dA = {zz:g} m⁴"
                yield Problem("second_moments", what, "set a value of |∫yz dA| below √(∫y² dA · ∫z² dA)")
            for name, remedy in (
                ("torsion", "set `torsion` to the torsion constant J [m⁴]"),
                ("direction", "set `direction` to a vector in the x-y plane of the beams, such as [0, 0, 1]"),
            ):
                if name not in of_beams:
                    yield Problem(name, "missing, but required for beams with second_moments", remedy, at_key=True)


class Support(Section):
    """A fixed support, or springs to the ground, in addition to the supports of the mesh file."""

    node: NodeId | None = Field(None, description="Id of the supported node.")
    set: Text | None = Field(None, description="Name of the supported node set or face, instead of `node`.")
    components: Components = Field(
        (1, 2, 3),
        description="Supported components in x, y, z of the mesh: 1-3 translations, 4-6 rotations of a reference node.",
    )
    stiffness: Annotated[NotNegative | Vector | None, STIFFNESS] = Field(
        None,
        description="Stiffness of springs to the ground, instead of a fixed support [N/m, for rotations N m/rad]. Either one "
        "value for every component, or three values along x, y and z of the mesh. The value is the stiffness of the whole "
        "support: the nodes of a set have equal shares, and a face has a constant stiffness per area. An estimated modulus "
        "does not change this stiffness.",
    )

    def problems(self) -> Iterator[Problem]:
        yield from exactly_one({"node": self.node, "set": self.set})
        if self.stiffness is None:
            return
        values = self.stiffness if isinstance(self.stiffness, tuple) else (self.stiffness,)
        if min(values) < 0 or max(values) == 0:
            what = "the stiffness is not positive"
            yield Problem(
                "stiffness", what, "use a positive stiffness in N/m, or remove `stiffness` for a fixed support"
            )
        if len(values) > 1 and self.components != (1, 2, 3):
            what = "three stiffness values apply along x, y and z, so `components` is not permitted"
            yield Problem("components", what, "remove `components`, or set one stiffness value", at_key=True)
        if len({component > 3 for component in self.components}) > 1:
            what = "one stiffness cannot apply to translations [N/m] and to rotations [N m/rad]"
            yield Problem("components", what, "define two supports, one with components 1-3 and one with 4-6")


class PointMassSection(Section):
    """Mass of a sensor, cable or fixture that the mesh file lacks."""

    node: NodeId | None = Field(None, description="Id of the node with the mass.")
    set: Text | None = Field(
        None, description="Name of the node set or face with the mass, in equal shares of its nodes, instead of `node`."
    )
    mass: Annotated[NotNegative, Plausible(0.0, 1e5, "kg")] = Field(description="Mass [kg].")
    std: Annotated[NotNegative, Plausible(0.0, 1e5, "kg")] = Field(
        0.0, description="Standard deviation of the mass [kg]; it has the effect of a tolerance. 0: exact mass."
    )

    def problems(self) -> Iterator[Problem]:
        yield from exactly_one({"node": self.node, "set": self.set})


class Face(Section):
    """A named part of the surface. Each of `near`, `normal`, `box` and `radius` selects facets; the face consists of
    the facets selected by every specified key."""

    near: Point | Annotated[tuple[Point, ...], Field(min_length=1)] | None = Field(
        None,
        description="A point or a list of points [m]; selects the face nearest to each point. A face ends at an edge where the "
        "normal turns by more than 30°, or where a curved surface begins. A point on the axis of a bore selects the bore. "
        "The command `strainsight import` lists a point of every face.",
    )
    normal: DirectionVector | None = Field(None, description="Outward normal [-]; selects the facets with this normal.")
    angle: float = expert(
        10.0, gt=0, le=90, description="Largest angle between the normal of a facet and `normal` [deg]."
    )
    box: tuple[Point, Point] | None = Field(
        None,
        description="Lower and upper corner [[x, y, z], [x, y, z]] [m]; selects the facets with their centre in the box.",
    )
    radius: Size | None = Field(
        None, description="Radius of bores and cylinders to select [m], with a tolerance of 2 %."
    )

    def problems(self) -> Iterator[Problem]:
        if not (self.near or self.normal or self.box or self.radius):
            yield Problem(
                "", "no key selects the facets of this face", "set `near`, `normal`, `box` or `radius`", at_key=True
            )
        if self.box is not None:
            yield from box_problem(self.box)


class Tie(Section):
    """A rigid element (`rigid`, RBE2), an averaging element (`averaging`, RBE3), or nodes tied to a surface (`surface`)."""

    type: Literal["rigid", "averaging", "surface"] = Field(
        description="Kind of constraint. With `rigid`: the nodes follow the reference node. With `averaging`: the reference "
        "node follows the mean motion of the nodes. With `surface`: each node follows the solid facet on which the node "
        "lies, with the shape functions of the facet. Use `surface` to tie a fine mesh to a coarse mesh."
    )
    reference: NodeId | None = Field(
        None,
        description="Id of the reference node. If `at` is set, a node with this id is created. Not used with `type: surface`.",
    )
    at: Point | None = Field(None, description="Position of a new reference node [m].")
    set: Text = Field(
        description="Name of the node set or face with the tied nodes; with `surface`, on the finer mesh."
    )
    to: Text | None = Field(None, description="With `type: surface`: name of the node set or face on the coarser mesh.")
    within: Annotated[Positive, Plausible(1e-9, 0.1, "m", share=0.1)] = expert(
        1e-4,
        description="With `type: surface`: largest permitted distance of the tied nodes from the coarser mesh [m].",
    )
    components: Components | None = expert(
        None,
        description="Constrained components. With `rigid`: components of the nodes, default [1, 2, 3]. With `averaging`: "
        "components of the reference node, default all six.",
    )

    @model_validator(mode="after")
    def _of_its_type(self) -> Tie:
        if self.type == "surface" and self.to is None:
            raise ValueError("a tie of type surface needs `to`; set `to` to the name of the coarser node set or face")
        if self.type == "surface" and (self.reference, self.at, self.components) != (None, None, None):
            raise ValueError(
                "a tie of type surface has no reference node and no components; remove `reference`, `at` and `components`"
            )
        if self.type != "surface" and self.reference is None:
            raise ValueError(
                f"a tie of type {self.type} needs `reference`; set `reference` to the id of the reference node"
            )
        return self


class MeshFile(Section):
    """The finite-element model."""

    file: Text = Field(
        description="Mesh file: Nastran (.bdf, .nas, .dat), Abaqus (.inp), gmsh (.msh), CalculiX results (.frd), VTU/VTK, or "
        "another format of meshio. Text files may be compressed (.gz). The path is relative to the folder of the config."
    )
    format: Literal["auto", "nastran", "abaqus", "gmsh", "frd", "meshio"] = expert(
        "auto", description="File format; `auto`: by the file extension."
    )
    length_unit: Literal["m", "mm", "cm", "km", "in", "ft"] = Field("m", description="Length unit of the mesh file.")
    mass_unit: Literal["kg", "t", "g", "lb", "slug", "lbf*s2/in"] = Field(
        "kg",
        description="Mass unit of the mesh file. The time unit is s: use t with N and mm, and lbf*s2/in with lbf and in.",
    )
    region_data: Text | None = expert(
        None,
        description="Name of the cell data array with the region ids (VTU, VTK and similar formats). Null: the first "
        "existing array with a usual name, such as region, gmsh:physical, MaterialIds or PartId.",
    )
    ignore: tuple[Text, ...] = Field(
        (),
        description="Cards (CQUAD4, MPC), keywords (TIE, DLOAD) and element types (S4R) of the deck to ignore although they "
        "affect stiffness, mass or loads. Unsupported elements, ties and loads have to be listed here.",
    )
    contact: Literal["bonded", "open"] | None = Field(
        None,
        description="Treatment of contact pairs of the deck (*CONTACT PAIR). With `bonded`: nodes of the first surface that lie "
        "on the second surface follow the second surface; this is the upper bound of the contact stiffness. With `open`: "
        "the surfaces are not connected. Null: a deck with contact pairs is an error. Pairs that the deck defines as tied "
        "are always bonded.",
    )
    mass: Literal["consistent", "lumped"] | None = expert(
        None,
        description="Mass matrix of solids. With `consistent`: ∫ ρ N_a N_b dV. With `lumped`: the diagonal of this matrix, "
        "scaled to the mass of each element; use `lumped` to compare frequencies with programs that use lumped masses. "
        "Null: `lumped` if a Nastran deck of solids requests lumped masses (PARAM,COUPMASS,-1), otherwise `consistent`.",
    )
    spc: NodeId | None = expert(
        None,
        description="Id of the active support set (SPC, SPC1, SPCADD) of a Nastran deck; null: the support set selected "
        "in the case control section.",
    )
    step: NodeId | None = expert(
        None,
        description="Number, from 1, of the step of an Abaqus or CalculiX deck with the active supports (*BOUNDARY) and "
        "elements (*MODEL CHANGE). Null: the frequency step (*FREQUENCY); without a frequency step, all steps "
        "need the same supports and elements.",
    )
    include_dirs: tuple[Text, ...] = Field(
        (),
        description="Additional folders for included files (INCLUDE, *INCLUDE, INPUT=). Files in the folder of the deck and in "
        "its subfolders are always permitted. Paths are relative to the folder of the config; symbolic links are resolved "
        "first.",
    )
    merge: Annotated[Positive | None, Plausible(1e-9, 0.01, "m", share=0.1)] = Field(
        None,
        description="Distance below which nodes of elements are merged into the node with the lowest id [m]; use 1e-6 for "
        "parts with coincident but separate nodes. Nodes connected by a tie or spring are not merged. Null: no merging.",
    )
    faces: dict[Name, Face] = Field(
        {},
        description="Named faces of the surface, defined in the config instead of in the mesh file. Each name can be used like "
        "a node set: for loads, supports, ties, zones and gauges.surface.",
    )
    materials: dict[Name, MaterialSection] = Field(
        {}, description="Materials in addition to those of the mesh file, or instead of them, in SI units, by name."
    )
    sections: dict[Name, ElementSection] = Field(
        {},
        description="Sections of shells, beams and rods in a gmsh, VTU or similar file, by name. Triangles, "
        "quadrangles and lines without a section have no stiffness; they describe the surface of the solids.",
    )
    supports: tuple[Support, ...] = Field((), description="Supports in addition to those of the mesh file.")
    point_masses: dict[Name, PointMassSection] = Field(
        {},
        description="Point masses in addition to those of the mesh file: accelerometers, cables, load cells and fixtures, by "
        "name.",
    )
    free: bool = Field(
        False,
        description="`true`: the structure is free and needs no supports. Rigid-body modes produce no strain and are omitted; "
        "static responses include the inertia of the rigid-body acceleration (inertia relief). Only strain gauges are "
        "possible. For accelerometers and displacement sensors, use soft springs instead of `free` (`stiffness` in "
        "mesh.supports).",
    )
    ties: tuple[Tie, ...] = Field(
        (), description="Rigid elements, averaging elements and surface ties in addition to those of the mesh file."
    )
    matrices: Matrices | None = Field(None, description="Stiffness and mass matrices from another program.")
    results: ResultsSection | None = Field(
        None,
        description="Modes and static responses from another program, instead of stiffness and mass matrices. The mesh then "
        "needs no supports and no materials.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.sections and self.matrices is not None:
            yield Problem("sections", "stiffness and mass come from mesh.matrices", "remove mesh.sections", at_key=True)
        for i, support in enumerate(self.supports):
            if support.stiffness is not None and max(support.components) > 3 and support.set in self.faces:
                what = "a face has no rotational components"
                yield Problem(f"supports.{i}.components", what, "remove components 4-6, or set `node` instead of `set`")
            if support.stiffness is not None and self.matrices is not None:
                what = "the stiffness comes from mesh.matrices"
                remedy = "remove `stiffness`, and include the spring in these matrices"
                yield Problem(f"supports.{i}.stiffness", what, remedy, at_key=True)
        claimed: dict[object, str] = {}
        for name, material in self.materials.items():
            for region in ("all",) if isinstance(material.regions, str) else material.regions:
                if (other := claimed.setdefault(region, name)) != name:
                    what = f"region {region} is also assigned to material {other}"
                    yield Problem(f"materials.{name}.regions", what, "assign the region to one material only")
        if len(self.materials) > 1 and "all" in claimed:
            what = "'all' cannot be combined with other materials"
            yield Problem(f"materials.{claimed['all']}.regions", what, "list the regions of each material")

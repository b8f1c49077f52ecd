"""Wrong models, each a sound deck and config with one mistake that an engineer makes, and words of what has to be said of it."""

from __future__ import annotations

from .decks import bar, bricks, deck, frame, inp, msh, plate

ON_PLATE = {"load": "node: 15, direction: [0, 0, 1]"}
OF_PLIES = {**ON_PLATE, "property": "stiffness_factor", "guess": "1.0", "range": "[0.5, 2.0]"}
IN_MM = {"mesh": ", length_unit: mm, mass_unit: t"}
ABAQUS = {"file": "deck.inp"}
HELD = "faces: {hold: {normal: [-1, 0, 0], box: [[-1, -1, -1], [0.001, 1, 1]]}}, supports: [{set: hold}]"
CARBON = "MAT8,1,1.4+11,1.+10,.3,5.+9,4.+9,4.+9,1600."


def of_gmsh(E: str = "2.1e11", rho: str = "7850") -> dict[str, str]:
    own = f"steel: {{regions: all, youngs_modulus: {E}, poisson_ratio: 0.3, density: {rho}}}"
    return {"file": "deck.msh", "mesh": f", materials: {{{own}}}, {HELD}"}


def mm(E: str, rho: str, *more: str) -> str:
    return deck(*bricks(size=(400.0, 100.0, 100.0)), "PSOLID,1,1", *more, material=f"MAT1,1,{E},,.3,{rho}")


def steel(E: str = "2.1+11", G: str = "", nu: str = ".3", rho: str = "7850.") -> dict[str, str]:
    return {"material": f"MAT1,1,{E},{G},{nu},{rho}"}


def plies(*angles: str, material: str = CARBON) -> str:
    lines = "\n".join(f",1,.0005,{a},YES,1,.0005,{b}" for a, b in zip(angles[::2], angles[1::2], strict=True))
    return plate(section=f"PCOMP,1\n{lines}", material=material)


def pair(at: tuple[float, float, float], cells: tuple[int, int, int] = (4, 1, 1)) -> str:
    return deck(*bricks(), *bricks(cells=cells, at=at, first=101, element=101), "PSOLID,1,1")


UNITS = {
    "mm and MPa read as m and Pa": (mm("2.1+5", "7.85-9"), {}, "Check mesh.length_unit"),
    "Pa in a deck in mm and t": (mm("2.1+11", "7.85-9"), IN_MM, "the value of the deck is 2.1e+17"),
    "kg/m3 in a deck in mm and t": (mm("2.1+5", "7850."), IN_MM, "density is 7.85e+15 kg/m³, outside"),
    "MPa in a deck in m": (bar(**steel(E="2.1+5")), {}, "the value of the deck is 2.1e+05"),
    "g/cm3 in a deck in m": (bar(**steel(rho="7.85")), {}, "density is 7.85 kg/m³, outside"),
    "a weight per volume": (
        bar(**steel(rho="77000.")),
        {},
        "the density would be 7852 kg/m³ (PARAM,WTMASS)",
    ),
    "WTMASS of pounds in SI": (bar("PARAM,WTMASS,.00259"), {}, "the speed of sound √(E/ρ) is 1.02e+05 m/s"),
    "WTMASS twice": (
        bar("PARAM,WTMASS,.00259", case="SPC = 1\nPARAM,WTMASS,1."),
        {},
        "PARAM WTMASS: the factor WTMASS is 1 here, but 0.00259",
    ),
    "WTMASS misspelt": (bar("PARAM,WTMAS,.00259"), {}, "did you mean WTMASS?"),
    "no density": (bar(**steel(rho="")), {}, "the total mass is 0 kg"),
    "m/s2 in a deck in mm": (
        mm("2.1+5", "7.85-9", "GRAV,7,,9.81,0.,0.,-1."),
        {**IN_MM, "load": "deck_load: LOAD-7, factor: true"},
        "load LOAD-7 has an acceleration of 0.00981 m/s²",
    ),
    "kg of a point mass in t": (
        mm("2.1+5", "7.85-9", "CONM2,50,5,,5."),
        IN_MM,
        "159 times as heavy as the elements (31.4 kg)",
    ),
    "a mesh of gmsh in mm": (msh(1000.0), of_gmsh(), "no facet meets all of these criteria"),
    "t/mm3 beside a mesh of gmsh": (msh(), of_gmsh(rho="7.85e-9"), "Values of the config are in Pa and kg/m³."),
    "a thickness in mm": (plate(section="PSHELL,1,1,2.,1,,1"), ON_PLATE, "is 2 m thick, but 0.447 m long"),
    "a thickness in km": (plate(section="PSHELL,1,1,2.-6,1,,1"), ON_PLATE, "thinner than 5e-05 m"),
    "an area in mm2": (frame(section="PBAR,1,1,400.,2.-8,1.-8,2.-8"), {}, "below the minimum for this area"),
    "moments of area in mm4": (
        frame(section="PBAR,1,1,4.-4,2.+4,1.+4,2.+4"),
        {},
        "radius of gyration √((I1 + I2)/A) is 8.66e+03 m",
    ),
    "an offset of a shell in mm": (plate(rest=",,.2"), ON_PLATE, "has an offset of up to 0.2 m from the nodes"),
    "an offset of a beam in mm": (frame(rest="\n,,,0.,0.,5.,0.,0.,5."), {}, "has an offset of 5 m from its nodes"),
    "a reference node in mm": (
        bar("GRID,99,,500.,0.,0.", "RBE2,98,99,123456,5,10,15,20"),
        {},
        "node 99 of RBE2 98 is 500 m away from the other nodes of this tie",
    ),
    "a point of the config in mm": (
        bar(),
        {"mesh": ", faces: {f: {near: [400, 50, 50]}}", "load": "set: f, direction: [1, 0, 0]"},
        "405.8 m away from a part that is only 0.4243 m long",
    ),
    "damping in per cent": (bar(), {"ratio": "2.0"}, "damping.ratio: the value is 2.0, but has to be below 1"),
}
MATERIALS = {
    "no modulus": (bar(**steel(E="")), {}, "defines only NU"),
    "a Poisson's ratio of a wrong G": (bar(**steel(G="2.1+11", nu="")), {}, "Poisson's ratio is -0.5"),
    "a Poisson's ratio that locks": (bar(**steel(nu=".4999999")), {}, "Poisson's ratio is 0.4999999"),
    "ν before E": (inp(elastic="0.3, 2.1e11"), ABAQUS, "Poisson's ratio is 2.1e+11, outside"),
    "angles of plies in radians": (
        plies(".785", "-.785", "0.", "1.571"),
        OF_PLIES,
        "The unit is degrees, not radians.",
    ),
    "a range without the deck's value": (
        bar(),
        {"guess": "7.0e10", "range": "[6.0e10, 8.0e10]"},
        "outside parameters.E.range",
    ),
}
SECTIONS = {
    "a shell without stiffness in bending": (plate(section="PSHELL,1,1,.002"), ON_PLATE, "has no bending stiffness"),
    "area and moment of area swapped": (
        frame(section="PBAR,1,1,2.-8,4.-4,1.-8,2.-8"),
        {},
        "area and moments of area are swapped",
    ),
    "a torsion constant in other units": (
        frame(section="PBAR,1,1,4.-4,2.-8,1.-8,2.-4"),
        {},
        "J = 0.0002 m⁴ exceeds I1 + I2",
    ),
    "no torsion constant": (frame(section="PBAR,1,1,4.-4,2.-8,1.-8"), {}, "does not resist torsion"),
    "a beam that is not oriented": (frame(way=""), {}, "the orientation is missing: G0, X1 to X3"),
    "normals that change sides": (
        plate(turned=(3,)),
        ON_PLATE,
        "normals of neighbouring shells are opposite, for example of elements 2 and 3 (3 such pairs in total)",
    ),
    "a section of shells on solids": (
        inp(section="*SHELL SECTION, ELSET=EALL, MATERIAL=STEEL\n0.01"),
        ABAQUS,
        "contains C3D8 1, to which this section does not apply",
    ),
    "a spring that is a clamp": (bar("CELAS2,60,1.+30,5,1"), {}, "1.1e+19 times E L of the structure"),
}
CONNECTIONS = {
    "parts that are not merged": (pair((0.4, 0.0, 0.0)), {}, "8 nodes coincide with another"),
    "a fine mesh on a coarse one": (
        pair((0.4, 0.0, 0.0), (4, 2, 2)),
        {},
        "5 nodes lie on the surface of elements without belonging to them",
    ),
    "a beam twice": (frame("CBAR,9,1,1,2,0.,0.,1."), {}, "CBAR 9 has the same nodes as CBAR 1"),
    "an element twice": (bar("CHEXA,9,1,1,2,7,6,11,12,\n,17,16"), {}, "CHEXA 9 has the same nodes as CHEXA 1"),
    "a relation that grounds": (
        bar("MPC,1,5,3,1.,3,3,-1.", case="SPC = 1\nMPC = 1"),
        {},
        "resist a rigid-body motion like a support: MPC 1 (rotation about y",
    ),
}
SUPPORTS = {
    "no selected supports": (bar(case="TITLE = A"), {}, "the case control selects no supports"),
    "rotations of solids held": (bar(held="SPC1,1,456,1,6,11,16"), {}, "the structure has no supports"),
    "one node held": (bar(held="SPC1,1,123,1"), {}, "can move freely: rotation about x"),
    "one component held": (bar(held="SPC1,1,1,1,6,11,16"), {}, "can move freely: translation y"),
    "a part that nothing holds": (
        pair((0.0, 0.0, 0.5)),
        {},
        "can move freely: translation x of the part with node 101",
    ),
}
LOADS = {
    "a load on a node that nothing holds": (
        bar("GRID,99,,1.,1.,1."),
        {"load": "node: 99, direction: [0, 0, 1]"},
        "acts on node 99, which is not connected to any element",
    ),
    "a preload": (
        inp(more="*STEP, NLGEOM\n*STATIC\n*CLOAD\n5, 3, 1.\n*END STEP"),
        ABAQUS,
        "without preload or initial stress",
    ),
    "stress at the start": (
        inp(more="*INITIAL CONDITIONS, TYPE=STRESS\nEALL, 1e8, 0, 0, 0, 0, 0"),
        ABAQUS,
        "1 × *INITIAL CONDITIONS, TYPE=STRESS ignored: the stiffness is that of the unloaded structure",
    ),
    "a preload of another subcase": (
        bar(case="SPC = 1\nSUBCASE 1\nLOAD = 2\nSUBCASE 2\nSTATSUB(PRELOAD) = 1\nMETHOD = 3"),
        {},
        "1 × PRELOAD by STATSUB (first at",
    ),
    "modes of nonlinear statics": (
        bar("PARAM,LGDISP,1", case="SPC = 1\nLOAD = 2\nMETHOD = 3").replace("SOL 103", "SOL 106"),
        {},
        "1 × PRELOAD by SOL 106 (first at",
    ),
    "a bolt's pretension": (inp(more="*PRE-TENSION SECTION, NODE=5, SURFACE=A"), ABAQUS, "1 × PRE-TENSION SECTION"),
    "a material that yields": (
        inp(more="*MATERIAL, NAME=A\n*ELASTIC\n1.,.3\n*PLASTIC\n2.,0."),
        ABAQUS,
        "1 × *PLASTIC ignored",
    ),
    "a matrix beside the elements": (bar(case="SPC = 1\nK2GG = K2"), {}, "K2GG of the case control ignored"),
}
AT_IMPORT = {**UNITS, **MATERIALS, **SECTIONS, **CONNECTIONS, **SUPPORTS, **LOADS}
"""Name → deck, what its config says beside `AS_MEANT`, words of the error or warning: all of these when it is imported."""
FIXED = ", fixed: [{{name: A, position: [{}], direction: [{}]}}]"
LATER = {
    "hinges at both ends": ("modes", frame(rest="\n,456,456"), {}, "the structure has a mechanism"),
    "a gauge in mm": ("train", bar(), {"gauges": FIXED.format("200, 50, 100", "1, 0, 0")}, "Correct the position (in metres)"),
}
"""Name → the stage that says it, and the same."""

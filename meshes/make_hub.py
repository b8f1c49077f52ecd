"""Write the deck of a cast-iron hub: `python make_hub.py SIZE OUT [small|bench]`, SIZE of the elements in m, OUT a .bdf or
.bdf.gz.

A hollow sphere about the origin. It is cut flat below, where the main shaft is bolted on, and on three axes in the plane
z = 0, 120° apart, the first along x, where the blades are; a bore along each axis goes through the wall. Solids are tet10
with their mid-side nodes on the surfaces.

small (where nothing is said): 0.5 m in outer radius, a wall of 0.15 m. Size 0.0408 gives 88 000 unknowns, 0.0251 gives
316 000.
bench: the hub of a 3 MW turbine, 1.9 m in outer radius, a wall of 0.12 m. Each blade flange is a face of 1.3 m in radius with
a bore of 1.1 m and as thick as the wall, to carry the outer ring of a bearing of 2.3 m in pitch diameter. Size 0.11 gives
99 000 unknowns.

Node 1, the centre of the shaft flange, is clamped and holds the flange rigidly; node 2, the centre of the first blade
flange, carries that flange rigidly and takes the load.

Needs gmsh (`pip install gmsh`), one version of which always gives the same deck; the deck says which.
"""

from __future__ import annotations

import gzip
import sys
from dataclasses import dataclass
from pathlib import Path

import gmsh
import numpy as np

BLADES = 3
YOUNGS_MODULUS, POISSON_RATIO, DENSITY = "1.7E+11", "0.275", "7100."
SHAFT, BLADE, FIRST_NODE = 1, 2, 1001
LEAST_QUALITY = 0.1
TET10, MIDSIDES = 11, (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
"""gmsh's type number, and its nodes in Nastran's order."""


@dataclass(frozen=True)
class Shape:
    """Lengths in m: outer radius and wall of the sphere; shaft z of the shaft flange; face distance of the blade flanges from
    the centre; bore radius; plate thickness of the blade flanges where they are thicker than what the sphere leaves, 0 for
    none; clearance along the surface from the flanges to the zone for gauges."""

    radius: float
    wall: float
    shaft: float
    face: float
    bore: float
    plate: float
    clearance: float


SHAPES = {
    "small": Shape(0.5, 0.15, -0.63 * 0.5, 0.43, 0.15, 0.0, 0.05),
    # a face of 1.3 m in radius on a sphere of 1.9 m
    "bench": Shape(1.9, 0.12, -1.6, 1.386, 1.1, 0.12, 0.1),
}


@dataclass(frozen=True)
class Solids:
    """position (n, 3) [m] rounded to 1e-10 m, as the deck has it; tetrahedra (e, 10) indices in Nastran's order."""

    position: np.ndarray
    tetrahedra: np.ndarray


def mesh(shape: Shape, size: float) -> Solids:
    """The hub in elements of this size [m]; ValueError where one of them is too flat to compute with."""
    gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,
            "Mesh.MeshSizeMin": size,
            "Mesh.MeshSizeMax": size,
            "Mesh.Algorithm": 6,  # frontal on the surfaces
            "Mesh.Algorithm3D": 10,  # the plain Delaunay algorithm leaves a sliver at every third size
            "Mesh.ElementOrder": 2,
        }.items():
            gmsh.option.setNumber(option, value)
        _solid(shape)
        gmsh.model.mesh.generate(3)
        elements, nodes = gmsh.model.mesh.getElementsByType(TET10)
        for measure in ("minSICN", "minSJ"):
            worst = gmsh.model.mesh.getElementQualities(elements, measure).min()
            if not worst >= LEAST_QUALITY:
                raise ValueError(
                    f"size {size:g} m gives an element of {measure} {worst:.2g}: take a slightly other size"
                )
        tags, position, _ = gmsh.model.mesh.getNodes()
    finally:
        gmsh.finalize()
    used = np.unique(nodes)
    where = np.searchsorted(used, tags)
    known = (where < len(used)) & (used[np.minimum(where, len(used) - 1)] == tags)
    ordered = np.empty((len(used), 3))
    ordered[where[known]] = position.reshape(-1, 3)[known]
    tetrahedra = np.searchsorted(used, nodes).reshape(-1, 10)[:, MIDSIDES]
    return Solids(np.round(ordered, 10) + 0.0, tetrahedra)


def _solid(shape: Shape) -> None:
    """The geometry, in the kernel of gmsh."""
    occ, far = gmsh.model.occ, 2 * shape.radius
    sphere = (3, occ.addSphere(0, 0, 0, shape.radius))
    cavity = [(3, occ.addSphere(0, 0, 0, shape.radius - shape.wall))]
    cuts = [(3, occ.addBox(-far, -far, shape.shaft - far, 2 * far, 2 * far, far))]
    plates = []
    for blade in range(BLADES):
        angle = 2 * np.pi * blade / BLADES
        face = (3, occ.addBox(shape.face, -far, -far, 2 * far, 2 * far, 2 * far))
        bore = (3, occ.addCylinder(0, 0, 0, far, 0, 0, shape.bore))
        # the seams of bore and sphere must not lie on each other, or the cut fails
        occ.rotate([bore], 0, 0, 0, 1, 0, 0, 0.3)
        occ.rotate([face, bore], 0, 0, 0, 0, 0, 1, angle)
        cuts += [face, bore]
        if shape.plate:
            plates.append((3, occ.addBox(shape.face - shape.plate, -far, -far, 2 * far, 2 * far, 2 * far)))
            occ.rotate(plates[-1:], 0, 0, 0, 0, 0, 1, angle)
    if plates:
        cavity, _ = occ.cut(cavity, plates)
    occ.cut([sphere], cavity + cuts)
    occ.synchronize()


def axis(blade: int) -> np.ndarray:
    """Unit vector of a blade's axis, (3,)."""
    angle = 2 * np.pi * blade / BLADES
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def on_shaft_flange(shape: Shape, position: np.ndarray) -> np.ndarray:
    """(n, 3) → (n,) bool."""
    return np.abs(position[:, 2] - shape.shaft) < 1e-7


def on_blade_flange(shape: Shape, position: np.ndarray, blade: int) -> np.ndarray:
    """(n, 3) → (n,) bool."""
    return np.abs(position @ axis(blade) - shape.face) < 1e-7


def in_gauge_zone(shape: Shape, position: np.ndarray) -> np.ndarray:
    """On the outer sphere, at least the clearance from every flange: (n, 3) → (n,) bool."""
    zone = np.abs(np.linalg.norm(position, axis=1) - shape.radius) < 1e-7
    flanges = [(np.array([0.0, 0.0, -1.0]), -shape.shaft), *((axis(b), shape.face) for b in range(BLADES))]
    for direction, distance in flanges:
        angle = np.arccos(np.clip(position @ direction / shape.radius, -1, 1))
        zone &= shape.radius * (angle - np.arccos(distance / shape.radius)) >= shape.clearance
    return zone


def card(name: str, *fields: object) -> list[str]:
    """One card in small fields, eight to a line."""
    texts = [str(f) for f in fields]
    rows = [texts[i : i + 8] for i in range(0, len(texts), 8)]
    heads = [name.ljust(8)] + ["+".ljust(8)] * (len(rows) - 1)
    return [(head + "".join(text.rjust(8) for text in row)).rstrip() for head, row in zip(heads, rows, strict=True)]


def grid(number: int, x: np.ndarray) -> list[str]:
    """A GRID in large fields, ten decimals."""
    first, second, third = (f"{float(v):16.10f}" for v in x)
    return [f"GRID*   {number:16d}{'':16s}{first}{second}", f"*       {third}"]


def ranges(ids: np.ndarray) -> list[object]:
    """Ascending ids with THRU for runs of three and more."""
    fields: list[object] = []
    for run in np.split(ids, np.flatnonzero(np.diff(ids) > 1) + 1):
        fields += [run[0], "THRU", run[-1]] if len(run) > 2 else list(run)
    return fields


def deck(shape: Shape, solids: Solids, size: float) -> str:
    """The whole deck."""
    position = solids.position
    ids = FIRST_NODE + np.arange(len(position))
    sets = {11: ("outer surface away from the flanges: a zone for gauges", in_gauge_zone(shape, position))}
    for blade in range(BLADES):
        sets[21 + blade] = (f"face of blade flange {blade + 1}", on_blade_flange(shape, position, blade))
    shaft, loaded = ids[on_shaft_flange(shape, position)], ids[on_blade_flange(shape, position, 0)]
    lines = [
        f"$ Hub of cast iron, {shape.radius:g} m in radius, tet10; units m, kg, s.",
        f"$ Written by make_hub.py, size {size:g} m, with gmsh {gmsh.__version__}.",
        "SOL 103",
        "CEND",
        "TITLE = HUB",
        "SPC = 1",
        "METHOD = 1",
        "BEGIN BULK",
    ]
    lines += card("EIGRL", 1, "", "", 10)
    lines += card("MAT1", 1, YOUNGS_MODULUS, "", POISSON_RATIO, DENSITY)
    lines += card("PSOLID", 1, 1)
    lines += ["$ centre of the shaft flange, clamped", *grid(SHAFT, np.array([0.0, 0.0, shape.shaft]))]
    lines += ["$ centre of the first blade flange, loaded", *grid(BLADE, shape.face * axis(0))]
    for number, x in zip(ids, position, strict=True):
        lines += grid(number, x)
    for element, nodes in enumerate(ids[solids.tetrahedra], start=1):
        lines += card("CTETRA", element, 1, *nodes)
    lines += card("SPC1", 1, 123456, SHAFT)
    lines += card("RBE2", len(solids.tetrahedra) + 1, SHAFT, 123, *shaft)
    lines += card("RBE2", len(solids.tetrahedra) + 2, BLADE, 123, *loaded)
    for number, (what, members) in sets.items():
        lines += [f"$ {what}", *card("SET1", number, *ranges(ids[members]))]
    return "\n".join([*lines, "ENDDATA", ""])


def main(size: float, out: Path, shape: Shape) -> None:
    """Write the deck, packed where its name ends in .gz."""
    content = deck(shape, mesh(shape, size), size).encode("ascii")
    out.write_bytes(gzip.compress(content, 9, mtime=0) if out.suffix == ".gz" else content)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4) or (sys.argv[3:] or ["small"])[0] not in SHAPES:
        sys.exit(f"{__doc__}\nusage: python make_hub.py SIZE OUT [{'|'.join(SHAPES)}]")
    try:
        main(float(sys.argv[1]), Path(sys.argv[2]), SHAPES[(sys.argv[3:] or ["small"])[0]])
    except ValueError as error:
        sys.exit(f"make_hub.py: {error}")

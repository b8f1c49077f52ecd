"""Three parts as decks of Nastran: a yoke of ten-node tetrahedra, a portal of shells, a jib crane of beams."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from pathlib import Path

import numpy as np

from strainsight import api
from strainsight.rom.model import modal_basis

STEPS, PER_PERIOD = 400, 40
"""Samples of a record, and those a period of the highest load frequency."""
GAUGES, NOISE, STRONGEST = 5, 1e-6, 3e-4
"""Gauges of the layout; noise of a sample and the largest RMS strain of a candidate [m/m]."""


@dataclass(frozen=True)
class Part:
    """Cards of a deck; node, direction and position [m] of the load, and the distance [m] from it without gauges."""

    cards: list[str]
    node: int
    direction: tuple[int, int, int]
    position: tuple[float, ...]
    clear: float


def write_grid(points: np.ndarray) -> list[str]:
    return [f"GRID,{i},,{x:.9g},{y:.9g},{z:.9g}" for i, (x, y, z) in enumerate(points, 1)]


def yoke() -> Part:
    """A curved fork of 0.3 m on a foot, one prong loaded."""
    lines = (np.linspace(0, 0.3, 19), np.linspace(0, 0.12, 7), np.linspace(0, 0.06, 4))
    cells = [
        (i, j, k)
        for i, j, k in product(*(range(len(line) - 1) for line in lines))
        if i < 9 or j not in (2, 3)
    ]
    number: dict[tuple[int, ...], int] = {}

    def node(twice: np.ndarray) -> int:
        """Number of a point given by twice its grid coordinates."""
        return number.setdefault(tuple(int(v) for v in twice), len(number) + 1)

    tets = []
    for cell in cells:
        for steps in permutations(np.eye(3, dtype=int)):
            corner = 2 * (np.array(cell) + np.vstack([np.zeros((1, 3), dtype=int), np.cumsum(steps, axis=0)]))
            if np.linalg.det(np.array(steps)) < 0:
                corner[[1, 2]] = corner[[2, 1]]
            edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
            tets.append([node(c) for c in corner] + [node((corner[a] + corner[b]) // 2) for a, b in edges])
    at = np.array(list(number)) / 2
    x, y, z = (np.interp(at[:, c], np.arange(len(line)), line) for c, line in enumerate(lines))
    points = np.column_stack([x, y * (1 - 0.6 * x), z + 0.8 * x**2])
    cards = write_grid(points)
    for e, tet in enumerate(tets, 1):
        numbers = [str(n) for n in tet]
        cards += [f"CTETRA,{e},1,{','.join(numbers[:6])}", f",{','.join(numbers[6:])}"]
    held = np.flatnonzero(x < 1e-9) + 1
    cards += ["PSOLID,1,1", *(f"SPC1,1,123,{n}" for n in held)]
    loaded = number[36, 0, 3]
    return Part(cards, loaded, (0, 1, 2), tuple(points[loaded - 1]), 0.06)


def portal() -> Part:
    """A frame of square tubes of 80 mm, mitred at both corners."""
    corners = np.array([(0, 0), (0, 0.9), (1.2, 1.1), (1.2, 0)], dtype=float)
    side, per_side, along = 0.08, 2, 8
    ring = np.concatenate(
        [
            side * ((np.arange(per_side) / per_side)[:, None] * d + o - 0.5)
            for o, d in (((0, 0), (1, 0)), ((1, 0), (0, 1)), ((1, 1), (-1, 0)), ((0, 1), (0, -1)))
        ]
    )
    legs = np.diff(corners, axis=0)
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    normal = np.column_stack([-legs[:, 1], legs[:, 0]])
    mitre = [normal[0], *((a + b) / (1 + a @ b) for a, b in pairwise(normal)), normal[-1]]
    stations = [
        (a + s * (b - a), (1 - s) * p + s * q)
        for a, b, p, q in zip(corners[:-1], corners[1:], mitre[:-1], mitre[1:], strict=True)
        for s in np.arange(along) / along
    ]
    stations.append((corners[-1], mitre[-1]))
    points = np.array([(*(c + u * n), v) for c, n in stations for u, v in ring])[:, [0, 2, 1]]
    count = len(ring)
    cards, e = write_grid(points), 0
    for s in range(len(stations) - 1):
        for i in range(count):
            e, j = e + 1, (i + 1) % count
            quad = (s * count + i, s * count + j, (s + 1) * count + j, (s + 1) * count + i)
            cards.append(f"CQUAD4,{e},1,{','.join(str(n + 1) for n in quad)}")
    held = np.flatnonzero(np.abs(points[:, 2]) < 1e-9) + 1
    cards += ["PSHELL,1,1,0.004,1,,1", *(f"SPC1,1,123456,{n}" for n in held)]
    node = along * count + 1
    return Part(cards, node, (1, 1, 0), tuple(points[node - 1]), 0.15)


def jib() -> Part:
    """Mast, jib and counter-jib of box beams with two stays."""
    points = [(0.0, 0.0, z) for z in np.linspace(0, 6, 9)]
    points += [(x, 0.0, 5.25) for x in np.linspace(0.6, 6, 10)] + [(-x, 0.0, 5.25) for x in (0.8, 1.6, 2.4)]
    parts: Sequence[tuple[Sequence[int], int]] = (
        (range(1, 10), 1),
        ([8, *range(10, 20)], 2),
        ([8, 20, 21, 22], 2),
        ([9, 16], 3),
        ([9, 22], 3),
    )
    cards, e = write_grid(np.array(points)), 0
    for path, section in parts:
        for a, b in pairwise(path):
            e += 1
            cards.append(f"CBAR,{e},{section},{a},{b},0.,1.,0.")
    for number, (width, height, wall) in enumerate(((0.3, 0.3, 0.01), (0.15, 0.25, 0.008), (0.06, 0.06, 0.005)), 1):
        cards += [f"PBARL,{number},1,,BOX", f",{width},{height},{wall},{wall}"]
    cards += ["CONM2,900,22,,800.", "SPC1,1,123456,1"]
    return Part(cards, 19, (0, 1, -2), points[18], 0.3)


PARTS = {"yoke": yoke, "portal": portal, "jib": jib}


def deck(part: Part, *cards: str) -> str:
    """The deck of a part in steel, SI units, with more cards."""
    head = ("SOL 103", "CEND", "SPC = 1", "BEGIN BULK")
    return "\n".join([*head, *part.cards, "MAT1,1,2.0E11,,0.3,7850.0", *cards, "ENDDATA", ""])


def write_part(folder: Path, name: str, unknown: str) -> Path:
    """Write deck and config of a part with an unknown, "load" or "E", and return the path of the config. The band of the load
    is below the first frequency, its amplitude from the strongest candidate."""
    part = PARTS[name]()
    (folder / f"{name}.bdf").write_text(deck(part))
    file, load = folder / f"{name}-{unknown}.yaml", unknown == "load"
    near = [[v + way * part.clear for v in part.position] for way in (-1, 1)]
    band, amplitude, h = (5.0, 20.0), 1.0, 1e-3

    def write() -> None:
        signal = {"type": "multisine", "lowest": band[0], "highest": band[1], "count": 12, "amplitude": amplitude}
        moved = {"node": part.node, "direction": part.direction, "signal": signal, "known": not load}
        noise = {"process_noise": {"model": "integrated_random_walk", "frequency": band[1]}}
        modulus = {"property": "youngs_modulus", "region": 1, "guess": 1.9e11, "range": [1.4e11, 2.8e11]}
        config = {
            "kind": "placement",
            "name": f"{name}-{unknown}",
            "mesh": {"file": f"{name}.bdf", "length_unit": "m", "mass_unit": "kg"},
            "parameters": {} if load else {"E": modulus},
            "loads": {"tip": moved | (noise if load else {})},
            "damping": {"type": "modal", "ratio": 0.01},
            "rom": {"modes": 6},
            "train": {"duration": STEPS * h, "time_step": h},
            "gauges": {
                "surface": "all",
                "direction": {"type": "principal", "angles": [0]},
                "exclude": [{"box": near}],
                "noise_std": {"value": NOISE},
            },
            "place": {"estimate": ["tip" if load else "E"], "keep": GAUGES, "certificate": False},
            "validate": {
                "truth": {"model": "perturbed", "parameters": {} if load else {"E": 2.0e11}},
                "time_step": h,
                "duration": STEPS * h,
                "initial_std": {"tip": 1.0} if load else {"E": 0.1},
            },
            "filter": {"compare": False},
        }
        file.write_text(json.dumps(config))

    write()
    case = api.load(file)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    first = float(np.sqrt(modal_basis(reduced.model, reduced.model.reference)[0][0])) / (2 * np.pi)
    band = round(0.1 * first, 3), round(0.6 * first, 3)
    h = float(f"{1 / (PER_PERIOD * band[1]):.3g}")
    write()
    training = api.train(api.load(file), mesh, reduced)
    strongest = np.sqrt(np.mean((training.motions[0].coordinate @ training.rows.T) ** 2, axis=0)).max()
    amplitude = float(f"{STRONGEST / strongest:.3g}")
    write()
    return file

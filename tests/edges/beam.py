"""Small beams of any size, material and unit, their config, and what the pipeline makes of them."""

from __future__ import annotations

import copy
import json
import shutil
import warnings
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

from strainsight import api
from strainsight.config.load import load_config
from strainsight.experiment.structure import placement
from strainsight.experiment.structure.placement import StructurePlacement
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.validation import Validation
from strainsight.runner.artefact import Artefact
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.placement import PLACEMENT

from ..shared import once

SIZE, E, NU, RHO, TIP = (1.0, 0.1, 0.08), 2.1e11, 0.3, 7850.0, 900_001
# Half steps from an element's first corner to its nodes: corners, then mid-sides in Nastran's order.
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
SIDES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
SEEN_AS_NONE = (
    "screen/range",
    "place/selected/final/load",
    "place/at_gauges/room",
    "place/failure/loss",
    "place/baseline/",
    "place/criteria/",
    "observe/condition",
    "import/shells/quad4/axis",
    "import/shells/tri3/axis",
)
"""inf or NaN there says: none stated, an unknown is lost, along the first side (docs/artefacts.md)."""

PLACEMENT_CONFIG: dict[str, Any] = {
    "kind": "placement",
    "name": "edge",
    "seed": 1,
    "mesh": {"file": "beam.bdf", "length_unit": "m", "mass_unit": "kg"},
    "parameters": {
        "E": {"property": "youngs_modulus", "region": 1, "guess": 0.9 * E, "range": [0.75 * E, 1.2 * E]},
    },
    "loads": {
        "tip": {
            "node": TIP,
            "direction": [0.2, 0.5, 1.0],
            "known": True,
            "signal": {"type": "sine", "frequency": 20.0, "amplitude": 1000.0},
        }
    },
    "damping": {"type": "modal", "ratio": 0.01},
    "rom": {"modes": 4, "parameter_samples": 1},
    "train": {"duration": 0.1, "time_step": 0.001},
    "gauges": {
        "direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0, 45.0]},
        "noise_std": {"relative_to_strongest": 0.01},
    },
    "screen": {"keep": 8, "minimum_spacing": 0.02},
    "place": {"estimate": ["E"], "keep": 2, "instants": 2},
    "validate": {
        "truth": {"model": "perturbed", "parameters": {"E": E}, "modes": 6},
        "time_step": 0.001,
        "duration": 0.1,
        "initial_std": {"E": 0.1},
        "random_sets": 0,
        "noise_factors": [],
        "repeats": 1,
    },
}
BENCH_CONFIG: dict[str, Any] = {
    "kind": "bench",
    "name": "edge",
    "bodies": {
        "beam": {
            "type": "flexible",
            "mesh": {"file": "beam.bdf"},
            "modes": 4,
            "damping": {"type": "modal", "ratio": 0.01},
        }
    },
    "frames": {"tip": {"body": "beam", "node": TIP}},
    "forces": {
        name: {
            "type": "force",
            "frame": "tip",
            "direction": direction,
            "signal": {"type": "sine", "frequency": 2.0, "amplitude": 100.0},
        }
        for name, direction in (("side", [0.0, 1.0, 0.0]), ("down", [0.0, 0.2, 1.0]))
    },
    "sensors": {"gauges": {"type": "strain", "body": "beam", "layout": "place"}},
    "simulate": {"duration": 0.1, "time_step": 0.01},
    "estimate": {
        "sensors": {"gauges": {"noise": 1e-7}},
        "inputs": {name: {"std": 100.0, "increment": 20.0} for name in ("side", "down")},
    },
    "place": {
        "body": "beam",
        "keep": 3,
        "noise": 1e-7,
        "pool": 8,
        "spacing": 0.05,
        "random": 0,
        "direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0, 45.0]},
        "exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 20}}],
    },
}


def bricks(
    counts: tuple[int, int, int],
    kind: str = "hex8",
    *,
    size: float = 1.0,
    modulus: float = E,
    density: float = RHO,
    length: float = 1.0,
    mass: float = 1.0,
    tip: bool = True,
) -> str:
    """A beam along x, held at x = 0, in Nastran's free format; at its end a rigid element with the node TIP, or none.

    size: times SIZE; modulus [Pa], density [kg/m³]; length [m] and mass [kg]: units of the deck.
    """
    half = np.stack(np.meshgrid(*(np.arange(2 * c + 1) for c in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    odd = (half % 2).sum(axis=1)
    half = half[odd <= (1 if kind == "hex20" else 0)]
    number = {tuple(h): n for n, h in enumerate(half.tolist(), start=1)}
    place = half / (2 * np.array(counts)) * np.array(SIZE) * size / length
    steps = [*CORNERS]
    if kind == "hex20":
        steps += [tuple((np.add(CORNERS[a], CORNERS[b]) // 2).tolist()) for a, b in SIDES]
    cards: list[list[Any]] = [["GRID", n, "", *map(repr, x)] for n, x in enumerate(place.tolist(), start=1)]
    for e, first in enumerate(np.ndindex(*counts), start=1):
        cards.append(["CHEXA", e, 1, *(number[tuple((2 * np.array(first) + s).tolist())] for s in steps)])
    ends = half[:, 0] == 0, half[:, 0] == 2 * counts[0]
    cards.append(["SPC1", 1, 123, *(1 + np.flatnonzero(ends[0]))])
    if tip:
        middle = np.array([SIZE[0], SIZE[1] / 2, SIZE[2] / 2]) * size / length
        cards += [
            ["GRID", TIP, "", *map(repr, middle.tolist())],
            ["RBE2", 1, TIP, 123456, *(1 + np.flatnonzero(ends[1]))],
        ]
    return deck(cards, modulus * length / mass, density * length**3 / mass)


def deck(cards: list[list[Any]], modulus: float, density: float) -> str:
    cards = [*cards, ["PSOLID", 1, 1], ["MAT1", 1, repr(float(modulus)), "", NU, repr(float(density))]]
    words = [[str(field) for field in card] for card in cards]
    lines = ["\n,".join([",".join(w[:9]), *(",".join(w[i : i + 8]) for i in range(9, len(w), 8))]) for w in words]
    return "\n".join(["SOL 103", "CEND", "SPC = 1", "BEGIN BULK", *lines, "ENDDATA", ""])


def config_of(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    config = copy.deepcopy(dict(base))
    for key, value in changes.items():
        *path, last = key.split(".")
        section = config
        for part in path:
            section = section.setdefault(part, {})
        section[last] = copy.deepcopy(value)
    return config


def of_material(modulus: float) -> dict[str, Any]:
    return {
        "parameters.E.guess": 0.9 * modulus,
        "parameters.E.range": [0.75 * modulus, 1.2 * modulus],
        "validate.truth.parameters.E": modulus,
    }


def finished(
    folder: Path, until: str, text: str, changes: Mapping[str, Any] = {}, base: Mapping[str, Any] = PLACEMENT_CONFIG
) -> dict[str, Artefact]:
    """stage → artefact of a run up to a stage, made once for all tests, which warns each of them; a RuntimeWarning is an error.

    The run reads the files that lie in the folder; its results are copied there."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "beam.bdf").write_text(text, encoding="ascii")
    path = folder / "edge.yaml"
    path.write_text(yaml.safe_dump(config_of(base, changes)), encoding="utf-8")
    files = sorted(file for file in folder.iterdir() if file.is_file())
    # tests may run without the test for hot spots (`without_hot_spots`)
    inputs = [until, placement.tested_hot_spots.__name__, *(f"{file.name}\n{file.read_bytes()!r}" for file in files)]
    stages = PLACEMENT if base["kind"] == "placement" else bench_stages(load_config(path, ()).data)
    stages = stages[: [stage.name for stage in stages].index(until) + 1]

    def make(place: Path) -> None:
        for file in files:
            shutil.copy(file, place)
        loaded = load_config(place / path.name, ())
        job = Job(loaded.data, place, place / "results", loaded.locate, loaded.model)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warnings.simplefilter("error", RuntimeWarning)
            found = {event.stage: event.artefact for event in run(stages, job) if event.artefact is not None}
        assert not (strange := infinite(found)), strange
        (place / "warnings.json").write_text(json.dumps([str(one.message) for one in caught]), encoding="utf-8")

    kept = once("beam", "\n".join(inputs), make)
    for words in json.loads((kept / "warnings.json").read_text(encoding="utf-8")):
        warnings.warn(words, stacklevel=2)
    shutil.copytree(kept / "results", folder / "results", dirs_exist_ok=True)
    results = folder / "results" / load_config(path, ()).data["name"]
    return {stage.name: Artefact(results / f"{stage.name}.h5") for stage in stages}


def prepared(folder: Path, text: str, changes: Mapping[str, Any] = {}, *overrides: str) -> SimpleNamespace:
    """Case, mesh, reduced model, training simulation and screened candidates of a placement, without artefacts."""
    (folder / "beam.bdf").write_text(text, encoding="ascii")
    (folder / "edge.yaml").write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, changes)), encoding="utf-8")
    case = api.load(folder / "edge.yaml", overrides)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    structure = Structure(case.config, case.files, mesh, reduced, training)
    return SimpleNamespace(
        case=case, mesh=mesh, reduced=reduced, training=training, screened=screened, structure=structure
    )


def placed(own: SimpleNamespace) -> StructurePlacement:
    return api.place(own.case, own.mesh, own.reduced, own.training, own.screened)


def validated(own: SimpleNamespace, gauges: np.ndarray) -> Validation:
    return api.validate(own.case, own.mesh, own.reduced, own.training, own.screened, gauges)


def infinite(found: Mapping[str, Artefact]) -> list[str]:
    """stage/dataset of what holds NaN or infinity, but for those where that has a meaning, as of σ that is withheld."""
    withheld = {"std", "smoothed_std"} if any("out_of_range" in own.summary for own in found.values()) else set()
    every = [(f"{stage}{path}", artefact[path]) for stage, artefact in found.items() for path in artefact.paths()]
    return [
        name
        for name, array in every
        if array.dtype.kind == "f" and not np.isfinite(array).all() and not name.startswith(SEEN_AS_NONE)
        if not withheld & set(name.split("/"))
    ]


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())

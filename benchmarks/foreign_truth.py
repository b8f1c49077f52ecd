"""Does σ cover errors of the model? `python -m benchmarks.foreign_truth [draws] [--structure NAME …] [--kind WORD …]`.

The records come from another finite-element code (scikit-fem, 20-node bricks) and a Newmark integrator, on three
structures that strainsight reads as a deck. Every record has other phases of the loads, noise, and errors of gauges, loads
and damping drawn from the default tolerances; every kind adds one error of the model, or several. A table says for every
kind how many records are within 2σ, without σ and with which cause, beyond 4σ and reported as consistent. Numbers do not
depend on the machine.
"""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from multiprocessing import Pool
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import eigsh, splu
from skfem import Basis, BilinearForm, ElementHexS2, ElementVector, MeshHex
from skfem.helpers import ddot, dot, eye, sym_grad, trace

from strainsight import api
from strainsight.errors import InconsistentRecordError, UserError
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.sensors.candidates import Candidates

E, NU, RHO, DAMPING = 2.1e11, 0.3, 7850.0, 0.01
STEPS, PER_PERIOD, FINER = 600, 40, 8
"""Samples of a record; samples a period of the highest load frequency; steps of the integrator a sample."""
MODES, GAUGES, NOISE, STRONGEST = 60, 5, 1e-6, 3e-4
"""Modes of the truth; gauges of the layout; noise of a sample and the largest RMS strain of a candidate [m/m]."""
CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float
)
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
C3D20 = np.concatenate([CORNERS, [(CORNERS[a] + CORNERS[b]) / 2 for a, b in EDGES]])
"""Local coordinates (20, 3) of the nodes of a C3D20 in [0, 1]³."""


@dataclass(frozen=True)
class Shape:
    """Grid lines [m] of a structure, which cells it has, where it is clamped, and point and direction of both loads."""

    lines: tuple[np.ndarray, np.ndarray, np.ndarray]
    solid: Callable[[np.ndarray], np.ndarray]
    clamped: Callable[[np.ndarray], np.ndarray]
    tip: tuple[tuple[float, ...], tuple[float, ...]]
    side: tuple[tuple[float, ...], tuple[float, ...]]


def shapes() -> dict[str, Shape]:
    width = np.linspace(0, 0.03, 3)
    bracket = Shape(
        (np.r_[0, 0.01, np.linspace(0.02, 0.25, 10)], width, np.r_[np.linspace(0, 0.28, 11), 0.29, 0.30]),
        lambda x: (x[0] < 0.02) | (x[2] > 0.28),
        lambda x: x[2] < 1e-9,
        ((0.25, 0.015, 0.3), (0, 0, 1)),
        ((0.25, 0.015, 0.3), (0, 1, 0)),
    )
    frame = Shape(
        (np.r_[0, np.linspace(0.02, 0.38, 10), 0.40], width, np.r_[np.linspace(0, 0.28, 9), 0.30]),
        lambda x: (x[0] < 0.02) | (x[0] > 0.38) | (x[2] > 0.28),
        lambda x: x[2] < 1e-9,
        ((0.0, 0.015, 0.3), (1, 0, 0)),
        ((0.2, 0.015, 0.3), (0, 0, 1)),
    )
    plate = Shape(
        (np.linspace(0, 0.4, 9), np.linspace(0, 0.25, 7), np.array([0, 0.006])),
        lambda x: x[0] > -1,
        lambda x: x[0] < 1e-9,
        ((0.4, 0.0, 0.006), (0, 0, 1)),
        ((0.4, 0.25, 0.006), (0, 0, 1)),
    )
    return {"bracket": bracket, "frame": frame, "plate": plate}


@dataclass(frozen=True)
class Kind:
    """A kind of model error of the truth. load: whether the load is unknown, else E; cause: what a right message names.

    density, damping: factors; tip_mass: share of the mass; support: share of the first frequency that elastic supports cost;
    angle: of the load [deg]; second: size of a load that the model lacks, over the known one; gain: of all gauges; load_gain;
    moved [m], turned [deg]: error of every gauge, of one; warming: strain of all gauges at the end; hum: strain at 50 Hz."""

    name: str
    load: bool
    cause: str = ""
    density: float = 1.0
    damping: float = 1.0
    tip_mass: float = 0.0
    support: float = 0.0
    angle: float = 0.0
    second: float = 0.0
    gain: float = 1.0
    load_gain: float = 1.0
    moved: float = 0.0
    turned: float = 0.0
    warming: float = 0.0
    hum: float = 0.0


KINDS = (
    Kind("E: nothing", False),
    Kind("E: density +1 %", False, "frequency", density=1.01),
    Kind("E: density −1 %", False, "frequency", density=0.99),
    Kind("E: density +5 %", False, "frequency", density=1.05),
    Kind("E: mass of 1 % at the tip", False, "mass", tip_mass=0.01),
    Kind("E: mass of 4 % at the tip", False, "mass", tip_mass=0.04),
    Kind("E: elastic supports, −1 % of f₁", False, "frequency", support=0.01),
    Kind("E: elastic supports, −3.5 % of f₁", False, "frequency", support=0.035),
    Kind("E: damping × 3", False, "damping", damping=3.0),
    Kind("E: damping / 3", False, "damping", damping=1 / 3),
    Kind("E: gauges 3 mm off, one turned by 10°", False, "gauges", moved=0.003, turned=10.0),
    Kind("E: all gauges 2 % low", False, "gauges", gain=0.98),
    Kind("E: load direction 10° off", False, "load", angle=10.0),
    Kind("E: load cell 2 % high", False, "load", load_gain=1.02),
    Kind("E: second load of 30 %", False, "load", second=0.3),
    Kind("load: nothing", True),
    Kind("load: density +5 %", True, "frequency", density=1.05),
    Kind("load: mass of 4 % at the tip", True, "mass", tip_mass=0.04),
    Kind("load: elastic supports, −3.5 % of f₁", True, "frequency", support=0.035),
    Kind("load: damping × 3", True, "damping", damping=3.0),
    Kind("load: direction 10° off", True, "load", angle=10.0),
    Kind("load: second load of 30 %", True, "load", second=0.3),
    Kind("load: all gauges 2 % low", True, "gauges", gain=0.98),
    Kind("load: warming, 20 µm/m on all gauges", True, "common", warming=2e-5),
    Kind("load: hum, 5 µm/m on all gauges", True, "common", hum=5e-6),
    Kind("load: mass of 2 %, damping / 2, gauges 2 % high", True, "mass", tip_mass=0.02, damping=0.5, gain=1.02),
)
WORDS = {
    "frequency": ("is measured at",),
    "mass": ("is measured at", "is missing in the model", "inertia force"),
    "damping": ("damping ratios",),
    "load": ("unmodelled load", "a load has another direction"),
    "gauges": ("common gain error", "is rotated", "as large as expected"),
    "common": ("drift together", "common sine"),
}
"""Parts of a message that name a cause."""
SENSOR = (
    "is rotated",
    "as large as expected",
    "opposite sign",
    "swapped",
    "has an offset",
    "drifts by",
    "is clipped",
    "only noise",
    "spikes:",
    "is stuck",
    "shifts by",
    "late",
    "early",
)
"""Parts of a message that accuse a sensor."""
COLUMNS = (
    "within 2σ",
    "2 to 4σ",
    "beyond 4σ",
    "withheld, cause right",
    "withheld, cause not named",
    "withheld, a sensor accused",
)


@dataclass(frozen=True)
class Truth:
    """A structure in scikit-fem, with the model error of a kind."""

    shape: Shape
    kind: Kind = field(default_factory=lambda: KINDS[0])

    @cached_property
    def mesh(self) -> MeshHex:
        mesh = MeshHex.init_tensor(*self.shape.lines)
        return mesh.restrict(np.flatnonzero(self.shape.solid(mesh.p[:, mesh.t].mean(axis=1))))

    @cached_property
    def basis(self) -> Basis:
        return Basis(self.mesh, ElementVector(ElementHexS2()), intorder=5)

    @cached_property
    def scalar(self) -> Basis:
        return self.basis.with_element(ElementHexS2())

    @cached_property
    def nodes(self) -> np.ndarray:
        return self.scalar.doflocs.T

    @cached_property
    def matrices(self) -> tuple[csr_matrix, csr_matrix]:
        lam, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))

        @BilinearForm
        def stiffness(u, v, w):
            strain = sym_grad(u)
            return ddot(lam * eye(trace(strain), 3) + 2 * mu * strain, sym_grad(v))

        @BilinearForm
        def mass(u, v, w):
            return RHO * dot(u, v)

        return stiffness.assemble(self.basis).tocsr(), mass.assemble(self.basis).tocsr()

    @cached_property
    def of_node(self) -> np.ndarray:
        """Degrees of freedom (n, 3) of the nodes: those of the vector element beside those of the scalar one."""
        dofs = np.zeros((len(self.nodes), 3), dtype=int)
        dofs[self.scalar.element_dofs.ravel()] = (
            self.basis.element_dofs.reshape(20, 3, -1).transpose(0, 2, 1).reshape(-1, 3)
        )
        return dofs

    def node(self, point: Sequence[float]) -> int:
        return int(np.argmin(np.linalg.norm(self.nodes - np.asarray(point), axis=1)))

    def unit_load(self, at: tuple[Sequence[float], Sequence[float]], angle: float = 0.0) -> np.ndarray:
        """Load vector of one newton, turned by an angle [deg] towards the next axis."""
        direction = np.asarray(at[1], dtype=float)
        across = np.roll(direction, 1)
        f = np.zeros(self.basis.N)
        turned = np.cos(np.deg2rad(angle)) * direction + np.sin(np.deg2rad(angle)) * across
        f[self.of_node[self.node(at[0])]] = turned
        return f

    @cached_property
    def clamped(self) -> np.ndarray:
        return self.of_node[np.flatnonzero(self.shape.clamped(self.nodes.T))].ravel()

    def operators(self, spring: float | None) -> tuple[csr_matrix, csr_matrix, np.ndarray]:
        """K, M and the degrees of freedom in motion; spring [N/m] of every clamped degree of freedom, None: fixed."""
        K, M = self.matrices
        M = self.kind.density * M
        total = float(M.sum()) / 3
        one = np.zeros(self.basis.N)
        one[self.of_node[self.node(self.shape.tip[0])]] = self.kind.tip_mass * total
        M = M + diags(one)
        if spring is None:
            return K, M, np.setdiff1d(np.arange(self.basis.N), self.clamped)
        ground = np.zeros(self.basis.N)
        ground[self.clamped] = spring
        return K + diags(ground), M, np.arange(self.basis.N)

    @cached_property
    def spring(self) -> float | None:
        """Stiffness [N/m] at which the first frequency falls by the share of the kind."""
        if not self.kind.support:
            return None
        rigid, low, high = self.first(None), 3.0, 12.0
        for _ in range(24):
            middle = (low + high) / 2
            soft = 1 - self.first(10.0**middle) / rigid > self.kind.support
            low, high = (middle, high) if soft else (low, middle)
        return 10.0**high

    def first(self, spring: float | None) -> float:
        """First natural frequency [Hz]."""
        K, M, free = self.operators(spring)
        lam = eigsh(K[free][:, free].tocsc(), 1, M[free][:, free].tocsc(), sigma=0, return_eigenvectors=False)
        return float(np.sqrt(lam[0])) / (2 * np.pi)

    @cached_property
    def modal(self) -> tuple[np.ndarray, np.ndarray]:
        """ω² (r,) and shapes (N, r): MODES modes and what the static responses to both loads add."""
        K, M, free = self.operators(self.spring)
        K_free, M_free = K[free][:, free].tocsc(), M[free][:, free].tocsc()
        _, phi = eigsh(K_free, MODES, M_free, sigma=0, v0=np.ones(len(free)))
        loads = np.stack(
            [self.unit_load(at, angle) for at in (self.shape.tip, self.shape.side) for angle in (0, 90)], axis=1
        )
        shapes, _ = np.linalg.qr(
            np.column_stack([phi, splu(K_free).solve(loads[free])]) / np.sqrt(K_free.diagonal().mean())
        )
        lam, own = eigh(shapes.T @ (K_free @ shapes), shapes.T @ (M_free @ shapes))
        whole = np.zeros((self.basis.N, len(lam)))
        whole[free] = shapes @ own
        return lam, whole

    def strain_rows(self, position: np.ndarray, direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Strain (m, N) along directions (m, 3) at points of the surface (m, 3), just below it."""
        mapping, element = self.basis.mapping, self.basis.elem
        rows = np.zeros((len(position), self.basis.N))
        inside = position - 1e-7 * normal
        cells = self.mesh.element_finder()(*inside.T)
        for i, (point, cell, t) in enumerate(zip(inside, cells, direction, strict=True)):
            local = mapping.invF(point[:, None, None], tind=np.array([cell]))
            for k in range(60):
                grad = element.gbasis(mapping, local[:, 0], k, tind=np.array([cell]))[0].grad[:, :, 0, 0]
                rows[i, self.basis.element_dofs[k, cell]] += t @ grad @ t
        return rows

    def deck(self) -> str:
        """The structure as an Abaqus deck with C3D20."""
        corner = self.mesh.p[:, self.mesh.t]
        low, high = corner.min(axis=1), corner.max(axis=1)
        lines = ["*NODE", *(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(self.nodes, 1))]
        lines.append("*ELEMENT, TYPE=C3D20, ELSET=ALL")
        for cell, numbers in enumerate(self.scalar.element_dofs.T):
            local = (self.nodes[numbers] - low[:, cell]) / (high - low)[:, cell]
            order = [int(np.argmin(np.linalg.norm(local - at, axis=1))) for at in C3D20]
            words = [str(cell + 1), *(str(n + 1) for n in numbers[order])]
            lines += [", ".join(words[:11]) + ",", ", ".join(words[11:])]
        fixed = np.flatnonzero(self.shape.clamped(self.nodes.T)) + 1
        lines += ["*NSET, NSET=BASE", *(str(n) for n in fixed)]
        lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{E}, {NU}", "*DENSITY", f"{RHO}"]
        lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL", "*BOUNDARY", "BASE, 1, 3"]
        return "\n".join([*lines, ""])


def newmark(lam: np.ndarray, damping: np.ndarray, force: np.ndarray, h: float) -> np.ndarray:
    """Motion (T + 1, r) from rest of modes with ω² (r,) and ratios (r,) under modal forces (T + 1, r), by constant mean
    acceleration (β = ¼, γ = ½)."""
    c = 2 * damping * np.sqrt(lam)
    q, v = np.zeros(len(lam)), np.zeros(len(lam))
    a, motion = force[0] - lam * q, np.zeros_like(force)
    whole = 1 + h / 2 * c + h * h / 4 * lam
    for k in range(1, len(force)):
        qp, vp = q + h * v + h * h / 4 * a, v + h / 2 * a
        a = (force[k] - c * vp - lam * qp) / whole
        q, v = qp + h * h / 4 * a, vp + h / 2 * a
        motion[k] = q
    return motion


@dataclass(frozen=True)
class Study:
    """A structure in strainsight, with E or the load unknown, and a layout from `place`."""

    folder: Path
    name: str
    truth: Truth
    load: bool

    @cached_property
    def band(self) -> tuple[float, float]:
        """Of the loads [Hz]."""
        first = self.truth.first(None)
        return (round(0.15 * first, 3), round((0.9 if self.load else 1.6) * first, 3))

    @property
    def h(self) -> float:
        return float(f"{1 / (PER_PERIOD * self.band[1]):.3g}")

    def config(self, amplitude: float) -> dict[str, object]:
        point, direction = self.truth.shape.tip
        signal = {
            "type": "multisine",
            "lowest": self.band[0],
            "highest": self.band[1],
            "count": 12,
            "amplitude": amplitude,
        }
        load: dict[str, object] = {"node": self.truth.node(point) + 1, "direction": direction, "signal": signal}
        load |= {"known": not self.load}
        if self.load:
            load["process_noise"] = {"model": "integrated_random_walk", "frequency": self.band[1]}
        unknown = "tip" if self.load else "E"
        return {
            "kind": "placement",
            "name": self.name,
            "mesh": {"file": f"{self.name}.inp", "length_unit": "m", "mass_unit": "kg"},
            "parameters": {"E": {"property": "youngs_modulus", "region": 1, "guess": 2.0e11, "range": [1.5e11, 2.8e11]}}
            if not self.load
            else {},
            "loads": {"tip": load},
            "damping": {"type": "modal", "ratio": DAMPING},
            "rom": {"modes": 6},
            "train": {"duration": STEPS * self.h, "time_step": self.h},
            "gauges": {
                "surface": "all",
                "direction": {"type": "principal", "angles": [0]},
                "noise_std": {"value": NOISE},
            },
            "place": {"estimate": [unknown], "keep": GAUGES},
            "validate": {
                "time_step": self.h,
                "duration": STEPS * self.h,
                "initial_std": {unknown: 1.0 if self.load else 0.1},
            },
            "filter": {"compare": False},
        }

    @cached_property
    def file(self) -> Path:
        (self.folder / f"{self.name}.inp").write_text(self.truth.deck())
        file = self.folder / f"{self.name}-{'load' if self.load else 'E'}.yaml"
        file.write_text(json.dumps(self.config(1.0)))
        case = api.load(file)
        mesh = api.mesh(case)
        training = api.train(case, mesh, api.reduce(case, mesh))
        file.write_text(json.dumps(self.config(float(f"{STRONGEST / strongest(training):.3g}"))))
        return file

    @cached_property
    def prepared(self) -> tuple[Mesh, Reduced, Training, Screened, np.ndarray, Candidates]:
        """Mesh, reduced model, training, screened candidates, gauges of the layout, and their channels."""
        case = api.load(self.file)
        mesh = api.mesh(case)
        reduced = api.reduce(case, mesh)
        training = api.train(case, mesh, reduced)
        screened = api.screen(case, mesh, reduced, training)
        gauges = api.place(case, mesh, reduced, training, screened).gauges
        pool = training.candidates
        return mesh, reduced, training, screened, gauges, pool.take(pool.channels(gauges))


def strongest(training: Training) -> float:
    """Largest RMS reading of a candidate in training [m/m]."""
    return float(np.sqrt(np.mean((training.motions[0].coordinate @ training.rows.T) ** 2, axis=0)).max())


@dataclass(frozen=True)
class Outcome:
    """Result of one record. ratio: error over σ, NaN without σ; message: why σ is withheld."""

    ratio: float
    message: str = ""

    def column(self, cause: str) -> str:
        """Column of the table in which this record counts; cause: of the true model error."""
        if not self.message:
            return "within 2σ" if self.ratio <= 2 else "2 to 4σ" if self.ratio <= 4 else "beyond 4σ"
        if cause != "gauges" and any(word in self.message for word in SENSOR):
            return "withheld, a sensor accused"
        right = bool(cause) and any(word in self.message for word in WORDS[cause])
        return "withheld, cause right" if right else "withheld, cause not named"


def record(study: Study, truth: Truth, number: int) -> Outcome:
    """Simulate a record of a kind of truth and estimate from it."""
    kind, rng = truth.kind, np.random.default_rng([17, number])
    mesh, reduced, training, screened, gauges, bonded = study.prepared
    m, direction, normal = len(gauges), bonded.direction, bonded.normal
    # installation, within the default tolerances
    across = np.cross(normal, direction)
    offset = 0.002 * rng.standard_normal((2, m, 1))
    if kind.moved:
        way = rng.uniform(0, 2 * np.pi, (m, 1))
        offset = kind.moved * np.stack([np.cos(way), np.sin(way)])
    angle = np.deg2rad(2.0 * rng.standard_normal((m, 1)))
    if kind.turned:
        angle[rng.integers(m)] += np.deg2rad(kind.turned)
    moved = bonded.position + offset[0] * direction + offset[1] * across
    turned = np.cos(angle) * direction + np.sin(angle) * across
    lam, phi = truth.modal
    read = truth.strain_rows(moved, turned, normal) @ phi
    damping = DAMPING * kind.damping * np.exp(np.log(1.5) * rng.standard_normal(len(lam)) * (kind.damping == 1))
    # loads
    low, high = study.band
    t = study.h / FINER * np.arange(FINER * STEPS + 1)
    f = np.linspace(low, high, 12)
    size = float(json.loads(study.file.read_text())["loads"]["tip"]["signal"]["amplitude"])

    def signal() -> np.ndarray:
        return size * np.sin(2 * np.pi * np.outer(t, f) + rng.uniform(0, 2 * np.pi, 12)).sum(axis=1)

    tip, side = signal(), kind.second * signal()
    towards = kind.angle or float(rng.standard_normal())
    unit = truth.unit_load(truth.shape.tip, towards)
    force = np.outer(tip, unit @ phi) + np.outer(side, truth.unit_load(truth.shape.side) @ phi)
    force *= np.minimum(1.0, t / (10 * study.h))[:, None]
    tip = tip * np.minimum(1.0, t / (10 * study.h))
    y = newmark(lam, damping, force, study.h / FINER)[FINER::FINER] @ read.T
    time = study.h * np.arange(STEPS + 1)
    y *= kind.gain * (1 + 0.01 * rng.standard_normal(m))
    y += (kind.warming * time[1:] / time[-1] + kind.hum * np.sin(2 * np.pi * 50 * time[1:]))[:, None]
    y += NOISE * rng.standard_normal(y.shape)
    known = tip[::FINER] * kind.load_gain * (1 + 0.005 * rng.standard_normal())
    names = [f"G{i + 1}" for i in range(m)]
    columns = np.column_stack([time, np.vstack([np.zeros(m), y]), known])
    heads = ["time [s]", *(f"{n} [m/m]" for n in names), "force [N]"]
    np.savetxt(study.folder / "record.csv", columns, "%.12g", ",", header=",".join(heads), comments="")
    channels = ", ".join(f"{{channel: {n}, gauge: {n}, unit: m/m}}" for n in names)
    inputs = "" if kind.load else ", inputs: {tip: {channel: force, unit: N}}"
    settings = (
        f"{{file: record.csv, as_placed: true, start: rest, time: {{channel: time}}, channels: [{channels}]{inputs}}}"
    )
    case = api.load(study.file, [f"estimate={settings}"])
    try:
        result = api.estimate(case, mesh, reduced, training, screened, gauges)
    except (InconsistentRecordError, UserError) as error:
        return Outcome(np.nan, error.what)
    if result.decision.withheld:
        return Outcome(np.nan, result.decision.withheld)
    name = "tip" if kind.load else "E"
    mean, sigma = result.estimated.smoothed[name], result.estimated.smoothed_std[name]
    if not kind.load:
        return Outcome(abs(float(mean[-1]) - E) / float(sigma[-1]))
    late = slice(STEPS // 10, None)
    difference = (mean - tip[::FINER])[late]
    return Outcome(float(np.sqrt(np.mean(difference**2) / np.mean(sigma[late] ** 2))))


def run_study(task: tuple[str, bool, tuple[Kind, ...], int, int]) -> dict[str, Counter[str]]:
    """Columns of all records of one structure with E or the load unknown: structure, load, kinds, draws, seed."""
    name, load, kinds, draws, seed = task
    exact = Truth(shapes()[name])
    counts: dict[str, Counter[str]] = {}
    with TemporaryDirectory() as folder:
        study = Study(Path(folder), name, exact, load)
        for kind in kinds:
            truth, of_kind = replace(exact, kind=kind), counts.setdefault(kind.name, Counter())
            for draw in range(draws):
                outcome = record(study, truth, 1000 * seed + draw)
                column = outcome.column(kind.cause)
                of_kind[column] += 1
                line = f"{name}, {kind.name}, {draw}: {column}, {outcome.ratio:.2f}, {outcome.message}"
                print(line, file=sys.stderr, flush=True)
    return counts


def main(arguments: Sequence[str]) -> None:
    parser = ArgumentParser(description="Whether σ covers errors of the model.")
    parser.add_argument("draws", type=int, nargs="?", default=10)
    parser.add_argument("--structure", nargs="*", default=[*shapes()], choices=[*shapes()])
    parser.add_argument("--kind", nargs="*", default=[""], help="texts that the name of a kind contains")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    kinds = [kind for kind in KINDS if any(text in kind.name for text in options.kind)]
    tasks = []
    for name in options.structure:
        for load in (False, True):
            some = tuple(kind for kind in kinds if kind.load == load)
            tasks += [(name, load, some, options.draws, options.seed)] * bool(some)
    with Pool(2) as pool:
        results = pool.map(run_study, tasks, chunksize=1)
    totals = {kind.name: sum((result.get(kind.name, Counter()) for result in results), Counter()) for kind in kinds}
    print(f"| truth | {' | '.join(COLUMNS)} |\n|---|{'---|' * len(COLUMNS)}")
    whole = sum(totals.values(), Counter())
    for name, counts in (*totals.items(), ("all", whole)):
        print(f"| {name} | {' | '.join(str(counts[column]) for column in COLUMNS)} |")
    withheld = sum(count for column, count in whole.items() if column.startswith("withheld"))
    right = whole["withheld, cause right"]
    print(f"\nwithin 2σ, or withheld with the right cause: {100 * (whole[COLUMNS[0]] + right) / whole.total():.1f} %")
    print(f"right cause of {withheld} withheld: {100 * right / max(withheld, 1):.0f} %")


if __name__ == "__main__":
    main(sys.argv[1:])

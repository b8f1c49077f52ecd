"""A system as arrays for compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from strainsight.multibody.forces import CompiledLaw, ForceLaw, InPython
from strainsight.multibody.relations import Relations
from strainsight.multibody.system import System

MOTIONS = 6
"""Minimal coordinates of a moving body before its modal ones: displacement and rotation."""


class Moments(NamedTuple):
    """Moments (nm): on: the body, its loads, their directions, the rotation shapes."""

    on: np.ndarray
    inputs: np.ndarray
    direction: np.ndarray
    rotation: np.ndarray


class Sparsity(NamedTuple):
    """Sparsity of the matrix of a step: body, dt and feels of `Arrays`; joints: number of joint constraints. tied, pushed
    (nb, any): bodies that share a joint or an element with a body, itself included; reached (nb, any): bodies coupled through
    both; joint_rows (nb, any): joint constraints of a body. place (N,): positions of the unknowns (nt, μ, λ) in the matrix;
    low (N,): last nonzero row of each column, fill-in included."""

    body: np.ndarray
    dt: np.ndarray
    feels: np.ndarray
    joints: int
    tied: np.ndarray
    pushed: np.ndarray
    reached: np.ndarray
    joint_rows: np.ndarray
    place: np.ndarray
    low: np.ndarray


class Arrays(NamedTuple):
    """What a system is made of, by number; compiled functions take the part that they need, for each array is an argument.
    Bodies (nb): body (nb, 6): whether it moves, its first natural and its first minimal coordinate, modes, where its inertia
    begins in `inertia` (−1: it is constant, in `mass`), number of minimal coordinates; d (n,), dt (nt,): diagonal scale of
    the mass, natural and minimal. weights (nr,) of the weight; input_row, input_which: which load acts along which relation.
    Elements (ne): element (ne, 4): first row, rows, parameters and loads, where its memory begins; element_feels;
    element_parameter: places in (θ, u). joints: how many constraints are held, rigid: how many come before theirs; drive (k,
    4): row of a driven constraint, of its second relation or −1, which drive, power; drive_at, drives: where p begins in u,
    how many."""

    body: np.ndarray
    d: np.ndarray
    dt: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    relations: Relations
    weights: np.ndarray
    input_row: np.ndarray
    input_which: np.ndarray
    element: np.ndarray
    element_feels: np.ndarray
    element_parameter: np.ndarray
    moments: Moments
    joints: int
    rigid: int
    drive: np.ndarray
    drive_at: int
    drives: int


class StepPoint(NamedTuple):
    """Start and conditions of a step: q, v (n,), h, u with p and ṗ behind the loads, θ, K(θ), C(θ) (n, n), w (n,) or (0,);
    addresses of the force laws, offsets of their numbers, and the numbers."""

    q: np.ndarray
    v: np.ndarray
    h: float
    u: np.ndarray
    theta: np.ndarray
    K: np.ndarray
    C: np.ndarray
    w: np.ndarray
    address: np.ndarray
    begin: np.ndarray
    numbers: np.ndarray


class TrialState(NamedTuple):
    """Trial state of an iteration: q (n,), ζ (nt,), μ, λ (m,)."""

    q: np.ndarray
    z: np.ndarray
    mu: np.ndarray
    lam: np.ndarray


class StateChange(NamedTuple):
    """Change of a trial state: y and that of ζ (nt, k), of μ and λ (joints, k)."""

    y: np.ndarray
    z: np.ndarray
    mu: np.ndarray
    lam: np.ndarray


class Terms(NamedTuple):
    """The equations of a step at a trial state: r₁, r₂ (nt,), r₃, r₄ (joints,), ∇ρ, ∂ρ̇ (nr, nt), X, A, K (nt, nt) of `scaled`,
    TᵀM (nt, 12 + most modes), ∂r₂/∂(θ, u) of the elements (nt, nθ + all of u), by_drive (k, nt + 2) of `drive_relations`; without
    tangents ∂ρ̇, X, A, K, TᵀM and ∂r₂/∂(θ, u) are empty."""

    r1: np.ndarray
    r2: np.ndarray
    r3: np.ndarray
    r4: np.ndarray
    g: np.ndarray
    gr: np.ndarray
    X: np.ndarray
    A: np.ndarray
    K: np.ndarray
    TM: np.ndarray
    by_parameters: np.ndarray
    by_drive: np.ndarray


def arrays(system: System, memory: Sequence[int]) -> tuple[Arrays, Sparsity]:
    """Arrays over minimal coordinates. memory: values that each law stores from one trial state to the next."""
    names = [body.name for body in system.bodies]
    body, inertia, flat = np.zeros((len(names), 6), dtype=np.int64), {x.at: x for x in system.inertia}, [np.zeros(0)]
    t0, begin, dt = 0, 0, []
    for k, b in enumerate(system.bodies):
        span, width = system.of[b.name], MOTIONS * b.moves + b.modes
        body[k] = b.moves, span.start, t0, b.modes, -1, width
        t0 += width
        d = system.metric[span]
        dt.append(np.concatenate([d[:3], np.sqrt(2.0) * d[3:6], d[12:]]) if b.moves else d)
        if span.start in inertia and b.moves and b.modes:
            x = inertia[span.start]
            body[k, 4] = begin
            flat += [np.array([x.mass]), *(np.ravel(field) for field in x[2:])]
            begin = sum(len(part) for part in flat)
    relations, rigid, starts = system.products.relations, system.rigid, body[:, 1]
    feels = [[int(k) for k in row if k >= 0] for row in relations.feels[rigid:]]
    joints, drives = system.constrained - rigid, system.drives
    driven = np.stack([drives.row, drives.across, drives.which, drives.power], axis=1).astype(np.int64)
    driven[:, :1] -= rigid
    driven[:, 1] -= np.where(driven[:, 1] >= 0, rigid, 0)
    for row, across, _, _ in driven:
        if across >= 0:
            feels[row] = feels[across] = sorted({*feels[row], *feels[across]})
    elements = [
        (e.rows.start - rigid, e.rows.stop - e.rows.start, len(e.parameters) + len(e.inputs)) for e in system.elements
    ]
    element_feels = [sorted({k for row in feels[first : first + rows] for k in row}) for first, rows, _ in elements]
    tied, pushed = _neighbours(len(names), feels[:joints]), _neighbours(len(names), element_feels)
    near = [sorted({j for i in bodies for j in tied[i]}) for bodies in pushed]
    joint_rows = [[row for row in range(joints) if k in feels[row]] for k in range(len(names))]
    place = _places(body, near, feels[:joints])
    moments, most = system.moments, max(b.modes for b in system.bodies)
    rotation = np.zeros((len(moments), 3, most))
    direction = np.zeros((len(moments), 3, max([len(m.inputs) for m in moments], default=0)))
    for k, moment in enumerate(moments):
        rotation[k, :, : moment.rotation.shape[1]] = moment.rotation
        direction[k, :, : len(moment.inputs)] = moment.directions
    moment_on = [int(np.searchsorted(starts, m.eta.start if m.R < 0 else m.R, side="right")) - 1 for m in moments]
    table = np.zeros((len(elements), 4), dtype=np.int64)
    for k, (first, rows, parameters) in enumerate(elements):
        table[k] = first, rows, parameters, sum(memory[:k])
    feeling, scale = _padded(feels, 4), np.concatenate(dt)
    result = Arrays(
        body, np.ascontiguousarray(system.metric), scale, np.ascontiguousarray(system.mass), np.concatenate(flat),
        relations._replace(
            part=relations.part[rigid:], sign=relations.sign[rigid:], value=relations.value[rigid:], feels=feeling
        ),
        np.ascontiguousarray(system.weights[rigid:]), (system.input_rows[0] - rigid).astype(np.int64),
        system.input_rows[1].astype(np.int64), table, _padded(element_feels),
        _padded([[*e.parameters, *(len(system.parameters) + e.inputs)] for e in system.elements]),
        Moments(
            np.array(moment_on, dtype=np.int64), _padded([m.inputs.tolist() for m in moments], direction.shape[2]),
            direction, rotation,
        ),
        joints, rigid, driven, drives.at, len(drives.names),
    )  # fmt: skip
    pattern = Sparsity(
        body,
        scale,
        feeling,
        joints,
        _padded(tied),
        _padded(pushed),
        _padded(near),
        _padded(joint_rows),
        place,
        _reach(body, near, feels[:joints], place),
    )
    return result, pattern


def natural(system: System, s: Arrays) -> Arrays:
    """The same over natural coordinates, in which the rigidity of bodies is a constraint: see `balance`."""
    rigid, products = system.rigid, system.products
    body = products.body.copy()
    body[:, 4] = s.body[:, 4]
    element, drive = s.element.copy(), s.drive.copy()
    element[:, 0] += rigid
    drive[:, 0] += rigid
    drive[:, 1] += np.where(drive[:, 1] >= 0, rigid, 0)
    return s._replace(
        body=body, dt=s.d, relations=products.relations, weights=np.ascontiguousarray(system.weights),
        input_row=s.input_row + rigid, element=element, joints=system.constrained, rigid=0,
        drive=drive,
    )  # fmt: skip


def _padded(rows: Sequence[Sequence[int]], least: int = 0) -> np.ndarray:
    """Lists of different lengths as one array, padded with −1."""
    padded = np.full((len(rows), max([least, *(len(row) for row in rows)])), -1, dtype=np.int64)
    for k, row in enumerate(rows):
        padded[k, : len(row)] = row
    return padded


def _neighbours(count: int, groups: Sequence[Sequence[int]]) -> list[list[int]]:
    neighbours = [{k} for k in range(count)]
    for group in groups:
        for k in group:
            neighbours[k] |= set(group)
    return [sorted(bodies) for bodies in neighbours]


def _places(body: np.ndarray, near: list[list[int]], joints: list[list[int]]) -> np.ndarray:
    """Elimination order from the free ends of chains to the supports. Multipliers of a joint follow the first of its bodies with
    remaining motions, for little fill-in and no zero pivot."""
    count = len(body)
    links = np.zeros((count, count))
    for k, bodies in enumerate(near):
        links[k, bodies] = links[bodies, k] = 1.0
    order = reverse_cuthill_mckee(csr_matrix(links), symmetric_mode=True)
    ground = {row[0] for row in joints if len(row) == 1} | {k for k in range(count) if not body[k, 0]}
    where = {int(k): i for i, k in enumerate(order)}
    if ground and np.mean([where[k] for k in ground]) < 0.5 * (count - 1):
        order = order[::-1]
    sequence: list[int] = []
    nt, waiting, visited = int(body[:, 5].sum()), list(range(len(joints))), set()
    for k in map(int, order):
        visited.add(k)
        sequence += range(body[k, 2], body[k, 2] + body[k, 5])
        free = int(body[k, 5])
        now = [row for row in waiting if set(joints[row]) <= visited]
        free -= len(now)
        for row in waiting:
            if row not in now and k in joints[row] and free > 0:
                now.append(row)
                free -= 1
        waiting = [row for row in waiting if row not in now]
        sequence += [nt + row for row in now] + [nt + len(joints) + row for row in now]
    place = np.empty(len(sequence), dtype=np.int64)
    place[sequence] = np.arange(len(sequence))
    return place


def _reach(body: np.ndarray, near: list[list[int]], joints: list[list[int]], place: np.ndarray) -> np.ndarray:
    """Last nonzero row (N,) of each column and those before it, fill-in included."""
    nt, count = int(body[:, 5].sum()), len(joints)
    spans = [range(body[k, 2], body[k, 2] + body[k, 5]) for k in range(len(body))]
    filled = np.eye(len(place), dtype=bool)
    for k, bodies in enumerate(near):
        for j in bodies:
            first, second = place[list(spans[k])], place[list(spans[j])]
            filled[np.ix_(first, second)] = filled[np.ix_(second, first)] = True
    for row, mine in enumerate(joints):
        felt = sorted({j for k in mine for j in near[k]})
        columns = place[[i for k in felt for i in spans[k]]]
        for unknown in (nt + row, nt + count + row):
            filled[place[unknown], columns] = filled[columns, place[unknown]] = True
        others = [r for r, other in enumerate(joints) if set(other) & set(mine)]
        both = place[[nt + r for r in others] + [nt + count + r for r in others]]
        filled[np.ix_(place[[nt + row, nt + count + row]], both)] = True
    last = np.array([np.flatnonzero(column)[-1] for column in filled.T]) if len(place) else np.zeros(0, dtype=np.int64)
    return np.maximum.accumulate(last).astype(np.int64)


NONE = np.zeros(0)
REMEMBERED = 4
"""Number of values of θ whose preparation is stored."""


class Compiled:
    """arrays with their pattern, of the step; natural: of `balance`; memory: values stored by the laws; in_python: law called
    back for each element, or None."""

    def __init__(self, system: System):
        laws = [element.force.law for element in system.elements]
        fast = [law if isinstance(law, CompiledLaw) and law.address else None for law in laws]
        self.in_python = tuple(
            None if compiled_law else InPython(law) for compiled_law, law in zip(fast, laws, strict=True)
        )
        memory = [0 if compiled_law is None else compiled_law.memory for compiled_law in fast]
        self.arrays, self.pattern = arrays(system, memory)
        self.natural: Arrays = natural(system, self.arrays)
        self.memory = sum(memory)
        self._prepared: dict[bytes, StepPoint] = {}
        self._numbers: list[tuple[bytes, np.ndarray] | None] = [None] * len(laws)

    def failure(self) -> Exception | None:
        """Error of a Python law that stopped compiled code."""
        return next(filter(None, [law.pop_failure() for law in self.in_python if law is not None]), None)

    def at(self, system: System, theta: np.ndarray) -> StepPoint:
        """A point with everything that depends on θ (nθ,), without a state. Raises the errors of a law with these parameters."""
        if (point := self._prepared.get(theta.tobytes())) is None:
            point = self._prepare(system, theta)
            while len(self._prepared) >= REMEMBERED:
                del self._prepared[next(iter(self._prepared))]
            self._prepared[theta.tobytes()] = point
        return point

    def _prepare(self, system: System, theta: np.ndarray) -> StepPoint:
        address, begin, numbers, count = [], [], [np.zeros(0)], 0
        for e, (element, back) in enumerate(zip(system.elements, self.in_python, strict=True)):
            law = element.force.law
            values = self._numbers_of(e, law, theta[element.parameters]) if back is None else np.zeros(0)
            address.append(back.address if back is not None else law.address)  # type: ignore[attr-defined]
            begin.append(count)
            numbers.append(values)
            count += len(values)
        K, C = system.at(theta)
        return StepPoint(
            NONE, NONE, 1.0, NONE, theta.copy(), np.ascontiguousarray(K), np.ascontiguousarray(C), NONE,
            np.array(address, dtype=np.int64), np.array(begin, dtype=np.int64), np.concatenate(numbers),
        )  # fmt: skip

    def _numbers_of(self, e: int, law: ForceLaw, parameters: np.ndarray) -> np.ndarray:
        """Numbers of element e, stored for unchanged parameters."""
        last = self._numbers[e]
        if last is None or last[0] != parameters.tobytes():
            assert isinstance(law, CompiledLaw)
            last = self._numbers[e] = parameters.tobytes(), np.asarray(law.numbers(parameters), dtype=float)
        return last[1]


_compiled: WeakKeyDictionary[System, Compiled] = WeakKeyDictionary()


def compile_system(system: System) -> Compiled:
    """The compiled form of a system, created once."""
    if (result := _compiled.get(system)) is None:
        result = _compiled[system] = Compiled(system)
    return result

"""A system of bodies, joints and forces, compiled to arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.errors import InfeasibleError, did_you_mean
from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bodies import (
    Body,
    Carried,
    FlexibleBody,
    Frame,
    Inertia,
    RigidBody,
    as_inertia,
    constant,
    mass_matrix,
    mass_moment,
    metric,
)
from strainsight.multibody.forces import Force, FrameLoad, Gravity, PointForce, PointMoment, RelativeElement
from strainsight.multibody.joints import DrivenRelation, Drives, Joint, compile_drives
from strainsight.multibody.relations import Products, Relation, compile_products, place

AXES = "xyz"


@dataclass(frozen=True)
class Element:
    """A force law on relations: element, its rows, its parameters in θ, its loads in u."""

    force: RelativeElement
    rows: slice
    parameters: np.ndarray
    inputs: np.ndarray


@dataclass(frozen=True)
class TurningMoment:
    """A moment Σ u_k d_k on a body: R its first R coordinate or −1, eta the modal slice, shapes Ψ (3, n)."""

    R: int
    eta: slice
    rotation: np.ndarray
    directions: np.ndarray
    inputs: np.ndarray


@dataclass(frozen=True, eq=False)
class System:
    """What (1.3) needs, over q = [q_b for every body]; made by `assemble`. size n; of (name → slice): a body's coordinates;
    constraints (m): the name of every row of φ, those of the rigid motions first; inputs, parameters: the names of u and θ;
    drives: of joints that are driven, then u goes on with p and ṗ of every drive; relations: the constraints, then those of
    elements, inputs and gravity; metric d (n,): d² is the diagonal scale of the mass; mass (n, n): the constant part of M;
    inertia: the bodies whose mass moves; stiffness, damping (n, n): elastic, constant and per parameter (nθ, n, n)."""

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    forces: tuple[Force, ...]
    size: int
    of: Mapping[str, slice]
    constraints: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    products: Products
    metric: np.ndarray
    mass: np.ndarray
    inertia: tuple[Inertia, ...]
    stiffness: np.ndarray
    stiffness_terms: np.ndarray
    damping: np.ndarray
    damping_terms: np.ndarray
    elements: tuple[Element, ...]
    input_rows: tuple[np.ndarray, np.ndarray]
    weights: np.ndarray
    moments: tuple[TurningMoment, ...]
    drives: Drives

    @cached_property
    def starts(self) -> np.ndarray:
        """First coordinate of every body."""
        return np.array([coordinates.start for coordinates in self.of.values()])

    @property
    def constrained(self) -> int:
        """Number m of constraints."""
        return len(self.constraints)

    @property
    def rigid(self) -> int:
        """Number of leading constraints that keep the bodies' frames orthonormal."""
        return 6 * sum(body.moves for body in self.bodies)

    def modal(self, name: str) -> slice:
        """The modal coordinates of a body."""
        body = next(b for b in self.bodies if b.name == name)
        return slice(self.of[name].stop - body.modes, self.of[name].stop)

    def most_in(self, x: np.ndarray) -> str:
        """The body with the largest absolute value of these entries (n,)."""
        return max(self.of, key=lambda name: float(np.max(np.abs(x[self.of[name]]), initial=0.0)))

    def at(self, theta: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K(θ), C(θ) (n, n)."""
        K, C, theta = self.stiffness, self.damping, np.asarray(theta, dtype=float)
        if len(self.stiffness_terms):
            count = len(self.stiffness_terms)
            K = K + (theta @ self.stiffness_terms.reshape(count, -1)).reshape(K.shape)
            C = C + (theta @ self.damping_terms.reshape(count, -1)).reshape(C.shape)
        return K, C


def assemble(bodies: Iterable[Body], joints: Iterable[Joint] = (), forces: Iterable[Force] = ()) -> System:
    """The system of these bodies, joints and forces. Raises InfeasibleError for two bodies or joints of one name, a body that
    no one gave, shapes that do not fit a body, a frame whose axes are not orthonormal, a point mass. Whether the joints are
    independent depends on the configuration: `project_position` checks it."""
    bodies, joints, forces = tuple(bodies), tuple(joints), tuple(forces)
    _refuse_twins("bodies", [b.name for b in bodies])
    _refuse_twins("joints", [j.name for j in joints])
    _refuse_twins("forces", [f.name for f in forces])
    of, n = {}, 0
    for body in bodies:
        of[body.name] = slice(n, n + body.size)
        n += body.size

    relations, constraints = _rigidity(bodies)
    joint_constraints: list[Relation | DrivenRelation] = [*relations]
    for joint in joints:
        joint_constraints += joint.relations
        relations += [
            relation.relation if isinstance(relation, DrivenRelation) else relation for relation in joint.relations
        ]
        constraints += [f"{joint.name}: {relation.name}" for relation in joint.relations]
    parameters = _parameter_names(bodies, forces)
    inputs = list(dict.fromkeys(name for f in forces if not isinstance(f, Gravity) for name in f.inputs))
    drives, across = compile_drives(joint_constraints, len(relations), len(inputs))
    relations += across

    elements, moments = [], []
    weights = [0.0] * len(relations)
    input_rows: tuple[list[int], list[int]] = ([], [])
    for force in forces:
        first = len(relations)
        if isinstance(force, RelativeElement):
            which = np.array([parameters.index(name) for name in force.parameters], dtype=int)
            relations += force.relations
            loads = np.array([inputs.index(name) for name in force.inputs], dtype=int)
            elements.append(Element(force, slice(first, len(relations)), which, loads))
        elif isinstance(force, PointForce):
            relations += [place(force.frame, d) for d in _directions(force)]
            input_rows[0].extend(range(first, len(relations)))
            input_rows[1].extend(inputs.index(name) for name in force.inputs)
        elif isinstance(force, PointMoment):
            moments.append(_moment(force, bodies, of, inputs))
        else:
            # g·∫ρ p, whose negative is the potential of the weight
            pull = (constant(force.acceleration),)
            relations += [Relation(f"weight of body {body.name}", pull, (mass_moment(body),)) for body in bodies]
        weights += [-1.0 if isinstance(force, Gravity) else 0.0] * (len(relations) - first)

    _check_carried(relations, bodies)
    mass = np.zeros((n, n))
    d = np.empty(n)
    K, C = (np.zeros((n, n)) for _ in range(2))
    K_terms, C_terms = (np.zeros((len(parameters), n, n)) for _ in range(2))
    for body in bodies:
        span = of[body.name]
        d[span] = metric(body)
        if isinstance(body, RigidBody) or body.clamped:
            mass[span, span] = mass_matrix(body)
        if isinstance(body, FlexibleBody):
            eta = slice(span.stop - body.modes, span.stop)
            for total, terms, X in ((K, K_terms, body.stiffness), (C, C_terms, body.damping)):
                X = X if isinstance(X, AffineOperator) else AffineOperator(X, {})
                total[eta, eta] = X.constant
                assert not X.coefficients, f"body {body.name}: stiffness and damping must be linear in the parameters"
                for name, term in X.terms.items():
                    terms[parameters.index(name), eta, eta] = term
    moving = [
        as_inertia(of[b.name].start, b.invariants) for b in bodies if isinstance(b, FlexibleBody) and not b.clamped
    ]
    return System(
        bodies, joints, forces, n, of, tuple(constraints), tuple(inputs), tuple(parameters),
        compile_products(relations, bodies), d, mass, tuple(moving), K, K_terms, C, C_terms, tuple(elements),
        (np.array(input_rows[0], dtype=int), np.array(input_rows[1], dtype=int)), np.array(weights), tuple(moments),
        drives,
    )  # fmt: skip


def _rigidity(bodies: Sequence[Body]) -> tuple[list[Relation], list[str]]:
    """R_a·R_b = δ_ab, a ≤ b, of every body that moves."""
    relations, names = [], []
    for body in bodies:
        if body.moves:
            R = [Carried(body.name, 0.0, e, np.zeros((3, 0))) for e in np.eye(3)]
            relations += [Relation("", (R[a],), (R[b],), float(a == b)) for a in range(3) for b in range(a, 3)]
            names += [
                f"scalar product of the {AXES[a]} axis and the {AXES[b]} axis of body {body.name}"
                for a in range(3)
                for b in range(a, 3)
            ]
    return relations, names


def _moment(force: PointMoment, bodies: Sequence[Body], of: Mapping[str, slice], inputs: list[str]) -> TurningMoment:
    body = _body(force.frame, bodies)
    rotation = np.zeros((3, body.modes)) if force.frame.rotation is None else force.frame.rotation
    span = of[body.name]
    eta = slice(span.stop - body.modes, span.stop)
    R = span.start + 3 if body.moves else -1
    which = np.array([inputs.index(name) for name in force.inputs], dtype=int)
    return TurningMoment(R, eta, np.asarray(rotation, dtype=float), _directions(force).T, which)


def _directions(force: FrameLoad) -> np.ndarray:
    """The columns of the directions as rows (k, 3)."""
    D = np.asarray(force.directions, dtype=float)
    D = D[:, None] if D.ndim == 1 else D
    _refuse_twins(f"inputs of the force {force.name}", list(force.inputs))
    if D.shape != (3, len(force.inputs)):
        raise InfeasibleError(
            f"force {force.name}: the array of load directions has shape {D.shape}, but {len(force.inputs)} inputs require "
            f"(3, {len(force.inputs)})"
        )
    return D.T


def _body(frame: Frame, bodies: Sequence[Body]) -> Body:
    for body in bodies:
        if body.name == frame.body:
            return body
    raise InfeasibleError(
        f"frame {frame.name} is not on a body", remedy="apply the moment to a frame of a body instead of the ground"
    )


def _check_carried(relations: Sequence[Relation], bodies: Sequence[Body]) -> None:
    known = {body.name: body.modes for body in bodies}
    for relation in relations:
        for b in relation.x + relation.y:
            if b.body is not None and b.body not in known:
                raise InfeasibleError(
                    f"{relation.name}: body {b.body} not found",
                    remedy=did_you_mean(b.body, known, f"bodies: {', '.join(known)}"),
                )
            shapes = b.C.shape[1]
            if shapes and shapes != known.get(str(b.body), 0):
                raise InfeasibleError(
                    f"{relation.name}: the frame has {shapes} mode shapes, "
                    f"but body {b.body} has {known.get(str(b.body), 0)} modes"
                )


def _parameter_names(bodies: Sequence[Body], forces: Sequence[Force]) -> list[str]:
    names: list[str] = []
    for body in bodies:
        if isinstance(body, FlexibleBody):
            for X in (body.stiffness, body.damping):
                names += X.terms if isinstance(X, AffineOperator) else ()
    for force in forces:
        if isinstance(force, RelativeElement):
            names += force.parameters
    return list(dict.fromkeys(names))


def _refuse_twins(what: str, names: Sequence[str]) -> None:
    if twins := sorted({name for name in names if names.count(name) > 1}):
        raise InfeasibleError(f"{what} with the same name: {', '.join(twins)}", remedy="rename all but one")

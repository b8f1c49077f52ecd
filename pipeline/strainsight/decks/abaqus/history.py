"""Supports, elements and contact pairs that result from the steps of an Abaqus deck (*BOUNDARY, *MODEL CHANGE)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row, Step
from strainsight.decks.faults import ENFORCED, HELD, plural
from strainsight.errors import ChoiceError, DeckError
from strainsight.mesh.model import IntArray

LARGE = "*STEP, NLGEOM"
"""Name of large displacements that no modal step follows."""
STRESSED = "*INITIAL CONDITIONS, TYPE=STRESS"
MODAL = {
    *("FREQUENCY", "COMPLEXFREQUENCY", "STEADYSTATEDYNAMICS", "MODALDYNAMIC", "RANDOMRESPONSE", "RESPONSESPECTRUM"),
    "SUBSTRUCTUREGENERATE",
}
LOADS = {"CLOAD", "DLOAD", "DSLOAD", "BOUNDARY", "TEMPERATURE"}


def preloads(steps: Sequence[Step]) -> dict[str, list[Keyword]]:
    """Preload cards, named as in `Mesh.ignored` → keywords that cause them.

    "PRELOAD by *STEP, NLGEOM": steps with large displacements before a modal step, which affect the modes in Abaqus,
    and in CalculiX with PERTURBATION. "PRELOAD by *STEP, PERTURBATION": modes that CalculiX computes about the loads
    of a preceding static step. Abaqus requires NLGEOM for this, and a deck with NLGEOM=NO is an Abaqus deck."""
    preload_steps: dict[str, list[Keyword]] = {}
    bent: list[Keyword] = []
    loaded = large = False
    for step in steps:
        parameters, inside = step.keyword.parameters, _names(step)
        if "NLGEOM" in parameters:  # remains active in later steps
            large = parameters["NLGEOM"].upper() != "NO"
        if not inside & MODAL:
            bent += [step.keyword] if large else []
            loaded |= "STATIC" in inside and "NLGEOM" not in parameters and bool(inside & LOADS)
        elif bent:
            preload_steps.setdefault("PRELOAD by *STEP, NLGEOM", []).extend(bent)
            bent = []
        elif loaded and "PERTURBATION" in parameters and "NLGEOM" not in parameters:
            preload_steps.setdefault("PRELOAD by *STEP, PERTURBATION", []).append(step.keyword)
    return preload_steps | ({LARGE: bent} if bent else {})


TYPES = {
    "ENCASTRE": (0, 1, 2, 3, 4, 5),
    "PINNED": (0, 1, 2),
    "XSYMM": (0, 4, 5),
    "YSYMM": (1, 3, 5),
    "ZSYMM": (2, 3, 4),
    "XASYMM": (1, 2, 3),
    "YASYMM": (0, 2, 4),
    "ZASYMM": (0, 1, 5),
}
"""Components 0-5 that a named support fixes."""
NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Supports:
    """motion (f,) 6·row + component 0-5 of the fixed motions, unique and sorted; moves (f,) whether the value is not
    zero; line (f,) number of the last data line that defines it."""

    motion: IntArray = field(default_factory=lambda: NONE)
    moves: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    line: IntArray = field(default_factory=lambda: NONE)

    def then(self, more: Iterable[Supports]) -> Supports:
        """These supports followed by `more`, where the last definition applies."""
        all_ = [self, *more]
        motion = np.concatenate([supports.motion for supports in all_])[::-1]
        unique_motion, at = np.unique(motion, return_index=True)
        moves, line = (
            np.concatenate([getattr(supports, name) for supports in all_])[::-1][at] for name in ("moves", "line")
        )
        return Supports(unique_motion, moves, line)

    def pairs(self, rotations: dict[int, int], ignored: Counter[str], free: bool = False) -> IntArray:
        """(f, 2) unique sorted pairs (row, component 0-5). Prescribed displacements are fixed at zero, or left free,
        and counted.

        rotations: node whose translations are the rotations of another node (CalculiX) → that node; free: leave
        prescribed displacements free instead of fixing them at zero."""
        if self.moves.any():
            ignored[ENFORCED if free else HELD] += len(np.unique(self.line[self.moves]))
        motion = self.motion[~self.moves] if free else self.motion
        fixed = np.column_stack([motion // 6, motion % 6])
        for i in np.flatnonzero(np.isin(fixed[:, 0], list(rotations))):
            fixed[i] = rotations[int(fixed[i, 0])], fixed[i, 1] + 3
        return np.unique(fixed[fixed[:, 1] < 6], axis=0)


@dataclass(frozen=True)
class State:
    """Supports of a step; rows of the elements and names of the contact pairs that *MODEL CHANGE has removed."""

    supports: Supports = field(default_factory=Supports)
    elements: frozenset[int] = frozenset()
    pairs: frozenset[tuple[str, str]] = frozenset()

    def same(self, other: State) -> bool:
        """Whether both states have the same supports, elements and pairs."""
        same = np.array_equal(self.supports.motion, other.supports.motion)
        return same and (self.elements, self.pairs) == (other.elements, other.pairs)


def state_of(assembly: Assembly, ignored: Counter[str], chosen: int | None = None) -> State:
    """State in step `chosen` or in the frequency step; without either, the state of all steps, which must agree.

    OP=NEW removes all previous supports, including those of the model. Supports of a perturbation step end with it
    in Abaqus and continue in CalculiX. Raises ChoiceError if steps differ, DeckError if the two programs differ, and
    for a missing step, motions of a submodel or subroutine, missing nodes and elements, and an unknown support name."""
    reader = _Reader(assembly, ignored)
    model = State(Supports().then(reader.supports(assembly.keywords("BOUNDARY"))))
    for _, keyword in assembly.keywords("MODELCHANGE"):
        if "ACTIVATE" not in keyword.parameters:
            raise keyword.error(
                "this keyword is not allowed before the first *STEP",
                "move *MODEL CHANGE into the step that removes or adds the elements or contact pairs",
            )
    if not assembly.steps:
        return model
    if chosen is not None and not 1 <= chosen <= len(assembly.steps):
        raise DeckError(
            f"step {chosen} (mesh.step) is not in the deck",
            where=assembly.steps[-1].keyword.where,
            remedy=f"set mesh.step to a number from 1 to {len(assembly.steps)}",
        )
    modal = [step.number for step in assembly.steps if _names(step) & MODAL]
    requested = [chosen] if chosen else modal or [step.number for step in assembly.steps]
    states: dict[int, State] = {}
    running = general = model
    for step in assembly.steps[: max(requested)]:
        running, local = reader.after(step, running), reader.after(step, general)
        ends = "PERTURBATION" in step.keyword.parameters or bool(_names(step) & {*MODAL, "BUCKLE"})
        general = general if ends else local
        states[step.number] = running
        if step.number in requested and not running.same(local):
            raise DeckError(
                f"the supports of step {step.number} are ambiguous: supports of an earlier perturbation step "
                "end with that step in Abaqus, but continue in CalculiX",
                where=step.keyword.where,
                remedy="define all supports of this step in the step itself (*BOUNDARY, OP=NEW)",
            )
    _check_choice(assembly.steps, states, requested)
    state, step = states[requested[0]], assembly.steps[requested[0] - 1]
    if not state.same(model):
        count = f"; *MODEL CHANGE removes {plural(len(state.elements), 'element')}" if state.elements else ""
        assembly.notes.append(f"the supports are those of step {step.number} ({step.keyword.where}){count}")
    return state


def _check_choice(steps: Sequence[Step], states: dict[int, State], requested: Sequence[int]) -> None:
    """Raise ChoiceError if the requested steps have different states."""
    other = next((number for number in requested if not states[number].same(states[requested[0]])), None)
    if other is not None:
        what = "supports" if states[other].elements == states[requested[0]].elements else "elements"
        raise ChoiceError(
            f"steps {requested[0]} and {other} have different {what} ({steps[requested[0] - 1].keyword.where}, "
            f"{steps[other - 1].keyword.where})",
            where=steps[other - 1].keyword.where,
            remedy=f"set mesh.step to the step that defines the model, for example mesh.step: {other}",
            choices=tuple(requested),
            key="step",
        )


def _names(step: Step) -> set[str]:
    return {keyword.name for keyword in step.keywords}


@dataclass
class _Reader:
    """Reader of the keywords of steps; lines: number of data lines of *BOUNDARY read so far."""

    assembly: Assembly
    ignored: Counter[str]
    lines: int = 0
    known: dict[tuple[int, str], list[Supports]] = field(default_factory=dict)

    def after(self, step: Step, before: State) -> State:
        """State in a step, given the state before it."""
        scope = self.assembly.scopes[""]
        boundary_keywords = [keyword for keyword in step.keywords if keyword.name == "BOUNDARY"]
        new = any(keyword.word("OP") == "NEW" for keyword in boundary_keywords)
        state = before
        if boundary_keywords:
            supports = Supports() if new else before.supports
            state = replace(
                before, supports=supports.then(self.supports((scope, keyword) for keyword in boundary_keywords))
            )
        for keyword in step.keywords:
            if keyword.name == "MODELCHANGE":
                state = self.changed(keyword, scope, state)
        return state

    def changed(self, keyword: Keyword, scope: Scope, state: State) -> State:
        """The state after a *MODEL CHANGE."""
        ways = {"ADD", "REMOVE"} & keyword.parameters.keys()
        kind = keyword.word("TYPE", "ELEMENT").replace(" ", "")
        if "ACTIVATE" in keyword.parameters:  # prepares a change in a later analysis
            return state
        if len(ways) != 1:
            raise keyword.error(
                "exactly one of ADD and REMOVE is required",
                "write REMOVE to remove elements or contact pairs, or ADD to add removed ones again",
            )
        rows = keyword.rows()
        if kind == "CONTACTPAIR":
            pairs = {(row.text(0).upper(), row.text(1).upper()) for row in rows}
            return replace(state, pairs=state.pairs - pairs if "ADD" in ways else state.pairs | pairs)
        if kind != "ELEMENT":
            raise keyword.error(f"TYPE={kind} is not supported", "set TYPE to ELEMENT or CONTACT PAIR")
        named = [
            self.assembly.rows("ELEMENT", entry, scope, row).tolist() for row in rows for entry in row.tokens if entry
        ]
        elements = frozenset(number for number_list in named for number in number_list)
        return replace(state, elements=state.elements - elements if "ADD" in ways else state.elements | elements)

    def supports(self, keywords: Iterable[tuple[Scope, Keyword]]) -> list[Supports]:
        """Supports of each data line of *BOUNDARY, in order."""
        found_supports: list[Supports] = []
        for scope, keyword in keywords:
            if "SUBMODEL" in keyword.parameters or "USER" in keyword.parameters:
                raise keyword.error(
                    "displacements from a submodel (SUBMODEL) or a subroutine (USER) are not supported",
                    "replace these displacements by supports with the value 0",
                )
            key = id(keyword), scope.name
            if key not in self.known:
                self.known[key] = [self._line(row, scope) for row in keyword.rows(needed=False)]
            found_supports += self.known[key]
        return found_supports

    def _line(self, row: Row, scope: Scope) -> Supports:
        nodes = np.unique(self.assembly.rows("NODE", row.text(0), scope, row))
        components = np.array(_fixed_components(row, self.ignored), dtype=np.int64)
        motion = np.sort((6 * nodes[:, None] + components).ravel())
        self.lines += 1
        moves = np.full(len(motion), row.real(3, "the displacement", 0.0) != 0)
        return Supports(motion, moves, np.full(len(motion), self.lines))


def _fixed_components(row: Row, ignored: Counter[str]) -> tuple[int, ...]:
    """Components 0-5 of a data line of *BOUNDARY."""
    label = row.text(1).upper()
    if label and not label[0].isdigit():
        if label not in TYPES:
            raise row.error(
                f"{row.text(1)!r} is not a support type",
                f"write degrees of freedom from 1 to 6, or one of {', '.join(TYPES)}",
            )
        return TYPES[label]
    first = row.integer(1, "the first degree of freedom of the support")
    last = row.integer(2, "the last degree of freedom of the support", first) or first
    if last < first or (first < 1 and last != 0):
        raise row.error(
            f"the range of degrees of freedom {first} to {last} is not valid",
            "write the lower degree of freedom first; both must be from 1 to 6",
        )
    for other in {first, last} - {*range(1, 7)}:  # temperature (0, 11), pressure (8) …
        ignored[f"*BOUNDARY of degree of freedom {other}"] += 1
    return tuple(c - 1 for c in range(max(first, 1), min(last, 6) + 1))

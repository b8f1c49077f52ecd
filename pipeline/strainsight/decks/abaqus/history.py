"""What the steps of an Abaqus deck leave of its supports, elements and contact pairs (*BOUNDARY, *MODEL CHANGE)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strainsight.decks.abaqus.scopes import Assembly, Scope, Step
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import ENFORCED, HELD, PRELOAD, plural
from strainsight.errors import ChoiceError, DeckError
from strainsight.mesh.model import IntArray

LARGE = "*STEP, NLGEOM"
"""Large displacements, where no modes follow."""
STRESSED = "*INITIAL CONDITIONS, TYPE=STRESS"
MODAL = {
    *("FREQUENCY", "COMPLEXFREQUENCY", "STEADYSTATEDYNAMICS", "MODALDYNAMIC", "RANDOMRESPONSE", "RESPONSESPECTRUM"),
    "SUBSTRUCTUREGENERATE",
}
LOADS = {"CLOAD", "DLOAD", "DSLOAD", "BOUNDARY", "TEMPERATURE"}


def preloads(steps: Sequence[Step]) -> dict[str, list[Keyword]]:
    """Cards as `Mesh.ignored` names them → where they stand.

    "PRELOAD by *STEP, NLGEOM": steps of large displacements before modes, which count in Abaqus, and in CalculiX beside
    PERTURBATION; "PRELOAD by *STEP, PERTURBATION": modes that in CalculiX are about the loads of a static step before. Abaqus
    asks for NLGEOM there, and a deck that states NLGEOM=NO is one of Abaqus.
    """
    found: dict[str, list[Keyword]] = {}
    bent: list[Keyword] = []
    loaded = large = False
    for step in steps:
        stated, inside = step.keyword.parameters, _names(step)
        if "NLGEOM" in stated:  # goes on from step to step
            large = stated["NLGEOM"].upper() != "NO"
        if not inside & MODAL:
            bent += [step.keyword] if large else []
            loaded |= "STATIC" in inside and "NLGEOM" not in stated and bool(inside & LOADS)
        elif bent:
            found.setdefault(f"{PRELOAD} by {LARGE}", []).extend(bent)
            bent = []
        elif loaded and "PERTURBATION" in stated and "NLGEOM" not in stated:
            found.setdefault(f"{PRELOAD} by *STEP, PERTURBATION", []).append(step.keyword)
    return found | ({LARGE: bent} if bent else {})


def stressed(keywords: Sequence[Keyword]) -> list[Keyword]:
    """*INITIAL CONDITIONS that state stress."""
    return [own for own in keywords if own.name == "INITIALCONDITIONS" and own.word("TYPE") == "STRESS"]


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
"""Components 0-5 that a named support holds."""
NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Supports:
    """motion (f,) 6·row + component 0-5 that is held, each once, sorted; moves (f,) where the value is not zero; line (f,) number
    of the data line that says so last."""

    motion: IntArray = field(default_factory=lambda: NONE)
    moves: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    line: IntArray = field(default_factory=lambda: NONE)

    def then(self, more: Iterable[Supports]) -> Supports:
        """These and those that come after them, of which the last counts."""
        all_ = [self, *more]
        motion = np.concatenate([own.motion for own in all_])[::-1]
        kept, at = np.unique(motion, return_index=True)
        moves, line = (np.concatenate([getattr(own, name) for own in all_])[::-1][at] for name in ("moves", "line"))
        return Supports(kept, moves, line)

    def pairs(self, rotations: dict[int, int], ignored: Counter[str], free: bool = False) -> IntArray:
        """(f, 2) pairs (row, component 0-5), each once, sorted. A displacement that is enforced is held at zero, or free, and
        counted.

        rotations: node whose translations are the rotations of another one (CalculiX) → that node; free: what is not held at
        zero is not held.
        """
        if self.moves.any():
            ignored[ENFORCED if free else HELD] += len(np.unique(self.line[self.moves]))
        motion = self.motion[~self.moves] if free else self.motion
        fixed = np.column_stack([motion // 6, motion % 6])
        for i in np.flatnonzero(np.isin(fixed[:, 0], list(rotations))):
            fixed[i] = rotations[int(fixed[i, 0])], fixed[i, 1] + 3
        return np.unique(fixed[fixed[:, 1] < 6], axis=0)


@dataclass(frozen=True)
class State:
    """What holds in a step: supports; rows of the elements, and names of the contact pairs, that *MODEL CHANGE has removed."""

    supports: Supports = field(default_factory=Supports)
    elements: frozenset[int] = frozenset()
    pairs: frozenset[tuple[str, str]] = frozenset()

    def same(self, other: State) -> bool:
        """Do the same supports, elements and pairs hold in both?"""
        same = np.array_equal(self.supports.motion, other.supports.motion)
        return same and (self.elements, self.pairs) == (other.elements, other.pairs)


def state_of(assembly: Assembly, ignored: Counter[str], chosen: int | None = None) -> State:
    """The state in step `chosen`, or in that of the frequency analysis; without any, of all steps, which have to agree.

    OP=NEW removes the supports before it, of the model too. Those of a perturbation step end with it in Abaqus and go on in
    CalculiX. Raises ChoiceError where steps differ, DeckError where the two programs do, for a step that is not there, motions of
    another model or a subroutine, nodes and elements that are not there, and a support of unknown name.
    """
    reader = _Reader(assembly, ignored)
    model = State(Supports().then(reader.supports(assembly.keywords("BOUNDARY"))))
    for _, keyword in assembly.keywords("MODELCHANGE"):
        if "ACTIVATE" not in keyword.parameters:
            raise keyword.error("stands before the first *STEP", "move it into the step in which it changes the model")
    if not assembly.steps:
        return model
    if chosen is not None and not 1 <= chosen <= len(assembly.steps):
        raise DeckError(
            f"step {chosen} (mesh.step) is not in the deck",
            where=assembly.steps[-1].keyword.where,
            remedy=f"steps are numbered from 1 to {len(assembly.steps)}",
        )
    modal = [step.number for step in assembly.steps if _names(step) & MODAL]
    asked = [chosen] if chosen else modal or [step.number for step in assembly.steps]
    states: dict[int, State] = {}
    running = general = model
    for step in assembly.steps[: max(asked)]:
        running, local = reader.after(step, running), reader.after(step, general)
        general = general if _is_perturbation(step) else local
        states[step.number] = running
        if step.number in asked and not running.same(local):
            raise DeckError(
                f"the supports of step {step.number} are not the same in all programs: those of a perturbation step before it "
                "end with that step in Abaqus, and go on in CalculiX",
                where=step.keyword.where,
                remedy="write all supports of this step in it (*BOUNDARY, OP=NEW)",
            )
    _check_choice(assembly.steps, states, asked)
    state, step = states[asked[0]], assembly.steps[asked[0] - 1]
    if not state.same(model):
        count = f", without {plural(len(state.elements), 'element')} (*MODEL CHANGE)" if state.elements else ""
        assembly.notes.append(f"supports are those in step {step.number} ({step.keyword.where}){count}")
    return state


def _check_choice(steps: Sequence[Step], states: dict[int, State], asked: Sequence[int]) -> None:
    """Raise ChoiceError where the steps asked for do not have the same state."""
    other = next((number for number in asked if not states[number].same(states[asked[0]])), None)
    if other is not None:
        what = "supports" if states[other].elements == states[asked[0]].elements else "elements"
        raise ChoiceError(
            f"steps {asked[0]} and {other} have different {what} ({steps[asked[0] - 1].keyword.where}, "
            f"{steps[other - 1].keyword.where})",
            where=steps[other - 1].keyword.where,
            remedy=f"say which step counts: mesh.step: {other}",
            choices=tuple(asked),
            key="step",
        )


def _names(step: Step) -> set[str]:
    return {keyword.name for keyword in step.keywords}


def _is_perturbation(step: Step) -> bool:
    return "PERTURBATION" in step.keyword.parameters or bool(_names(step) & {*MODAL, "BUCKLE"})


@dataclass
class _Reader:
    """Reads the keywords of steps; lines: how many data lines of *BOUNDARY so far."""

    assembly: Assembly
    ignored: Counter[str]
    lines: int = 0
    known: dict[tuple[int, str], list[Supports]] = field(default_factory=dict)

    def after(self, step: Step, before: State) -> State:
        """The state in a step, from that before it."""
        scope = self.assembly.scopes[""]
        own = [keyword for keyword in step.keywords if keyword.name == "BOUNDARY"]
        new = any(keyword.word("OP") == "NEW" for keyword in own)
        state = before
        if own:
            supports = Supports() if new else before.supports
            state = replace(before, supports=supports.then(self.supports((scope, keyword) for keyword in own)))
        for keyword in step.keywords:
            if keyword.name == "MODELCHANGE":
                state = self.changed(keyword, scope, state)
        return state

    def changed(self, keyword: Keyword, scope: Scope, state: State) -> State:
        """The state after a *MODEL CHANGE."""
        ways = {"ADD", "REMOVE"} & keyword.parameters.keys()
        kind = keyword.word("TYPE", "ELEMENT").replace(" ", "")
        if "ACTIVATE" in keyword.parameters:  # it prepares a change of a later analysis
            return state
        if len(ways) != 1:
            raise keyword.error("says neither ADD nor REMOVE, or both", "give one of them")
        rows = keyword.rows()
        if kind == "CONTACTPAIR":
            pairs = {(row.text(0).upper(), row.text(1).upper()) for row in rows}
            return replace(state, pairs=state.pairs - pairs if "ADD" in ways else state.pairs | pairs)
        if kind != "ELEMENT":
            raise keyword.error(f"TYPE={kind} is neither ELEMENT nor CONTACT PAIR", "correct the type")
        named = [
            self.assembly.element_rows(entry, scope, row).tolist() for row in rows for entry in row.tokens if entry
        ]
        elements = frozenset(number for own in named for number in own)
        return replace(state, elements=state.elements - elements if "ADD" in ways else state.elements | elements)

    def supports(self, keywords: Iterable[tuple[Scope, Keyword]]) -> list[Supports]:
        """Of each data line of *BOUNDARY, in their order."""
        found: list[Supports] = []
        for scope, keyword in keywords:
            if "SUBMODEL" in keyword.parameters or "USER" in keyword.parameters:
                raise keyword.error("motions of another model are not supported", "only supports at zero are imported")
            key = id(keyword), scope.name
            if key not in self.known:
                self.known[key] = [self._line(row, scope) for row in keyword.rows(needed=False)]
            found += self.known[key]
        return found

    def _line(self, row: Row, scope: Scope) -> Supports:
        nodes = np.unique(self.assembly.node_rows(row.text(0), scope, row))
        held = np.array(_held(row, self.ignored), dtype=np.int64)
        motion = np.sort((6 * nodes[:, None] + held).ravel())
        self.lines += 1
        moves = np.full(len(motion), row.real(3, "the value", 0.0) != 0)
        return Supports(motion, moves, np.full(len(motion), self.lines))


def _held(row: Row, ignored: Counter[str]) -> tuple[int, ...]:
    """Components 0-5 of a data line of *BOUNDARY."""
    label = row.text(1).upper()
    if label and not label[0].isdigit():
        if label not in TYPES:
            raise row.error(f"{row.text(1)!r} is no support", f"write degrees of freedom, or {', '.join(TYPES)}")
        return TYPES[label]
    first = row.integer(1, "the first degree of freedom")
    last = row.integer(2, "the last degree of freedom", first) or first
    if last < first or (first < 1 and last != 0):
        raise row.error(f"degrees of freedom {first} to {last}", "write the first and the last one, from 1 to 6")
    for other in {first, last} - {*range(1, 7)}:  # temperature (0, 11), pressure (8) …
        ignored[f"*BOUNDARY of degree of freedom {other}"] += 1
    return tuple(c - 1 for c in range(max(first, 1), min(last, 6) + 1))

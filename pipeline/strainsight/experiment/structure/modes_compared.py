"""Modes of another program beside those of this one, on the same mesh: frequencies, and shapes where they are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from strainsight.config.placement import PlacementConfig
from strainsight.decks.faults import plural
from strainsight.errors import ConfigError, DeckError, UserError, blame
from strainsight.experiment.structure.results import on_nodes
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.foreign.results.reader import READERS, read_responses
from strainsight.foreign.results.response import Response, printed_modes
from strainsight.mesh.model import IdTable, Mesh
from strainsight.mesh.sanity import ignored_structure, lost

KNOWN = {".f06": printed_modes, ".dat": printed_modes, **READERS}
MORE = 4
"""Modes of ours beyond as many as the file has, among which its shapes are sought."""
ALIKE = 1e-3
"""Frequencies of ours that lie nearer to each other have one space of shapes: a program may turn them in it."""
RIGID = 1e-2
"""Of our first frequency that is none of a rigid motion: modes of the file below are rigid motions."""
MOST = 60
"""Modes of a file that are compared, the lowest."""
FEWEST, SHARE, ENOUGH = 10, 0.1, 20
"""Nodes of both that distinguish shapes: ten (all of a smaller mesh) that are a tenth of it, or twenty, as of sensors."""


@dataclass(frozen=True)
class Pair:
    """A mode of the file: its number and frequency [Hz]; number and frequency of ours that it is compared with; off: ours over
    theirs less one, infinite of 0 Hz; mac: share of its shape within the space of ours (1 if it is the same), NaN where it has no
    shape."""

    number: int
    theirs: float
    mode: int
    ours: float
    off: float
    mac: float


@dataclass(frozen=True)
class Compared:
    """Pairs, what to look at, and over how many nodes of how many of the mesh shapes are compared; None without shapes."""

    pairs: tuple[Pair, ...]
    notes: tuple[str, ...]
    over: tuple[int, int] | None


def modes_of_file(path: Path, step: int | None) -> list[Response]:
    """Its modes, the lowest first. Raises DeckError where there are none, or several steps have some and none is chosen."""
    modes = [mode for mode in read_responses(path, KNOWN) if mode.kind == "mode" and step in (None, mode.step)]
    if not modes:
        asked = "" if step is None else f" in step {step}"
        raise DeckError(f"no modes{asked} in the file", where=str(path), remedy="give the results of normal modes")
    steps = sorted({mode.step for mode in modes})
    if len(steps) > 1:
        raise DeckError(
            f"steps {', '.join(map(str, steps[:8]))} have modes",
            where=str(path),
            remedy=f"choose one, --step {steps[0]}",
        )
    return sorted(modes, key=lambda mode: mode.frequency)[:MOST]


def modes_compared(config: PlacementConfig, mesh: Mesh, theirs: Sequence[Response]) -> Compared:
    """Every mode of a file beside one of the mesh as its deck has it, whatever is guessed.

    By shapes, MAC_ij = |φᵢ·ψⱼ|²/(φᵢ·φᵢ ψⱼ·ψⱼ) of the translations at the nodes of both, one to one, for the largest sum;
    without shapes in the order of frequencies. Rigid motions of a free structure are left out on both sides. Raises DeckError
    where nothing is left, or no node of the file is in the mesh.
    """
    for key in ("matrices", "results"):
        if getattr(config.mesh, key) is not None:
            raise ConfigError(
                "modes are compared with those of a deck, and this model comes from another program",
                key=f"mesh.{key}",
                remedy="compare the model of a deck",
            )
    with blame("mesh.file"), mesh.located():
        model = build_model(mesh, free=config.mesh.free)
    rigid = 0 if model.rigid is None else model.rigid.shape[1]
    massive = int(np.count_nonzero(model.mass.constant.diagonal() > 0)) - rigid
    wanted = min(len(theirs) + MORE, massive)
    frequency, shape = lowest_modes(model.stiffness.constant, model.mass.constant, wanted, rigid=model.rigid)
    still = [mode for mode in theirs if mode.frequency < RIGID * frequency[0]]
    theirs = [*still[rigid:], *(mode for mode in theirs if mode.frequency >= RIGID * frequency[0])]
    if not theirs:
        raise DeckError(
            f"only rigid motions in the file: its {plural(len(still), 'mode')} have up to {still[-1].frequency:.3g} Hz, "
            f"the first of the deck beside them has {frequency[0]:.4g} Hz",
            where=still[0].where,
            remedy=f"have that program find more than {len(still)} modes, or correct mesh.length_unit or mass_unit",
        )
    if len(theirs) > massive:
        raise UserError(
            f"{len(theirs)} modes of a model with {massive} unknowns that have mass", remedy="compare fewer"
        )
    notes = [
        f"mode {mode.number} of the file, {mode.frequency:.3g} Hz, is a rigid motion, and the deck has "
        + (f"{rigid} only" if rigid else "none")
        for mode in still[rigid:]
        if mode.frequency <= RIGID * theirs[-1].frequency  # not all of them, as with other units
    ]
    shapes = nodal(model, shape).reshape(-1, 3, wanted)[: mesh.own_nodes]
    both, doubts, over = _on_both(mesh, theirs)
    chosen, mac = np.arange(len(theirs)), np.full((wanted, len(theirs)), np.nan)
    if both is not None:
        by_mode, mac = _macs(shapes[both[0]], frequency, both[1])
        mode_of, number = linear_sum_assignment(-by_mode.T)
        chosen = number[np.argsort(mode_of)]
    pairs = tuple(
        Pair(
            mode.number,
            mode.frequency,
            int(i) + 1,
            float(frequency[i]),
            float(frequency[i] / mode.frequency - 1) if mode.frequency > 0 else np.inf,
            float(mac[i, j]),
        )
        for j, (i, mode) in enumerate(zip(chosen, theirs, strict=True))
    )
    left_out = [
        f"{card} of the deck may move frequencies and is not in ours: {lost(card)}" for card in ignored_structure(mesh)
    ]
    return Compared(pairs, (*notes, *doubts, *left_out), over)


def _on_both(
    mesh: Mesh, theirs: Sequence[Response]
) -> tuple[tuple[np.ndarray, np.ndarray] | None, list[str], tuple[int, int] | None]:
    """Nodes (c,) of the mesh that every mode has and translations (c, 3, modes) there, None where they are too few to
    distinguish shapes; notes; how many they are, and of how many."""
    lacking = [str(mode.number) for mode in theirs if not len(mode.node_ids)]
    if lacking:
        some = f"no MAC: mode {', '.join(lacking[:8])} of the file has no shape, others have"
        return None, [some] if len(lacking) < len(theirs) else [], None
    table, columns = IdTable(mesh.node_ids[: mesh.own_nodes]), []
    ids = np.unique(np.concatenate([mode.node_ids for mode in theirs]))
    foreign = ids[table.rows(ids)[1]]
    if len(foreign) == len(ids):
        raise DeckError(
            f"none of its {len(ids)} nodes is in the mesh",
            where=theirs[0].where,
            remedy="give the results of this deck, with its ids",
        )
    common = np.arange(mesh.own_nodes)
    for mode in theirs:
        rows, missing = table.rows(mode.node_ids)
        common = np.intersect1d(common, rows[~missing])
    notes = []
    if len(foreign):
        notes.append(
            f"{len(foreign)} of {plural(len(ids), 'node')} of the file are not in the mesh and left out, such as {foreign[0]}: "
            "is it of this deck?"
        )
    over = len(common), mesh.own_nodes
    if len(common) < min(FEWEST, over[1]) or len(common) < min(ENOUGH, SHARE * over[1]):
        notes.append(
            f"no MAC: {len(common)} of {plural(over[1], 'node')} of the mesh have a shape in every mode of the file, too few to "
            "distinguish shapes; have that program print all nodes"
        )
        return None, notes, None
    for mode in theirs:
        rows, missing = table.rows(mode.node_ids)
        columns.append(on_nodes(mesh, mode, rows, ~missing)[common, :3])
    return (common, np.stack(columns, axis=2)), notes, over


def _macs(ours: np.ndarray, frequency: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """MAC (ours, theirs) of shapes (c, 3, modes), and the share of each of theirs within the space of ours of like frequency."""
    Phi, Psi = ours.reshape(-1, ours.shape[2]), theirs.reshape(-1, theirs.shape[2])
    size = np.sum(Phi**2, axis=0)[:, None] * np.sum(Psi**2, axis=0)
    mac = np.divide((Phi.T @ Psi) ** 2, size, out=np.zeros_like(size), where=size > 0)
    within = np.empty_like(mac)
    for i, one in enumerate(frequency):
        group = Phi[:, np.abs(frequency - one) <= ALIKE * one]
        Q = np.linalg.qr(group)[0]
        within[i] = np.sum((Q.T @ Psi) ** 2, axis=0) / np.maximum(np.sum(Psi**2, axis=0), np.finfo(float).tiny)
    return mac, within

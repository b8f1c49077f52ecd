"""Comparison of modes with those of another program on the same mesh: frequencies, and MAC if shapes are available."""

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
"""Additional modes computed to find the shapes of the file."""
EQUAL = 1e-3
"""Relative distance of frequencies below which modes span one space."""
RIGID = 1e-2
"""Modes of the file below this fraction of the first elastic frequency are rigid-body modes."""
MOST = 60
"""Largest number of modes of a file that are compared."""
FEWEST, SHARE, ENOUGH = 10, 0.1, 20
"""Common nodes needed to distinguish shapes: FEWEST (all of a smaller mesh) and SHARE of the mesh, or ENOUGH."""


@dataclass(frozen=True)
class Pair:
    """A mode of the file and the computed mode assigned to it.

    number, theirs [Hz]: of the file; mode, ours [Hz]: computed; off: ours/theirs − 1, infinite for 0 Hz; mac: share of its shape
    in the space of the computed modes of equal frequency, NaN without a shape."""

    number: int
    theirs: float
    mode: int
    ours: float
    off: float
    mac: float


@dataclass(frozen=True)
class Compared:
    """Pairs of modes and notes; over: number of compared nodes and of all nodes, None without shapes."""

    pairs: tuple[Pair, ...]
    notes: tuple[str, ...]
    over: tuple[int, int] | None


def modes_of_file(path: Path, step: int | None) -> list[Response]:
    """Modes of the file, lowest first. Raises DeckError without modes, or if several steps have modes and none is chosen."""
    modes = [mode for mode in read_responses(path, KNOWN) if mode.kind == "mode" and step in (None, mode.step)]
    if not modes:
        in_step = "" if step is None else f" in step {step}"
        raise DeckError(
            f"the file contains no modes{in_step}", where=str(path), remedy="Use results of a modal analysis."
        )
    steps = sorted({mode.step for mode in modes})
    if len(steps) > 1:
        raise DeckError(
            f"several steps have modes: {', '.join(map(str, steps[:8]))}",
            where=str(path),
            remedy=f"Choose a step, for example --step {steps[0]}.",
        )
    return sorted(modes, key=lambda mode: mode.frequency)[:MOST]


def modes_compared(config: PlacementConfig, mesh: Mesh, theirs: Sequence[Response]) -> Compared:
    """Assign every mode of a file to a computed mode of the deck (without the guesses of parameters).

    One to one by the largest sum of MAC_ij = |φᵢ·ψⱼ|²/(φᵢ·φᵢ ψⱼ·ψⱼ) over the translations of common nodes; without shapes in
    the order of frequencies. Rigid-body modes of a free structure are omitted. Raises DeckError if no modes are left, or no node
    of the file is in the mesh."""
    for key in ("matrices", "results"):
        if getattr(config.mesh, key) is not None:
            raise ConfigError(
                "only the modes of a deck can be compared, but the model of this config is imported from another program",
                key=f"mesh.{key}",
                remedy="Use a config that reads the deck (mesh.file).",
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
            f"the file contains only rigid-body modes: {plural(len(still), 'mode')} up to {still[-1].frequency:.3g} Hz, "
            f"while the first elastic mode of the deck has {frequency[0]:.4g} Hz",
            where=still[0].where,
            remedy=f"Compute more than {len(still)} modes in the other program, or correct mesh.length_unit or mesh.mass_unit.",
        )
    if len(theirs) > massive:
        raise UserError(
            f"the file has {len(theirs)} modes, but the model has only {massive} degrees of freedom with mass",
            remedy="Use a results file with fewer modes.",
        )
    notes = [
        f"mode {mode.number} of the file ({mode.frequency:.3g} Hz) is a rigid-body mode, but the model of the deck has "
        f"{f'only {rigid}' if rigid else 'none'}. Check the supports of both models"
        for mode in still[rigid:]
        if mode.frequency <= RIGID * theirs[-1].frequency  # with wrong units all modes would be listed
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
        f"{card} of the deck is not modelled and may change frequencies ({lost(card)})"
        for card in ignored_structure(mesh)
    ]
    return Compared(pairs, (*notes, *doubts, *left_out), over)


def _on_both(
    mesh: Mesh, theirs: Sequence[Response]
) -> tuple[tuple[np.ndarray, np.ndarray] | None, list[str], tuple[int, int] | None]:
    """Common nodes (c,) with translations (c, 3, modes), None if too few to distinguish shapes; notes; number of common nodes and
    of all nodes."""
    lacking = [str(mode.number) for mode in theirs if not len(mode.node_ids)]
    if lacking:
        some = f"the MAC is not available, because these modes of the file have no shape: {', '.join(lacking[:8])}"
        return None, [some] if len(lacking) < len(theirs) else [], None
    table, columns = IdTable(mesh.node_ids[: mesh.own_nodes]), []
    ids = np.unique(np.concatenate([mode.node_ids for mode in theirs]))
    foreign = ids[table.rows(ids)[1]]
    if len(foreign) == len(ids):
        raise DeckError(
            f"none of the {len(ids)} nodes of the file is in the mesh",
            where=theirs[0].where,
            remedy="Use results of this deck with the same node ids.",
        )
    common = np.arange(mesh.own_nodes)
    for mode in theirs:
        rows, missing = table.rows(mode.node_ids)
        common = np.intersect1d(common, rows[~missing])
    notes = []
    if len(foreign):
        notes.append(
            f"nodes of the file that are not in the mesh and are omitted: {len(foreign)} of {len(ids)}, for example "
            f"{foreign[0]}. Check that the file belongs to this deck"
        )
    over = len(common), mesh.own_nodes
    if len(common) < min(FEWEST, over[1]) or len(common) < min(ENOUGH, SHARE * over[1]):
        notes.append(
            f"the MAC is not available: only {len(common)} of the {over[1]} nodes of the mesh have values in every mode "
            "shape of the file. Write the mode shapes at all nodes in the other program"
        )
        return None, notes, None
    for mode in theirs:
        rows, missing = table.rows(mode.node_ids)
        columns.append(on_nodes(mesh, mode, rows, ~missing)[common, :3])
    return (common, np.stack(columns, axis=2)), notes, over


def _macs(ours: np.ndarray, frequency: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """MAC (ours, theirs) of shapes (c, 3, modes), and the share of theirs in the space of ours with equal frequency."""
    Phi, Psi = ours.reshape(-1, ours.shape[2]), theirs.reshape(-1, theirs.shape[2])
    size = np.sum(Phi**2, axis=0)[:, None] * np.sum(Psi**2, axis=0)
    mac = np.divide((Phi.T @ Psi) ** 2, size, out=np.zeros_like(size), where=size > 0)
    within = np.empty_like(mac)
    for i, one in enumerate(frequency):
        group = Phi[:, np.abs(frequency - one) <= EQUAL * one]
        Q = np.linalg.qr(group)[0]
        within[i] = np.sum((Q.T @ Psi) ** 2, axis=0) / np.maximum(np.sum(Psi**2, axis=0), np.finfo(float).tiny)
    return mac, within

"""Modes of another program beside those of this one, on the same mesh: frequencies, and shapes where they are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from strainsight.cases.structure.results import on_nodes
from strainsight.config.placement import PlacementConfig
from strainsight.decks.faults import IdTable
from strainsight.decks.results.printed import printed_modes
from strainsight.decks.results.reader import ending_of, read_responses
from strainsight.decks.results.response import Response
from strainsight.errors import ConfigError, DeckError, UserError, blame
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes as lowest_modes
from strainsight.mesh.model import Mesh

PRINTED = (".f06", ".dat")
MORE = 4
"""Modes of ours beyond as many as the file has, among which its shapes are sought."""
ALIKE = 1e-3
"""Frequencies of ours that lie nearer to each other have one space of shapes: a program may turn them in it."""
RIGID = 1e-4
"""Of the highest frequency: modes below are rigid motions of a free structure."""
MOST = 60
"""Modes of a file that are compared, the lowest."""


@dataclass(frozen=True)
class Pair:
    """A mode of the file: its number and frequency [Hz]; number and frequency of ours that it is compared with; off: ours over
    theirs less one; mac: share of its shape within the space of ours (1 if it is the same), NaN where it has no shape."""

    number: int
    theirs: float
    mode: int
    ours: float
    off: float
    mac: float


def modes_of_file(path: Path, step: int | None) -> list[Response]:
    """Its modes, the lowest first. Raises DeckError where there are none, or several steps have some and none is chosen."""
    found = printed_modes(path) if ending_of(path) in PRINTED else read_responses(path)
    modes = [own for own in found if own.kind == "mode" and step in (None, own.step)]
    if not modes:
        asked = "" if step is None else f" in step {step}"
        raise DeckError(f"no modes{asked} in the file", where=str(path), remedy="give the results of normal modes")
    steps = sorted({own.step for own in modes})
    if len(steps) > 1:
        raise DeckError(
            f"steps {', '.join(map(str, steps[:8]))} have modes",
            where=str(path),
            remedy=f"choose one, --step {steps[0]}",
        )
    return sorted(modes, key=lambda own: own.frequency)[:MOST]


def modes_compared(config: PlacementConfig, mesh: Mesh, theirs: Sequence[Response]) -> tuple[Pair, ...]:
    """Every mode of a file beside one of the mesh as its deck has it, whatever is guessed.

    By shapes, MAC_ij = |φᵢ·ψⱼ|²/(φᵢ·φᵢ ψⱼ·ψⱼ) of the translations at the nodes of both, one to one, for the largest sum;
    without shapes in the order of frequencies. Rigid motions of a free structure are left out on both sides.
    """
    if config.mesh.matrices is not None or config.mesh.results is not None:
        key = "mesh.matrices" if config.mesh.matrices is not None else "mesh.results"
        raise ConfigError(
            "modes are compared with those of a deck, and this model comes from another program",
            key=key,
            remedy="compare the model of a deck",
        )
    highest = max(own.frequency for own in theirs)
    theirs = [own for own in theirs if not config.mesh.free or own.frequency > RIGID * highest]
    with blame("mesh.file"), mesh.located():
        model = build_model(mesh, free=config.mesh.free)
    massive = int(np.count_nonzero(model.mass.constant.diagonal() > 0))
    massive -= 0 if model.rigid is None else model.rigid.shape[1]
    wanted = min(len(theirs) + MORE, massive)
    if len(theirs) > massive:
        raise UserError(
            f"{len(theirs)} modes of a model with {massive} unknowns that have mass", remedy="compare fewer"
        )
    frequency, shape = lowest_modes(model.stiffness.constant, model.mass.constant, wanted, rigid=model.rigid)
    shapes = nodal(model, shape).reshape(-1, 3, wanted)
    macs = _macs(mesh, shapes[: mesh.own_nodes], frequency, theirs)
    chosen = np.arange(len(theirs)) if macs is None else _paired(macs[0])
    return tuple(
        Pair(
            own.number,
            own.frequency,
            int(i) + 1,
            float(frequency[i]),
            float(frequency[i] / own.frequency - 1) if own.frequency > 0 else np.inf,
            np.nan if macs is None else float(macs[1][i, j]),
        )
        for j, (i, own) in enumerate(zip(chosen, theirs, strict=True))
    )


def _paired(mac: np.ndarray) -> np.ndarray:
    """Ours (columns of the file,) for each of theirs, one to one."""
    of, ours = linear_sum_assignment(-mac.T)
    return np.asarray(ours[np.argsort(of)])


def _macs(
    mesh: Mesh, shapes: np.ndarray, frequency: np.ndarray, theirs: Sequence[Response]
) -> tuple[np.ndarray, np.ndarray] | None:
    """MAC (ours, theirs), and the share of each of theirs within the space of ours of like frequency; None without shapes."""
    if not all(len(own.node_ids) for own in theirs):
        return None
    table, columns = IdTable(mesh.node_ids[: mesh.own_nodes]), []
    rows, missing = table.rows(theirs[0].node_ids)
    common = np.unique(rows[~missing])
    if not len(common):
        raise DeckError(
            f"none of its {len(rows)} nodes is in the mesh",
            where=theirs[0].where,
            remedy="give the results of this deck, with its ids",
        )
    for own in theirs:
        at, lost = table.rows(own.node_ids)
        columns.append(on_nodes(mesh, own, at, ~lost)[common, :3])
    Psi = np.stack([np.nan_to_num(own).ravel() for own in columns], axis=1)
    Phi = shapes[common].reshape(-1, shapes.shape[2])
    size = np.sum(Phi**2, axis=0)[:, None] * np.sum(Psi**2, axis=0)
    mac = np.divide((Phi.T @ Psi) ** 2, size, out=np.zeros_like(size), where=size > 0)
    within = np.empty_like(mac)
    for i, own_frequency in enumerate(frequency):
        group = Phi[:, np.abs(frequency - own_frequency) <= ALIKE * own_frequency]
        Q = np.linalg.qr(group)[0]
        within[i] = np.sum((Q.T @ Psi) ** 2, axis=0) / np.maximum(np.sum(Psi**2, axis=0), np.finfo(float).tiny)
    return mac, within

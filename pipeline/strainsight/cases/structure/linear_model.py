"""The linear augmented model that a layout was chosen by, in the coordinates of the reduced model, for MATLAB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from strainsight.records.placed import Placed
from strainsight.rom.model import ReducedModel

HEADER = 116
"""[bytes] of text at the head of a MAT file, where the writer puts a date."""


@dataclass(frozen=True)
class LinearModel:
    """ẋ = A x + B u + w, y = C x + v, cov w = Q δ, cov v = R δ, for each of s scenarios.

    A (s, n, n) [1/s]; B (n, p) known loads, at the guess of the parameters; C (s, m, n) rows of the layout's channels;
    Q (s, n, n); R (s, m, m) [unit² s]; states, their units; loads; channels, their units.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    loads: tuple[str, ...]
    load_units: tuple[str, ...]
    channels: tuple[str, ...]
    channel_units: tuple[str, ...]


def linear_model(
    placed: Placed, model: ReducedModel, channels: Sequence[str], units: Sequence[str], load_units: Mapping[str, str]
) -> LinearModel:
    """From the scenarios as solved, x* = S x̃ with S = diag(scale):

        A = S F S⁻¹,   C = H S⁻¹,   Q = S Q̃ S,   B = [0; M⁻¹ S_known; 0]

    channels and units of the layout's channels, in its order; load_units: that of every load, by name.
    """
    own, n = placed.augmented, model.size
    s = own.scale
    wanted = placed.final.channel[placed.final.channel >= 0]
    rows = [int(np.flatnonzero(placed.pool.channel == channel)[0]) for channel in wanted]
    r = own.R[:, rows]
    known = [i for i, name in enumerate(model.inputs) if name not in own.state]
    B = np.zeros((len(own.state), len(known)))
    B[n : 2 * n] = np.linalg.solve(model.mass.at(model.reference), model.input_shape[:, known])
    loads = tuple(model.inputs[i] for i in known)
    return LinearModel(
        A=own.F * s[:, :, None] / s[:, None, :],
        B=B,
        C=own.H[:, rows] / s[:, None, :],
        Q=own.Q * s[:, :, None] * s[:, None, :],
        R=np.einsum("sm,mk->smk", r, np.eye(len(rows))),
        states=own.state,
        state_units=tuple(_unit(name, i, n) for i, name in enumerate(own.state)),
        loads=loads,
        load_units=tuple(load_units[name] for name in loads),
        channels=tuple(channels),
        channel_units=tuple(units),
    )


def mat_file(model: LinearModel) -> bytes:
    """A MAT file of version 5 without a date: arrays with the scenario last, names and units as cells of text."""
    from scipy.io import savemat  # which most runs need not load

    content = {
        **{name: np.moveaxis(getattr(model, name), 0, -1) for name in ("A", "C", "Q", "R")},
        "B": model.B,
        **{
            name: np.array(getattr(model, name), dtype=object).reshape(-1, 1)
            for name in ("states", "state_units", "loads", "load_units", "channels", "channel_units")
        },
        "about": "dx/dt = A(:,:,k) x + B u + w, y = C(:,:,k) x + v; Q, R: intensities of w, v; an unknown load over its "
        "amplitude, a parameter as ln(value/guess); B at the guess",
    }
    with TemporaryDirectory() as folder:
        file = Path(folder) / "model.mat"
        savemat(file, content, do_compression=True)
        found = file.read_bytes()
    return b"MATLAB 5.0 MAT-file, strainsight".ljust(HEADER) + found[HEADER:]


def _unit(name: str, place: int, n: int) -> str:
    if place < 2 * n:
        return "kg^1/2 m" if place < n else "kg^1/2 m/s"
    power = {"rate of": "1/s", "curvature of": "1/s^2"}
    return next((unit for words, unit in power.items() if name.startswith(words)), "1")

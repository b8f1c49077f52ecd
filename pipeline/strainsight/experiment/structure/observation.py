"""Observability of unknowns by the candidate pool (all cases of tables 6.1 and 6.2), and by the channels of a test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.decks.faults import plural
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.recorded import signal_of
from strainsight.experiment.structure.candidates import channels_of, largest_of_quantity, reading_sizes
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.references import characteristic
from strainsight.experiment.structure.start import loading_of, motion_of
from strainsight.experiment.system import Resources
from strainsight.fem.affine import DAMPING, of_stiffness
from strainsight.loads.histories import Sine, instant_values
from strainsight.loads.linearisation import linearisation_instants, linearise
from strainsight.loads.observability import cases, undetectable_directions, undetectable_in_words, unseen_along
from strainsight.records.placed import Observed, Placed
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.rom.model import ReducedModel

STEPS_A_PERIOD = 40
AT_ONCE = 1000
"""Instants linearised at a time."""
HEADER = 116
"""Text header of a MAT file [bytes], where scipy writes a date."""


def observed_of(
    config: PlacementConfig, reduced: Reduced, training: Training, screened: Screened, using: Resources
) -> Observed:
    """Observability of every combination of unknown loads, moduli and densities, for the training simulation and every
    frequency."""
    model, every = reduced.model, channels_of(training, screened)
    pool = np.flatnonzero(np.isin(every.gauge, screened.kept))
    amplitude = {}
    for name in model.inputs:
        signal = signal_of(name, config.loads[name].signal, using.files)
        amplitude[name] = characteristic(config.loads[name], signal, config.train.duration)[1]
    kinds = {name: config.parameters[name].property for name in model.parameters}
    sensed = every.sensed(pool)
    excitations, table = _excitations(config, model, training, amplitude), []
    for _, x, u in excitations:
        _, peak = reading_sizes(model, sensed.rows, sensed.quantity, x, u)
        with blame("observe"):
            case_table = cases(
                model,
                model.reference,
                x,
                u,
                inputs=tuple(name for name in model.inputs if not config.loads[name].known) or model.inputs,
                moduli=[name for name, kind in kinds.items() if of_stiffness(kind)],
                densities=[name for name, kind in kinds.items() if kind == "density"],
                damping=[name for name, kind in kinds.items() if kind == DAMPING],
                amplitude=amplitude,
                guess=model.reference,
                sensed=sensed,
                largest=largest_of_quantity(peak, sensed.quantity),
                instants=config.place.instants,
                seed=config.seed,
            )
        table.append(case_table)
    return Observed(
        excitation=tuple(label for label, _, _ in excitations),
        case=tuple(case.label for case in table[0]),
        unknowns=tuple(", ".join(case.unknowns) for case in table[0]),
        condition=np.array([[case.result.condition for case in row] for row in table]),
        condition_raw=np.array([[case.result.condition_raw for case in row] for row in table]),
        sigma_min=np.array([[case.result.sigma_min for case in row] for row in table]),
        lost=np.array([[case.reason or case.result.null_direction for case in row] for row in table], dtype=np.str_),
    )


def _excitations(
    config: PlacementConfig, model: ReducedModel, training: Training, amplitude: dict[str, float]
) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Label, motion x (s, 2n) = [q, q̇] and loads u (s, n_u) [N] for each excitation."""
    excitations = [
        (label, np.hstack([motion_of_case.coordinate, motion_of_case.velocity]), motion_of_case.load)
        for label, motion_of_case in zip(
            sorted(training.cases) or ["training simulation"], training.motions, strict=True
        )
    ]
    for frequency in config.observe.frequencies:
        duration = max(config.train.duration, 5 / frequency)
        steps = ceil(duration * STEPS_A_PERIOD * frequency)
        signals = [Sine(frequency, amplitude[name], 0.0) for name in model.inputs]
        loading = loading_of(config.train.settle, signals, duration / steps, steps)
        motion = motion_of(model, model.reference, loading)
        excitations.append((f"{frequency:g} Hz", motion, instant_values(loading.coefficients)))
    return excitations


def mat_file(
    placed: Placed, model: ReducedModel, channels: Sequence[str], units: Sequence[str], load_units: Mapping[str, str]
) -> bytes:
    """Write ẋ = A x + B u + w, y = C x + v, cov w = Q δ, cov v = R δ as a MAT file (version 5) without a date.

    Arrays have the s scenarios as last axis; names and units are text cells. With x* = S x̃, S = diag(scale):

        A = S F S⁻¹,   C = H S⁻¹,   Q = S Q̃ S,   B = [0; M⁻¹ S_known; 0]

    A (n, n, s) [1/s]; B (n, p): known loads, at the guess; C (m, n, s): channels of the layout; Q (n, n, s); R (m, m, s)
    [unit² s]. channels, units: of the layout's channels, in order; load_units: by load."""
    from scipy.io import savemat  # slow to import

    solved, n = placed.augmented, model.size
    scale = solved.scale
    wanted = placed.final.channel[placed.final.channel >= 0]
    rows = [int(np.flatnonzero(placed.pool.channel == channel)[0]) for channel in wanted]
    known = [i for i, name in enumerate(model.inputs) if name not in solved.state]
    B = np.zeros((len(solved.state), len(known)))
    B[n : 2 * n] = np.linalg.solve(model.mass.at(model.reference), model.input_shape[:, known])
    loads = [model.inputs[i] for i in known]
    arrays = {
        "A": solved.F * scale[:, :, None] / scale[:, None, :],
        "C": solved.H[:, rows] / scale[:, None, :],
        "Q": solved.Q * scale[:, :, None] * scale[:, None, :],
        "R": np.einsum("sm,mk->smk", solved.R[:, rows], np.eye(len(rows))),
    }
    words = {
        "states": solved.state,
        "state_units": [_unit(name, i, n) for i, name in enumerate(solved.state)],
        "loads": loads,
        "load_units": [load_units[name] for name in loads],
        "channels": channels,
        "channel_units": units,
    }
    content = {
        **{name: np.moveaxis(array, 0, -1) for name, array in arrays.items()},
        "B": B,
        **{name: np.array(tuple(texts), dtype=object).reshape(-1, 1) for name, texts in words.items()},
        "about": "dx/dt = A(:,:,k) x + B u + w, y = C(:,:,k) x + v; Q, R: intensities of w, v; an unknown load over its "
        "amplitude, a parameter as ln(value/guess); B at the guess",
    }
    with TemporaryDirectory() as folder:
        file = Path(folder) / "model.mat"
        savemat(file, content, do_compression=True)
        written = file.read_bytes()
    return b"MATLAB 5.0 MAT-file, strainsight".ljust(HEADER) + written[HEADER:]


def _unit(name: str, place: int, n: int) -> str:
    if place < 2 * n:
        return "kg^1/2 m" if place < n else "kg^1/2 m/s"
    power = {"rate of": "1/s", "curvature of": "1/s^2"}
    return next((unit for words, unit in power.items() if name.startswith(words)), "1")


def undetectable(problem: Problem, channels: np.ndarray, instants: int, seed: int, allowed: bool) -> str:
    """Name the unknowns that channels (k,) cannot determine at any instant of the training simulation; empty without any.

    Raises InfeasibleError if there are some and this is not allowed."""
    p, u = problem, instant_values(problem.u)
    at = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, instants, seed)
    if not any(undetectable_directions(F, H).shape[1] for F, H in zip(*_linearised(p, channels, at), strict=True)):
        return ""
    hidden = _hidden_along(p, channels)
    if not hidden.shape[1]:
        return ""
    words = undetectable_in_words(hidden, p.unknowns.state_names)
    if allowed:
        return words
    raise InfeasibleError(
        f"the {plural(len(channels), 'channel')} cannot determine {words}",
        key="estimate.channels",
        remedy="Add channels to estimate.channels, or use --allow-unobservable to estimate anyway.",
    )


def _linearised(problem: Problem, channels: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F* (s, n*, n*) and H* (s, m, n*) at some instants of the training simulation."""
    p = problem
    motion = p.model, p.unknowns, p.model.reference, p.x[at], instant_values(p.u)[at]
    F = linearise(*motion)
    return F, p.channels.sensed(channels).linearised(*motion, F)


def _hidden_along(problem: Problem, channels: np.ndarray) -> np.ndarray:
    """Unobservable directions (n*, d): of loads, the same at all instants, else of parameters along the whole run."""
    k, n = len(problem.unknowns.parameters), 2 * problem.model.size
    states = problem.unknowns.size(problem.model) - k
    driven, read = [], []
    for part in np.array_split(np.arange(len(problem.x)), -(-len(problem.x) // AT_ONCE)):
        F, H = _linearised(problem, channels, part)
        driven.append(F[:, :n, states:])
        read.append(H[:, :, states:])
    F, H = F[0, :states, :states], H[0, :, :states]
    alone = undetectable_directions(F, H)
    if alone.shape[1] or not k:
        return np.pad(alone, [(0, k), (0, 0)])
    inputs = problem.unknowns.position(problem.model)[: len(problem.unknowns.inputs)]
    motion = F[:n, :n], F[:n, inputs], H[:, :n], H[:, inputs]
    loads, parameters = unseen_along(*motion, np.concatenate(driven), np.concatenate(read), problem.h)
    hidden = np.zeros((states + k, parameters.shape[1]))
    hidden[inputs], hidden[states:] = loads, parameters
    return hidden

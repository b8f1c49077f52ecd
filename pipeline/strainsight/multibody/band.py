"""Up to which frequency of a load a time step follows what the load moves."""

from __future__ import annotations

import numpy as np

from strainsight.multibody.advance import CARRIED, GAMMA, INSTANTS, Method

SHARE = 0.01
"""Of the displacement in a mode, by which the step may be off."""
FINENESS = 2000
"""Frequencies that are tried."""


def followed(frequencies: np.ndarray, h: float, method: Method) -> float:
    """Frequency of a load [Hz] below which its displacement in every undamped mode of frequencies (k,) [Hz] is within SHARE of
    the exact one, in steps of h [s]; never above the first mode, beside which no share holds."""
    first = float(np.min(frequencies))
    tried = np.geomspace(1e-4, 1.0, FINENESS)[:-1] * min(first, 0.5 / h)
    off = np.max([relative_error(tried, float(own), h, method) for own in frequencies], axis=0)
    beyond = np.flatnonzero(off > SHARE)
    return float(tried[-1] if not len(beyond) else tried[max(beyond[0] - 1, 0)])


def missed(loads: np.ndarray, frequencies: np.ndarray, h: float, method: Method) -> np.ndarray:
    """Share (nu,) of the RMS of each load about its mean that the step gets wrong, 0 of a constant one:

        √(Σ e²|U|² / Σ |U|²),     e = min(1, error of the displacement in any mode),     U its spectrum in Hann's window

    loads (T + 1, nu) every h [N, N m]; frequencies (k,) [Hz] of the undamped modes.
    """
    count = len(loads)
    about = loads - loads.mean(axis=0)
    energy = np.abs(np.fft.rfft(about * np.hanning(count)[:, None], axis=0)[1:]) ** 2
    tried = np.fft.rfftfreq(count, h)[1:]
    # a load that a mode follows at its own frequency has no displacement to compare with
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.max([relative_error(tried, float(own), h, method) for own in frequencies], axis=0)
    off = np.minimum(np.nan_to_num(off, nan=1.0, posinf=1.0), 1.0)
    whole = energy.sum(axis=0)
    return np.sqrt(np.divide(off**2 @ energy, whole, out=np.zeros(loads.shape[1]), where=whole > 0))


def relative_error(load: np.ndarray, frequency: float, h: float, method: Method) -> np.ndarray:
    """|X_h(Ω)/X(Ω) − 1| of the displacement X = 1/(ω² − Ω²) of an undamped mode ω under a load of Ω, both in Hz:

        X_h = (Y(iω) − Y(−iω))/(2iω),     Y(s) = (b₀ + b₁E)/(E − R),   E = exp(iΩh),   ẏ = s y + f   in steps with
        R = (1 − c) r + c r²,   b₁ = b (1 + γ c r),   b₀ = (1 − γ) c r b,   r = 1/(1 − γsh),   b = γh r,   c = (1 − γ)/γ

    and of implicit Euler R = r, b₁ = b, b₀ = 0 with γ = 1. load (k,) [Hz]; h [s].
    """
    omega, E = 2 * np.pi * frequency, np.exp(2j * np.pi * load * h)
    own = INSTANTS[method][0] * h

    def response(s: complex) -> np.ndarray:
        r = 1 / (1 - own * s)
        b = own * r
        if method == "thesis":
            return np.asarray(b * E / (E - r))
        R = (1 - CARRIED) * r + CARRIED * r * r
        return np.asarray(((1 - GAMMA) * CARRIED * r * b + b * (1 + GAMMA * CARRIED * r) * E) / (E - R))

    found = (response(1j * omega) - response(-1j * omega)) / (2j * omega)
    return np.asarray(np.abs(found * (omega**2 - (2 * np.pi * load) ** 2) - 1))

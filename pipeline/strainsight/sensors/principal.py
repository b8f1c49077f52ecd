"""The direction of each place along which the training run strains most."""

from __future__ import annotations

import numpy as np

ROSETTE = (0.0, 45.0, 90.0)
"""Angles from any tangent [deg] whose strains give those of every direction."""
SAMPLES = 64
ALIKE = 1e-6
"""Directions whose mean squares are this share of the largest apart are alike; rounding is 1e-10 of it. Degrees this near to
half a turn are none."""


def principal_angles(rows: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Angle (f,) [deg], −90 ≤ φ < 90, at which the mean square of ε(φ) over the run is largest, from 0°, 45° and 90°:

        ε(φ) = a + b cos 2φ + c sin 2φ,     a = ½(ε₀ + ε₉₀),  b = ½(ε₀ − ε₉₀),  c = ε₄₅ − a
        f(ψ) = M_aa + 2 M_ab cos ψ + 2 M_ac sin ψ + M_bb cos² ψ + M_cc sin² ψ + 2 M_bc sin ψ cos ψ,     ψ = 2φ

    M (3, 3) is the mean of [a b c]ᵀ[a b c]. f has two maxima at most; the larger of 64 samples is refined by Newton's
    method. Of samples alike the first is taken, and where all directions strain alike it is 0°.
    rows (f, 3, r) strain of gauges at 0°, 45° and 90° from any tangent, per coordinate; moment (r, r) mean of q qᵀ over the
    run.
    """
    zero, half, right = np.moveaxis(np.asarray(rows, dtype=float), 1, 0)
    mean = 0.5 * (zero + right)
    parts = np.stack([mean, 0.5 * (zero - right), half - mean], axis=1)
    M = parts @ moment @ np.swapaxes(parts, 1, 2)
    psi = np.linspace(0.0, 2 * np.pi, SAMPLES, endpoint=False)
    basis = np.stack([np.ones(SAMPLES), np.cos(psi), np.sin(psi)])
    f = np.einsum("ap,fab,bp->fp", basis, M, basis)
    size = np.maximum(np.abs(f).max(axis=1), np.finfo(float).tiny)
    # Rounding must not choose between directions that are alike.
    x = psi[np.argmax(f >= (f.max(axis=1) - ALIKE * size)[:, None], axis=1)]
    moves = np.ptp(f, axis=1) > ALIKE * size
    p, q, r, s = 2 * M[:, 0, 2], -2 * M[:, 0, 1], 2 * M[:, 1, 2], M[:, 2, 2] - M[:, 1, 1]
    for _ in range(20):
        slope = p * np.cos(x) + q * np.sin(x) + r * np.cos(2 * x) + s * np.sin(2 * x)
        bend = -p * np.sin(x) + q * np.cos(x) - 2 * r * np.sin(2 * x) + 2 * s * np.cos(2 * x)
        # Uphill where the curve is not yet that of a maximum; never past the neighbouring samples.
        step = np.where(bend < -1e-12 * size, -slope / np.where(bend < 0, bend, -1.0), np.sign(slope) * 0.01)
        step = np.where(moves & (np.abs(slope) > 1e-14 * size), step, 0.0)
        x = x + np.clip(step, -np.pi / SAMPLES, np.pi / SAMPLES)
    turn = (np.rad2deg(x / 2) + 90.0) % 180.0
    return np.where(turn > 180.0 - ALIKE, 0.0, turn) - 90.0

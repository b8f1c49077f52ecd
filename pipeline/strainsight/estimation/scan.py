"""Grids of parameter values that are fine enough for the resonances of the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.estimation.bank_filters import BankRecord
from strainsight.estimation.lattice import Lattice
from strainsight.rom.model import modal_basis

PER_WIDTH = 2.0
"""Grid points per width of a resonance."""
MOST_SCANNED = 200
"""Points of a grid; where resonances ask for more, it is as coarse as this allows."""
GRID = 3
"""Most parameters of a grid; of more, values are tried along each axis alone."""


def resonance_widths(records: Sequence[BankRecord]) -> np.ndarray:
    """Change of each parameter p = ln(θ/guess) (k,) that moves some resonance by its width, the least over modes and records:

        Δpᵢ = 2 max(ζω, 1/T) / |∂ω/∂pᵢ|,     ∂ω/∂pᵢ = θᵢ φᵀ(∂K/∂θᵢ − ω² ∂M/∂θᵢ) φ / 2ω

    at the guess, of modes below half the sampling rate; at most 2, of a mode that hardly moves. A record of length T resolves no
    more than 1/T. Farther apart than that, likelihoods of two values have hardly anything to do with each other.
    """
    model = records[0].model
    rom, names, h = model.model, model.unknowns.parameters, min(own.model.h * own.model.every for own in records)
    theta = {**model.fixed, **{name: float(model.unknowns.guess[name]) for name in names}}
    lam, phi = modal_basis(rom, theta)
    omega = np.sqrt(np.maximum(lam, 0.0))
    longest = max(own.steps * own.model.h for own in records)
    rate = np.maximum(0.5 * rom.damping.at(theta).viscous(lam)[0], 1 / longest)
    seen = (omega > 0) & (omega * h < np.pi)
    width = np.full(len(names), 2.0)
    for i, name in enumerate(names):
        dK, dM = rom.stiffness.derivative(name, theta), rom.mass.derivative(name, theta)
        slope = np.einsum("am,abm,bm->m", phi, dK[:, :, None] - lam * dM[:, :, None], phi)
        moved = theta[name] * np.abs(slope[seen]) / (2 * omega[seen])
        width[i] = np.min(2 * rate[seen] / np.maximum(moved, rate[seen]), initial=2.0)
    return width


def scan_lattice(mean: np.ndarray, covariance: np.ndarray, width: np.ndarray, radius: float) -> Lattice:
    """Points within `radius` standard deviations of a prior, mean (k,) and covariance (k, k): PER_WIDTH of them per `width` (k,)
    along each parameter as far as MOST_SCANNED allows, and at least one per standard deviation."""
    k, std = len(mean), np.sqrt(np.diag(covariance))
    share = np.minimum(1.0, width / (PER_WIDTH * std))
    if k > GRID:
        share = np.minimum(1.0, np.maximum(share, 2 * k * radius / MOST_SCANNED))
        count = (radius / share).astype(int)
        lines = [np.outer(np.arange(-n, n + 1), unit) for n, unit in zip(count, np.eye(k, dtype=int), strict=True)]
        return Lattice(mean, np.diag(share * std), np.unique(np.concatenate(lines), axis=0))
    while (whole := float(np.prod(2 * radius / share + 1))) > MOST_SCANNED and np.any(share < 1.0):
        share = np.minimum(1.0, share * 1.01 * (whole / MOST_SCANNED) ** (1 / k))
    factor = np.linalg.cholesky(covariance)
    node = np.indices([2 * int(radius / own) + 1 for own in share]).reshape(k, -1).T
    node -= (radius / share).astype(int)
    frame = share[:, None] * factor
    inside = np.sum(np.linalg.solve(factor, frame @ node.T) ** 2, axis=0) <= radius**2
    return Lattice(mean, frame, node[inside])

"""Most likely parameters of a record and its evidence, by Laplace's approximation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.grid_filter_points import GridProblem, filter_points, linearise_about_samples
from strainsight.estimation.parameter_grid import ParameterGrid, one_point, scattered_points
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import LOST
from strainsight.rom.model import modal_basis

Density = Callable[..., np.ndarray]
"""Points (B, k) and number of steps (default all) → ln of the posterior density (B,)."""

RADIUS, DEPTH = 3.5, 10.0
"""Scanned range in prior standard deviations, and depth below the largest density of points that are still tried."""
PARTS = 1 / 64, 1 / 16, 1 / 4
"""Increasing shares of the record by which scanned points are compared first."""
FEWEST, MOST_STARTS, RISE = 6, 3, 3.0
"""Fewest points after each part; most refined peaks; and how much a peak may exceed its grid point relative to another."""
ROUNDS = 15
"""Most Newton steps; without convergence the model cannot explain the record."""
SETTLED = 0.2
"""Step in posterior standard deviations below which Newton's method has converged."""
FLATTEST = 1e-12
"""Least relevant curvature, in units of the prior's."""


AGAIN, NOTICED = 4, 0.1
"""Most relinearisations in the damping for a settled motion, and the change of ln p below which they stop."""
PER_WIDTH = 2.0
"""Grid points per width of a resonance."""
MOST_SCANNED = 200
"""Most grid points; the grid is coarser if resonances need more."""
GRID = 3
"""Most parameters of a full grid; more parameters are scanned along each axis."""


@dataclass(frozen=True)
class PosteriorPeak:
    """Maximum of the posterior: point (k,), density ln p(y, point) there, and evidence ln p(y). about: ν about which readings
    are linear, as in `ConsideredParameters`; None if unchanged."""

    point: np.ndarray
    evidence: float
    density: float
    about: np.ndarray | None = None


def find_peak(record: GridRecord) -> PosteriorPeak:
    """The most likely parameters of a record, and its evidence:

        ln p(y) ≈ ln p(y, p̂) + ½ ln det Σ − ½ ln det P₀,     Σ⁻¹ = −∂² ln p(y, p)/∂p² at its largest value p̂

    p(y | p) by a filter at p, tolerances integrated out: a scan of the prior, as fine as resonances are wide, then Newton's
    method on differences over a σ of the posterior, in 1 + 2k + k(k − 1)/2 filters a round. A settled motion is far from linear
    in the damping: the search is done again, linear about the most likely damping."""
    problem = GridProblem((record,), along=False)
    peak = _best(find_peaks(problem))
    if record.settled is None or not problem.bilinear:
        return peak
    for _ in range(AGAIN):
        here = filter_points(problem, one_point(peak.point), problem.first[-1])
        again = linearise_about_samples(problem, peak.point, here.nu[0])
        if again is problem:
            break
        problem, before = again, peak.evidence
        refined = _refine(density_of(problem), *problem.prior, peak.point, resonance_widths(problem.records) / 8)
        peak = replace(refined, about=problem.records[0].considered.about)
        if abs(peak.evidence - before) <= NOTICED:
            break
    return peak


def find_common_peak(records: Sequence[GridRecord]) -> PosteriorPeak:
    """The same for records with common parameters and ν, as in `filter_records`."""
    return _best(find_peaks(GridProblem(tuple(records), along=False)))


def _best(peaks: Sequence[PosteriorPeak]) -> PosteriorPeak:
    return max(peaks, key=lambda peak: peak.evidence)


def find_peaks(problem: GridProblem) -> list[PosteriorPeak]:
    """Maximum of the posterior at the end of all records, and other tried peaks."""
    centre, prior = problem.prior
    if not len(centre):
        value = float(density_of(problem)(centre[None])[0])
        return [PosteriorPeak(centre, value, value)]
    scanned = problem if problem.directions is not None else problem.reduced_at(centre)
    grid = build_scan_grid(centre, prior, resonance_widths(problem.records), RADIUS)
    starts = _scan(grid, density_of(scanned), problem.first[-1])
    peaks: list[PosteriorPeak] = []
    for start, value in starts:
        # a peak stands as far above its grid point as the first one, or a few times as far
        if not peaks or value + RISE * (peaks[0].density - starts[0][1]) + DEPTH >= max(peak.density for peak in peaks):
            peaks.append(_refine(density_of(problem.reduced_at(start)), centre, prior, start, 0.5 * grid.step))
    return peaks


def density_of(problem: GridProblem) -> Density:
    """Posterior density of the parameters, by filters from the start of the first record."""

    def density(point: np.ndarray, steps: int = problem.first[-1]) -> np.ndarray:
        value = filter_points(problem, scattered_points(point), steps).log_weight
        return np.where(np.isfinite(value), value, -np.finfo(float).max)

    return density


def find_hills(grid: ParameterGrid, density: Density, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the grid points with no higher neighbour, and their log-density, highest first. Increasing parts of the record
    are compared, and after each the best quarter and all points within DEPTH of the best remain. From the hills of these, the
    whole record is climbed to the next higher neighbour."""
    which, part_value, neighbour = np.arange(len(grid.node)), np.full(len(grid.node), -np.inf), grid.neighbour
    for part in PARTS:
        value = density(grid.point[which], max(1, round(part * steps)))
        order = np.argsort(-value, kind="stable")
        order = order[: max(FEWEST, len(order) // 4, int(np.sum(value > value.max() - DEPTH)))]
        which, value = which[order], value[order]
    part_value[which] = value

    def around(points: Sequence[int]) -> list[int]:
        return [int(i) for i in np.unique(neighbour[points]) if i >= 0]

    here = [i for i in which.tolist() if part_value[i] >= part_value[around([i])].max(initial=-np.inf)]
    whole: dict[int, float] = {}
    while True:
        new = [i for i in {*here, *around(here)} if i not in whole]
        whole |= dict(zip(new, density(grid.point[new]).tolist(), strict=True)) if new else {}
        after = [max([i, *around([i])], key=whole.__getitem__) for i in here]
        if after == here:
            break
        here = list(dict.fromkeys(after))
    here.sort(key=whole.__getitem__, reverse=True)
    return np.array(here), np.array([whole[i] for i in here])


def _scan(grid: ParameterGrid, density: Density, steps: int) -> list[tuple[np.ndarray, float]]:
    """At most MOST_STARTS highest hills (k,) of a grid that are not neighbours, with their log-density, highest first."""
    which, value = find_hills(grid, density, steps)
    starts: list[int] = []
    for i, node in enumerate(grid.node[which]):
        if all(np.abs(node - grid.node[which[j]]).max() > 1 for j in starts):
            starts.append(i)
    return [(grid.point[which[i]], float(value[i])) for i in starts[:MOST_STARTS]]


def _refine(
    density: Density, centre: np.ndarray, prior: np.ndarray, start: np.ndarray, step: np.ndarray
) -> PosteriorPeak:
    """Newton's method from a point (k,), with differences over `step` (k,) initially. Downhill moves are rejected, and no move
    leaves a stencil that brackets the maximum."""
    k = len(centre)
    pairs = [(i, j) for i in range(k) for j in range(i)]
    offsets = np.vstack([np.zeros(k), np.eye(k), -np.eye(k), *[(np.eye(k)[i] + np.eye(k)[j])[None] for i, j in pairs]])
    at, best, highest = start, start, -np.inf
    hessian = -np.linalg.inv(prior)
    for _ in range(ROUNDS):
        tried = np.clip(at + step * offsets, centre - LOST, centre + LOST)
        value = density(tried)
        if value[0] < highest:
            at, step = best, 0.25 * step
            continue
        top = int(np.argmax(value))
        best, highest = tried[top], float(value[top])
        up, down = value[1 : k + 1], value[k + 1 : 2 * k + 1]
        slope, curve = (up - down) / 2, up + down - 2 * value[0]
        scaled = np.diag(curve)
        for both, (i, j) in zip(value[2 * k + 1 :], pairs, strict=True):
            scaled[i, j] = scaled[j, i] = both - up[i] - up[j] + value[0]
        size, axes = np.linalg.eigh(-scaled)
        if size[0] <= FLATTEST * np.max(np.abs(value[0]), initial=1.0):
            at, step = best, (1.5 if top else 0.5) * step
            continue
        move = axes @ ((axes.T @ slope) / size)
        spread = step * np.sqrt(np.diag(axes @ np.diag(1 / size) @ axes.T))
        hessian = scaled / np.outer(step, step)
        near = np.all(np.abs(step * move) <= SETTLED * spread) and np.all(np.abs(np.log(step / spread)) < np.log(4.0))
        move *= min(1.0, (4.0 if top else 1.0) / max(float(np.abs(move).max()), 1e-300))
        at = np.clip(at + step * move, centre - LOST, centre + LOST)
        if near:
            best, highest = at, float(value[0] + 0.5 * slope @ move)
            break
        step = np.clip(spread, 0.05 * step, 4.0 * step)
    sign, logdet = np.linalg.slogdet(-hessian)
    wide = -logdet if sign > 0 else 0.0
    return PosteriorPeak(best, highest + 0.5 * wide - 0.5 * float(np.linalg.slogdet(prior)[1]), highest)


def resonance_widths(records: Sequence[GridRecord]) -> np.ndarray:
    """Change of each parameter p = ln(θ/guess) (k,) that moves some resonance by its width, the least over modes and records:

        Δpᵢ = 2 max(ζω, 1/T) / |∂ω/∂pᵢ|,     ∂ω/∂pᵢ = θᵢ φᵀ(∂K/∂θᵢ − ω² ∂M/∂θᵢ) φ / 2ω

    at the guess, of modes below half the sampling rate; at most 2, of a mode that hardly moves. A record of length T resolves no
    more than 1/T. Farther apart than that, likelihoods of two values have hardly anything to do with each other."""
    model = records[0].model
    rom, names, h = (
        model.model,
        model.unknowns.parameters,
        min(record.model.h * record.model.every for record in records),
    )
    theta = {**model.fixed, **{name: float(model.unknowns.guess[name]) for name in names}}
    lam, phi = modal_basis(rom, theta)
    omega = np.sqrt(np.maximum(lam, 0.0))
    longest = max(record.steps * record.model.h for record in records)
    rate = np.maximum(0.5 * rom.damping.at(theta).viscous(lam)[0], 1 / longest)
    resolved = (omega > 0) & (omega * h < np.pi)
    width = np.full(len(names), 2.0)
    for i, name in enumerate(names):
        dK, dM = rom.stiffness.derivative(name, theta), rom.mass.derivative(name, theta)
        slope = np.einsum("am,abm,bm->m", phi, dK[:, :, None] - lam * dM[:, :, None], phi)
        moved = theta[name] * np.abs(slope[resolved]) / (2 * omega[resolved])
        width[i] = np.min(2 * rate[resolved] / np.maximum(moved, rate[resolved]), initial=2.0)
    return width


def build_scan_grid(mean: np.ndarray, covariance: np.ndarray, width: np.ndarray, radius: float) -> ParameterGrid:
    """Points within `radius` standard deviations of a prior, mean (k,) and covariance (k, k): PER_WIDTH of them per `width` (k,)
    along each parameter as far as MOST_SCANNED allows, and at least one per standard deviation."""
    k, std = len(mean), np.sqrt(np.diag(covariance))
    share = np.minimum(1.0, width / (PER_WIDTH * std))
    if k > GRID:
        share = np.minimum(1.0, np.maximum(share, 2 * k * radius / MOST_SCANNED))
        count = (radius / share).astype(int)
        lines = [np.outer(np.arange(-n, n + 1), unit) for n, unit in zip(count, np.eye(k, dtype=int), strict=True)]
        return ParameterGrid(mean, np.diag(share * std), np.unique(np.concatenate(lines), axis=0))
    while (whole := float(np.prod(2 * radius / share + 1))) > MOST_SCANNED and np.any(share < 1.0):
        share = np.minimum(1.0, share * 1.01 * (whole / MOST_SCANNED) ** (1 / k))
    factor = np.linalg.cholesky(covariance)
    node = np.indices([2 * int(radius / part) + 1 for part in share]).reshape(k, -1).T
    node -= (radius / share).astype(int)
    frame = share[:, None] * factor
    inside = np.sum(np.linalg.solve(factor, frame @ node.T) ** 2, axis=0) <= radius**2
    return ParameterGrid(mean, frame, node[inside])

"""place: gauges leave one by one by the steady error covariance, exchanges, a bound on what any layout could reach (5.3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.augmentation.linearisation import augment_rows, linearisation_instants, linearise
from strainsight.augmentation.noise import gauge_intensity
from strainsight.augmentation.observability import Observability, observability
from strainsight.errors import blame
from strainsight.estimation.filter import covariance_recursion
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.elimination import Scenario, eliminate, whole_pool_weight
from strainsight.placement.recommendation import alike, worth_keeping
from strainsight.placement.scenario import thesis_weight
from strainsight.placement.score import score
from strainsight.rom.model import modal_basis
from strainsight.signals.histories import instant_values
from strainsight.stages.case.layout import layout_of
from strainsight.stages.case.problem import Problem, filter_model, initial_covariance, problem_of
from strainsight.stages.records.placement import (
    advice_table,
    augmented_datasets,
    certificate_datasets,
    expected_dataset,
    gauge_csv,
    gauge_table,
    place_message,
    placed_grid,
    selection_datasets,
)
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Linearise along the training run, eliminate, exchange, certify, and say what the layout is expected to know."""
    settings = context.config.place
    candidate = context.upstream["screen"]["/kept"]
    problem = problem_of(context)
    names = problem.unknowns.names
    with blame("place.estimate"):
        scenarios = scenarios_of(problem, candidate, settings.instants, settings.weights, context.seed)
    context.progress("elimination", 0.0)
    with blame("place.keep"):
        result = eliminate(scenarios, settings.keep, settings.aggregate, names=names)
        layout = layout_of(result.pools, result.kept, settings, context.progress)
    greedy, final, swapped, certificate = result.kept, layout.gauges, layout.exchange, layout.certificate
    sets = _baselines(problem, candidate, settings.keep, context.seed)
    std, without = expected_std(problem, candidate[final])
    order = np.argsort(-_importance(without, std), kind="stable")
    final, loss = final[order], layout.loss[order]
    without = {name: values[order] for name, values in without.items()}
    context.progress("observability", 0.9)
    train = context.upstream["train"]
    condition = _observability(problem, scenarios[0], float(np.abs(train["/strain"][:, candidate]).max()))
    grid, grid_attributes = placed_grid(final, result.removed, candidate, train)
    return Output(
        datasets=grid
        | augmented_datasets(result)
        | selection_datasets("greedy", greedy, candidate, train)
        | selection_datasets("final", final, candidate, train)
        | {f"/expected_std/{name}": expected_dataset(problem, name, std) for name in names}
        | {
            f"/without/{name}": Dataset(
                without[name], "1", f"relative σ of {name} expected without each gauge of the final set"
            )
            for name in names
        }
        | {
            "/failure/loss": Dataset(
                loss, "1", "tr(W P) when each gauge of the final set fails; inf where an unknown is then lost"
            ),
            "/pool/candidate": Dataset(candidate, "1", "row of train.h5 of every pool gauge"),
            "/elimination/removed": Dataset(result.removed, "1", "pool gauges in the order of their removal"),
            "/elimination/trace": Dataset(result.trace, "1", "tr(W P), the full pool first"),
            "/elimination/rise": Dataset(result.rise, "1", "rise of tr(W P) at every removal, with all its digits"),
            "/elimination/unknowns": Dataset(
                np.array(names, dtype=np.str_), "1", "name of every unknown, inputs first"
            ),
            "/elimination/blocks": Dataset(
                result.blocks, "1", "the same by unknown (step × unknown)", ("", "/elimination/unknowns")
            ),
            "/elimination/solves": Dataset(result.solves, "1", "exact Riccati solves of every removal"),
            "/riccati/residual": Dataset(
                np.array(result.residual), "1", "largest relative residual of the elimination's Riccati solutions"
            ),
            "/observability/condition": Dataset(
                np.array(condition.condition), "1", "condition of the scaled PBH matrix at λ = 0"
            ),
            "/observability/sigma_min": Dataset(np.array(condition.sigma_min), "1", "its smallest singular value"),
            "/observability/condition_raw": Dataset(
                np.array(condition.condition_raw), "1", "the thesis's number, which orders cases by their units"
            ),
        }
        | {
            f"/baseline/{name}": Dataset(
                np.array(score(result.pools, gauges, settings.aggregate)), "1", f"tr(W P) of the set by {name}"
            )
            for name, gauges in sets.items()
        }
        | certificate_datasets(certificate),
        attributes=grid_attributes
        | {"/augmented": {"aggregate": settings.aggregate}}
        | {
            f"/expected_std/{name}": {"scale": float(scale)}
            for name, scale in zip(names, problem.unknowns.scale, strict=True)
        },
        summary={
            "pool": len(candidate),
            "selected": len(final),
            "trace_initial": float(result.trace[0]),
            "trace_greedy": float(result.trace[-1]),
            "trace_final": float(layout.trace),
            "worst_failure": float(loss.max()),
            "riccati_residual": float(result.residual),
            "riccati_solves": int(result.solves.sum()),
            "condition": condition.condition,
            "worth": worth_keeping(result.trace, settings.keep),
            "ties": sum(1 for tied in result.ties if tied),
        }
        | ({"exchanges": len(swapped.swaps), "exchange_complete": swapped.complete} if swapped else {})
        | ({"proven": layout.proof.proven, "nodes": layout.proof.nodes} if layout.proof else {})
        | ({"lower_bound": certificate.lower_bound, "gap": certificate.gap} if certificate else {})
        | {f"std.{name}": float(std[name]) for name in names}
        | ({"null_direction": condition.null_direction} if condition.null_direction else {}),
        message=place_message(len(candidate), len(final), certificate, std, condition),
        tables=(
            gauge_table(final, candidate, train, without),
            advice_table(result.trace, settings.keep, alike(_scaled_rows(problem, candidate[final]))),
        ),
        files={"gauges.csv": gauge_csv(final, candidate, train, without)},
    )


RANDOM_SETS = 10
"""Random sets of the pool, scored beside the other rules."""

SILENT = 1e12
"""Factor on a gauge's noise intensity that makes it say nothing."""


def scenarios_of(
    problem: Problem, candidate: np.ndarray, instants: int, weights: str, seed: int
) -> tuple[Scenario, ...]:
    """One frozen linearisation an instant, with the weight that lets every unknown start at 1 (or the thesis's plain trace)."""
    p = problem
    u = instant_values(p.u)
    # One instant is the thesis's case: any of them, also where a parameter hardly acts.
    share = 0.0 if instants == 1 else 0.5
    chosen = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, instants, seed, share)
    F = linearise(p.model, p.unknowns, p.model.reference, p.x[chosen], u[chosen])
    H = augment_rows(p.rows[candidate], p.unknowns)
    r = gauge_intensity(np.full(len(H), p.noise_std), p.h)
    plain = tuple(Scenario(f, p.Q, H, r, np.zeros(len(f))) for f in F)
    if weights == "thesis":
        weight = thesis_weight(len(F[0]), p.unknowns.scale)
    else:
        weight = whole_pool_weight(plain, p.unknowns.count, p.unknowns.names)
    return tuple(Scenario(s.F, s.Q, s.H, s.r, weight) for s in plain)


def expected_std(problem: Problem, gauges: np.ndarray) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """σ of every unknown, relative to its scale, along the training run from a 100 % prior: RMS over its last half.

    gauges (k,) candidates. Returns name → σ with all of them, and name → (k,) σ without each of them in turn; a gauge that
    is left out has its noise raised until it says nothing.
    """
    k = len(gauges)
    silent = np.ones((k + 1, k))
    silent[1:][np.eye(k, dtype=bool)] = SILENT
    model = filter_model(problem, np.broadcast_to(gauges, (k + 1, k)), problem.h)
    model = replace(model, r=model.r * silent)
    start = initial_covariance(problem, dict.fromkeys(problem.unknowns.names, 1.0))
    std = covariance_recursion(model, problem.x, problem.u, start)
    late = std[len(std) // 2 :, :, 2 * problem.model.size :]
    level = np.sqrt(np.mean(late**2, axis=0))
    names = problem.unknowns.names
    return (
        {name: float(level[0, i]) for i, name in enumerate(names)},
        {name: level[1:, i] for i, name in enumerate(names)},
    )


def _importance(without: Mapping[str, np.ndarray], std: Mapping[str, float]) -> np.ndarray:
    """How much σ grows without each gauge, summed over the unknowns (k,): the most missed gauge is G1."""
    return np.asarray(sum(values / std[name] for name, values in without.items()))


def _scaled_rows(problem: Problem, gauges: np.ndarray) -> np.ndarray:
    """Rows (k, n) on coordinates that are uncorrelated and of unit size in the training run: R L with L Lᵀ = cov(q)."""
    values, V = np.linalg.eigh(np.cov(problem.x[:, : problem.model.size], rowvar=False))
    return np.asarray(problem.rows[gauges] @ (V * np.sqrt(np.maximum(values, 0.0))))


def _baselines(problem: Problem, candidate: np.ndarray, keep: int, seed: int) -> dict[str, np.ndarray]:
    """Sets of the same size by other rules, in pool rows."""
    n = problem.model.size
    rows = problem.rows[candidate]
    prior = np.cov(problem.x[:, :n], rowvar=False)
    sets = {
        "effective_independence": effective_independence(rows, keep),
        "qr_pivoting": qr_pivoting(rows, keep),
        "d_optimal": d_optimal(rows, np.full(len(rows), problem.noise_std**2), prior, keep),
    }
    return sets | {
        f"random_{i}": gauges for i, gauges in enumerate(random_sets(len(candidate), keep, RANDOM_SETS, seed), start=1)
    }


def _observability(problem: Problem, scenario: Scenario, largest_strain: float) -> Observability:
    p, n = problem, problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    return observability(
        scenario.F,
        scenario.H,
        names=p.unknowns.names,
        frequency=frequency,
        state_amplitude=amplitude,
        largest_strain=largest_strain,
        raw_scale=p.unknowns.scale,
    )


PLACE = Stage(
    "place",
    version=2,
    reads=(
        "seed",
        "loads.*.signal",
        "loads.*.process_noise",
        "parameters.*.process_noise_scale",
        "process_noise",
        "train",
        "place",
    ),
    upstream=("rom", "train", "screen"),
    files=("loads.*.signal.file",),
    run=run,
)

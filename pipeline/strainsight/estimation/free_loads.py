"""Filters with free loads, by which parameters are weighted. An unknown load is modelled as a random walk, which no real load
is. The likelihood of the configured walk depends on the size of the readings, and biases parameters on which that size
depends. Therefore the walk is free enough to follow a line in the spectrum. What the gauge noise alone adds to the likelihood
on average is subtracted at each point: of the parameters by a filter of the loads alone (`advance_free_loads`), of ν by
`noise_alone`.
Source: Francke, Koopman and de Vos, J. Time Series Analysis 31 (2010)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import linear_models, none_considered, tune_frequencies
from strainsight.estimation.noise_bias import NoiseBias
from strainsight.estimation.parallel_filters import Data, Filters, LinearModels, Passage, advance, build_filters
from strainsight.estimation.record import GridRecord, start_filters

SLIGHT = 1e-3
"""Change of ln R for finite differences."""


@dataclass(frozen=True)
class FreeLoadFilters:
    """Filters with free loads at the grid points, by which the points are weighted. alone: model of the loads alone, without
    ν and channel offsets; louder, quieter: its filters with a noise SLIGHT larger and smaller than that of the gauges; share
    (B, j): weights of the nodes of `GridRecord.noise_bias`."""

    models: LinearModels
    filters: Filters
    alone: LinearModels
    louder: Filters
    quieter: Filters
    share: np.ndarray


def build_free_load_filters(record: GridRecord, load_models: LinearModels, point: np.ndarray) -> FreeLoadFilters:
    """Filters at points (B, k) before the first step of a record; load_models: models with the configured loads."""
    (free, alone), (mean, covariance) = record.free, record.start
    loads = np.zeros(len(mean), dtype=bool)
    loads[free.input_states] = True
    models = record.with_free_loads(load_models)
    alone = tune_frequencies(alone, record.considered, point)[0]
    of_loads = linear_models(alone, point, none_considered(free), record.biased)
    start = np.zeros((len(point), len(mean))), np.where(np.outer(loads, loads), covariance, 0.0)
    return FreeLoadFilters(
        models,
        build_filters(models, *start_filters(free, models, mean, covariance, None)),
        of_loads,
        louder=build_filters(of_loads, *start, np.zeros((len(point), 0, len(mean)))),
        quieter=build_filters(of_loads, *start, np.zeros((len(point), 0, len(mean)))),
        share=record.bias_shares(point),
    )


def advance_free_loads(
    free_load: FreeLoadFilters, data: Data, biases: Sequence[NoiseBias], span: slice, keep: bool
) -> Passage:
    """Advance the filters, and return their passage with the fit by which the points are weighted. biases: of the record, at
    its steps `span`; other arguments as in `advance`.

    For noise v alone, with S the covariance of all readings of the loads alone, E ln p(v) = −½ ln|S| − ½ tr(R S⁻¹) up to a
    constant. tr(R S⁻¹) is the slope of ln|S| in ln R, from zero readings at R e^{±δ}."""
    at_nodes = np.stack([bias.row[bias.step[span]] for bias in biases])
    if free_load.models.directions is not None:
        at_nodes = at_nodes @ free_load.models.directions
    less = np.tensordot(free_load.share, at_nodes, 1)
    passage = advance(free_load.models, free_load.filters, data, keep, states=False, less=less)
    loads = np.zeros((len(data.known_end), free_load.alone.F.shape[-1]))
    quiet = replace(data, known=0 * data.known, known_end=loads, samples=np.where(np.isnan(data.samples), np.nan, 0.0))

    def alone(filters: Filters, factor: float) -> np.ndarray:
        return advance(free_load.alone, filters, replace(quiet, noise=factor * data.noise), False).fit

    louder, quieter = alone(free_load.louder, np.exp(SLIGHT)), alone(free_load.quieter, np.exp(-SLIGHT))
    return replace(passage, fit=passage.fit - 0.5 * (louder + quieter) - (louder - quieter) / (2 * SLIGHT))

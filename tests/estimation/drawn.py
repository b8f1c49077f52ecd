"""A filter model with its prior, and measurements that are drawn from them."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.draws import draw_truth


def prior(model, std=0.1):
    P = np.zeros((model.size, model.size))
    unknown = range(2 * model.model.size, model.size)
    P[unknown, unknown] = std**2
    return P


def drawn(make_filter, beam, sine, inputs, parameters, steps=60, runs=3, **options):
    """A model with its prior, known load and measurements of its own."""
    known = () if inputs else ("tip",)
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=known, **options)
    u = sine(model.h * np.arange(steps), model.h, 1e4, 20.0)[:, :, : len(known)]
    mean, P = np.zeros(model.size), prior(model)
    truth, y = draw_truth(model, mean, P, u, range(runs))
    return model, mean, P, u, truth, y

"""The small beam under tolerances: what drawn truths of it are off by, beside the σ that is claimed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.experiment.structure.considered import tolerated
from strainsight.experiment.structure.problem import filter_model, problem_of, sample_std
from strainsight.experiment.structure.trial import sample_noise, trial_of
from strainsight.experiment.structure.truth import truth_of

from ..edges.beam import bricks, prepared

NOTHING = {"position": 0, "angle": 0, "gain": 0, "common_gain": 0, "transverse": 0, "damping": 1, "frequency": 0, "load_mass": 0,
           "discrepancy": 0, "load_angle": 0, "load_position": 0, "load_gain": 0}  # fmt: skip


def beam_in(folder, kind="hex8"):
    """Changes of the small beam's config → its case up to four gauges of its pool, made once."""

    def made(changes):
        own = prepared(folder, bricks((6, 2, 2), kind), changes)
        own.problem = problem_of(own.structure, own.screened)
        own.gauges = own.screened.kept[:4]
        own.channels = own.problem.channels.of(own.gauges)[:, 0]
        own.tolerated = tolerated(own.structure, own.channels)
        return own

    return made


def trial(own):
    truth = truth_of(own.structure, None, own.problem, own.case)
    return trial_of(own.case.config, own.problem, truth, own.tolerated, own.gauges)


def filtered(own, found, realisation):
    """Error and σ of every unknown in time, of the truth of one realisation with noise."""
    model, reading = filter_model(own.problem, found.chosen, found.h), found.again(realisation)
    noise = sample_noise(7, realisation, len(reading) - 1, reading.shape[1])
    measured = reading[1:] + noise * sample_std(own.problem, found.chosen, found.h)
    run = found.filtered(model, found.chosen, measured).run
    (name,), at = own.problem.unknowns.names, model.position[0]
    if name in own.problem.unknowns.parameters:
        true = np.log(found.history[name] / own.problem.unknowns.guess[name])
        late = slice(-1, None)
    else:
        true, late = found.history[name] / model.amplitude[0], slice(len(run.mean) // 4, None)
    return (run.mean[:, 0, at] - true)[late], run.std[late, 0, at]


def spread(own, draws, tolerances=None):
    """Of draws of truths: share within 2σ, RMS error over RMS σ, and RMS σ."""
    found = trial(own)
    if tolerances is not None:
        found = replace(found, tolerated=tolerances)
    error, std = (np.array(values) for values in zip(*(filtered(own, found, r) for r in range(1, draws + 1)), strict=True))
    level = np.sqrt(np.mean(std**2))
    return np.mean(np.abs(error) < 2 * std), np.sqrt(np.mean(error**2)) / level, level

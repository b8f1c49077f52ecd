"""Masses of sensors and fixtures: in the model by the config, and as a tolerance of frequencies and unknown loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from strainsight import api
from strainsight.errors import ConfigError
from strainsight.experiment.structure import tolerated_masses
from strainsight.experiment.structure.problem import filter_model, sample_std
from strainsight.experiment.structure.reduction import full_model
from strainsight.experiment.structure.references import parameters_of
from strainsight.experiment.structure.start import loading_of, motion_of
from strainsight.experiment.structure.tolerated_masses import sensor_masses_in_words
from strainsight.experiment.structure.truth import model_of
from strainsight.fem.mass import mass_properties
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import ACCELERATION

from ..edges.beam import TIP, E
from .drawn_truths import NOTHING, beam_in, trial

OF_A_LOAD = {
    "loads.tip.known": False,
    "loads.tip.process_noise": {"model": "oscillator"},
    "parameters.E.guess": E,
    "place.estimate": ["tip"],
    "validate.initial_std": {"tip": 0.5},
    "validate.duration": 0.5,
}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return beam_in(tmp_path_factory.mktemp("beam"))


def test_point_mass_of_the_config_has_the_eigenfrequency_of_a_mass_added_to_the_matrix(beam):
    plain = beam({"tolerances": "none"})
    added = beam({"tolerances": "none", "mesh.point_masses": {"sensor": {"node": TIP, "mass": 3.0}}})
    assert mass_properties(added.mesh)[0] == pytest.approx(mass_properties(plain.mesh)[0] + 3.0, rel=1e-12)
    parameters = parameters_of(plain.case.config.parameters, plain.mesh, {})
    model, theta = full_model(plain.case.config.mesh, plain.mesh, parameters, {}).model, plain.reduced.model.reference
    node = plain.mesh.node_index(TIP)
    motion = model.constraint.transform[3 * node : 3 * node + 3]
    M = model.mass.at(theta) + 3.0 * motion.T @ motion
    lam = eigsh(model.stiffness.at(theta), 3, M, sigma=0, return_eigenvectors=False)
    np.testing.assert_allclose(added.reduced.frequency[:3], np.sort(np.sqrt(lam)) / (2 * np.pi), rtol=1e-7)
    assert added.reduced.frequency[0] < 0.97 * plain.reduced.frequency[0]


def test_mass_on_a_set_is_shared_equally_by_its_nodes(beam):
    own = beam({"mesh.faces": {"end": {"normal": [1, 0, 0]}}, "mesh.point_masses": {"plate": {"set": "end", "mass": 2.0}}})
    masses = np.array([point.mass for point in own.mesh.point_masses])
    assert len(masses) == 9
    np.testing.assert_allclose(masses, 2.0 / 9, rtol=1e-12)


def test_point_mass_needs_a_place_and_no_imported_model(beam):
    with pytest.raises(ConfigError, match="node"):
        beam({"mesh.point_masses": {"sensor": {"mass": 3.0}}})


def test_uncertain_point_mass_changes_every_frequency_like_the_mass_itself(beam):
    """d ln ω of Rayleigh against eigenvalues of M ± dm, dm the mass in three directions: 2e-3 of the largest, the curvature."""
    std = 0.126
    own = beam({"tolerances": NOTHING, "mesh.point_masses": {"sensor": {"node": TIP, "mass": 0, "std": std}}})
    rows, model = own.tolerated.frequency, own.reduced.model
    assert own.tolerated.masses == len(rows) == 1
    s = own.reduced.basis.reshape(-1, 3, model.size)[own.mesh.node_index(TIP)].T
    K, M = (each.at(model.reference) for each in (model.stiffness, model.mass))
    ends = [np.log(eigh(K, M + sign * std * s @ s.T, eigvals_only=True)) / 2 for sign in (1, -1)]
    np.testing.assert_allclose(rows[0], (ends[0] - ends[1]) / 2, atol=2e-3 * np.abs(rows).max())
    assert own.tolerated.frequency.min() < -1e-3


def test_estimate_of_an_unknown_load_is_off_by_the_inertia_that_its_sigma_contains(beam):
    """A truth with a mass of exactly one σ at the load, all else exact: RMS error over RMS σ is 1 to 3 %, and without the
    tolerance more than five."""
    std = 0.5
    own = beam(OF_A_LOAD | {"tolerances": NOTHING | {"load_mass": std}, "gauges.noise_std": {"relative_to_strongest": 1e-5}})
    found = trial(own)
    s = own.reduced.model.input_shape
    mass = own.reduced.model.mass
    heavy = replace(mass, constant=mass.constant + std * mass_properties(own.mesh)[0] * s @ s.T)
    exact = replace(own.problem, model=replace(own.problem.model, mass=heavy))
    reading = simulated(own, found, exact)
    model = filter_model(own.problem, found.chosen, found.h)
    noise = np.random.default_rng(1).standard_normal(reading.shape) * sample_std(own.problem, found.chosen, found.h)
    at, late = model.position[0], slice(len(reading) // 4, None)

    def ratio(trial):
        run = trial.filtered(model, found.chosen, reading + noise).run
        error = run.mean[1:, 0, at] - found.history["tip"][1:] / model.amplitude[0]
        return np.sqrt(np.mean(error[late] ** 2) / np.mean(run.std[1:, 0, at][late] ** 2))

    assert ratio(found) == pytest.approx(1.0, rel=0.03)
    assert ratio(replace(found, tolerated=replace(own.tolerated, load_mass=np.zeros(1)))) > 5


def simulated(own, found, problem):
    """Readings (T, k) of the layout by a reduced model, under the loads of a trial from rest."""
    run = own.problem.run
    loading = loading_of(run.settle, list(run.signals.values()), found.h, len(found.time) - 1)
    x = motion_of(problem.model, problem.model.reference, loading)
    return x[1:, : problem.model.size] @ own.training.rows[found.chosen].T


def test_expected_sigma_of_an_unknown_load_has_mass_as_a_source(beam):
    """Between zero and 1 % of the mass, the variance grows by that of its source alone."""
    plain, own = (beam(OF_A_LOAD | {"tolerances": NOTHING | {"load_mass": std}}) for std in (0, 0.01))
    found, less = (
        api.expect(one.case, one.mesh, one.reduced, one.training, one.screened, own.gauges) for one in (own, plain)
    )
    part = found.budget["tip"]["mass"] * found.std["tip"] ** 2
    assert part == pytest.approx(found.std["tip"] ** 2 - less.std["tip"] ** 2, rel=1e-6)
    assert "mass" not in less.budget["tip"]


def test_two_unknown_forces_at_a_node_lack_one_mass_that_moves_in_three_directions(beam):
    """Frequencies of the reduced model with the mass against those of a mesh with a point mass there: 1e-4."""
    signal = {"type": "sine", "frequency": 15.0, "amplitude": 500.0}
    side = {"node": TIP, "direction": [0, 1, 0], "known": False, "signal": signal}
    unknown = {"place.estimate": ["tip", "side"], "validate.initial_std": {"tip": 0.5, "side": 0.5}, "loads.side": side}
    own = beam(OF_A_LOAD | unknown | {"tolerances": NOTHING | {"load_mass": 0.02}})
    mass = {"node": TIP, "mass": 0.02 * mass_properties(own.mesh)[0]}
    added = beam(OF_A_LOAD | {"tolerances": "none", "mesh.point_masses": {"cell": mass}})
    model = own.reduced.model
    K, M = (each.at(model.reference) for each in (model.stiffness, model.mass))
    heavy = np.sqrt(eigh(K, M + own.tolerated.lacking, eigvals_only=True)[:3]) / (2 * np.pi)
    np.testing.assert_allclose(heavy, added.reduced.frequency[:3], rtol=1e-4)
    assert heavy[0] < 0.99 * own.reduced.frequency[0]


def test_simulated_test_samples_the_mass_at_an_unknown_force(beam):
    own = beam(OF_A_LOAD | {"tolerances": NOTHING | {"load_mass": 0.01}})
    model, s = own.reduced.model, np.ones((own.reduced.model.size, 1))
    base = model.mass.at(model.reference)
    drawn = [(model_of(own.case.config, model, r, (s,)).mass.at(model.reference) - base)[0, 0] for r in range(1, 400)]
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(1.0, abs=0.1)
    assert min(drawn) >= 0
    truth = trial(own)
    assert "mass at each unknown force 1 %" in truth.truth.description
    assert np.ptp([truth.again(r)[-1, 0] for r in (1, 2, 3)]) > 0
    assert modal_basis(model, model.reference)[0][0] > 0


ACCELEROMETER = {"quantity": "acceleration", "axes": [[0, 0, 1]], "every": 0.2, "noise_std": {"value": 0.5}}
SENSORS = {"motion_sensors": {"acc": ACCELEROMETER}}


def test_accelerometers_without_mass_are_reported_if_they_change_the_first_frequency(beam, monkeypatch):
    """2 kg at each of the candidates along z: the fall of the first frequency is that of eigenvalues, to 5 %."""
    mass = 2.0
    own = beam({"tolerances": NOTHING | {"frequency": 0.01}} | SENSORS)
    pool, model = own.training.candidates, own.reduced.model
    channels = np.flatnonzero(pool.quantity == ACCELERATION)[-1:]
    assert sensor_masses_in_words(own.structure, channels) == ""
    monkeypatch.setattr(tolerated_masses, "TYPICAL_MASS", mass)
    said = sensor_masses_in_words(own.structure, channels)
    K, M = (each.at(model.reference) for each in (model.stiffness, model.mass))
    s = own.training.rows[channels].T
    heavy, light = (eigh(K, m, eigvals_only=True)[0] for m in (M + mass * s @ s.T, M))
    assert "masses of the 1 accelerometers: with 2000 g each, mode 1 falls by" in said
    assert float(said.split("falls by ")[1].split(" %")[0]) / 100 == pytest.approx(1 - np.sqrt(heavy / light), rel=0.08)
    known = beam({"tolerances": NOTHING, "mesh.point_masses": {"acc": {"node": TIP, "mass": 0.01}}} | SENSORS)
    assert sensor_masses_in_words(known.structure, channels) == ""

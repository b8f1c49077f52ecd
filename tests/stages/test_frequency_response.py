"""Frequency response functions of a layout: against the full matrices, the influence matrix and the oscillator of one mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.experiment.structure.influence import frequency_response_of, frequency_response_table
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.sensors.strain_operator import channel_rows

from ..edges.beam import TIP, E, bricks, placed, prepared

ALPHA, BETA = 5.0, 2e-5
LOADS = {
    name: {"node": TIP, "direction": direction, "known": True, "signal": {"type": "sine", "frequency": 20.0, "amplitude": 1e3}}
    for name, direction in (("across", [0.0, 1.0, 0.0]), ("down", [0.0, 0.0, 1.0]))
}
RAYLEIGH = {"loads": LOADS, "damping": {"type": "rayleigh", "alpha": ALPHA, "beta": BETA}, "rom.modes": 10}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A prepared beam with two loads, and its placement."""
    own = prepared(tmp_path_factory.mktemp("frf"), bricks((8, 2, 2), "hex20"), RAYLEIGH)
    return own, placed(own)


def test_response_is_that_of_the_full_matrices(beam):
    """K + iω(αM + βK) − ω²M of all degrees of freedom, up to half the last mode, to 0.1 % of the static strain; for two loads."""
    own, layout = beam
    found = layout.frequency_response
    mesh = replace(own.mesh, materials={1: replace(own.mesh.materials[1], youngs_modulus=0.9 * E)})
    model = build_model(mesh)
    K, M = model.stiffness.constant.tocsc(), model.mass.constant.tocsc()
    S = input_shape(model, [PointLoad(name, node_id=TIP, direction=tuple(load["direction"])) for name, load in LOADS.items()])
    grids = own.training.candidates.take(own.training.candidates.channels(layout.gauges))
    last = found.natural.max()
    some = np.unique(np.append(np.arange(0, len(found.frequency), 15), np.searchsorted(found.frequency, found.natural)))
    some = some[found.frequency[some] < 0.5 * last]
    assert np.sum(found.natural < 0.5 * last) >= 3
    for k in some:
        omega = 2 * np.pi * found.frequency[k]
        Z = spsolve(K + 1j * omega * (ALPHA * M + BETA * K) - omega**2 * M, S.astype(complex))
        H = sum(unit * channel_rows(mesh.position, grids, nodal(model, part)) for unit, part in ((1, Z.real), (1j, Z.imag)))
        of_model = found.magnitude[k] * np.exp(1j * found.phase[k])
        np.testing.assert_allclose(of_model, H, rtol=1e-3, atol=1e-3 * found.magnitude[0].max())


def test_response_at_zero_is_the_influence_matrix(beam):
    layout = beam[1]
    found = layout.frequency_response
    assert (found.frequency[0], found.load) == (0.0, ("across", "down"))
    np.testing.assert_allclose(found.magnitude[0] * np.cos(found.phase[0]), layout.influence.reading, rtol=1e-9)
    low = found.magnitude[1]  # at a tenth of the first mode: 1/(1 − 0.01)
    np.testing.assert_allclose(low, found.magnitude[0], rtol=0.02)


def test_each_load_excites_the_bending_modes_in_its_plane(beam):
    """Bending frequencies of a clamped beam are as the depths 0.1 and 0.08; the table has static and excited rows only."""
    found = beam[1].frequency_response
    across, down = (found.natural[found.excited[:, i]] for i in range(2))
    assert across[0] / down[0] == pytest.approx(0.1 / 0.08, rel=0.02)
    assert not {*across} & {*down}
    for i, natural in enumerate((across, down)):
        near = np.abs(found.frequency - natural[0]) < 0.2 * natural[0]
        peak = found.frequency[near][np.argmax(found.magnitude[near, :, i].max(axis=1))]
        assert peak == pytest.approx(natural[0], rel=0.01)
    table = frequency_response_table(found)
    assert (table.name, len(table.rows)) == ("FRF", 2 + len(across) + len(down))
    row = table.rows[1]
    first = 1e9 * found.magnitude[np.searchsorted(found.frequency, across[0]), :, 0]  # µm/m per kN
    assert (row[0], row[2]) == ("across", "µm/m per kN")
    np.testing.assert_allclose([float(cell) for cell in row[3:]], first, rtol=1e-3)


def test_quasi_static_and_undamped_models_have_no_response(beam):
    own, layout = beam
    channels = own.training.candidates.channels(layout.gauges)
    case, model = own.structure, own.reduced.model

    def response(structure):
        return frequency_response_of(structure, layout.listed, channels)

    assert response(case) is not None
    static = case.config.model_copy(update={"train": case.config.train.model_copy(update={"model": "static"})})
    assert response(replace(case, config=static)) is None
    undamped = replace(own.reduced, model=replace(model, damping=replace(model.damping, alpha=0.0, beta=0.0)))
    assert response(replace(case, reduced=undamped)) is None
    # a load that excites nothing but the static residual
    shape = np.where(np.arange(model.size) < 10, 0.0, 1.0)[:, None] * model.input_shape
    assert response(replace(case, reduced=replace(own.reduced, model=replace(model, input_shape=shape)))) is None

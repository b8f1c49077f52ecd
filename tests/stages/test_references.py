"""What a config refers to is asked for at `import`, before anything that takes time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from strainsight.cases.structure.references import on_one_node
from strainsight.config.loads import Load
from strainsight.errors import UserError

from ..edges.beam import TIP, bricks, finished
from ..fem.test_thin import straight
from ..mesh.test_shell_faces import plate, strip

GAUGES = {"direction": {"type": "axis", "axis": [1, 0, 0], "angles": [0.0]}, "noise_std": {"relative_to_strongest": 0.01}}
SENSOR = {"quantity": "displacement", "noise_std": {"value": 1e-6}, "surface": "lid"}
MODULUS = {"property": "youngs_modulus", "region": 1, "guess": 210000.0, "range": [1.8e5, 2.2e5]}


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"loads.tip.node": 99999}, "loads.tip", "node 99999, which is not there"),
        ({"loads.tip.node": None, "loads.tip.set": "tipp"}, "loads.tip", "node set 'tipp', which is not there"),
        ({"parameters.E.guess": {"from": "other"}, "parameters.E.region": 7}, "parameters.E.region", "no region 7"),
        ({"parameters.E.region": 7}, "parameters.E.region", "no region 7"),
        ({"parameters": {"E": MODULUS}, "validate.truth.parameters": {"E": 2e5}}, "parameters.E.guess", "210000 MPa are 2.1e"),
        ({"gauges": GAUGES | {"surface": "lid"}}, "gauges.surface", "the set 'lid' is not in the mesh"),
        ({"gauges": GAUGES | {"exclude": [{"near_set": {"set": "rim", "distance": 0.1}}]}}, "gauges.exclude.0", "'rim'"),
        ({"motion_sensors": {"laser": SENSOR}}, "motion_sensors.laser.surface", "the set 'lid' is not in the mesh"),
    ],
)
def test_what_is_not_in_the_mesh_is_named_at_once(tmp_path, changes, key, what):
    with pytest.raises(UserError, match=what) as caught:
        finished(tmp_path, "import", bricks((4, 2, 2)), changes)
    assert caught.value.key == key


def test_a_force_on_one_node_of_a_solid_is_warned_of_and_one_on_a_tie_is_not(tmp_path):
    solid = finished(tmp_path / "solid", "import", bricks((4, 2, 2), tip=False), {"loads.tip.node": 45})
    assert any("loads.tip acts on node 45 of a solid alone" in text for text in solid["import"].warnings)
    tie = finished(tmp_path / "tie", "import", bricks((4, 2, 2)), {"loads.tip.node": TIP})
    assert not any("acts on node" in text for text in tie["import"].warnings)


def test_so_is_one_on_a_node_of_shells_and_none_on_one_that_a_beam_ends_at():
    push = Load(
        node=100, direction=(0.0, 0.0, 1.0), known=True, signal={"type": "sine", "frequency": 1.0, "amplitude": 1.0}
    )
    mesh = plate(*strip())
    assert "acts on node 100 of a shell alone" in on_one_node({"push": push}, mesh)[0]
    beam = straight(1).beams[0]
    assert not on_one_node({"push": push}, replace(mesh, beams=(beam,)))


def test_runs_that_differ_in_their_loads_alone_share_the_modes(tmp_path):
    """The mesh is what `import` writes; that it looks at loads too changes nothing in it."""
    one = finished(tmp_path / "one", "modes", bricks((4, 2, 2)), {})
    other = finished(tmp_path / "other", "modes", bricks((4, 2, 2)), {"loads.tip.direction": [1, 0, 0]})
    assert one["import"].digest == other["import"].digest
    assert one["modes"].key == other["modes"].key

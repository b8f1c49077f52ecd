"""A deck that names nothing: faces of the config hold it, load it and carry its gauges, as sets of the deck would."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import ConfigError, UserError

from ..edges.beam import bricks, finished
from ..shared import strains

FACES = {"root": {"near": [0, 0.05, 0.04]}, "end": {"normal": [1, 0, 0]}, "top": {"near": [0.5, 0.05, 0.08]}}
LOAD = {"known": True, "direction": [0, 0, 1], "signal": {"type": "sine", "frequency": 20.0, "amplitude": 1000.0}}


def unheld() -> str:
    """The beam without its SPC1 card."""
    lines = bricks((8, 2, 2), "hex20", tip=False).replace("SPC = 1\n", "").splitlines()
    kept, skip = [], False
    for line in lines:
        skip = line.startswith("SPC1") or (skip and line.startswith(","))
        kept += [] if skip else [line]
    return "\n".join([*kept, ""])


def changes(faces: bool) -> dict:
    own = {"loads": {"tip": {**LOAD, "set": "end"}}, "mesh.faces": FACES if faces else {"end": FACES["end"]}}
    own |= {"screen.keep": "all", "screen.minimum_spacing": 0.0, "gauges.clearance": "none"}
    own["gauges.exclude"] = [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}]
    return own | ({"mesh.supports": [{"set": "root"}], "gauges.surface": "top"} if faces else {})


def test_a_face_holds_loads_and_carries_gauges(tmp_path):
    of_deck = finished(tmp_path / "deck", "train", bricks((8, 2, 2), "hex20", tip=False), changes(False))
    of_faces = finished(tmp_path / "faces", "train", unheld(), changes(True))
    np.testing.assert_array_equal(of_faces["import"]["/constraints/fixed"], of_deck["import"]["/constraints/fixed"])
    np.testing.assert_array_equal(of_faces["modes"]["/frequency"], of_deck["modes"]["/frequency"])
    on_top = of_deck["train"]["/gauges/position"][:, 2] > 0.08 - 1e-9
    np.testing.assert_array_equal(strains(of_faces["train"]), strains(of_deck["train"])[:, on_top])


def test_the_import_lists_six_faces_of_a_beam_and_the_names_that_stand_for_three(tmp_path):
    found = finished(tmp_path, "import", unheld(), changes(True))["import"]
    np.testing.assert_allclose(found["/faces/found/area"], [0.1, 0.1, 0.08, 0.08, 0.008, 0.008], rtol=1e-12)
    assert found["/faces/named/name"].astype(str).tolist() == ["end", "root", "top"]  # yaml sorts them
    assert found["/faces/named/facets_offset"].tolist() == [0, 4, 8, 24]


def test_a_name_that_the_deck_has_is_refused(tmp_path):
    text = unheld().replace("ENDDATA", "SET1,7,1,THRU,4\nENDDATA")
    with pytest.raises(UserError, match="the mesh has a set 'SET1-7'") as caught:
        finished(tmp_path, "import", text, {"mesh.faces": {"SET1-7": {"near": [0, 0.05, 0.04]}}})
    assert caught.value.key == "mesh.faces.SET1-7"


@pytest.mark.parametrize(
    ("load", "key", "what"),
    [
        ({"node": 1, "pressure": True}, "loads.tip.pressure", "acts on a face"),
        ({"set": "end", "pressure": True, "bearing": [0, 0, 1]}, "loads.tip.pressure", "a load with 'bearing', too"),
        ({"set": "end", "bearing": [0, 0, 0]}, "loads.tip.bearing", "length zero"),
        ({"set": "end", "pressure": True, "direction": [0, 0, 1]}, "loads.tip.direction", "a pressure acts inward"),
        ({"set": "end"}, "loads.tip.direction", "missing"),
    ],
)
def test_what_presses_has_one_kind_and_a_face(tmp_path, load, key, what):
    own = {name: value for name, value in LOAD.items() if name != "direction"}
    with pytest.raises(ConfigError, match=what) as caught:
        finished(tmp_path, "import", unheld(), changes(True) | {"loads": {"tip": own | load}})
    assert key in str(caught.value)


def test_an_unknown_pressure_is_placed_for_in_pascal_and_a_known_pin_beside_it(tmp_path):
    own = changes(True) | {
        "mesh.faces": FACES | {"below": {"near": [0.5, 0.05, 0.0]}},
        "loads": {
            "press": {"known": False, "set": "below", "pressure": True, "signal": LOAD["signal"] | {"amplitude": 2e5}},
            "pin": {"known": True, "set": "end", "bearing": [-1, 0, 0], "signal": LOAD["signal"]},
        },
        "parameters": {},
        "place.estimate": ["press"],
        "tolerances": "none",
        "validate": {"truth": {"model": "modes"}, "time_step": 0.001, "duration": 0.1, "repeats": 1, "random_sets": 0},
    }
    own["validate"] |= {"noise_factors": [], "initial_std": {"press": 1.0}}
    found = finished(tmp_path, "validate", unheld(), own)
    own = found["validate"]
    assert own.attributes("/estimate/press")["units"] == "Pa"
    truth, mean, std = (own[f"/{name}/press"].ravel() for name in ("truth", "smoothed", "smoothed_std"))
    assert np.abs(truth).max() == pytest.approx(2e5, rel=0.05)
    assert np.all(np.abs(mean - truth)[10:] < 4 * std[10:])

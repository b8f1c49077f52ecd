"""Joints, forces and sensors between frames: the frames they name, and whether each can be built from its keys."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import get_args

import pytest

from strainsight.config.bench.bench import Sensor
from strainsight.config.bench.connections import Force, Joint
from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.multibody.joints import JOINTS
from strainsight.multibody.laws.kinds import LAWS

FULL = Path(__file__).parents[2] / "configs" / "bench-full.yaml"
LOADS = "direction: [0, 0, 1], signal: {type: constant, value: 1.0}"
PAIR = "frames: [flange, root]"
DRIVE = "drive: {signal: {type: constant, value: 1.0}}"
EXAMPLES = {
    "joints": {
        **dict.fromkeys(("spherical", "revolute", "prismatic", "cylindrical", "universal", "pin", "fixed"), PAIR),
        "coincidence": f"{PAIR}, components: [x]",
        "perpendicular": f"{PAIR}, axis: x, to: z",
        "distance": f"{PAIR}, length: 1.0",
        "generic": f"{PAIR}, held: [x, about_y]",
        **dict.fromkeys(("driven_angle", "driven_displacement", "driven_distance"), f"{PAIR}, {DRIVE}"),
    },
    "forces": {
        "gravity": "acceleration: [0, 0, -9.81]",
        "spring": f"{PAIR}, stiffness: 1.0",
        "torsion": f"{PAIR}, stiffness: 1.0",
        "bushing": f"{PAIR}, stiffness: [1, 1, 1, 0, 0, 0]",
        "friction": f"{PAIR}, coulomb: 1.0",
        **dict.fromkeys(("torque", "actuator"), f"{PAIR}, signal: {{type: constant, value: 1.0}}"),
        "force": f"frame: root, {LOADS}",
        "moment": f"frame: root, {LOADS}",
        "bearing": "bearing: pitch-bearing, outer: flange, inner: root",
    },
    "sensors": {
        "strain": "body: hub, layout: place",
        "relative": PAIR, "motion": "frame: root", "acceleration": "frame: root", "reaction": "joint: pitch",
    },
}
"""Section → kind → the keys of a valid entry on bench-full."""
UNIONS = {"joints": Joint, "forces": Force, "sensors": Sensor}


def kinds(section):
    """Kind → model."""
    members = get_args(get_args(UNIONS[section])[0])
    return {get_args(model.model_fields["type"].annotation)[0]: model for model in members}


def entry(section, kind, **changed):
    keys = EXAMPLES[section][kind]
    for old, new in changed.items():
        keys = keys.replace(old, new)
    return f"{section}.extra={{type: {kind}, {keys}}}"


def test_there_is_an_example_of_every_kind():
    for section, examples in EXAMPLES.items():
        assert examples.keys() == kinds(section).keys()


@pytest.mark.parametrize(("section", "kind"), [(section, kind) for section in EXAMPLES for kind in EXAMPLES[section]])
@pytest.mark.parametrize("name", ["flange", "root"])
def test_a_frame_that_is_not_there_is_refused_by_every_kind_that_names_it(section, kind, name):
    load = (FULL, [entry(section, kind)]) if kind != "strain" else (FULL, [])
    load_config(*load)
    if name not in EXAMPLES[section][kind]:
        return
    with pytest.raises(ConfigError) as caught:
        load_config(FULL, [entry(section, kind, **{name: f"{name}s"})])
    assert not caught.value.others
    assert caught.value.key.startswith(f"{section}.extra.")
    assert f"no frame '{name}s'" in caught.value.what
    assert f"did you mean {name}?" in str(caught.value)


@pytest.mark.parametrize(
    ("section", "kind"), [(section, kind) for section in EXAMPLES for kind in EXAMPLES[section] if kind != "strain"]
)
def test_two_frames_of_one_body_are_refused_by_every_kind_that_names_two(section, kind):
    if "flange" not in EXAMPLES[section][kind]:
        return
    with pytest.raises(ConfigError, match="both frames are on 'blade'") as caught:
        load_config(FULL, [entry(section, kind, flange="station")])
    assert caught.value.key == f"{section}.extra" + ("" if kind == "bearing" else ".frames")


@pytest.mark.parametrize(
    ("override", "key", "says"),
    [
        ("frames.far={body: blades}", "frames.far.body", "did you mean blade?"),
        ("forces.bearing.bearing=pitch", "forces.bearing.bearing", "did you mean pitch-bearing?"),
        ("sensors.gauges.body=blade", "sensors.gauges.body", "no flexible body 'blade'"),
        ("field={body: blade}", "field.body", "no flexible body 'blade'"),
    ],
)
def test_what_is_named_has_to_be_there_and_of_its_kind(override, key, says):
    with pytest.raises(ConfigError) as caught:
        load_config(FULL, [override])
    assert caught.value.key == key
    assert says in str(caught.value)


@pytest.mark.parametrize(("section", "table"), [("joints", JOINTS), ("forces", LAWS)])
def test_every_joint_and_law_of_the_kernel_is_reached_with_the_keys_it_wants(section, table):
    """A section has a key for every argument of its function, of the same name, and besides no other than a history."""
    models = kinds(section)
    others = {"joints": set(), "forces": {"gravity", "force", "moment", "bearing"}}[section]
    assert models.keys() == table.keys() | others
    for kind, build in table.items():
        name, first, second, *own = inspect.signature(build).parameters
        assert (name, first, second) == ("name", "i", "j")
        assert models[kind].model_fields.keys() - {"drive", "signal"} == {"type", "frames", *own}

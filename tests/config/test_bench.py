"""Benches: connections and estimates of their configs."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import get_args

import pytest
from pydantic import ValidationError

from strainsight.config.bench.bench import Sensor
from strainsight.config.bench.connections import Force, Joint
from strainsight.config.estimate import ClockSection
from strainsight.config.load import load_config
from strainsight.errors import ConfigError, UserError
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.joints import JOINTS
from strainsight.multibody.laws import LAWS

FULL = Path(__file__).parents[2] / "configs" / "bench-full.yaml"
RADII = ("radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right")
OF_THE_BEARING = "bearings.pitch-bearing"
SMALL = ", ".join(f"{radius}: 0.0053" for radius in RADII)
SECOND = (
    f"bearings.spare={{balls: 20, ball_diameter: 0.01, pitch_diameter: 0.2, contact_angle: 45, {SMALL}}}"  # of 10 mm
)


def refused(*overrides: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        load_config(FULL, overrides)
    assert not caught.value.others
    assert caught.value.where
    return caught.value


REFUSED = [
    # (overrides, key at fault, words of the message)
    (["bodies.hub.moduli.constant={region: 1, value: 1.7e+11}"], "bodies.hub.moduli.constant", ("is reserved",)),
    (["cases.weight.bearing=pitch-baering"], "cases.weight.bearing", ("did you mean pitch-bearing?",)),
    (["cases.weight.bearing=[]"], "cases.weight.bearing", ()),
    (["curves=[{along: x, reach: 1.0e-4, bearing: [pitch]}]"], "curves[0].bearing", ("did you mean pitch-bearing?",)),
    ([SECOND, "curves=[{along: x, reach: 0.05}]"], "curves[0].reach", ("balls of 'spare'", "diameter of 0.01 m")),
    (["bodies.blade.mass=1.0e+30"], "bodies.blade.mass", ("radius of gyration of 1.6",)),
    (["bodies.blade.mass=1.0e-30"], "bodies.blade.mass", ("1e-30 kg and moments of inertia",)),
    (["bodies.dust={type: rigid, mass: 1.0e-10, inertia: {xx: 1.0e-10, yy: 1.0e-10, zz: 1.0e-10}}"],
     "bodies.dust.mass", ("1e-10 kg and the mass of 'blade', 14000 kg",)),
    (["frames.far={body: blades}"], "frames.far.body", ("did you mean blade?",)),
    (["forces.bearing.bearing=pitch"], "forces.bearing.bearing", ("did you mean pitch-bearing?",)),
    (["sensors.gauges.body=blade"], "sensors.gauges.body", ("no flexible body has the name 'blade'",)),
    (["field={body: blade}"], "field.body", ("no flexible body has the name 'blade'",)),
    *(
        ([f"{OF_THE_BEARING}.preload={preload!r}"], f"{OF_THE_BEARING}.preload", (says,))
        for preload, says in ((-1.0, "-1 m exceeds ±0.0012 m, 2 %"), (0.0013, "exceeds"), (1e300, "exceeds"))
    ),
    *(
        ([f"curves=[{{along: x, reach: 1.0e-4}}, {{along: {along}, reach: {reach!r}}}]"], "curves[1].reach", says)
        for along, reach, says in (
            ("x", 0.0601, ("up to 0.0601 m, more than the ball diameter of 0.06 m", "use at most 0.06 m")),
            ("tilt_y", 0.06, ("moves the balls of ", "by up to 0.069 m", "use at most 0.05217 rad")),
            ("z", 5e-11, ("numerical resolution", "6e-11 m")),
            ("tilt_z", 1e-300, ("numerical resolution", "rad")),
            ("y", 1e300, ("1e+300 m moves the balls",)),
        )
    ),
]  # fmt: skip


@pytest.mark.parametrize(("overrides", "key", "says"), REFUSED)
def test_invalid_bench_is_refused_with_key(overrides, key, says):
    error = refused(*overrides)
    assert error.key.startswith(key)
    assert all(text in str(error) for text in says)


def test_unusual_but_valid_bench_is_accepted():
    """A case of one bearing or several, a curve within the bearing that it names, a heavy body with moments to match."""
    for chosen in ("null", "spare", "[spare]", "[pitch-bearing, spare]"):
        load_config(FULL, [SECOND, f"cases.weight.bearing={chosen}"])
    load_config(FULL, [SECOND, "curves=[{along: x, reach: 0.05, bearing: pitch-bearing}]"])
    load_config(FULL, ["bodies.blade.mass=1.0e+30", "bodies.blade.inertia={xx: 1.0e+30, yy: 1.0e+30, zz: 1.0e+30}"])


@pytest.mark.parametrize("radius", [0.0299, 0.0304, 0.0306])
@pytest.mark.parametrize("preload", [0.0, 5e-4])
def test_config_and_kernel_refuse_the_same_grooves(radius, preload):
    """The rule is written twice because a config knows no kernel; this holds the two together."""
    data = load_config(FULL).data["bearings"]["pitch-bearing"]
    own = {key: value for key, value in data.items() if key != "pressure_limit"}
    values = own | {"radius_outer_left": radius, "preload": preload, "contact_angle": 0.7}
    try:
        Bearing(**values)
        passes = True
    except UserError:
        passes = False
    overrides = [f"{OF_THE_BEARING}.radius_outer_left={radius!r}", f"{OF_THE_BEARING}.preload={preload!r}"]
    if passes:
        load_config(FULL, overrides)
    else:
        key = "radius_outer_left" if radius <= 0.03 else "preload"
        assert refused(*overrides).key == f"{OF_THE_BEARING}.{key}"


@pytest.mark.parametrize(
    ("entry", "key", "says"),
    [
        ("E: {guess: 187, std: 20}", "E.guess", "187 Pa"),
        ("E: {guess: 1.87e11, std: 1.7e10, starts: [153]}", "E.starts", "153 Pa"),
        ("r: {bearing: pitch-bearing, property: radius_inner_left, guess: 31.8}", "r.guess", "31.8 m"),
    ],
)
def test_guess_in_wrong_unit_is_refused_with_location(entry, key, says):
    with pytest.raises(ConfigError) as caught:
        load_config(FULL.parent / "bench" / "modulus.yaml", [f"estimate.parameters={{{entry}}}"])
    assert not caught.value.others
    assert caught.value.key == f"estimate.parameters.{key}"
    assert caught.value.what.startswith(f"{says} is far from the value in the bench, ")
    assert "within a factor of 100" in caught.value.remedy


# Joints, forces and sensors between frames: the frames they name, and whether each can be built from its keys.
LOADS = "direction: [0, 0, 1], signal: {type: constant, value: 1.0}"
PAIR = "frames: [flange, root]"
DRIVE = "drive: {signal: {type: constant, value: 1.0}}"
EXAMPLES = {
    "joints": {
        **dict.fromkeys(("spherical", "revolute", "prismatic", "cylindrical", "universal", "pin", "fixed"), PAIR),
        "coincidence": f"{PAIR}, components: [x]",
        "perpendicular": f"{PAIR}, axis: x, to: z",
        "distance": f"{PAIR}, length: 1.0",
        "generic": f"{PAIR}, fixed: [x, about_y]",
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
    members = get_args(get_args(UNIONS[section])[0])
    return {get_args(model.model_fields["type"].annotation)[0]: model for model in members}


def every_kind(**changed):
    """An entry of every kind, for `--set`; changed: names of frames, and what stands in their place."""
    found = []
    for section, examples in EXAMPLES.items():
        for kind, keys in examples.items():
            for old, new in changed.items():
                keys = keys.replace(old, new)
            found += [f"{section}.{kind}-extra={{type: {kind}, {keys}}}"] * (kind != "strain")
    return found


def keys_naming(*frames):
    return {
        f"{section}.{kind}-extra" for section, examples in EXAMPLES.items() for kind, keys in examples.items()
        if all(frame in keys for frame in frames)
    }  # fmt: skip


def test_every_kind_has_an_example():
    for section, examples in EXAMPLES.items():
        assert examples.keys() == kinds(section).keys()


def test_unknown_frame_is_refused_by_every_kind():
    load_config(FULL, every_kind())
    for name in ("flange", "root"):
        with pytest.raises(ConfigError) as caught:
            load_config(FULL, every_kind(**{name: f"{name}s"}))
        errors = [caught.value, *caught.value.others]
        assert {".".join(error.key.split(".")[:2]) for error in errors} == keys_naming(name)
        assert all(f"no frame has the name '{name}s'" in error.what and f"did you mean {name}?" in str(error) for error in errors)


def test_two_frames_of_one_body_are_refused_by_every_kind():
    with pytest.raises(ConfigError, match="both frames are on the same body, 'blade'") as caught:
        load_config(FULL, every_kind(flange="station"))
    errors = [caught.value, *caught.value.others]
    assert {error.key.removesuffix(".frames") for error in errors} == keys_naming("flange", "root")


@pytest.mark.parametrize(("section", "table"), [("joints", JOINTS), ("forces", LAWS)])
def test_every_joint_and_force_law_is_configurable(section, table):
    """A section has a key for every argument of its function, of the same name, and besides no other than a history."""
    models = kinds(section)
    others = {"joints": set(), "forces": {"gravity", "force", "moment", "bearing"}}[section]
    assert models.keys() == table.keys() | others
    for kind, build in table.items():
        name, first, second, *own = inspect.signature(build).parameters
        assert (name, first, second) == ("name", "i", "j")
        assert models[kind].model_fields.keys() - {"drive", "signal"} == {"type", "frames", *own}


@pytest.mark.parametrize(
    ("stated", "hertz"),
    [({"rate": 100}, 100.0), ({"rate": 100, "unit": "Hz"}, 100.0), ({"rate": 1.2, "unit": "kHz"}, 1200.0), ({}, None)],
)
def test_a_rate_is_in_hertz_unless_stated(stated, hertz):
    assert ClockSection(**stated).hertz == hertz


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"rate": 100, "channel": "t"}, "`channel` and `rate` are both set"),
        ({"rate": 100, "unit": "ms"}, "ms is not a unit"),
        ({"rate": 0}, "greater than 0"),
    ],
)
def test_a_clock_is_a_channel_or_a_rate(stated, message):
    with pytest.raises(ValidationError, match=message):
        ClockSection(**stated)

"""The step as a filter's model: its Jacobian, what fails, how it is brought back on constraints; coordinates without bounds."""

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.bodies import FlexibleBody, Frame
from strainsight.multibody.forces import PointForce
from strainsight.multibody.initial import constraints_at, static_equilibrium
from strainsight.multibody.inverse.linear import indistinct
from strainsight.multibody.inverse.loads import walks
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import parameter_coordinates
from strainsight.multibody.sensors import Accelerometer, StrainSensor, readings
from strainsight.multibody.system import assemble

from .benches import bench, inertia_of, springs

FREE = ("ball_diameter", "radius_inner_left", "preload")


def disturbed(model, x, seed=0):
    """A state that moves, on the constraints, with a white force, loads and other parameters."""
    rng = np.random.default_rng(seed)
    x = x.copy()
    x[model.q] += 1e-4 * rng.normal(size=model.system.size)
    x[model.v] += 1e-3 * rng.normal(size=model.system.size)
    x = model.projected(x[None], 0)[0]
    x[model.w] = 1e2 * rng.normal(size=model.system.size)
    x[model.u] = 1e4 * rng.normal(size=len(model.inputs))
    x[model.delta] = 1e3 * rng.normal(size=len(model.inputs))
    x[model.xi] += 1e-3 * rng.normal(size=model.coordinates.size)
    return x


@pytest.mark.parametrize(
    ("h", "damped", "method"),
    [(0.01, False, "second_order"), (0.2, False, "second_order"), (0.01, True, "second_order"), (0.2, False, "thesis")],
)
def test_jacobian_is_the_differences_of_the_step(h, damped, method):
    b = bench([*FREE], modulus=True, damped=damped)
    free = ["E", *(f"b.{name}" for name in FREE)]
    model = b.model(h, 1, free=free, load=1.0, method=method, rest=False)
    x = disturbed(model, b.start(model)[0])
    ahead, A = (found[0] for found in model.step(x[None], 0))
    assert not ahead[model.w].any()
    assert not ahead[model.delta].any()
    np.testing.assert_array_equal(ahead[model.u], x[model.u] + x[model.delta])
    np.testing.assert_array_equal(ahead[model.xi], x[model.xi])
    blocks = {"q": model.q, "v": model.v, "w": model.w, "delta": model.delta, "c": model.c, "xi": model.xi}
    widths = {"q": 1e-6, "v": 1e-5, "w": 1e2, "delta": 1e2, "c": 1e2, "xi": 1e-3}
    for name, own in blocks.items():
        columns = []
        for j in range(own.start, own.stop):
            d = np.zeros(model.size)
            d[j] = widths[name]
            near, far = (model.step(np.stack([x + c * d, x - c * d]), 0)[0] for c in (1, 2))
            columns.append((8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * d[j]))
        difference = np.stack(columns, axis=1)
        for rows in blocks.values():
            size = np.abs(A[rows, own]).max()
            np.testing.assert_allclose(A[rows, own], difference[rows], rtol=0, atol=1e-7 * max(size, 1e-300))


def test_jacobian_of_the_first_step_from_rest_is_its_differences():
    b, h = bench([*FREE], modulus=True, preload=2e-4), 0.02
    model = b.model(h, 1, free=["E", *(f"b.{name}" for name in FREE)], load=1.0)
    x = b.start(model)[0]
    x[model.u], x[model.delta] = [1e4, -2e4, 3e4], [2e4, 1e4, -1e4]
    ahead, A = (found[0] for found in model.step(x[None], 0))
    elsewhere = x.copy()
    elsewhere[model.q] += 1e-5
    moved = model.step(elsewhere[None], 0)[0][0]
    np.testing.assert_allclose(moved[model.q], ahead[model.q], rtol=0, atol=1e-11)
    assert not A[: model.w.start, : model.w.start].any()
    for own, width in ((model.c, 1e3), (model.xi, 1e-4)):
        for j in range(own.start, own.stop):
            d = np.zeros(model.size)
            d[j] = width
            near, far = (model.step(np.stack([x + c * d, x - c * d]), 0)[0] for c in (1, 2))
            difference = (8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * width)
            for rows in (model.q, model.v):
                # a constant load moves nothing that rests: velocities are those of its change
                size = np.abs(A[rows, model.delta if (rows, own) == (model.v, model.c) else own]).max()
                np.testing.assert_allclose(A[rows, j], difference[rows], rtol=0, atol=1e-6 * size)


def test_a_step_that_fails_leaves_nan_in_its_run_alone():
    b = bench(["ball_diameter"])
    model = b.model(0.1, 1, free=["b.ball_diameter"], load=1.0)
    good = b.start(model)[0]
    bad, absurd = good.copy(), good.copy()
    bad[model.xi] += 1e4
    absurd[model.w] = np.inf
    ahead, A = model.step(np.stack([good, bad, absurd]), 0)
    assert np.isfinite(ahead[0]).all()
    assert np.isfinite(A[0]).all()
    assert np.isnan(ahead[1:]).all()
    np.testing.assert_array_equal(model.lost(ahead), [False, True, True])
    assert np.isnan(model.projected(ahead, 1)[1:]).all()


def test_projection_puts_a_state_back_on_its_constraints():
    b = bench()
    model = b.model(0.1, 1, load=1.0)
    rng = np.random.default_rng(2)
    x = np.stack([b.start(model)[0]] * 3)
    x[:, : model.w.start] += 1e-3 * rng.normal(size=(3, model.w.start))
    assert np.all(model.violation(x, 0) > 1e-6)
    back = model.projected(x, 0)
    assert np.all(model.violation(back, 0) < 1e-15)
    d = b.system.metric
    for old, new in zip(x, back, strict=True):
        phi, B, _ = constraints_at(b.system, new[model.q])
        assert np.abs(phi).max() < 1e-14
        assert np.abs(B @ new[model.v]).max() < 1e-15
        # nearest in the metric: what is taken off is across the constraints
        off = d * (old[model.v] - new[model.v])
        across = np.linalg.lstsq((B / d).T, off, rcond=None)[0]
        np.testing.assert_allclose((B / d).T @ across, off, atol=1e-12 * np.abs(off).max())
    np.testing.assert_array_equal(back[:, model.w.start :], x[:, model.w.start :])


def test_modulus_and_loads_of_weightless_bench_are_inseparable():
    M, C, K, shape, _ = springs()
    body = FlexibleBody("body", True, AffineOperator(0 * K, {"E": K / 7.0}), M, C, inertia_of(M, 3.0))
    frame = Frame("end", "body", displacement=shape, rotation=0 * shape)
    forces = [PointForce("F", frame, np.eye(3)[0], ["x"]), PointForce("G", frame, 2 * np.eye(3)[0], ["z"]),
              PointForce("W", frame, np.eye(3)[1], ["w"])]  # fmt: skip
    system = assemble([body], [], forces)
    theta = np.array([7.0])

    def lacking(unknown, known, free):
        inputs = np.array([system.inputs.index(name) for name in unknown])
        u = np.array([3.0, 0.0, known])
        model = AugmentedStep(
            system, readings(system, [StrainSensor("s", "body", np.eye(3))]), np.zeros(3), "second_order", np.tile(u, (2, 1)),
            inputs, walks(np.ones(len(inputs)), 0.1), parameter_coordinates(["E"], ["E"] if free else [], theta, {}),
            np.zeros(3), np.zeros(int(free)), np.full(3, 1e-6),
        )  # fmt: skip
        q, _ = static_equilibrium(system, np.zeros(3), u, theta)
        return indistinct(model, model.pack(q, 0 * q, u[inputs], theta), 0, [*unknown, *["E"] * free])

    assert lacking(["x"], 0.0, False) == []
    assert lacking(["x"], 0.0, True) == ["x and E together"]
    assert lacking(["x"], 5.0, True) == []
    assert lacking(["x", "z"], 0.0, False) == ["x and z together"]
    assert len(lacking(["x", "z"], 0.0, True)) == 2


def test_readings_of_an_accelerometer_feel_loads_and_parameters_at_once():
    b = bench(["ball_diameter"], modulus=True)
    tip = Accelerometer("tip", Frame("tip", "blade", np.array([15.0, 0.3, 0.1])))
    b = replace(b, sensors=readings(b.system, [*b.sensors.sensors, tip]))
    model = replace(b.model(0.1, 1, free=["E", "b.ball_diameter"], load=1.0), R=np.ones(12), offset=np.arange(12.0))
    x = disturbed(model, b.start(model)[0])
    y, J = (found[0] for found in model.measure(x[None], 0))
    plain = readings(b.system, b.sensors.sensors[:-1])
    np.testing.assert_allclose(y[:9], plain.read(x[model.q], x[model.v])[0] - np.arange(9.0))
    pulled = x.copy()
    pulled[model.u] = 0.0
    assert np.abs(y - model.measure(pulled[None], 0)[0][0])[-3:].max() > 0.1
    assert not np.abs(y - model.measure(pulled[None], 0)[0][0])[:-3].any()
    widths = np.full(model.size, 1e-4)
    widths[model.c], widths[model.delta], widths[model.w], widths[model.v] = 1e3, 1e3, 1e3, 1e-3
    widths[model.q] = 1e-7
    for j, width in enumerate(widths):
        d = np.zeros(model.size)
        d[j] = width
        near, far = (model.measure(np.stack([x + c * d, x - c * d]), 0)[0] for c in (1, 2))
        difference = (8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * width)
        for rows in (slice(0, 9), slice(9, 12)):
            size = max(np.abs(J[rows, j]).max(), 1e-9 / width)
            np.testing.assert_allclose(J[rows, j], difference[rows], rtol=0, atol=2e-6 * size, err_msg=str(j))


RING = np.array([0.06, 0.0318, 0.0317, 0.0319, 0.032, 1e-5])
NAMES = ["E", *(f"b.{name}" for name in PARAMETERS)]
THETA = np.array([2e11, *RING])
RADII = [f"b.{name}" for name in PARAMETERS[1:5]]
SETS = [
    ["E"],
    ["b.ball_diameter"],
    ["b.preload"],
    ["b.radius_inner_left"],
    ["b.radius_outer_right", "E", "b.ball_diameter"],
    ["b.ball_diameter", *RADII],
    [*RADII, "b.preload", "E"],
]


def of(free, theta=THETA, **bearings):
    return parameter_coordinates(NAMES, free, theta, bearings or {"b": RING})


@pytest.mark.parametrize("free", SETS, ids=" ".join)
def test_coordinates_roundtrip_with_exact_slopes(free):
    found = of(free)
    xi = found.xi(THETA)
    back, slopes = found.theta(xi)
    np.testing.assert_allclose(back, THETA, rtol=1e-13)
    for k in range(len(free)):
        d = np.zeros(len(free))
        d[k] = 1e-5 * max(1.0, abs(xi[k]))
        difference = (found.theta(xi + d)[0] - found.theta(xi - d)[0]) / (2 * d[k])
        np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-7, atol=1e-12 * np.abs(THETA).min())
    assert [NAMES[at] for at in found.free] == free


@pytest.mark.parametrize("free", SETS[1:], ids=" ".join)
def test_every_value_is_a_bearing_that_can_be_built(free):
    found, rng = of(free), np.random.default_rng(0)
    for _ in range(200):
        _, D, *radii, preload = found.theta(found.xi(THETA) + 3 * rng.normal(size=len(free)))[0]
        known = 0.0 if "b.preload" in free else preload
        assert D > 0
        assert min(radii) > 0.5 * D + known


def test_values_by_hand():
    np.testing.assert_allclose(of(["E"]).xi(THETA), np.log(2e11))
    np.testing.assert_allclose(of(["b.preload"]).xi(THETA), 10.0)
    plain = THETA.copy()
    plain[-1] = 0.0
    assert of(["b.radius_outer_left"], plain).xi(plain)[0] == pytest.approx(np.log(2 * 0.0319 / 0.06 - 1))
    assert of(["b.ball_diameter"], plain).xi(plain)[0] == pytest.approx(np.log(2 * 0.0317 / 0.06 - 1))
    assert of(["b.ball_diameter", "b.radius_inner_right"], plain).xi(plain)[0] == pytest.approx(
        np.log(2 * 0.0318 / 0.06 - 1)
    )
    assert of(["b.ball_diameter", *RADII]).xi(THETA)[0] == pytest.approx(np.log(0.06))


def test_values_that_are_no_parameter_come_from_the_bearing():
    found = parameter_coordinates(["b.ball_diameter"], ["b.ball_diameter"], [0.06], {"b": RING})
    assert found.xi([0.06])[0] == pytest.approx(np.log(2 * (0.0317 - 1e-5) / 0.06 - 1))


@pytest.mark.parametrize("free", SETS, ids=" ".join)
def test_spread_of_the_coordinates_is_that_of_the_values(free):
    """Draws in θ, turned into ξ one by one."""
    found, rng = of(free), np.random.default_rng(1)
    std = 1e-5 * np.abs(THETA[found.free])
    drawn = np.tile(THETA, (4000, 1))
    drawn[:, found.free] += std * rng.normal(size=(4000, len(free)))
    xi = np.array([found.xi(theta) for theta in drawn])
    P = found.covariance(THETA, std)
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose(scale, xi.std(axis=0), rtol=0.05)
    drawn_correlation = np.atleast_2d(np.corrcoef(xi.T))
    np.testing.assert_allclose(P / np.outer(scale, scale), drawn_correlation, atol=0.06)


def test_infeasible_parameters_are_refused():
    with pytest.raises(InfeasibleError, match=r"0\.029 of the parameter b\.radius_inner_left is not above 0\.03001"):
        of(["b.radius_inner_left"]).xi(np.array([2e11, 0.06, 0.029, *RING[2:]]))
    with pytest.raises(InfeasibleError, match=r"0\.064 of the parameter b\.ball_diameter is not between 0 and 0\.06338 m"):
        of(["b.ball_diameter"]).xi(np.array([2e11, 0.064, *RING[1:]]))
    with pytest.raises(InfeasibleError, match="the value -1 of the parameter E is not positive"):
        of(["E"], np.array([-1.0, *RING]))
    with pytest.raises(InfeasibleError, match="the dimensions of bearing b are missing"):
        of(["b.preload"], c=RING)

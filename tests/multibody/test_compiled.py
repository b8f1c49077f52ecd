"""The compiled step in minimal coordinates is the step in natural ones; compiled laws are their Python."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.compiled import kept
from strainsight.multibody.advance import sensitivities
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.bearing.law import BearingLaw
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.compiled import arrays, blocks, equations, matrix, newton, relations, slopes, stages
from strainsight.multibody.forces import CompiledLaw, Gravity, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import coincidence, revolute
from strainsight.multibody.laws.kinds import LAWS
from strainsight.multibody.laws.linear import LinearLaw
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.step import compiled, step
from strainsight.multibody.system import assemble

from ..shared import ROOT
from .mechanisms import turned
from .natural import natural_slopes, natural_step
from .test_laws import KEYS

SMALL = Bearing(24, 0.4, np.pi / 4, 0.02, 0.0106, 0.0105, 0.0107, 0.0106, 1e-5)


@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_the_step_is_that_of_natural_coordinates_to_rounding(everything, h):
    """Position, velocity, multipliers of the joints and all slopes, with every kind of body, joint and force."""
    e = everything
    w = np.random.default_rng(3).normal(size=e.system.size)
    new = step(e.system, e.q, e.v, e.u, h, e.theta, w=w)
    q, v, mu, lam, _ = natural_step(e.system, e.q, e.v, e.u, h, e.theta, w)
    np.testing.assert_allclose(new.q, q, rtol=0, atol=1e-13 * np.abs(q).max())
    np.testing.assert_allclose(new.v, v, rtol=0, atol=1e-12 * np.abs(v).max())
    joints = slice(e.system.rigid, None)
    np.testing.assert_allclose(new.mu[joints], mu[joints], rtol=0, atol=1e-9 * np.abs(mu).max())
    np.testing.assert_allclose(new.lam[joints], lam[joints], rtol=0, atol=1e-10 * np.abs(lam).max())
    found, (A, B_w) = sensitivities(e.system, new), natural_slopes(e.system, e.q, e.v, e.u, h, e.theta, w)
    n = e.system.size
    for exact, own in ((A, found.A), (B_w, found.B_w)):
        for half in (slice(0, n), slice(n, None)):
            np.testing.assert_allclose(own[half], exact[half], rtol=0, atol=1e-10 * np.abs(exact[half]).max())


def chain(count, closed=False):
    """Links on revolute joints, zigzag from a wall, in any order; closed: the end of the last one is held, too."""
    rng = np.random.default_rng(4)
    bodies = [
        RigidBody(f"link {k}", 1.0 + 0.1 * k, np.array([0.5, 0.1, 0.0]), np.diag([0.1, 0.5, 0.6])) for k in range(count)
    ]
    poses, at = {}, np.zeros(3)
    for k in range(count):
        poses[f"link {k}"] = Pose(at, turned(0.5 * (-1) ** k))
        at = at + turned(0.5 * (-1) ** k)[:, 0]
    joints = [
        revolute(
            f"hinge {k}",
            Frame(f"tip {k}", f"link {k - 1}", np.array([1.0, 0, 0])) if k else Frame("wall"),
            Frame(f"root {k}", f"link {k}"),
        )
        for k in range(count)
    ]
    if closed:
        end = Frame("end", f"link {count - 1}", np.array([1.0, 0, 0]))
        joints.append(coincidence("far", Frame("other wall", None, at), end, "xy"))
    rng.shuffle(bodies)
    rng.shuffle(joints)
    system = assemble(bodies, joints, [Gravity(np.array([1.0, -9.0, 0.0]))])
    return system, *state(system, poses)


@pytest.mark.parametrize("closed", [False, True])
def test_a_chain_in_any_order_is_eliminated_along_itself(closed):
    """The answer is that of the dense matrix, and the envelope is that of a band: it grows with the number of links."""
    system, q, v = chain(7, closed)
    new = step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    dense = natural_step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    np.testing.assert_allclose(new.q, dense[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(new.v, dense[1], rtol=0, atol=1e-11)
    low = compiled(system).arrays.low
    assert np.all(low - np.arange(len(low)) < 3 * (6 + 10))


def in_python(law):
    """The same law without its compiled function."""
    return SimpleNamespace(load=law.load)


LINEAR = LinearLaw(np.diag([3.0, 4.0]) + 1.0, np.array([0.1, 0.2]), (np.eye(2),), np.ones((2, 2)))


@pytest.mark.parametrize("kind", ["spring", "torsion", "bushing", "linear", "bearing"])
def test_a_compiled_law_is_its_python(kind):
    """Through the step and its slopes: by state, inputs and parameters alike."""
    wall, held = Frame("wall", None, np.array([0.3, 0.2, -0.1])), Frame("held", "stone", np.array([0.1, 0.0, 0.05]))
    theta, parameters = np.zeros(0), ()
    if kind == "bearing":
        theta, parameters = np.array([0.02, 1e-5]), ("D", "p")
        law, relations = BearingLaw(SMALL, ("ball_diameter", "preload")), bearing_displacements(wall, held)
    elif kind == "linear":
        theta, parameters, law, relations = np.array([2.0]), ("k",), LINEAR, bearing_displacements(wall, held)[:2]
    else:
        made = LAWS[kind]("law", wall, held, **KEYS[kind])
        law, relations = made.law, made.relations
    assert isinstance(law, CompiledLaw)
    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    found = []
    for own in (law, in_python(law)):
        system = assemble([stone], [], [RelativeElement("law", relations, own, parameters), Gravity()])
        place = np.array([0.2, 0.2, -0.15]) + (5e-6 if kind == "bearing" else 0.2)
        q, v = state(
            system, {"stone": Pose(place, velocity=np.array([1e-3, 2e-3, 0]), spin=np.array([0.01, 0.0, 0.02]))}
        )
        new = step(system, q, v, np.zeros(0), 1e-4, theta)
        again = step(system, new.q, new.v, np.zeros(0), 1e-4, theta, guess=new)
        s = sensitivities(system, again)
        found.append((again.q, again.v, s.A, s.B_theta))
    for fast, plain in zip(*found, strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-9 * max(np.abs(plain).max(initial=0.0), 1e-300))


def test_an_error_of_a_law_in_python_that_is_no_missing_load_comes_through():
    def load(rho, rate, theta):
        raise ZeroDivisionError("of the law")

    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    relations = bearing_displacements(Frame("wall"), Frame("held", "stone"))
    system = assemble([stone], [], [RelativeElement("law", relations, SimpleNamespace(load=load))])
    with pytest.raises(ZeroDivisionError, match="of the law"):
        step(system, *state(system, {}), np.zeros(0), 1e-3, np.zeros(0))


def test_kept_code_notices_a_change_of_other_files():
    """Its stamp on disk has those of every file it calls into."""

    def function(x):
        return x

    made = kept("multibody/inertia.py")(function)
    other = Path(__file__).parents[2] / "pipeline" / "strainsight" / "multibody" / "inertia.py"
    assert (other.stat().st_mtime, other.stat().st_size) in made._cache._cache_file._source_stamp


@pytest.mark.parametrize("entry", [stages.solve_stages, slopes.step_slopes])
def test_compiled_code_notices_a_change_of_all_that_it_is_made_of(entry):
    """Also of the arrays that it takes: numba knows a tuple by its name and the types in it, and with two of its fields
    exchanged, code that was kept would read one for the other."""
    stamp = entry._cache._cache_file._source_stamp
    solver = [newton] if entry is stages.solve_stages else []
    for module in (arrays, blocks, relations, equations, matrix, *solver):
        file = Path(module.__file__).stat()
        assert (file.st_mtime, file.st_size) in stamp, module.__name__


STEP_AND_SLOPES = """
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.bearing.law import BearingLaw
from strainsight.multibody.forces import Gravity, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.initial import state
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.advance import sensitivities
from strainsight.multibody.step import step
from strainsight.multibody.system import assemble
from tests.multibody.conftest import Particles

arm = Particles(np.ones(4), np.eye(4, 3), np.ones((4, 3, 1))).flexible("arm", AffineOperator(np.eye(1), {}))
bearing = Bearing(24, 0.4, np.pi / 4, 0.02, 0.0106, 0.0105, 0.0107, 0.0106, 1e-5)
root = Frame("root", "arm", displacement=np.zeros((3, 1)), rotation=np.zeros((3, 1)))
ring = bearing_displacements(Frame("wall"), root)
system = assemble([arm], [], [RelativeElement("ring", ring, BearingLaw(bearing)), Gravity()])
q, v = state(system, {})
sensitivities(system, step(system, q, v, np.zeros(0), 1e-5, np.zeros(0)))
functions = {
    function
    for name, module in list(sys.modules.items()) if name.startswith("strainsight.multibody")
    for function in vars(module).values() if isinstance(function, Dispatcher) and function.signatures
}
print(len(functions), sorted(f.py_func.__name__ for f in functions if len(f.signatures) > 1))
"""


@pytest.mark.slow
def test_equations_are_compiled_for_one_set_of_types(tmp_path):
    """A process without compiled code on disk, which takes the step, its slopes and the inertia that Python asks for."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    child = subprocess.run(
        [sys.executable, "-c", STEP_AND_SLOPES], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert child.returncode == 0, child.stderr
    count, several = child.stdout.split(maxsplit=1)
    assert int(count) > 30
    assert several.strip() == "[]"

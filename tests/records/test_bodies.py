"""A reduced body comes back from its artefact as it was reduced."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from strainsight.fem.affine import AffineOperator, Coefficient, Newton
from strainsight.records.bodies import ReducedBodies, ReducedBody
from strainsight.records.record import read, written
from strainsight.rom.inertia import InertiaInvariants
from strainsight.workflow.artefact import Header
from strainsight.workflow.output import Output
from strainsight.workflow.store import write_artefact


def test_everything_of_a_reduced_body_comes_back(tmp_path):
    rng = np.random.default_rng(0)
    inertia = InertiaInvariants(
        2.0, rng.random(3), rng.random((3, 2)), np.eye(3), rng.random((2, 3, 3)), rng.random((2, 2, 3, 3)),
        rng.random((3, 3, 2)), rng.random((2, 3, 3, 2)), np.eye(2),
    )  # fmt: skip
    thickness = Newton("t", (1.5, 0.0), 0.5, (1.0, 2.0), 0.1, True)
    own = ReducedBody(
        clamped=True,
        frequency=np.array([1.0]),
        cut=5.0,
        reach={"E": np.array([1.0, 4.0])},
        mass=np.diag([1.0, 3.0]),
        stiffness=AffineOperator(
            np.diag([1.0, 2.0]),
            {"E": np.diag([3.0, 4.0]), "E t": np.eye(2)},
            {"E t": Coefficient((Newton("E"), thickness), np.arange(6.0).reshape(2, 3))},
        ),
        damping=AffineOperator(np.eye(2), {}),
        basis=np.eye(6, 2),
        interface={"7": np.eye(6, 2), "12": 2 * np.eye(6, 2)},
        inertia=inertia,
    )
    datasets = written(ReducedBodies(bodies={"b": own}))
    artefact = write_artefact(
        tmp_path / "reduce.h5", Output(datasets, {}, "toy"), Header("reduce", 1, "key", {}, {}, {})
    )
    found = read(ReducedBodies, artefact).bodies["b"]
    assert (found.clamped, found.cut) == (True, 5.0)
    assert found.stiffness.coefficients["E t"].bases == own.stiffness.coefficients["E t"].bases
    for t in (0.5, 1.5, 4.0):
        np.testing.assert_array_equal(*(X.stiffness.at({"E": 2.0, "t": t}) for X in (found, own)))
    np.testing.assert_array_equal(found.damping.at({"E": 2.0}), np.eye(2))
    np.testing.assert_array_equal(found.reach["E"], [1.0, 4.0])
    np.testing.assert_array_equal(found.interface["12"], 2 * np.eye(6, 2))
    for name in ("frequency", "mass", "basis"):
        np.testing.assert_array_equal(getattr(found, name), getattr(own, name))
    for field in fields(InertiaInvariants):
        np.testing.assert_array_equal(getattr(found.inertia, field.name), getattr(inertia, field.name))

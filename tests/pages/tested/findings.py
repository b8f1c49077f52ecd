"""Findings of a test on the box of tests/pages/conftest.py, from a known signal: one unknown load and E, four strain gauges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.pages.arrays import History, Reading
from strainsight.pages.tested.data import File, Findings, Map, Spectrum, SurfaceMoment, TestedUnknown, peak_of
from strainsight.records.estimated import Compared, TestSource

from ..conftest import layout, mixed_layout, posterior

STEP, SAMPLES = 1e-3, 4000
NOISE = 0.7e-6
TIME = STEP * np.arange(1, SAMPLES + 1)
INSTANTS = STEP * np.arange(SAMPLES + 1)


def load(amplitude=2e3, frequency=11.0):
    """Sine with one short shock at 2.5 s."""
    shock = np.exp(-(((INSTANTS - 2.5) / 0.01) ** 2))
    return amplitude * (np.sin(2 * np.pi * frequency * INSTANTS) + 1.5 * shock)


def reading(label="G1", gauge=0, unit="strain", size=5e-5, **changes):
    rng = np.random.default_rng(gauge + 1)
    true, noise = size * load()[1:] / 2e3, NOISE * size / 5e-5
    std = np.full(SAMPLES, 0.4 * noise)
    measured = true + noise * rng.standard_normal(SAMPLES)
    own = Reading(label, unit, TIME, measured, true, std, gauge, noise_std=noise)
    return replace(own, **changes)


def unknown_load(name="side", withheld=False):
    values = load()
    std = None if withheld else 60.0
    return TestedUnknown(name, "N", "load", float(np.sqrt(np.mean(values**2))), std, peak_of(INSTANTS, values))


def history(name, values, std, unit="N"):
    return History(name, unit, INSTANTS, None, values, np.full(len(values), std))


def spectrum(name, unit="strain", level=2 * NOISE**2 * STEP):
    f = np.arange(1.0, 500.0)
    return Spectrum(name, unit, f, 1e-15 * (1 + np.sin(f) ** 2), level)


def file_of(*names):
    """Of channels of one calibration: less 3 µm/m, and the sign turned."""
    many, nothing = len(names), np.full(len(names), np.nan)
    source = TestSource(
        file="run <7>.csv", sha256="ab" * 32, bytes=123_456, format="csv", date="2025-03-14", channel=names, measures=names,
        unit=("um/m",) * many, bridge=("",) * many, gauge_factor=nothing, poisson_ratio=nothing, sign=-np.ones(many),
        scale=np.ones(many), offset=np.full(many, 3.0), drift=np.zeros(many), zero=np.full((many, 2), np.nan),
        delay=np.zeros(many),
    )  # fmt: skip
    return File(source, 1000.0, 0.0, 4.0, SAMPLES)


def held(label="G1", gauge=0):
    own = reading(label, gauge)
    return replace(own, std=np.full(SAMPLES, own.noise_std))


def moment(points, faces):
    shift = np.column_stack([0 * points[:, 0], 0 * points[:, 0], 0.02 * points[:, 0] ** 2])
    middle = np.array([points[face[face >= 0]].mean(axis=0) for face in faces])
    mises = 40.0 * (2.0 - middle[:, 0])
    strain = Map("principal strain of largest size", "µm/m", 300.0 * (middle[:, 2] - 0.06))
    return SurfaceMoment(2.5, "G1", shift, 100.0, (strain, Map("von Mises stress", "MPa", mises, 0.05 * mises)))


def findings(**changes):
    own = layout()
    value = np.linspace(2.0e11, 2.2e11, 101)
    E = np.full(SAMPLES + 1, 2.1e11)
    labels = [gauge.label for gauge in own.gauges]
    made = Findings(
        name="beam",
        title="beam: what the test says of side and E",
        unknowns=(unknown_load(), TestedUnknown("E", "Pa", "parameter", 2.1e11, 1.2e9)),
        innovations="the innovations are as large as expected from the configured noise",
        consistent=True,
        warnings=(),
        notes=("G1: missing samples in the file: 1 of 4001",),
        layout=own,
        histories=(
            history("side", load(), 60.0),
            History("E", "Pa", INSTANTS, None, E, 0.01 * E, E, 0.01 * E),
        ),
        file=file_of(*labels, "tip"),
        readings=tuple(reading(label, i) for i, label in enumerate(labels)),
        residuals=tuple(spectrum(label) for label in labels),
        known=(history("tip", 3 * load(), np.nan),),
        load_spectra=(spectrum("side", "N", None),),
        posteriors={"E": posterior(value, np.exp(-(((value - 2.1e11) / 1e9) ** 2)), 0 * value + 0.1)},
        filters=Compared(
            filter=("grid",), estimate={"E": np.array([2.1e11])}, std={"E": np.array([0.006 * 2.1e11])}, ratio={"E": np.ones(1)}
        ),
        budget={"E": {"noise": 0.4, "gain": 0.6}},
        moment=moment(own.points, own.faces),
        facts={"import": "40 elements"},
        provenance={"seed": "0"},
    )
    return replace(made, **changes)


def several_loads():
    names = ("Fx", "Fy", "Fz")
    return findings(
        unknowns=tuple(unknown_load(name) for name in names),
        histories=tuple(history(name, load(), 60.0) for name in names),
        resultants=(history("node 2", np.abs(load()), 60.0),),
        load_spectra=tuple(spectrum(name, "N", None) for name in names),
        posteriors={},
        filters=None,
        budget={},
        known=(),
    )


def parameters_only():
    own = findings()
    return replace(own, unknowns=own.unknowns[1:], histories=own.histories[1:], load_spectra=())


def withheld():
    why = "no load is known: the parameters rest on what is stated of the loads, and σ is withheld"
    own = findings()
    nothing = np.full(SAMPLES, np.nan)
    E = own.histories[1]
    none = np.full(SAMPLES + 1, np.nan)
    bare = own.moment
    assert bare is not None
    return replace(
        own,
        unknowns=(unknown_load(withheld=True), TestedUnknown("E", "Pa", "parameter", 2.1e11, None)),
        warnings=(why, "the innovations are 3.1 times as large as expected from the configured noise"),
        consistent=False,
        readings=tuple(replace(reading, std=nothing) for reading in own.readings),
        histories=(history("side", load(), np.nan), replace(E, std=none, smoothed_std=none)),
        posteriors={},
        filters=None,
        budget={},
        known=(),
        moment=replace(bare, maps=tuple(replace(own_map, std=None) for own_map in bare.maps)),
    )


def sensors():
    """A rosette of three grids, an accelerometer of two axes and a displacement sensor besides a gauge."""
    kinds = [
        ("G1", 0, "strain", 5e-5), ("G2", 1, "strain", 4e-5), ("G2.2", 1, "strain", 2e-5), ("G2.3", 1, "strain", 1e-5),
        ("G4", 3, "m/s^2", 30.0), ("G4.2", 3, "m/s^2", 3.0), ("G6", 5, "m", 2e-4),
    ]  # fmt: skip
    box = mixed_layout()
    return findings(
        layout=box,
        readings=tuple(reading(label, gauge, unit, size) for label, gauge, unit, size in kinds),
        residuals=tuple(spectrum(label, unit) for label, _, unit, _ in kinds),
        moment=moment(box.points, box.faces),
    )


def missing():
    """A stretch without samples, one channel with none at all."""
    own = findings()
    gap = own.readings[0].measured.copy()
    gap[500:2600] = np.nan
    nothing = np.full(SAMPLES, np.nan)
    first, second, *rest = own.readings
    return replace(
        own,
        readings=(replace(first, measured=gap), replace(second, measured=nothing), *rest),
        residuals=(own.residuals[0], *own.residuals[2:]),
    )


def biased():
    own = findings()
    return replace(own, readings=(replace(own.readings[0], offset=(3.1e-4, 2e-6)), *own.readings[1:]))


def held_out():
    return findings(hold_out=(held("G1", 0), held("G2", 1)))


def bare():
    """No surface, no notes, nothing besides the unknown."""
    nothing = dict.fromkeys(("notes", "known", "residuals", "load_spectra"), ())
    return findings(moment=None, filters=None, posteriors={}, budget={}, facts={}, provenance={}, **nothing)


CASES = {
    "plain": findings,
    "several loads": several_loads,
    "parameters only": parameters_only,
    "σ withheld": withheld,
    "sensors": sensors,
    "missing samples": missing,
    "offsets": biased,
    "held out": held_out,
    "bare": bare,
}
"""What a page of a test may have to show."""

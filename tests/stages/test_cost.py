"""The forecast of time and memory against what docs/scaling.md and docs/measured.md have as measured."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from strainsight.cases.structure.cost import BULK_AND_THIN, MEMORY, OF_A_PROCESS, SECONDS, SOLVES, cost_of, size_of
from strainsight.config.load import load_config
from strainsight.mesh.kinds import ELEMENTS

ROOT = Path(__file__).parents[2]
SCALING = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
SIDES = {11_100: 9, 31_164: 13, 107_163: 20}
"""Unknowns of the measured cubes → elements along a side."""
CONFIG = load_config(ROOT / "configs" / "cantilever-youngs-modulus.yaml", ["rom.modes=10", "validate.truth.modes=40"]).model


def number(text: str) -> float:
    return float(text.replace(" ", "").removesuffix("s"))


def rows() -> list[tuple[str, int, list[str]]]:
    found = re.findall(r"^\| (plate|block) \| ([\d ]+) \|(.*)\|$", SCALING, re.MULTILINE)
    return [(shape, int(number(size)), [cell.strip() for cell in rest.split("|")]) for shape, size, rest in found]


def measured_size(shape: str, unknowns: int):
    """Nodes and elements of bricks of twenty nodes: a wall of one layer, 7 nodes an element but for its rim, or a cube."""
    if shape == "plate":
        return size_of(unknowns // 3, {"hex20": unknowns // 3 // 7})
    k = SIDES[unknowns]
    nodes = (k + 1) ** 3 + 3 * k * (k + 1) ** 2
    assert 3 * nodes == unknowns
    return size_of(nodes, {"hex20": k**3})


@pytest.mark.parametrize(("shape", "unknowns", "cells"), rows())
def test_seconds_and_memory_of_the_measured_bodies_are_within_a_factor_of_two(shape, unknowns, cells):
    size = measured_size(shape, unknowns)
    _, modes, rom, _, peaks, _ = cells
    memory = [number(part) for part in peaks.split(",")]
    for stage, seconds, peak in zip(("modes", "rom"), (modes, rom), memory[1:], strict=False):
        said = cost_of(stage, CONFIG, size)
        assert 0.5 <= (said.seconds + OF_A_PROCESS) / number(seconds) <= 2, (stage, said.seconds)
        assert 0.5 <= said.memory / peak <= 2


def test_more_modes_take_longer_as_measured():
    """`spectrum` of 40 modes of the plate."""
    at = {98_937: (14, 1.14), 300_141: (40, 3.35), 1_003_011: (172, 11.4)}
    for unknowns, (seconds, memory) in at.items():
        assert f"`spectrum` {seconds} s and {memory} GiB" in SCALING
        said = cost_of("spectrum", CONFIG, measured_size("plate", unknowns))
        assert 0.5 <= (said.seconds + OF_A_PROCESS) / seconds <= 2
        assert 0.5 <= said.memory / memory <= 2


@pytest.mark.parametrize(
    ("name", "nodes", "tetrahedra", "seconds"), [("hub-coarse", 31_335, 18_467, 8.4), ("hub", 109_710, 70_158, 54.5)]
)
def test_the_hub_lies_between_wall_and_cube(name, nodes, tetrahedra, seconds):
    """Of ten-node tetrahedra, 20 modes, on an otherwise idle machine (docs/measured.md, sums with their import)."""
    table = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")
    peak = re.search(rf"^\| {name} \|.* ([\d.]+) \|$", table, re.MULTILINE)[1]
    size = size_of(nodes, {"tet10": tetrahedra})
    assert 1.5 < size.elements < 4
    said = cost_of("modes", CONFIG.model_copy(update={"rom": CONFIG.rom.model_copy(update={"modes": 20})}), size)
    assert 0.5 <= said.seconds / seconds <= 2
    assert 0.5 <= said.memory / float(peak) <= 2


def test_the_constants_are_those_of_the_document():
    def of(what: str) -> list[float]:
        formula = re.search(rf"^\| {re.escape(what)} \|[^|]*\| ([^|]*) \|", SCALING, re.MULTILINE)[1]
        return [float(term.split(" N")[0]) for term in formula.split(" + ")]

    for law, what in ((SECONDS, "[s]"), (MEMORY, "[GiB]")):
        for stage in ("modes", "rom"):
            name = f"plate, `{stage}` [s]" if what == "[s]" else f"plate, memory of `{stage}` [GiB]"
            own = law[stage]
            documented = of(name)
            assert documented == [own.constant, own.linear, own.factor][: len(documented)]
    assert "e^1.2" in SCALING


def test_every_kind_of_element_has_its_share_of_nodes():
    """Euler's count on a torus of cells, where there is no rim: nodes = corners + edges with a node + centres."""
    assert set(BULK_AND_THIN) == {kind.name for kind in ELEMENTS}
    for kind, (bulk, thin) in BULK_AND_THIN.items():
        k = 60
        cells = {"tet": 6, "pyr": 6, "wed": 2, "hex": 1}[kind[:3]]
        assert size_of(round(thin * cells * k * k), {kind: cells * k * k}).elements == pytest.approx(1, abs=0.02)
        thick = size_of(round((bulk + (thin - bulk) / 5) * cells * k**3), {kind: cells * k**3})
        assert thick.elements == pytest.approx(5, rel=0.01)


def test_materials_that_vary_apart_cost_their_samples():
    size = replace(measured_size("plate", 98_937), regions=2)
    one, apart = cost_of("modes", CONFIG, size), cost_of("rom", CONFIG, size)
    assert apart.seconds == pytest.approx((CONFIG.rom.parameter_samples + 3) * one.seconds)
    assert SOLVES == ("modes", "rom", "spectrum")

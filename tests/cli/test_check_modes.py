"""Modes of other programs beside those of a deck: CalculiX itself, and an .f06 of a cantilever whose modes are known."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.experiment.structure.modes_compared import modes_of_file
from strainsight.foreign.results.response import printed_modes
from strainsight_cli.main import app

from ..edges.beam import TIP, bricks
from ..frd import calculix
from ..wrong.decks import config, frame

ROOTS = (1.87510406871196, 4.69409113297418)
"""βL of a cantilever: cos βL cosh βL = −1."""
L, A, E, RHO = 0.4, 4e-4, 2.1e11, 7850.0
MOMENTS = {"y": 2e-8, "z": 1e-8}
"""Of the section that `frame` has: I1 resists bending along its z, I2 along y."""
HEAD = "1    A CANTILEVER                                              NOVEMBER  27, 2026  MSC NASTRAN  PAGE     3\n"


def cantilever():
    """Frequency [Hz] and shape along x (5,) of the four lowest modes of bending, with the direction in which each moves."""
    found = []
    x = np.linspace(0.0, 1.0, 5)
    for way, inertia in (("z", MOMENTS["y"]), ("y", MOMENTS["z"])):
        for root in ROOTS:
            s = (np.cos(root) + np.cosh(root)) / (np.sin(root) + np.sinh(root))
            shape = np.cosh(root * x) - np.cos(root * x) - s * (np.sinh(root * x) - np.sin(root * x))
            found.append((root**2 / (2 * np.pi * L**2) * np.sqrt(E * inertia / (RHO * A)), shape, way))
    return sorted(found, key=lambda own: own[0])


def f06(modes, shapes=True) -> str:
    """As Nastran prints them, over two pages."""
    rows = []
    for i, (f, _, _) in enumerate(modes, start=1):
        lam = (2 * np.pi * f) ** 2
        rows.append(f"{i:9d}{i:10d}{lam:20.6E}{2 * np.pi * f:20.6E}{f:20.6E}{1.0:20.6E}{lam:20.6E}\n")
    title = "                                              R E A L   E I G E N V A L U E S\n"
    names = "   MODE    EXTRACTION      EIGENVALUE            RADIANS             CYCLES            GENERALIZED\n"
    text = [HEAD, "0                                                      SUBCASE 1\n", title, names, *rows[:3]]
    text += [HEAD, title, names, *rows[3:]]
    for i, (f, shape, way) in enumerate(modes if shapes else [], start=1):
        text += [HEAD, f"      EIGENVALUE = {(2 * np.pi * f) ** 2:13.6E}\n"]
        text.append(f"          CYCLES = {f:13.6E}         R E A L   E I G E N V E C T O R   N O . {i:10d}\n \n")
        text.append("      POINT ID.   TYPE          T1             T2             T3             R1             R2\n")
        for node, value in enumerate(shape, start=1):
            y, z = (value, 0.0) if way == "y" else (0.0, value)
            text.append(f"{node:14d}      G   {0.0:15.6E}{y:15.6E}{z:15.6E}{0.0:15.6E}{0.0:15.6E}{0.0:15.6E}\n")
    return "".join([*text, HEAD])


def compared(folder: Path, *words: str):
    done = CliRunner().invoke(
        app, ["check-modes", str(folder / "own.yaml"), *words, "--results", str(folder / "results")]
    )
    assert "Traceback" not in done.output
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The deck of the cantilever and its config, whose modes are computed once for all files."""
    folder = tmp_path_factory.mktemp("beams")
    (folder / "deck.bdf").write_text(frame(), encoding="utf-8")
    (folder / "own.yaml").write_text(config(), encoding="utf-8")
    return folder


@pytest.fixture
def beams(folder) -> Path:
    """That folder, with the modes of the formula as its .f06."""
    (folder / "own.f06").write_text(f06(cantilever()), encoding="utf-8")
    return folder


def test_an_f06_with_the_modes_of_the_formula_agrees_at_the_modulus_of_the_deck(beams):
    code, said = compared(beams, str(beams / "own.f06"), "--json")
    assert code == 0, said
    rows = [json.loads(line) for line in said.splitlines()]
    assert [row["theirs"] for row in rows] == pytest.approx([own[0] for own in cantilever()], rel=1e-6)
    # the formula lacks the rotary inertia of the sections, which takes off less than I/A β², and four beams add 1e-3 at most
    rotary = MOMENTS["y"] / A * (ROOTS[1] / L) ** 2
    assert all(-rotary < row["off"] < 1e-3 for row in rows)
    assert min(row["mac"] for row in rows) > 0.9999


def test_modes_in_different_order_are_matched_by_shape(beams):
    second, first, *rest = cantilever()
    (beams / "own.f06").write_text(f06([first, (first[0] * 1.0001, *second[1:]), *rest]), encoding="utf-8")
    code, said = compared(beams, str(beams / "own.f06"), "--json")
    rows = [json.loads(line) for line in said.splitlines()]
    assert (code, [row["mode"] for row in rows]) == (3, [2, 1, 3, 4])


def test_modes_beyond_tolerance_have_exit_code_3(beams):
    softer = [(0.98 * f, shape, way) for f, shape, way in cantilever()]
    (beams / "own.f06").write_text(f06(softer, shapes=False), encoding="utf-8")
    code, said = compared(beams, str(beams / "own.f06"))
    assert code == 3
    assert "4 modes of the file and of the deck disagree: largest frequency difference 2.0" in said
    assert "the file has no mode shapes" in said
    code, said = compared(beams, str(beams / "own.f06"), "--tolerance", "3")
    assert code == 0
    assert "4 modes of the file and of the deck agree" in said


def test_a_file_that_shares_one_node_of_five_has_no_mac_and_its_foreign_nodes_are_named(beams):
    text = f06(cantilever()).replace(f"{5:14d}      G", f"{99:14d}      G")
    for node in (2, 3, 4):
        text = text.replace(f"{node:14d}      G", f"{node + 1000:14d}      G")
    (beams / "own.f06").write_text(text, encoding="utf-8")
    code, said = compared(beams, str(beams / "own.f06"))
    assert code == 0
    assert "nodes of the file that are not in the mesh and are omitted: 4 of 5, for example 99" in said
    assert "the MAC is not available: only 1 of the 5 nodes of the mesh" in said
    assert "mode shapes are not compared" in said


def test_rigid_body_modes_of_free_structure_are_omitted(tmp_path):
    beams = tmp_path
    (beams / "deck.bdf").write_text(frame(held="").replace("SPC = 1\n", ""), encoding="utf-8")
    (beams / "own.yaml").write_text(config(mesh=", free: true"), encoding="utf-8")
    none = np.zeros(5)
    rigid = [(1e-4 * i, none, "z") for i in range(1, 7)]
    (beams / "own.f06").write_text(f06(rigid, shapes=False), encoding="utf-8")
    code, said = compared(beams, str(beams / "own.f06"))
    assert code == 2
    assert "the file contains only rigid-body modes: 6 modes" in said
    free = 4.73004074486**2 / (2 * np.pi * L**2) * np.sqrt(E * MOMENTS["z"] / (RHO * A))  # cos βL cosh βL = 1
    (beams / "own.f06").write_text(f06([*rigid, (free, none, "y")], shapes=False), encoding="utf-8")
    code, said = compared(beams, str(beams / "own.f06"), "--json", "--tolerance", "5")
    assert code == 0, said
    assert [json.loads(line)["number"] for line in said.splitlines() if line.startswith("{")] == [7]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
def test_a_pipe_is_not_waited_for_and_an_unknown_ending_names_those_that_are_known(tmp_path):
    os.mkfifo(tmp_path / "a.f06")
    with pytest.raises(DeckError, match="is a pipe or a device, not a file"):
        modes_of_file(tmp_path / "a.f06", None)
    with pytest.raises(DeckError, match=r"\.f06, \.dat, \.frd"):
        modes_of_file(tmp_path / "a.txt", None)


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_calculix_agrees_on_the_same_bricks_by_its_dat_and_its_frd(tmp_path):
    """Quadratic bricks of both programs are the same but for the rule of their mass: 1e-5, as of the hub."""
    text = "\n".join(line for line in bricks((6, 2, 2), "hex20").splitlines() if not line.startswith("RBE2"))
    (tmp_path / "deck.bdf").write_text(text.replace(f"GRID,{TIP}", f"$GRID,{TIP}"), encoding="ascii")
    (tmp_path / "own.yaml").write_text(config(load="node: 2, direction: [0, 0, 1]"), encoding="utf-8")
    mesh = read_mesh(tmp_path / "deck.bdf")
    frd = calculix(tmp_path, mesh, [], 6)
    for file, shapes in ((frd, True), (frd.with_suffix(".dat"), False)):
        code, said = compared(tmp_path, str(file), "--tolerance", "0.01", "--mac", "0.99999", "--json")
        assert code == 0, said
        rows = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
        assert len(rows) == 6
        assert all((row["mac"] is not None) == shapes for row in rows)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.f06", "no modes\n", "no table R E A L"),
        ("a.f06", "        SOL 105\n", "buckling loads"),
        ("a.f06", "   B U C K L I N G   E I G E N V A L U E S\n", "buckling loads"),
        ("a.dat", "GRID,1\n", "no table E I G E N V A L U E"),
        ("a.f06", "R E A L   E I G E N V A L U E S\n 1 1 x.1 1. 1. 1. 1.\n", "'x.1' is not a finite number"),
        ("a.f06", "C O M P L E X   E I G E N V A L U E   S U M M A R Y\n", "complex eigenvalues"),
        ("a.dat", "E I G E N V A L U E   O U T P U T\n 1 1.E4 1. 1. 2.\n", "complex frequencies"),
        ("a.f06", "R E A L   E I G E N V A L U E S\0", "the file is not printed solver output"),
    ],
)
def test_file_without_modes_is_refused(tmp_path, name, text, words):
    (tmp_path / name).write_text(text, encoding="latin-1")
    with pytest.raises(DeckError, match=words):
        list(printed_modes(tmp_path / name))

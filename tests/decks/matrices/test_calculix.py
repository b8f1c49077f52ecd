"""Matrices that CalculiX 2.20 wrote of one C3D4, whose nodes 3 and 4 move: .sti, .mas and .dof."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.decks.matrices.files import read_matrix, read_numbering, symmetric
from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble
from strainsight_cli.main import app

DECK = """\
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, .25, .25, 1.
*ELEMENT, TYPE=C3D4, ELSET=E
1, 1, 2, 3, 4
*MATERIAL, NAME=S
*ELASTIC
2.1e11, .3
*DENSITY
7850.
*SOLID SECTION, ELSET=E, MATERIAL=S
*BOUNDARY
1, 1, 3
2, 1, 3
3, 1, 2
*STEP
*FREQUENCY, SOLVER=MATRIXSTORAGE
*END STEP
"""
DOF = "3.3\n4.1\n4.2\n4.3\n"
STI = """\
1 1  1.6406250000000e+10
1 2  0.0000000000000e+00
2 2  1.3461538461538e+10
1 3  1.3461538461538e+10
2 3  0.0000000000000e+00
3 3  1.3461538461538e+10
1 4 -1.1778846153846e+10
2 4  0.0000000000000e+00
3 4  0.0000000000000e+00
4 4  4.7115384615385e+10
"""
MAS = """\
1 1  8.1770833333333e+01
1 2  0.0000000000000e+00
2 2  8.1770833333333e+01
1 3  0.0000000000000e+00
2 3  0.0000000000000e+00
3 3  8.1770833333333e+01
1 4  8.1770833333333e+01
2 4  0.0000000000000e+00
3 4  0.0000000000000e+00
4 4  8.1770833333333e+01
"""


@pytest.fixture
def job(tmp_path):
    for ending, text in ((".inp", DECK), (".dof", DOF), (".sti", STI), (".mas", MAS)):
        (tmp_path / f"job{ending}").write_text(text)
    return tmp_path / "job.inp"


def test_stiffness_is_that_of_the_deck_and_mass_that_of_one_point(job):
    nodes, components = read_numbering(job.with_suffix(".dof"))
    K = read_matrix(job.with_suffix(".sti"))
    own = assemble(read_abaqus(job))[0].constant.toarray()
    at = 3 * (nodes - 1) + components
    assert np.allclose(K.toarray(), own[np.ix_(at, at)], rtol=1e-12, atol=1e-2)
    assert symmetric(K, job)[1] == 0.0
    expected = 7850 / 6 / 16 * np.equal.outer(components, components)
    assert np.allclose(read_matrix(job.with_suffix(".mas")).toarray(), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("ending", "text", "what"),
    [
        (".sti", STI + "2 1 0.0\n", "both triangles"),
        (".sti", STI.replace("4 4 ", "4 0 "), "not whole numbers from 1"),
        (".sti", "1 1\n", "not row, column and value"),
        (".sti", "1 1 1.\n1 2 x\n", r"job.sti:2.*'1 2 x' is not row, column and value"),
        (".sti", "1 1 1.\n1 nan 1.\n", "column nan of entry 2 are not whole numbers from 1"),
        (".sti", "", "the file is empty"),
        (".sti", "\n \n", "the file is empty"),
        (".dof", DOF + "5\n", "no node.component"),
        (".dof", DOF + "4.2\n", "node 4, component 2 is numbered twice"),
    ],
)
def test_what_is_no_matrix_of_calculix_is_refused(job, ending, text, what):
    path = job.with_suffix(ending)
    path.write_text(text)
    with pytest.raises(DeckError, match=what) as caught:
        read_numbering(path) if ending == ".dof" else read_matrix(path)
    assert str(path) in str(caught.value)


def test_exponents_with_d_are_numbers(job):
    K = read_matrix(job.with_suffix(".sti"))
    job.with_suffix(".sti").write_text(STI.replace("e", "D"))
    assert (read_matrix(job.with_suffix(".sti")) != K).nnz == 0


def test_init_writes_the_section_for_matrices_beside_the_deck(job, monkeypatch):
    monkeypatch.chdir(job.parent)
    options = ["--load", "node 4", "--direction", "0 0 1", "--amplitude", "1", "--frequency", "1"]
    assert CliRunner().invoke(app, ["init", "job.inp", *options]).exit_code == 0
    config = job.with_suffix(".yaml")
    text = config.read_text().replace("  # matrices:", "  matrices:").replace("    region: 1 ", "    # ")
    config.write_text(text)
    own = load_config(config).model.mesh.matrices
    assert own.numbering == "job.dof"
    assert [(term.file, term.parameter, term.at) for term in (*own.stiffness, *own.mass)] == [
        ("job.sti", "E", 2.1e11),
        ("job.mas", None, None),
    ]
    done = CliRunner().invoke(app, ["import", "job.yaml"])
    assert done.exit_code == 0, done.output

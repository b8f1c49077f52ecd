"""Files that hypothesis makes up: the smallest one that a reader does not bear is what it reports."""

from __future__ import annotations

import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strainsight.config.load import load_config
from strainsight.config.yaml_text import YamlProblem, parse
from strainsight.decks.text import LARGEST_ID, parse_integer, parse_real
from strainsight.errors import SPACES, UserError, printable
from strainsight.foreign.matrices.files import read_matrix

from .readers import fault_of
from .readers import read_deck as read_any_deck
from .seeds import ROOT

FEW = settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
CONFIG = (ROOT / "configs" / "cantilever-youngs-modulus.yaml").read_text("utf-8")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda below: st.lists(below, max_size=4) | st.dictionaries(st.text(max_size=6), below, max_size=4),
    max_leaves=12,
)
KEYS = ["kind", "name", "seed", "mesh", "parameters", "loads", "damping", "gauges", "place", "validate", "estimate"]
TOKENS = st.sampled_from(
    ["GRID", "CTETRA", "SPC1", "RBE2", "THRU", "INCLUDE", "'", "*", "+", "1", "1.-7", "", "$", "ENDDATA"]
)


@settings(FEW, max_examples=8)
@given(st.dictionaries(st.sampled_from(KEYS), JSON, max_size=4))
def test_any_values_below_the_keys_of_a_config(tmp_path_factory, values):
    path = tmp_path_factory.getbasetemp() / "made.yaml"
    path.write_text(json.dumps({"kind": "placement"} | values), "utf-8")
    assert fault_of(lambda path, _: load_config(path), path, 0) is None


@FEW
@given(st.sampled_from(["kind", "seed", "loads.tip.direction", "mesh.materials.x", "place.keep", "a.b.0"]), JSON)
def test_any_override_of_a_sound_config(tmp_path_factory, key, value):
    path = tmp_path_factory.getbasetemp() / "sound.yaml"
    path.write_text(CONFIG, "utf-8")
    assert fault_of(lambda path, _: load_config(path, [f"{key}={json.dumps(value)}"]), path, 0) is None


@FEW
@given(JSON)
def test_json_is_read_as_what_it_reports(value):
    with suppress(YamlProblem):
        assert parse(json.dumps({"a": value})).data == {"a": value}


@FEW
@given(st.text(max_size=200))
def test_any_text_is_yaml_or_has_a_place(text):
    found = None
    try:
        parse(text)
    except YamlProblem as problem:
        found = problem
    assert found is None or (found.line >= 1 and found.column >= 1)


@FEW
@given(st.lists(st.lists(TOKENS, max_size=10).map(",".join), max_size=12).map("\n".join))
def test_cards_of_any_words(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "made.bdf"
    path.write_text(text, "utf-8")
    assert fault_of(read_any_deck, path, 1) is None


@FEW
@given(st.text(max_size=12) | st.from_regex(r"[-+]?[0-9.]{1,8}[eEdD]?[-+]?[0-9]{0,5}", fullmatch=True))
def test_numbers_of_decks_are_finite_or_none(token):
    real, whole = parse_real(token), parse_integer(token)
    assert real is None or np.isfinite(real)
    assert whole is None or abs(whole) < LARGEST_ID


@FEW
@given(
    st.lists(st.tuples(st.integers(1, 4), st.integers(1, 4), st.floats(-1e9, 1e9)), max_size=12),
    st.integers(-1, 5), st.integers(-1, 5), st.sampled_from(["general", "symmetric"]),
)  # fmt: skip
def test_entries_of_a_matrix(tmp_path_factory, entries, rows, columns, kind):
    path = tmp_path_factory.getbasetemp() / "made.mtx"
    lines = "".join(f"{i} {j} {value!r}\n" for i, j, value in entries)
    path.write_text(f"%%MatrixMarket matrix coordinate real {kind}\n{rows} {columns} {len(entries)}\n{lines}")
    fits = rows > 0 and columns > 0 and all(i <= rows and j <= columns for i, j, _ in entries)
    if not fits or (kind == "symmetric" and rows != columns):
        with pytest.raises(UserError):
            read_matrix(path)
        return
    X = np.zeros((rows, columns))
    for i, j, value in entries:
        X[i - 1, j - 1] += value
        if kind == "symmetric" and i != j:
            X[j - 1, i - 1] += value
    np.testing.assert_allclose(read_matrix(path).toarray(), X, rtol=1e-12, atol=1e-6)


@FEW
@given(st.text(max_size=3000))
def test_a_message_shows_nothing_that_a_terminal_obeys(text):
    said = str(UserError(text, where=text, remedy=text))
    assert all(sign.isprintable() or sign in f"\n{SPACES}" for sign in said)
    assert len(printable(text)) <= 10 * 1500

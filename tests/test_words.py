"""The word list finds a word where readers meet it, at its line, and nowhere else."""

import importlib.util
import re
from pathlib import Path

import pytest

CI = Path(__file__).parents[1] / ".ci"


@pytest.fixture(scope="module")
def words():
    spec = importlib.util.spec_from_file_location("words", CI / "words.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def found(words, tmp_path):
    """What is found in one file with that text, as (line, word)."""

    def look(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return [(line, word) for _, line, word, _ in words.hits(tmp_path)]

    return look


def test_a_word_in_a_page_is_found_at_its_line_also_across_two(found):
    assert found("docs/a.md", "# A\nIt is sure and wrong.\nNothing is taken\nover.\n") == [
        (2, "sure and wrong"),
        (3, "taken over"),
    ]


def test_a_word_within_another_is_none(found):
    assert found("README.md", "He mends recommended amendments.\n") == [(1, "mends")]


def test_a_contract_is_left_alone(found):
    assert found("docs/a.md", "`/glued/distance` is how far a glued gauge was moved\n") == [(1, "glued")]


def test_of_the_changes_only_the_unreleased_ones_are_read(found):
    text = "# Changes\n## 2.0 (unreleased)\n- glued\n## 1.0\n- glued\n"
    assert found("CHANGELOG.md", text) == [(3, "glued")]


def test_of_source_comments_docstrings_and_texts_are_read(found):
    text = '"""Sure\nand wrong."""\nsure_and_wrong = f"{1} sure and wrong"  # sure and wrong\n'
    assert sorted(set(found("pipeline/p/a.py", text))) == [(1, "Sure and wrong"), (3, "sure and wrong")]


def test_names_are_read_where_the_list_says_so(found):
    assert found("pipeline/p/heard.py", "x = Heard_of(told, mended)\n") == [(1, "Heard"), (1, "heard"), (1, "told")]


def test_of_tests_the_names_are_read(found):
    assert found("tests/a/test_x.py", 'x = "glued"\ndef test_a_card_is_taken_over():\n    pass\n') == [
        (2, "taken over")
    ]


def test_no_replacement_is_itself_on_the_list(words):
    """It would never come to an end."""
    known = list(words.entries())
    assert 0 < len(known) <= 25
    for *_, write, _ in known:
        assert not any(word.search(write) for word, *_ in known), write


def test_hits_are_counted_by_word_and_by_package(words, tmp_path, monkeypatch, capsys):
    (tmp_path / "pipeline" / "p" / "decks").mkdir(parents=True)
    (tmp_path / "pipeline" / "p" / "decks" / "a.py").write_text("# glued\n# glued\n", encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["words.py", "--count"])
    assert words.main(tmp_path) is True
    printed = capsys.readouterr().out
    assert re.search(r"^ +2 +bond, bonded$", printed, re.MULTILINE)
    assert re.search(r"^ +2 +decks$", printed, re.MULTILINE)
    assert "2 to replace, in 1 files" in printed

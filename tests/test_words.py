"""The word list finds a word where readers meet it, at its line, and nowhere else."""

import subprocess

import pytest

from .shared import script


@pytest.fixture(scope="module")
def words():
    return script(".ci/words.py")


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("docs/a.md", "# A\nIt is sure and wrong.\nNothing is taken\nover.\n", [(2, "sure and wrong"), (3, "taken over")]),
        ("README.md", "He mends recommended amendments.\n", [(1, "mends")]),
        ("docs/a.md", "`/glued/distance` is how far a glued gauge was moved\n", [(1, "glued")]),
        ("CHANGELOG.md", "# Changes\n## 2.0 (unreleased)\n- glued\n## 1.0\n- glued\n", [(3, "glued")]),
        ("pipeline/p/a.py", '"""Sure\nand wrong."""\nx_sure_and_wrong = f"{1} glued"\n', [(1, "Sure and wrong"), (3, "glued")]),
        ("pipeline/p/heard.py", "x = Heard_of(told, mended)\n", [(1, "Heard"), (1, "heard"), (1, "told")]),
        ("tests/a/test_x.py", 'x = "glued"\ndef test_a_card_is_taken_over():\n    pass\n', [(2, "taken over")]),
    ],
    ids=["page, across lines", "within a word", "code", "unreleased", "texts of source", "names", "names of tests"],
)  # fmt: skip
def test_word_is_found_at_its_line(words, tmp_path, name, text, found):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    assert [(line, word) for _, line, word, _ in words.hits(tmp_path)] == found


def test_changed_files_are_those_of_the_last_commit_and_of_the_work_since(words, tmp_path):
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]

    def commit(*names):
        for name in names:
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(f"glued {len(names)}\n", encoding="utf-8")
        for command in (["add", "-A"], ["commit", "-qm", "x"]):
            subprocess.run([*git, *command], cwd=tmp_path, check=True)

    assert words.changed(tmp_path) is None
    subprocess.run([*git, "init", "-q"], cwd=tmp_path, check=True)
    commit("README.md", "OLD.md", "docs/a.md")
    assert words.changed(tmp_path) is None
    commit("README.md")
    (tmp_path / "docs" / "a.md").write_text("bonded\n", encoding="utf-8")
    (tmp_path / "NEW.md").write_text("glued\n", encoding="utf-8")
    assert words.changed(tmp_path) == {"README.md", "docs/a.md", "NEW.md"}
    assert [name for name, *_ in words.hits(tmp_path, words.changed(tmp_path))] == ["NEW.md", "README.md"]
    commit(".ci/words.toml")
    assert words.changed(tmp_path) is None

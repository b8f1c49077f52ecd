"""Find words of this project's own in what its readers read: `file:line: word → replacement`; ends with 1 where there is one.

The list is .ci/words.toml. Read are the manual, the first pages, the changes of the unreleased version, and of pipeline/ and
cli/ what is no code: comments, docstrings, texts. Of tests it is their names. --count prints hits by word and by package.
--changed reads the files alone that the last commit or the work since has changed, and all if the list itself has.
"""

import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

LIST = Path(__file__).with_name("words.toml")
GENERATED = ("docs/config/", "docs/history/")
TEXT = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", None)}


def entries():
    """(word, exceptions, replacement, whether names count) of the list; a space is any white space."""
    for entry in tomllib.loads(LIST.read_text(encoding="utf-8"))["entry"]:
        word = entry["word"].replace(" ", r"\s+")
        exceptions = "|".join(entry.get("except", [])) or r"(?!)"
        yield (
            re.compile(rf"(?<!\w)(?:{word})(?!\w)", re.IGNORECASE),
            re.compile(exceptions),
            entry["write"],
            entry.get("names", False),
        )


def unreleased(path, text):
    """The changes up to the heading of a version that is out."""
    headings = (found for found in re.finditer(r"^## .*$", text, re.MULTILINE) if "unreleased" not in found[0])
    return [(1, text[: next((found.start() for found in headings), None)], False)]


def words_of(name):
    """`aName_of` as "a Name of"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_+", " ", name).strip()


def source(path, text):
    """Comments, texts and names of Python source."""
    yield 1, words_of(path.stem), True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in TEXT:
            yield token.start[0], token.string, False
        elif token.type == tokenize.NAME:
            yield token.start[0], words_of(token.string), True


def names_of_tests(path, text):
    """The name of a file of tests, and those of its tests, as text."""
    yield 1, words_of(path.stem), False
    for number, line in enumerate(text.splitlines(), start=1):
        if name := re.match(r"def (test_\w+)", line):
            yield number, words_of(name[1]), False


def whole(path, text):
    return [(1, text, False)]


READERS = {
    "*.md": lambda path, text: (unreleased if path.name == "CHANGELOG.md" else whole)(path, text),
    "docs/**/*.md": whole,
    "pipeline/**/*.js": whole,
    "pipeline/**/*.py": source,
    "cli/**/*.py": source,
    "tests/**/test_*.py": names_of_tests,
}


def changed(root):
    """Files that the last commit or the work since has changed; None, which is all, without Git or if the list has."""
    names = set()
    for command in ("diff --name-only --relative HEAD~1", "ls-files --others --exclude-standard"):
        done = subprocess.run(["git", *command.split()], cwd=root, capture_output=True, text=True)
        if done.returncode:
            return None
        names.update(done.stdout.splitlines())
    return None if {".ci/words.py", ".ci/words.toml"} & names else names


def hits(root, names=None):
    """(file, line, what stands there, replacement), every one, in order; names: of the files that are read, or all."""
    known, found = list(entries()), set()
    likely = re.compile("|".join(f"(?:{word.pattern})" for word, *_ in known), re.IGNORECASE)

    @cache
    def words_in(text, is_name):
        """(place in a text, what stands there, replacement); most texts have none, and most names are there many times."""
        if not likely.search(text):
            return ()
        return tuple(
            (hit.start(), " ".join(hit[0].split()), write)
            for word, exceptions, write, names in known
            for hit in (word.finditer(text) if names or not is_name else ())
            if not any(start <= hit.start() and hit.end() <= end for start, end in map(re.Match.span, exceptions.finditer(text)))
        )

    for pattern, reader in READERS.items():
        for path in root.glob(pattern):
            name = path.relative_to(root).as_posix()
            if not name.startswith(GENERATED) and (names is None or name in names):
                for first, text, is_name in reader(path, path.read_text(encoding="utf-8")):
                    for at, word, write in words_in(text, is_name):
                        found.add((name, first + text.count("\n", 0, at), word, write))
    return sorted(found)


def package(name):
    """`pipeline/strainsight/decks/x.py` → `decks`; other files by their first folder."""
    parts = name.split("/")
    return parts[2] if parts[0] == "pipeline" and len(parts) > 3 else parts[0]


def main(root):
    names = changed(root) if "--changed" in sys.argv else None
    found = hits(root, names)
    if "--count" in sys.argv:
        for by in (lambda hit: hit[3], lambda hit: package(hit[0])):
            for what, count in Counter(map(by, found)).most_common():
                print(f"{count:6d}  {what}")
            print()
    else:
        for name, number, word, write in found:
            print(f"{name}:{number}: {word} → {write}")
    read = "" if names is None else ", of those that were changed"
    print(f"words: {len(found)} to replace, in {len({hit[0] for hit in found})} files{read}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(Path(__file__).resolve().parents[1]))

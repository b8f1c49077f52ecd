"""What is no YAML is refused at its line with what to do about it."""

from __future__ import annotations

import pytest

from strainsight.config.yaml_text import YamlProblem, parse


@pytest.mark.parametrize(
    ("text", "line", "remedy"),
    [
        ("a:\n  b: 1\n\tc: 2\n", 3, "with spaces, not with tabs"),
        ("a:\t1\n", 1, "with spaces, not with tabs"),
        ("a:\n    b: 1\n  c: 2\n", 3, "indent it exactly as its neighbours above"),
        ("a:\n  - 1\n  b: 2\n", 3, "indent it exactly as its neighbours above"),
        ("a:\n  b: 1\n    c: 2\n", 3, "indent it exactly as its neighbours above"),
        ("a: b: c\n", 1, "': ' in quotes"),
        ("a: 1\nb 2\nc: 3\n", 3, "KEY: VALUE in the line above"),
        ("a: [1, 2\nb: 3\n", 2, "close the bracket"),
        ("a: {b: 1\nc: 2\n", 2, "close the bracket"),
        ("a: 'x\nb: 1\n", 3, "close the quotes"),
        ("a: %b\n", 1, "put the value in quotes"),
        ("a: *b\n", 1, "put the value in quotes"),
        ('a: "C:\\data"\n', 1, "single quotes"),
    ],
)
def test_a_mistake_has_a_line_and_a_remedy(text, line, remedy):
    with pytest.raises(YamlProblem, match="not valid YAML") as caught:
        parse(text)
    assert caught.value.line == line
    assert remedy in caught.value.remedy

"""The same card says the same in every format, and nothing of it is lost."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from pyyeti import nastran

from strainsight.decks.nastran.cards import read_deck
from strainsight.decks.nastran.deck import read_nastran
from strainsight.decks.text import parse_integer, parse_real, read_bytes
from strainsight.errors import DeckError

from ...refusals import expect_refusal, refusal_table


@pytest.fixture
def cards(tmp_path):
    def of(text: str):
        path = tmp_path / "deck.bdf"
        path.write_text(text, newline="")
        return read_deck(path)

    return of


HEXA = ["71", "4", *(str(i) for i in range(101, 121))]
FIRST, SECOND, THIRD = HEXA[:8], HEXA[8:16], HEXA[16:]


def fixed(tokens: list[str], width: int) -> str:
    return "".join(token.rjust(width) for token in tokens)


def large(head: str, tail: str, join) -> str:
    return "".join((tail if i else head) + join(HEXA[i : i + 4]) + "\n" for i in range(0, 22, 4))


FREE = [",".join(tokens) for tokens in (FIRST, SECOND, THIRD)]
FORMATS = {
    "small field": f"CHEXA   {fixed(FIRST, 8)}+A1\n+A1     {fixed(SECOND, 8)}\n        {fixed(THIRD, 8)}\n",
    "large field": large("CHEXA*  ", "*       ", lambda tokens: fixed(tokens, 16)),
    "free field": f"CHEXA,{FREE[0]},+\n+,{FREE[1]}\n,{FREE[2]}\n",
    "free large field": large("CHEXA*,", "*,", ",".join),
    "mixed": f"chexa*  {fixed(FIRST[:4], 16)}\n*       {fixed(FIRST[4:], 16)}\n+,{FREE[1]}\n,{FREE[2]}\n",
    "comments between": f"CHEXA,{FREE[0]} $ first\n$ a comment\n\n+,{FREE[1]}\n$\n+,{FREE[2]}\n",
    "tabs": "CHEXA\t" + "\t".join(FIRST) + "\n\t" + "\t".join(SECOND) + "\n\t" + "\t".join(THIRD) + "\n",
    "line ends of another system": f"CHEXA,{FREE[0]}\r\n+,{FREE[1]}\r\n+,{FREE[2]}\r\n",
}


ELEVEN = ["100", "12456", *(str(i) for i in range(1, 11))]
SAME = [
    *(("CHEXA", text, HEXA) for text in FORMATS.values()),
    # fields beyond the eighth are on the next line
    ("SPC1", "SPC1,100,12456,1,2,3,4,5,6,7,8,9,10\n", ELEVEN),
    ("SPC1", "SPC1,100,12456,1,2,3,4,5,6,+,+,7,8,9,10\n", ELEVEN),
    ("SPC1", "SPC1,100,12456,1,2,3,4,5,6,+S,+S,7,8,9,10\n", ELEVEN),
    ("SPC1", "SPC1,100,12456,1,2,3,4,5,6,+S\n+S,7,8,9,10\n", ELEVEN),
    ("SPC1", "SPC1,100,12456,1,2,3,4,5,6,7,\n8,9,10\n", ELEVEN),
    ("SPC1", "spc1*,100,12456,1,2,3,4,5,6,7,8,9,10\n", ELEVEN),
    ("SPC1", "SPC1*,100,12456,1,2,*,*,3,4,5,6\n,7,8,9,10,,,,,,,\n", ELEVEN),
    (
        "GMCURV",
        "GMCURV, 1, P, 0\n        EQUATION, 0.0, 201,\n        206, 207\n",
        ["1", "P", "0", *[""] * 5, "EQUATION", "0.0", "201", *[""] * 5, "206", "207"],
    ),
]


@pytest.mark.parametrize(("name", "text", "fields"), SAME)
def test_every_format_gives_the_same_fields(cards, name, text, fields):
    (card,) = cards(f"BEGIN BULK\n{text}ENDDATA\n").cards[name]
    assert [*card.tokens[: len(fields)], *filter(None, card.tokens[len(fields) :])] == fields
    assert card.line == 2


@pytest.mark.parametrize(
    ("token", "value"),
    [
        ("1.7-4", 1.7e-4), ("1.7+4", 1.7e4), ("-1.7-4", -1.7e-4), ("1.7D4", 1.7e4), ("1.7e-4", 1.7e-4), (".5", 0.5),
        ("+3.", 3.0),
    ],
)
def test_reals_are_read_in_all_nastran_forms(token, value):
    assert parse_real(token) == value
    assert parse_real(token) == nastran.nas_sscanf(token)


@pytest.mark.parametrize("token", ["", "abc", "nan", "inf", "1_0", "1.2.3", "THRU", "1-", "1.5 3"])
def test_invalid_numbers_are_none(token):
    assert parse_real(token) is None


def test_reals_are_not_truncated_to_integers():
    assert parse_integer("12") == 12
    assert parse_integer("1.") is None
    assert parse_integer("1_2") is None


HEADS = {
    "statements": "NASTRAN SYSTEM(442)=-1, BUFFSIZE=65537\nASSIGN OUTPUT2='a,b.op2', UNIT=12\nID A,B\nTIME 5\nDIAG 8,13\n",
    "rulers": "$ 1 | 2 |\n$\n\n   $ indented\n",
    "file management": "INIT MASTER(S)\nACQUIRE NDDL\nCOMPILE SEMODES SOUIN=MSCSOU\nALTER 'BEGIN' $\nENDALTER\n",
    "a byte-order mark": "\ufeffNASTRAN NLINES=9999\n",
    "tabs": "\tSOL\t103\n",
    "an alter that is not there": "INCLUDE 'of_the_site.alter'\nINCLUDE '/etc/hostname'\n",
}


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("begin", ["BEGIN BULK", "\tbegin  bulk $ model", "BEGIN", "BEGIN BULK=0"])
def test_executive_and_case_control_are_not_cards(read, tetrahedron, head, begin):
    mesh = read(f"{HEADS[head]}SOL 103\nCEND\nTITLE = A, B\n  SPC = 1\n{begin}\n{tetrahedron}ENDDATA\n")
    assert (list(mesh.node_ids), mesh.notes, mesh.ignored) == ([1, 2, 3, 4], (), {})


def test_include_name_may_span_lines(tmp_path, read, tetrahedron):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "all.bdf").write_text(tetrahedron)
    mesh = read("BEGIN BULK\nINCLUDE 'parts/\n        all.bdf' $ a comment\nENDDATA\n")
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    with pytest.raises(DeckError, match="zero"):  # what follows keeps its line
        read("BEGIN BULK\nINCLUDE 'parts/\n        all.bdf'\nGRID,5,,zero\nENDDATA\n")


@pytest.mark.parametrize(("mark", "head"), [("CORD1", "+ORD1"), ("+A1", "+A1"), ("A1", "+A1"), ("", "+A1")])
def test_continuation_mark_ignores_column_1(cards, mark, head):
    deck = cards("BEGIN BULK\n" + "CORD2C  1".ljust(64) + "      1." + mark.ljust(8) + f"\n{head.ljust(8)}      1.\nENDDATA\n")
    (card,) = deck.cards["CORD2C"]
    assert card.tokens[7:9] == ["1.", "1."]


def line(head: str, *fields: str, mark: str = "") -> str:
    return head.ljust(8) + "".join(field.rjust(8) for field in fields).ljust(64) + mark + "\n"


MASS, HELD = ["703", "703", "", "3."], ["1", "23", "1", "5", "9"]


@pytest.mark.parametrize(
    "after",
    [
        line("+M1", ".02", "", ".03") + line("+S1", "702"),
        line("+S1", "702") + "$ a remark\n" + line("+M1", ".02", "", ".03"),
        "+m1,.02,,.03\n+s1,702\n",
        "SPC1,3,1,704\n*M1,.02,,.03\n+S1,702\n",
    ],
)
def test_continuations_are_matched_by_mark(cards, after):
    head = line("CONM2", *MASS, mark="+M1") + line("SPC1", *HELD, mark="+S1") + "SPC1,2,1,703\n"
    deck = cards("BEGIN BULK\n" + head + after + "SPC1,1,123456,701\nENDDATA\n").cards
    assert [own for own in deck["CONM2"][0].tokens if own] == ["703", "703", "3.", ".02", ".03"]
    assert deck["CONM2"][0].real(8, "I11") == 0.02
    assert deck["CONM2"][0].real(10, "I22") == 0.03
    assert [own for own in deck["SPC1"][0].tokens if own] == [*HELD, "702"]
    assert deck["SPC1"][1].tokens == ["2", "1", "703", *[""] * 5]


test_marks_without_their_other_end_or_with_two_are_named = refusal_table(str, [
    (line("CONM2", *MASS, mark="+M1") + line("SPC1", *HELD) + line("+M2", ".02"), "no line ends in this mark", 3),
    (line("CONM2", *MASS, mark="+M1") + line("SPC1", *HELD), r"continuation mark '\+M1', but no line begins with this mark", 1),
    (line("CONM2", *MASS, mark="+M1") * 2 + "GRID,1\n" + line("+M1", ".02"), "move this line directly below the line", 4),
    (line("CONM2", *MASS, mark="+M1") + line("", ".02") + line("+M1", ".02"), "both continue the line", 3),
    ("GRID,1\n=,*1,==\n,2\n", "the continuation has no preceding card", 3),
])


def test_repeated_marks_are_allowed_in_order(cards):
    pair = line("CONM2", *MASS, mark="+1") + line("+1", ".02")
    assert [card.text(8) for card in cards(pair * 3).cards["CONM2"]] == [".02"] * 3
    numbered = line("CONM2", *MASS, mark="00000010") + line("", ".02", mark="00000020") + line("SPC1", *HELD, mark="00000030")
    assert cards(numbered).cards["CONM2"][0].text(8) == ".02"


def test_grid_with_surplus_fields_is_refused(read, tetrahedron):
    with expect_refusal(DeckError, "more than 8 data fields", where=":3"):
        read(tetrahedron.replace("GRID,3,,0.,1.,0.", "GRID,3,,0.,1.,0.,0,0,0,1"))


@pytest.mark.parametrize(
    "lines",
    [
        "=,*(1),=,*(0.2),==\n=(3)\n",
        "=,*1,=,*.2,==\n=3\n",
        "=       *(1)    =       *(0.2)  ==\n=(3)\n",
        "=,*1,=,*2.-1,=,,=,=\n$ between\n=,*1,=,*.2,==\n=2\n",
    ],
)
def test_replicated_cards_are_expanded(cards, lines):
    """The example of the manual: five nodes 0.2 apart."""
    deck = cards(f"GRID,101,17,1.0,10.5,,17,3456\n{lines}GRID,9,,3.\n").cards["GRID"]
    assert [card.tokens[0] for card in deck] == ["101", "102", "103", "104", "105", "9"]
    np.testing.assert_allclose([card.real(2, "X") for card in deck[:5]], 1 + 0.2 * np.arange(5), rtol=1e-15)
    assert {tuple(card.tokens[i] for i in (1, 3, 4, 5, 6, 7)) for card in deck[:5]} == {("17", "10.5", "", "17", "3456", "")}
    assert deck[-1].tokens[:3] == ["9", "", "3."]
    assert cards("GRID,1\n=,*1,*1\n=(2)\n").cards["GRID"][3].tokens[:2] == ["4", "3"]  # a blank field counts from zero
    assert deck[0].line == 1
    assert deck[1].line == 2


def test_case_control_is_not_bulk_data_and_enddata_ends(cards):
    deck = cards("SOL 103\nCEND\nSPC = 1\nBEGIN BULK\nGRID,1\nENDDATA\nGRID,2\nGRID,3\n")
    assert [card.tokens[0] for card in deck.cards["GRID"]] == ["1"]
    assert [line.text for line in deck.case_control] == ["SOL 103", "CEND", "SPC = 1"]
    assert deck.after_end == 2


test_a_line_that_cannot_be_taken_is_named = refusal_table(str, [
    ("+,1,2\n", "the continuation has no preceding card", 1),
    ("GRID,1\n  GRID  2       0.\n", "column 1", 2),
    ("=,*1,=\n", "which must have exactly one line", 1),
    ("SET3,1,GRID\n=,*1,*1\n", "cannot be added to 'GRID'", 2),
    ("GRID,1\n=,*1,==\n=9\n=999999\n", "number of replicated cards to 1000009", 4),
    ("SOL 103\nCEND\nGRID,1\n", "found 'SOL 103', but BEGIN BULK is missing", 1),
    ("BEGIN BULK\nGRID,1\nBEGIN SUPER = 2\nGRID,2\n", "superelements", 3),
    ("BEGIN BULK\nENDDATA\n", "no bulk data", "deck.bdf"),
    ("INCLUDE 'there_is_none.bdf'\n", "no such file\n", 1),
    ("INCLUDE '$HOME/grids.bdf'\n", "; ~, variables and SYMBOL:file are not expanded", 1),
    ("INCLUDE 'deck.bdf'\n", "includes itself", 1),
])


@pytest.mark.parametrize(
    ("text", "line"),
    [("BEGIN BULK\nGRID,1\nGRID,2,,0.", 3), ("SOL 103\nCEND\nBEGIN BULK\nGRID,1\n\n", 4)],
)
def test_a_deck_without_enddata_is_refused_at_its_last_line(read, text, line):
    with expect_refusal(DeckError, "ENDDATA is missing: the deck may be truncated", where=f"deck.bdf:{line}") as caught:
        read(text)
    assert caught.value.remedy.endswith("mesh.ignore: [MISSING ENDDATA]")


def test_ignored_missing_enddata_is_noted_with_last_line(read, tetrahedron):
    mesh = read(f"SOL 103\nCEND\nBEGIN BULK\n{tetrahedron}", ignore=["missing enddata"])
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    (note,) = mesh.notes
    assert "selects no supports" in mesh.doubts[0]
    assert note.startswith("the deck has no ENDDATA, so check that the deck is complete; its last line is 'SPC1,1,123,1,2,3' (")
    assert mesh.unsupported["MISSING ENDDATA"].endswith("deck.bdf:11")
    assert read(f"BEGIN BULK\n{tetrahedron}ENDDATA\n", ignore=["MISSING ENDDATA"]).notes == ()


@pytest.mark.parametrize(
    ("content", "what"),
    [(b"", "empty"), (b" \n\n", "empty"), (b"GRID\0\0\x01\xff", "binary"), (b"$ only a comment\n", "no bulk data")],
)
def test_files_without_a_deck_are_refused(read, content, what):
    with pytest.raises(DeckError, match=what):
        read(content)


def test_compressed_files_and_includes_are_unpacked(tmp_path, tetrahedron):
    grids, rest = tetrahedron.split("CTETRA")
    (tmp_path / "grids.bdf.gz").write_bytes(gzip.compress(grids.encode()))
    deck = gzip.compress(f"BEGIN BULK\nINCLUDE 'grids.bdf.gz'\nCTETRA{rest}ENDDATA\n".encode())
    (tmp_path / "deck.bdf.gz").write_bytes(deck)
    mesh = read_nastran(tmp_path / "deck.bdf.gz")
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    assert mesh.where("node", 3) == f"{tmp_path / 'grids.bdf.gz'}:3"
    (tmp_path / "deck.bdf.gz").write_bytes(deck[:-20])
    with pytest.raises(DeckError, match="cannot be unpacked"):
        read_nastran(tmp_path / "deck.bdf.gz")


@pytest.mark.parametrize("sign", ["\x85", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e"])
def test_comment_ends_with_its_line(read, tetrahedron, sign):
    content = f"$ Nabe {sign}GRID,9,,9.,9.,9.\r\n{tetrahedron}".encode("latin-1")
    mesh = read(content)
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    assert mesh.where("node", 4).endswith(":5")


def test_an_include_after_the_end_is_not_opened(read, tetrahedron, tmp_path):
    mesh = read(f"BEGIN BULK\n{tetrahedron}ENDDATA\nINCLUDE 'none.bdf'\n")
    assert mesh.ignored == {"lines after ENDDATA": 1}
    (tmp_path / "end.bdf").write_text(f"{tetrahedron}ENDDATA\n")
    mesh = read("BEGIN BULK\nINCLUDE 'end.bdf'\nINCLUDE 'none.bdf'\n")
    assert list(mesh.node_ids) == [1, 2, 3, 4]
    assert mesh.included == (str(tmp_path / "end.bdf"),)


def test_compressed_deck_above_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("strainsight.decks.text.LARGEST", 999)
    path = tmp_path / "deck.bdf.gz"
    path.write_bytes(gzip.compress(b"GRID,1\n" + b"$" * 992))
    assert len(read_bytes(path)) == 999
    path.write_bytes(gzip.compress(b"GRID,1\n" + b"$" * 993))
    with pytest.raises(DeckError, match="the unpacked file is larger than 4 GiB"):
        read_bytes(path)


def test_excessive_includes_are_refused(cards, tmp_path):
    """Sixteen files that each take in the next one twice are 65 000; a hundred in a row were too deep for Python."""
    for i in range(120):
        (tmp_path / f"twice{i}.bdf").write_text(f"INCLUDE 'twice{i + 1}.bdf'\n" * 2)
        (tmp_path / f"row{i}.bdf").write_text(f"INCLUDE 'row{i + 1}.bdf'\n")
    for name in ("twice", "row"):
        with pytest.raises(DeckError, match="nested 17 levels"):
            cards(f"GRID,1\nINCLUDE '{name}0.bdf'\n")
    (tmp_path / "twice10.bdf").write_text("GRID,2\n")
    with pytest.raises(DeckError, match="included 101 times"):
        cards("GRID,1\nINCLUDE 'twice0.bdf'\n")

"""CSV tables of strangers: separators, comments and decimal commas, and what is no number and no table."""

from __future__ import annotations

from pathlib import Path

import pytest

from das.domain.errors import DasError
from precompute.foreign_text import read_csv


@pytest.mark.parametrize(
    ("text", "rows", "numbers"),
    [
        ("# by hand\na,b\n\n  # more\n1, 2.5\n", [(2, ["a", "b"]), (5, ["1", "2.5"])], [1.0, 2.5]),
        ("a;b\r\n-,5;1e3\r\n", [(1, ["a", "b"]), (2, ["-,5", "1e3"])], [-0.5, 1000.0]),
        ('a\tb\n"1\t2"\t3.\n', [(1, ["a", "b"]), (2, ["1\t2", "3."])], [None, 3.0]),
        # Commas separate cells: one in a cell is no decimal sign, it may as well group digits.
        ('a,b\n"1,500",٣\n', [(1, ["a", "b"]), (2, ["1,500", "٣"])], [None, None]),
        ("a,b\nnan,1.2.3\n", [(1, ["a", "b"]), (2, ["nan", "1.2.3"])], [None, None]),
    ],
)
def test_rows_have_their_lines_and_cells_are_numbers_or_not(
    text: str, rows: list[tuple[int, list[str]]], numbers: list[float | None], tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    table = read_csv(tmp_path / "t.csv", 1000, "anything")
    assert table.rows == rows
    assert [table.number(cell) for cell in rows[-1][1]] == numbers


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n", "t.csv: empty, expected a header"),
        ('a,b\n1,"2\n', "t.csv: not a usable CSV file (unexpected end of data)"),
        ("a,b\n" + 1000 * "1,2\n", "t.csv: more than 0.001 MB"),
    ],
)
def test_what_is_no_table_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DasError) as caught:
        read_csv(tmp_path / "t.csv", 1000, "a header")
    assert message in str(caught.value)

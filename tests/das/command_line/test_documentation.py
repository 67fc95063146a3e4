"""The page of commands names every command and every option of the three programs, as the programs have them."""

from __future__ import annotations

import pytest

from tests.support.command_tables import BLOCK, PAGE, commands, with_tables


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def test_every_command_has_a_part_of_the_page(page: str) -> None:
    assert [block["command"] for block in BLOCK.finditer(page)] == list(commands())


def test_the_tables_say_what_the_help_says(page: str) -> None:
    """After a change of options or their help: python -m tests.support.command_tables writes the tables anew."""
    assert with_tables(page, commands()) == page


def test_the_head_of_the_page_explains_the_options_that_every_command_has(page: str) -> None:
    head = page[: page.index("<!-- options")]
    assert all(f"`{option}`" in head for option in ("-h", "--help", "--version", "--install-completion"))

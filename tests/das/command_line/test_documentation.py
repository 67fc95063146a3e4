"""The page of commands has a table for each command of the programs, and explains what all of them share."""

from __future__ import annotations

import re

from docs.studies.reference import EVERYWHERE, commands
from tests.support.making import REPOSITORY


def test_the_page_asks_for_the_options_of_every_command_in_order() -> None:
    page = (REPOSITORY / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"docs\.studies\.reference -> ([\w-]+)\.md", page) == list(commands())
    assert [option for option in EVERYWHERE if f"`{option}`" not in page[: page.index("{{")]] == []

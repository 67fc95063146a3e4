"""The page of commands asks for the commands of each program, and explains what all of them share."""

from __future__ import annotations

import re

from docs.studies.reference import EVERYWHERE, PROGRAMS, commands, program
from tests.support.making import REPOSITORY


def test_the_page_asks_for_every_program_and_explains_what_they_share() -> None:
    page = (REPOSITORY / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"docs\.studies\.reference -> ([\w-]+)\.md", page) == list(PROGRAMS)
    assert [option for option in EVERYWHERE if f"`{option}`" not in page[: page.index("{{")]] == []


def test_every_command_has_its_heading() -> None:
    headings = re.findall(r"^### (.*)$", "\n".join(map(program, PROGRAMS)), re.MULTILINE)
    assert [one.replace(" ", "-") for one in headings] == list(commands())

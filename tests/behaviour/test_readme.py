"""The command lines of README.md and of the tutorials work, one after the other, in an empty folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

import precompute.cli.program
import sim.cli.program
from tests.support.making import REPOSITORY, das_precompute, das_sim

PAGES = ("README.md", "docs/tutorials/own-line.md", "docs/tutorials/first-replay.md")
ELSEWHERE = ("pytest", "das-node")
"""Programs of other tests: the tests themselves, and the node, which runs until it is stopped."""
WRITTEN = (
    "my-line/there.png", "my-line/posts.csv", "my-line/run.png", "my-line/tables/build.json", "run.png",
    "tables/build.json", "zug-luzern.png",
)  # fmt: skip
"""Files that the commands of all pages leave behind, beside recordings."""


def lines(page: str) -> list[list[str]]:
    """The words after `uv run` of every command line in a page's blocks of commands, without those run elsewhere."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    found = [line.split("uv run ", 1)[1] for block in blocks for line in block.splitlines() if "uv run " in line]
    words = [shlex.split(line, comments=True) for line in found]
    return [one for one in words if one[0] not in ELSEWHERE]


def run(words: list[str], folder: Path) -> str:
    """Run a command line in a folder as the page says it; what it printed."""
    program, *arguments = words
    guided = next(iter((folder / "recordings").glob("replay-*-guide.mcap")), folder)
    named = {
        "recordings/replay-….mcap": str(guided).replace("-guide", ""),
        "recordings/replay-…-guide.mcap": str(guided),
    }
    arguments = [named.get(one, one) for one in arguments]
    if arguments[:1] == ["view"] and "--save" not in arguments:  # a machine that tests has no display
        arguments += ["--save", "seen.rrd"]
    assert program in ("das-sim", "das-precompute"), words
    done = das_sim(*arguments, cwd=folder) if program == "das-sim" else das_precompute(folder, *arguments)
    assert done.returncode == 0, f"{shlex.join(words)}: {done.stderr}"
    return done.stdout


@pytest.mark.slow
def test_the_command_lines_of_readme_work(tmp_path: Path) -> None:
    """But `das-sim` alone, which test_replay.py runs at each commit, and a minute of building tables."""
    commands = [words for words in lines("README.md") if len(words) > 1 and "build" not in words]
    assert len(commands) >= 4
    for words in commands:
        assert run(words, tmp_path), words


@pytest.mark.nightly
def test_every_command_line_of_the_pages_works(tmp_path: Path) -> None:
    """One folder for all pages; a command that two pages have is run once."""
    commands = {shlex.join(words): words for page in PAGES for words in lines(page)}
    assert len(commands) >= 15
    for words in commands.values():
        assert run(words, tmp_path), words
    assert [name for name in WRITTEN if not (tmp_path / name).is_file()] == []
    assert list((tmp_path / "recordings").glob("*.mcap"))


COMMAND = re.compile(r"^ *(?:uv run )?(das-(?:sim|precompute)(?: .*)?)$", re.MULTILINE)
PROGRAMS = {"das-sim": sim.cli.program.app, "das-precompute": precompute.cli.program.app}


def test_every_command_line_of_all_pages_is_one_that_the_programs_read() -> None:
    """Commands, options and the kinds of their values, without running them: a renamed option is found in a second."""
    read = 0
    for page in (REPOSITORY / "README.md", *(REPOSITORY / "docs").rglob("*.md")):
        for line in COMMAND.findall(page.read_text(encoding="utf-8")):
            program, *words = shlex.split(line, comments=True)
            command: Any = PROGRAMS[program]
            context = typer.Context(command)
            while words and hasattr(command, "get_command"):
                command = command.get_command(context, words[0])
                assert command is not None, f"{page}: {line}"
                context = command.make_context(words.pop(0), list(words))
            read += 1
    assert read >= 100


def test_every_page_has_command_lines() -> None:
    assert [page for page in PAGES if len(lines(page)) < 5] == []

"""Marks in the pages: which command made a figure and, where that takes long, with which code and when.

A mark stands on the line before a table, a picture or a link to a report, and holds up to the next empty line:

    <!-- made by: COMMAND -->                                  the default tests make it, or a part of it, again
    <!-- made by: COMMAND; code: 0123abcd; on: 2026-11-26 -->  made by hand, because it takes long

`python -m docs.studies.made_by` lists the figures made by hand whose code has changed since, and
`python -m docs.studies.made_by --make-all` makes them again, one command after the other (two hours on two free cores).
After a command was run alone, `--stamp COMMAND` writes today's code and date; `write_table` does so by itself.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import io
import re
import shlex
import subprocess
import sys
import tokenize
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from das.domain.errors import DasError
from das.domain.files.writing import write_whole

ROOT: Final = Path(__file__).resolve().parents[2]
SOLVER: Final = ("das/domain", "das/solver")
DAY: Final = (*SOLVER, "das/advice", "das/cab", "das/estimate", "sim/plant", "sim/drivers", "sim/world")
"""The code that decides how a simulated day goes. What reads options, draws, records or sends is not in it."""
DEPENDS_ON: Final[dict[str, tuple[str, ...]]] = {
    "python -m docs.studies.bundled": (*DAY, "sim/experiment"),
    "python -m docs.studies.exact_front": (*SOLVER, "precompute/exact"),
    "python -m docs.studies.own_lines": (*SOLVER, "precompute/route_import"),
    "python -m docs.studies.peers": (*SOLVER, "precompute/tables"),
    "python -m docs.studies.pictures": (*DAY, "sim/bundled", "sim/drive", "sim/review"),
    "python -m tests.support.desk_pictures": (*DAY, "sim/desk"),
    "python -m docs.studies.planted_trains": (*DAY, "sim/trips"),
    "python -m docs.studies.real_trips": (*SOLVER, "sim/trips", "sim/drive"),
    "rerun": ("sim/review",),
}
"""The folders whose code decides a command's figures, by its beginning; a script of docs/studies counts as well."""
MINUTES: Final[dict[str, float]] = {
    "python -m docs.studies.coach_days": 1,
    "python -m docs.studies.what_if": 0.5,
    "python -m docs.studies.notebooks first-steps": 0.5,
    "python -m docs.studies.notebooks notebook-own-line": 0.5,
    "python -m docs.studies.notebooks notebook-real-trip": 0.5,
    "python -m docs.studies.notebooks notebook-own-experiment": 1.5,
    "python -m docs.studies.pictures review": 0.5,
    "python -m docs.studies.pictures report": 0.5,
    "python -m docs.studies.pictures what-if": 1,
    "python -m docs.studies.bundled smoke": 0.5,
    "python -m docs.studies.exact_front": 2,
    "python -m docs.studies.peers": 3,
    "python -m docs.studies.planted_trains": 6,
    "python -m docs.studies.real_trips": 0.5,
    "python -m docs.studies.own_lines": 1,
    "python -m tests.support.desk_pictures": 5,
}
"""What --make-all makes, in this order, and about how long each takes on two free cores (minutes)."""
SUFFIXES: Final = (".py", ".toml", ".csv")
NO_MATTER: Final = frozenset({"late_kernels.py"})
"""Files that decide when a kernel is compiled, and no figure."""
BEGINS: Final = "<!-- made by:"
MARK: Final = re.compile(
    r"<!-- made by: (?P<command>[^;]+?)(?:; code: (?P<code>[0-9a-f]{8}); on: (?P<on>\d{4}-\d\d-\d\d))? -->"
)
NUMBER: Final = re.compile(r"[+\-−]?\d+(?:\.\d+)?")
BLOCK_PIXELS: Final = 8
GREY_STEPS: Final = 12.0
"""Blocks of a picture whose mean grey differs by more than this (of 255) differ: hair lines of text do not."""
SAME_PICTURE: Final = 0.0005
"""Pictures with a smaller share of blocks that differ are the same; one that is drawn again has none."""


class StaleFigures(UserWarning):
    """Figures that were made by hand, with code that has changed since."""


@dataclass(frozen=True, kw_only=True)
class MadeBy:
    """The command that made a part of a page; `code` and `on` are None if the tests run the command again."""

    page: Path
    command: str
    code: str | None
    on: str | None
    what: str
    """The text that the mark is about: from its next line to the next empty line."""


def pages(root: Path = ROOT) -> list[Path]:
    """README.md and all pages and notebooks of the documentation."""
    docs = root / "docs"
    return [root / "README.md", *sorted([*docs.rglob("*.md"), *docs.rglob("*.ipynb")])]


def marks_of(page: Path) -> list[MadeBy]:
    """The marks of a page; raises DasError where one cannot be read."""
    text = page.read_text(encoding="utf-8")
    found = [
        MadeBy(page=page, command=one["command"], code=one["code"], on=one["on"], what=_paragraph(text[one.end() :]))
        for one in MARK.finditer(text)
    ]
    if len(found) != text.count(BEGINS):
        raise DasError(f"{page}: {text.count(BEGINS) - len(found)} of its marks '{BEGINS} …' cannot be read")
    return found


def _paragraph(text: str) -> str:
    return text.removeprefix("\n").split("\n\n", 1)[0]


def code_paths(command: str) -> tuple[str, ...]:
    """The folders and files that decide the figures of a command; raises DasError if nobody said which."""
    for begins, paths in DEPENDS_ON.items():
        if re.match(rf"{re.escape(begins)}(\s|$)", command):
            script = re.match(r"python -m (docs\.studies\.\w+)", command)
            return paths if script is None else (*paths, script[1].replace(".", "/") + ".py")
    raise DasError(f"'{command}': DEPENDS_ON of docs/studies/made_by.py does not say what code it depends on")


def code_hash(paths: Iterable[str], root: Path = ROOT) -> str:
    """Eight digits that change with the code below some paths, but not with its comments, docstrings or empty lines."""
    below = (file for path in paths for file in (root / path, *(root / path).rglob("*")))
    files = {file for file in below if file.suffix in SUFFIXES and file.name not in NO_MATTER and file.is_file()}
    found = hashlib.sha256()
    for file in sorted(files):
        found.update(f"{file.relative_to(root).as_posix()}\n{_content(file)}\n".encode())
    return found.hexdigest()[:8]


@cache
def _content(file: Path) -> str:
    """What counts of a file, read once a process: many figures depend on the same code."""
    text = file.read_text(encoding="utf-8")
    return bare(text) if file.suffix == ".py" else text


def bare(source: str) -> str:
    """Python source without comments, docstrings and empty lines."""
    lines = source.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines[node.lineno - 1 : node.end_lineno] = [""] * ((node.end_lineno or node.lineno) - node.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def changed_since(marks: Iterable[MadeBy], root: Path = ROOT) -> Iterator[str]:
    """A line for each command made by hand whose code is no longer the one of its marks: its pages and first date."""
    by_hand = [one for one in marks if one.code is not None]
    for command in sorted({one.command for one in by_hand}):
        now = code_hash(code_paths(command), root)
        old = [one for one in by_hand if one.command == command and one.code != now]
        if old:
            names = ", ".join(sorted({one.page.name for one in old}))
            yield f"{names}: {command}: its code has changed since {min(str(one.on) for one in old)}"


def stamped(text: str, command: str, code: str, on: str) -> str:
    """A page with a new code and date in all marks of a command that have them."""
    old = rf"(<!-- made by: {re.escape(command)}); code: [0-9a-f]{{8}}; on: [\d-]+ -->"
    return re.sub(old, lambda found: f"{found[1]}; code: {code}; on: {on} -->", text)


def today() -> str:
    """The date of now (UTC), as in a mark."""
    return datetime.now(tz=UTC).date().isoformat()


def agree(one: str, other: str) -> bool:
    """Whether two lines have the same words, and figures that differ by no more than one unit of their last digit."""
    words = [" ".join(NUMBER.sub("#", line).split()) for line in (one, other)]
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=False)
    return words[0] == words[1] and all(_near(*pair) for pair in pairs)


def _near(one: str, other: str) -> bool:
    decimals = [len(number.partition(".")[2]) for number in (one, other)]
    apart = abs(float(one.replace("−", "-")) - float(other.replace("−", "-")))
    return decimals[0] == decimals[1] and apart <= 1.001 * 10.0 ** -decimals[0]


def not_on_page(page: str, made: Iterable[str]) -> list[str]:
    """The lines made now with which no line of a page agrees."""
    there = page.splitlines()
    return [line for line in made if line not in there and not any(agree(line, one) for one in there)]


def picture_difference(one: bytes, other: bytes) -> float:
    """The share of the blocks of a picture that are lighter or darker in another one; 1 if they differ in size."""
    greys = [_blocks(content) for content in (one, other)]
    if greys[0].shape != greys[1].shape:
        return 1.0
    return float(np.mean(np.abs(greys[0] - greys[1]) > GREY_STEPS))


def _blocks(content: bytes) -> np.ndarray:
    from PIL import Image

    picture = Image.open(io.BytesIO(content)).convert("RGB").convert("L")
    return np.asarray(picture.reduce(BLOCK_PIXELS), dtype=float)


def to_make(marks: Sequence[MadeBy], root: Path = ROOT) -> list[str]:
    """The commands of --make-all whose figures are on a page: quick ones, and slow ones whose code has changed."""

    def is_asked(mark: MadeBy) -> bool:
        return mark.code is None or mark.code != code_hash(code_paths(mark.command), root)

    asked = {mark.command for mark in marks if mark.command in MINUTES and is_asked(mark)}
    return [command for command in MINUTES if command in asked]


def make_all(commands: Sequence[str], run: Callable[[Sequence[str]], int]) -> list[str]:
    """Run commands one after the other, and stamp those that succeed; returns the others.

    `run` runs a command, given as a list of words, and returns its exit code. The stamp has the code of the beginning,
    so that a figure is stale if its code was changed meanwhile.
    """
    failed = []
    for number, command in enumerate(commands, start=1):
        left = sum(MINUTES[one] for one in commands[number - 1 :])
        print(f"{number} of {len(commands)}: {command}, about {MINUTES[command]:g} of {left:g} min left", flush=True)
        slow = any(command == begins or command.startswith(f"{begins} ") for begins in DEPENDS_ON)
        code = code_hash(code_paths(command)) if slow else ""
        words = [sys.executable if word == "python" else word for word in shlex.split(command)]
        if run(words) != 0:
            failed.append(command)
        elif slow:
            stamp(command, code)
    return failed


def exit_code(words: Sequence[str]) -> int:
    """Run a program in the folder of the checkout; returns its exit code, as a shell does where there is none."""
    try:
        return subprocess.run(words, cwd=ROOT, check=False).returncode
    except FileNotFoundError:
        print(f"{words[0]}: not found")
        return 127


def stamp(command: str, code: str) -> None:
    """Write a code and the date of today into all marks of a command that have them."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        if (new := stamped(text, command, code, today())) != text:
            write_whole(page, new.encode())
            print(f"written: {page}")


def main() -> None:
    """List what is stale, make it again, or stamp the marks of a command that was run."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.made_by", description=__doc__)
    parser.add_argument("--stamp", metavar="COMMAND", help="Write today's code and date into the marks of a command.")
    parser.add_argument(
        "--make-all", action="store_true", help="Make all stale figures again, and stamp them; go on from where it was."
    )
    asked = parser.parse_args()
    marks = [mark for page in pages() for mark in marks_of(page)]
    if asked.stamp is not None:
        stamp(asked.stamp, code_hash(code_paths(asked.stamp)))
    elif asked.make_all:
        try:
            failed = make_all(to_make(marks), exit_code)
        except KeyboardInterrupt:
            sys.exit("stopped; what was finished is stamped, and the same command goes on from there")
        by_hand = {mark.command for mark in marks if mark.code is not None and mark.command not in MINUTES}
        for command in sorted(by_hand):
            print(f"to be made by hand, because it needs a screen: {command}")
        if failed:
            sys.exit("failed: " + ", ".join(failed))
    else:
        for line in changed_since(marks):
            print(line)


if __name__ == "__main__":
    main()

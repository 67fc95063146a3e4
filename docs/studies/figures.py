"""Figures of the pages, generated when the site is built: a hook of mkdocs that replaces marks in the Markdown.

    {{ figures: COMMAND }}            what a command prints
    {{ figures: COMMAND -> FILE }}    a text that it writes into its folder, or the path of a picture or report of its
    {{ value: MODULE.NAME }}          a constant of the code or of a test; {{ value: MODULE.NAME * 100 }} in per cent

A command begins with das-sim, das-precompute or python, and runs once, in an empty folder. Its output is stored in
build/figures, under a hash of the command, the sources of the project, and its main libraries.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import posixpath
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

from docs.studies.forks import ERRORS, PRINTED

ROOT: Final = Path(__file__).resolve().parents[2]
KEPT: Final = ROOT / "build" / "figures"
SOURCES: Final = (
    *("das", "sim", "precompute", "docs/studies", "docs/results/0.2/preview-of-advice"),
    "recordings/zurich-zug-late.mcap",
    *("tests/das/estimate", "tests/support"),
)
"""Folders and files on which the output of a command depends."""
LIBRARIES: Final = ("numpy", "numba", "scipy", "matplotlib")
PROGRAMS: Final = {
    "das-sim": ("-m", "sim.cli"),
    "das-precompute": ("-m", "precompute.cli"),
    "python": (),
}
"""Arguments of Python that replace the first word of a command."""
FIRST: Final = tuple(
    f"python -m docs.studies.{name}" for name in ("pictures what-if", "estimation", "bundled", "guide_days")
)
"""The longest commands; they are started first, because otherwise one would run alone at the end."""
MAKING: Final = "making-"
COPIED: Final = (".png", ".html")
"""Endings of the names of files that become files of the site; the text of other files is inserted into the page."""
URL: Final = "figures"
"""Folder of the site for copied files."""
MARK: Final = re.compile(r"\{\{ figures: (?P<command>[^{}\n]+?)(?: -> (?P<file>[\w.-]+))? \}\}")
VALUE: Final = re.compile(r"\{\{ value: (?P<module>[\w.]+)\.(?P<name>\w+)(?: \* (?P<factor>[\d.]+))? \}\}")
EXPECTED: Final = "expected {{ figures: COMMAND }}, {{ figures: COMMAND -> FILE }} or {{ value: MODULE.NAME }}"
BEGINS: Final = re.compile(r"\{\{ *(?:figures|value)\b")

_made: dict[str, Path] = {}
"""Folder of each command's output in the current build."""


class BadMarkError(PluginError):
    """A mark is invalid, or a command fails; the build ends."""


def marks_of(text: str, page: str) -> list[tuple[str, str | None]]:
    """The commands of a page, each with the requested file; raises BadMarkError for an invalid mark."""
    found = [(one["command"], one["file"]) for one in MARK.finditer(text)]
    values = VALUE.findall(text)
    if len(found) + len(values) != len(BEGINS.findall(text)):
        raise BadMarkError(f"{page}: a mark cannot be read; {EXPECTED}")
    return found


def input_hash(sources: tuple[str, ...] = SOURCES, root: Path = ROOT) -> str:
    """A hash of all sources on which figures depend, of the Python version, and of the libraries."""
    found = hashlib.sha256(sys.version.encode())
    for name in LIBRARIES:
        found.update(f"{name} {version(name)}\n".encode())
    for path in sorted(file for name in sources for file in (root / name, *(root / name).rglob("*"))):
        if path.is_file() and "__pycache__" not in path.parts:
            found.update(f"{path.relative_to(root).as_posix()}\n".encode())
            found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()


def made(commands: Iterable[str], inputs: str, kept: Path) -> dict[str, Path]:
    """The folders with the output of commands; a command runs only if its folder is missing.

    Raises BadMarkError if a command fails or belongs to no program of this project; the output of the others is kept.
    """
    found = {one: kept / hashlib.sha256(f"{inputs}\n{one}".encode()).hexdigest()[:16] for one in commands}
    missing = {one: _arguments(one) for one in longest_first(found) if not found[one].is_dir()}
    if not missing:
        return found
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=kept, prefix=MAKING) as name:
        places = {one: Path(name) / found[one].name for one in missing}
        for place in places.values():
            (place / "work").mkdir(parents=True)
        jobs = [[arguments, str(places[one] / "work"), str(places[one])] for one, arguments in missing.items()]
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        done = subprocess.run(
            [sys.executable, "-m", "docs.studies.forks"], input=json.dumps(jobs), stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "80", "NO_COLOR": "1", "MPLBACKEND": "agg",
                 "OPENBLAS_NUM_THREADS": "1"},  # a program has one core
            check=True,
        )  # fmt: skip
        codes = dict(zip(missing, json.loads(done.stdout), strict=True))
        for one, place in places.items():
            if codes[one] == 0:
                (place / PRINTED).replace(place / "work" / PRINTED)
                (place / "work").replace(found[one])
        for one in (one for one, code in codes.items() if code):
            said = "".join((places[one] / file).read_text(encoding="utf-8") for file in (PRINTED, ERRORS)).split("\n")
            last = next((line for line in reversed(said) if line.strip()), "no output")
            raise BadMarkError(f"{one}: exit code {codes[one]}: {last}")
    return found


def longest_first(commands: Iterable[str]) -> list[str]:
    """Commands in the order in which they are started."""
    return sorted(commands, key=lambda one: FIRST.index(one) if one in FIRST else len(FIRST))


def _arguments(command: str) -> list[str]:
    """The arguments of `python` that run a command."""
    program, *words = shlex.split(command)
    if program not in PROGRAMS:
        raise BadMarkError(f"{command}: expected a command that begins with {', '.join(PROGRAMS)}")
    return [*PROGRAMS[program], *words]


def value_of(module: str, name: str, factor: str | None = None, root: Path = ROOT) -> str:
    """The literal that a module assigns to a name, times a factor; raises BadMarkError if there is none."""
    path = root / f"{module.replace('.', '/')}.py"
    if not path.is_file():
        raise BadMarkError(f"{module}.{name}: no such module")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(one, ast.Name) and one.id == name for one in targets):
            try:
                value = ast.literal_eval(getattr(node, "value"))  # noqa: B009
            except ValueError as error:
                raise BadMarkError(f"{module}.{name}: expected a literal") from error
            return f"{value * float(factor or 1):g}"
    raise BadMarkError(f"{module}.{name}: the module assigns no such name")


def copied(wanted: Iterable[tuple[str, str | None]]) -> dict[str, Path]:
    """All pictures and reports requested by pages, by name; raises BadMarkError if two commands write the same name."""
    found: dict[str, Path] = {}
    for command, name in wanted:
        if name is None or not name.endswith(COPIED):
            continue
        path = written(command, name)
        if found.setdefault(name, path) != path:
            raise BadMarkError(f"{name}: two commands write a file of this name")
    return found


def written(command: str, name: str) -> Path:
    """A file written by a command; raises BadMarkError if it is missing."""
    path = _made[command] / name
    if not path.is_file():
        raise BadMarkError(f"{command}: it does not write {name}")
    return path


def on_files(files: Any, config: Any) -> Any:
    """Run all commands in the marks of pages, and add their pictures and reports to the site."""
    asked = [one for page in files.documentation_pages() if page.src_uri.endswith(".md") for one in _asked(page)]
    commands = list(dict.fromkeys(command for command, _ in asked))
    _made.clear()
    _made.update(made(commands, input_hash(), KEPT))
    for name, path in copied(asked).items():
        files.append(File.generated(config, f"{URL}/{name}", abs_src_path=str(path)))
    for old in set(KEPT.glob("*")) - set(_made.values()):
        if not old.name.startswith(MAKING):
            shutil.rmtree(old)
    return files


def _asked(page: Any) -> list[tuple[str, str | None]]:
    return marks_of(page.content_string, page.src_uri)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace marks by figures and values."""

    def figure(mark: re.Match[str]) -> str:
        name = mark["file"] or PRINTED
        path = written(mark["command"], name)
        if name.endswith(COPIED):
            return posixpath.relpath(f"{URL}/{name}", posixpath.dirname(page.file.src_uri))
        return path.read_text(encoding="utf-8").strip("\n")

    text = MARK.sub(figure, markdown)
    return VALUE.sub(lambda mark: value_of(mark["module"], mark["name"], mark["factor"]), text)

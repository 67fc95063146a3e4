"""What all programs have alike: -h, --version, completion, options in groups, start-up without heavy imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import typer

from das import __version__
from das.command_line.application import Entry, application, run_app, single_command, with_options
from das.command_line.options import JsonOption, LevelOption
from das.domain.errors import DasError
from das.domain.levels import Level
from precompute.cli.program import COMMANDS
from sim.cli import program as sim_commands
from tests.support.making import in_a_process

Run = Callable[..., tuple[int, str, str]]
HEAVY = ("numpy", "numba", "scipy", "rich", "zenoh", "google.protobuf", "mcap", "matplotlib", "rerun", "pyarrow")


@dataclass(frozen=True, kw_only=True)
class Inner:
    """A group in a group."""

    level: LevelOption = None


@dataclass(frozen=True, kw_only=True)
class Outer:
    """A group that refuses a count below 0."""

    name: Annotated[str, typer.Argument(help="A name.")]
    inner: Inner
    count: Annotated[int, typer.Option("--count", help="How many.")] = 1

    def __post_init__(self) -> None:
        if self.count < 0:
            raise DasError(f"--count {self.count}: expected at least 0")


def greet(outer: Outer, as_json: JsonOption = False) -> None:
    """Greet somebody.

    More words.
    """
    print(outer.name, outer.inner.level, outer.count, as_json)


def broken(first: Outer, second: Outer) -> None:
    """Have every option twice."""


ENTRIES = (
    Entry(
        name="greet", where=f"{__name__}:greet", summary="Greet somebody.", examples=("das-try greet A", "das-try …")
    ),
    Entry(name="lost", where="no.such.module:lost", summary="Cannot be imported.", examples=("das-try lost",)),
)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a program of two commands with some words; exit code, output, errors."""

    def ended(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["das-try", *words])
        with pytest.raises(SystemExit) as end:
            run_app(application("das-try", "Try things.", ENTRIES), "das-try")
        return (int(end.value.code or 0), *capsys.readouterr())

    return ended


def test_the_help_of_a_program_imports_no_command(run: Run) -> None:
    for spelling in ("-h", "--help"):
        code, said, errors = run(spelling)
        assert (code, errors) == (0, "")
        assert "Try things." in said
        assert "greet  Greet somebody." in said
        assert "lost   Cannot be imported." in said
        assert "--install-completion" in said
        assert "--show-completion" in said


def test_the_version_is_that_of_das(run: Run) -> None:
    assert run("--version") == (0, f"das-try {__version__}\n", "")


def test_the_help_of_a_command_has_its_examples_one_a_line(run: Run) -> None:
    for spelling in ("-h", "--help"):
        code, said, _ = run("greet", spelling)
        assert code == 0
        assert "  Greet somebody.\n\n  More words.\n" in said
        assert "  Examples:\n  das-try greet A\n  das-try …\n" in said
        assert "--count" in said


def test_groups_become_options_and_come_back_as_groups(run: Run) -> None:
    assert run("greet", "A") == (0, "A None 1 False\n", "")
    assert run("greet", "A", "--level", "l2", "--count", "3", "--json") == (0, f"A {Level.L2} 3 True\n", "")


def test_what_a_group_refuses_and_what_is_mistyped_are_one_line(run: Run) -> None:
    assert run("greet", "A", "--count", "-1") == (2, "", "error: --count -1: expected at least 0\n")
    for words in (
        ("greet",),
        ("greet", "A", "--cuont", "1"),
        ("great", "A"),
        ("greet", "A", "--level", "l9"),
        ("--nix",),
    ):
        code, said, errors = run(*words)
        assert (code, said) == (2, "")
        assert errors.startswith("error: ")
        assert errors.count("\n") == 1


def test_one_name_for_two_options_is_a_mistake_of_the_programmer() -> None:
    with pytest.raises(TypeError, match="two of these options have the same name"):
        with_options(broken)


def test_a_program_of_one_command_has_the_same_options(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for words, expected in (
        (["-h"], "Greet somebody."),
        (["--version"], f"das-one {__version__}"),
        (["A"], "A None 1"),
    ):
        monkeypatch.setattr(sys, "argv", ["das-one", *words])
        with pytest.raises(SystemExit) as end:
            run_app(single_command("das-one", greet, ("das-one A",)), "das-one")
        assert not end.value.code
        assert expected in capsys.readouterr().out


def complete(words: str) -> list[str]:
    """What a shell offers after some words."""
    environment = {
        "_DAS_PRECOMPUTE_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split())),
    }
    if not words.endswith(" "):
        environment["COMP_CWORD"] = str(len(words.split()) - 1)
    code = "from precompute.cli.program import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**environment, "PATH": ""}, cwd=Path(__file__).parents[3],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    return done.stdout.split()


@pytest.mark.nightly
def test_a_shell_completes_commands_options_and_values() -> None:
    assert complete("das-precompute so") == ["solve"]
    assert complete("das-precompute solve --lev") == ["--level"]
    assert complete("das-precompute solve --level l0") == ["l0-noreg", "l0-reg"]


PROGRAMS = {"precompute.cli.__main__": COMMANDS, "sim.cli.__main__": sim_commands.ENTRIES, "das.node.__main__": ()}


def imported(module: str, commands: list[list[str]]) -> set[str]:
    """The heavy packages that a program has imported when it has printed a help for each of some lists of words."""
    code = (
        f"import sys\nfrom {module} import main\n"
        f"for words in {commands!r}:\n"
        "    sys.argv = ['das', *words]\n"
        "    try:\n        main()\n    except SystemExit as end:\n        assert not end.code, words\n"
        f"print('IMPORTED', *[name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    folder = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage: ") == len(commands)
    return set(done.stdout.rsplit("IMPORTED", 1)[1].split())


@pytest.mark.nightly
@pytest.mark.parametrize("module", PROGRAMS)
def test_a_program_prints_its_help_without_anything_heavy(module: str) -> None:
    assert imported(module, [["-h"], ["--help"]]) == set()


@pytest.mark.parametrize("module", PROGRAMS)
def test_the_help_of_no_command_waits_for_compiler_science_or_bus(module: str) -> None:
    commands = [[entry.name, "--help"] for entry in PROGRAMS[module]] or [["tls-init", "--help"]]
    assert imported(module, commands) & {"numba", "scipy", "zenoh", "matplotlib", "rerun"} == set()


def test_the_version_of_the_installed_program(tmp_path: Path) -> None:
    done = in_a_process("precompute.cli", "--version", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"das-precompute {__version__}\n", "")

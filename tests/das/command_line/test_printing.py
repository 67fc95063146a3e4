"""What is printed: markup and control characters of data do nothing, tables keep their figures, errors are one line."""

from __future__ import annotations

import io
import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich import box
from rich.table import Table

from das.command_line.application import run_command
from das.command_line.printing import (
    COMPILING,
    LOADING,
    LONGEST_LINE,
    one_line,
    paragraph,
    print_table,
    say,
    tell,
    visible,
    warn,
)
from das.domain.errors import DasError

HOSTILE = "[/red] [bold]Bern[/bold] :warning: \x1b[31mred\x1b[0m \x9b2J \u202eneB"


def test_control_characters_are_shown_and_letters_stay() -> None:
    assert visible("Zürich – λ\t∞\n") == "Zürich – λ\t∞\n"
    assert visible("\x1b[2J\x07\x7f\x9b\u202e\u2028\r") == r"\x1b[2J\x07\x7f\x9b\u202e\u2028\r"


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_name_cannot_break_a_table(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    table = Table(title=HOSTILE, box=box.SIMPLE_HEAD)
    table.add_column("[/blue]", no_wrap=True)
    table.add_column("figure", justify="right", no_wrap=True)
    table.add_row(HOSTILE, "123456789.123")
    print_table(table, {"[/x]": "\x1b[1m a legend"})
    said = capsys.readouterr().out
    assert "\x1b" not in said
    assert "\x9b" not in said
    assert "[/red] [bold]Bern[/bold] :warning: \\x1b[31mred" in said
    assert "[/blue]" in said
    assert "123456789.123" in said
    assert "…" not in said
    assert r"[/x]: \x1b[1m a legend." in " ".join(said.split())


def test_tables_are_eighty_wide_where_nobody_says_how_wide(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    table = Table("what", "figure", box=box.SIMPLE_HEAD)
    table.add_row("word " * 60, "1")
    print_table(table, {"figure": "word " * 60})
    assert {len(line) <= 80 for line in capsys.readouterr().out.splitlines()} == {True}


def test_text_and_warnings_are_harmless(capsys: pytest.CaptureFixture[str]) -> None:
    tell(HOSTILE)
    paragraph(HOSTILE)
    warn(f"{HOSTILE}\nsecond line")
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert said.err.startswith("warning: [/red]")
    assert said.err.count("\n") == 1


def test_a_long_message_loses_its_middle_and_nothing_else() -> None:
    line = one_line("file.toml: name = '" + "x" * 50_000_000 + "': expected a name")
    assert len(line) <= LONGEST_LINE
    assert line.startswith("file.toml: name = 'xxx")
    assert line.endswith("xxx': expected a name")
    assert one_line("a\n b\x1b[0m") == r"a b\x1b[0m"


def test_an_error_with_control_characters_is_one_short_line(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> None:
        raise DasError("stop '\x1b[2J\x1b]0;owned\x07'\n" + "y" * 10_000)

    with pytest.raises(SystemExit) as end:
        run_command(main)
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.startswith(r"error: stop '\x1b[2J\x1b]0;owned\x07'\nyyy")
    assert said.count("\n") == 1
    assert len(said) <= LONGEST_LINE + len("error: \n")


def test_what_nobody_reads_is_not_said_and_holds_nobody_up() -> None:
    """Standard error is a pipe: full, then closed at the other end."""
    pipe, log = os.pipe()
    own = os.dup(2)
    os.dup2(log, 2)
    try:
        for _ in range(100_000):
            say("x")
        os.close(pipe)
        say("x")
    finally:
        os.dup2(own, 2)
        os.close(own)
        os.close(log)


def test_a_line_is_said_where_standard_error_has_no_encoding(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A program or a test that redirects standard error into a text buffer compiles as any other."""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    say("compiling …")
    assert capfd.readouterr().err == "compiling …\n"


PROGRAM = """
import sys
from das.command_line.printing import loading_solver
with loading_solver():
    import numpy as np
    from kernel import twice
    twice(np.ones(3))
print("scipy.linalg" in sys.modules)
"""
KERNEL = "from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return 2.0 * x.sum()\n"
ROOT = Path(__file__).parents[3]


def on_a_terminal(command: list[str], folder: Path) -> tuple[int, str]:
    """Run a command whose standard error is a terminal; exit code and what it showed there."""
    ours, theirs = pty.openpty()
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONPATH": f"{ROOT}:{folder}",
        "TERM": "xterm",
    }
    child = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    shown = b""
    while True:
        try:
            ready = select.select([ours], [], [], 60)[0]
            part = os.read(ours, 4096) if ready else b""
        except OSError:  # Linux: the other end is closed
            part = b""
        if not part:
            break
        shown += part
    os.close(ours)
    return child.wait(timeout=60), shown.decode(errors="replace")


def test_compiling_is_said_only_when_something_is_compiled(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    command = [sys.executable, "-c", PROGRAM]
    code, first = on_a_terminal(command, tmp_path)
    assert code == 0
    assert LOADING in first
    assert COMPILING[:40] in first
    code, again = on_a_terminal(command, tmp_path)
    assert code == 0
    assert LOADING in again
    assert "compiling" not in again


@pytest.mark.nightly
def test_elsewhere_compiling_is_said_in_one_line_and_scipy_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    later = PROGRAM + "twice(np.ones(3, np.float32))\ntwice(np.ones(3, np.int32))\n"
    for program, said in ((PROGRAM, f"{COMPILING}\n"), (PROGRAM, ""), (later, f"{COMPILING}\n")):
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120, check=False
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "False\n", said)


SOLVE = ("solve", "flat-6km", "re460-ic", "--buffer", "7")


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after_s", [0.3, 1.5, 4.0, 8.0])
def test_a_signal_during_the_first_compilation_ends_in_one_line(tmp_path: Path, after_s: float, number: int) -> None:
    """With an empty cache, from the imports to the depths of the compiler."""
    begin = (
        "from precompute.cli.__main__ import main\nfrom das.command_line.process import interrupted_by_termination\n"
    )
    begin += "with interrupted_by_termination():\n    print('started', flush=True)\n    main()"
    child = subprocess.Popen(
        [sys.executable, "-c", begin, *SOLVE],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stdout is not None
    assert child.stdout.readline() == "started\n"
    time.sleep(after_s)
    child.send_signal(number)
    said, errors = child.communicate(timeout=60)
    assert (child.returncode, said, errors.removeprefix(f"{COMPILING}\n")) == (130, "", "stopped\n")

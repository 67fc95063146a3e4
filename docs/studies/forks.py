"""Python programs run in forks of one process that has already imported and compiled what nearly all of them need.

`python -m docs.studies.forks` reads lists of [arguments of Python, folder to run in, folder for the output] as JSON,
runs them on all cores, and prints their exit codes. Their output is written to `printed.txt` and `errors.txt`.
"""

from __future__ import annotations

import atexit
import importlib
import json
import os
import runpy
import sys
import traceback
from collections.abc import Sequence
from multiprocessing import connection, get_context
from multiprocessing.context import ForkProcess
from pathlib import Path
from typing import Any, Final

from das.command_line.process import available_cores

PRINTED: Final = "printed.txt"
ERRORS: Final = "errors.txt"
IMPORTED: Final = ("matplotlib.pyplot", "scipy.optimize", "scipy.stats", "sim.world.driving", "sim.drive.comparison")
"""Modules imported once, before the first fork, if there are more programs than cores."""


def forked(arguments: Sequence[str], folder: Path, said: Path) -> ForkProcess:
    """A process that runs Python with arguments (-m MODULE … or -c CODE …) in a folder; a copy of this process."""
    process = get_context("fork").Process(target=_run, args=(list(arguments), folder, said))
    process.start()
    return process


def _run(arguments: list[str], folder: Path, said: Path) -> None:
    atexit._clear()  # the fork must not remove files that the first process has open
    for stream, name in ((sys.stdout, PRINTED), (sys.stderr, ERRORS)):
        stream.flush()
        with (said / name).open("wb") as file:
            os.dup2(file.fileno(), stream.fileno())
    os.chdir(folder)
    (option, what), sys.argv = arguments[:2], arguments[1:]
    try:
        if option == "-m":
            runpy.run_module(what, run_name="__main__", alter_sys=True)
        else:
            exec(what, {"__name__": "__main__"})
    except Exception:
        traceback.print_exc()
        raise SystemExit(1) from None
    finally:
        atexit._run_exitfuncs()  # a fork does not run them by itself


def main() -> None:
    """Run the programs listed on standard input."""
    waiting = [(n, words, Path(folder), Path(said)) for n, (words, folder, said) in enumerate(json.load(sys.stdin))]
    if len(waiting) > available_cores():
        for module in IMPORTED:
            importlib.import_module(module)
        importlib.import_module("das.cab.cab").warm_up()
    codes = [1] * len(waiting)
    running: dict[Any, tuple[int, ForkProcess]] = {}
    while waiting or running:
        while waiting and len(running) < available_cores():
            number, words, folder, said = waiting.pop(0)
            process = forked(words, folder, said)
            running[process.sentinel] = number, process
        for ended in connection.wait(list(running)):
            number, process = running.pop(ended)
            process.join()
            codes[number] = process.exitcode or 0
    print(json.dumps(codes))


if __name__ == "__main__":
    main()

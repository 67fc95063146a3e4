"""A Dask cluster of real processes on the loopback interface."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from distributed import Client

from tests.support.making import REPOSITORY

START_WITHIN_S = 60.0


@contextmanager
def running_cluster(folder: Path, workers: int) -> Iterator[str]:
    """A context with the address of a scheduler whose workers are ready; at its end all processes end."""
    path = os.pathsep.join([str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])])
    env = {**os.environ, "PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
    file = folder / "scheduler.json"
    of_workers = ["--nthreads", "1", "--nworkers", str(workers), "--local-directory", str(folder)]
    commands = [
        ["scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)],
        ["worker", "--scheduler-file", str(file), *of_workers],
    ]
    running = []
    try:
        for name, *options in commands:
            running.append(
                subprocess.Popen(
                    [sys.executable, "-m", f"distributed.cli.dask_{name}", *options, "--no-dashboard"],
                    env=env,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            )
            _wait_for(file)
        found = json.loads(file.read_text())["address"]
        with Client(found, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
        yield found
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait(30)


def _wait_for(file: Path) -> None:
    """Wait until a file is no longer empty."""
    deadline = time.monotonic() + START_WITHIN_S
    while not (file.is_file() and file.read_text()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{file} was not written within {START_WITHIN_S:g} s")
        time.sleep(0.05)

"""The server of a run's desk, a child process of the run: reads line and train, and answers until it is stopped."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import threading

from das.command_line.process import interrupt_on_termination
from das.domain.errors import DasError
from sim.desk.line import hello_of
from sim.desk.messages import GIVEN, DeskGiven, given_of
from sim.desk.server import Desk, server_of
from sim.world.scenario import load_scenario
from sim.world.service import lay_out

PARENT_LOOK_S = 1.0
"""The server looks this often (s) whether its parent is still there."""


def main() -> None:
    """Serve the desk."""
    interrupt_on_termination()
    threading.excepthook = _end_with_thread
    try:
        given = given_of(os.environ.pop(GIVEN, ""))
        asyncio.run(_serve(given))
    except DasError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(0)


def _end_with_thread(failed: threading.ExceptHookArgs) -> None:
    """End this process when a thread fails: without its session on the bus, a run would wait for the desk for good."""
    print(f"error: {failed.exc_value}", file=sys.stderr, flush=True)
    os._exit(2)


async def _serve(given: DeskGiven) -> None:
    scenario = load_scenario(given.scenario, given.journey)
    line = lay_out(scenario)
    desk = Desk(given, hello_of(scenario.title, line, scenario.departure_ns, given.language, given.page), line[0])
    watching = asyncio.create_task(_end_with_parent(int(sys.argv[sys.argv.index("--with-parent") + 1])))
    try:
        door = socket.socket(fileno=given.door)
        await server_of(desk.routes(), door.getsockname()[1], given.token).serve(sockets=[door])
    finally:
        desk.peer.close()
        watching.cancel()


async def _end_with_parent(parent: int) -> None:
    """End this process when its parent has ended."""
    while os.getppid() == parent:
        await asyncio.sleep(PARENT_LOOK_S)
    os._exit(0)

"""The command `das-sim reproduce`: whether today's cab says what was recorded."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, TablesOption
from das.command_line.printing import tell
from das.command_line.running import interrupt_on_termination
from sim.cli.options import RecordingArgument
from sim.options import OfTrainOption
from sim.progress import progress_bar

if TYPE_CHECKING:
    from sim.runs.reproduce.reproduce import Difference, Reproduction

EXIT_DIFFERENT = 1
MOST_FIELDS = 12
"""So many fields are shown of the first message that differs."""


def reproduce(
    file: RecordingArgument,
    of_train: OfTrainOption = None,
    node: Annotated[
        str | None,
        typer.Option(
            "--node",
            metavar="OPTIONS",
            help="What das-node was started with, in quotes [default: as the recording says].",
            show_default=False,
        ),
    ] = None,
    tables: TablesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Let today's cab hear a recording again, and compare all that it says with what was recorded.

    The exit code is 1 where something differs, 0 where nothing does.
    """
    interrupt_on_termination()
    with loading_solver():
        from das.cab.warm_up import warm_up
        from sim.runs.reproduce.reproduce import reproduce as run

        warm_up()
    with progress_bar(f"hearing {file.name} again", "solving the first section", "messages") as progress:
        found = run(file, progress, train=of_train, node=node, tables=tables)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        _print(found)
    if not found.same:
        raise typer.Exit(EXIT_DIFFERENT)


def _print(found: Reproduction) -> None:
    counts = ", ".join(f"{count} {topic}" for topic, count in found.comparison.compared.items())
    tell(f"{found.path}: {found.ticks} ticks, compared: {counts}")
    for note in found.notes:
        tell(f"note: {note}")
    differences = found.comparison.differences
    if not differences:
        tell("today's cab says the same")
        return
    tell(f"{len(differences)} messages differ; the first:")
    _print_first(differences[0], found)
    tell("all fields that differ:")
    for path, (count, most) in found.comparison.by_field.items():
        by = "" if most != most else f", by up to {most:.6g}"  # noqa: PLR0124
        tell(f"  {path}: {count} message{'s' if count > 1 else ''}{by}")
    only = {"recorded only": sum(one.today is None for one in differences)}
    only["said today only"] = sum(one.recorded is None for one in differences)
    for what, count in only.items():
        if count:
            tell(f"  {what}: {count} message{'s' if count > 1 else ''}")


def _print_first(first: Difference, found: Reproduction) -> None:
    from sim.recording.check import utc

    tell(f"  {first.topic} of tick {first.tick}, {utc(first.time_ns)} UTC")
    if first.today is None or first.recorded is None:
        which, message = ("recorded", first.recorded) if first.today is None else ("said today", first.today)
        tell(f"  only {which}: {' '.join(str(message).split())[:400]}")
    for one in first.fields[:MOST_FIELDS]:
        by = "" if one.by != one.by else f" (by {one.by:.6g})"
        tell(f"  {one.path}: recorded {one.recorded!r}, today {one.today!r}{by}")
    if len(first.fields) > MOST_FIELDS:
        tell(f"  and {len(first.fields) - MOST_FIELDS} more fields")
    for before_s, topic, text in found.context:
        tell(f"  heard {before_s:.1f} s before: {topic}: {text[:200]}")

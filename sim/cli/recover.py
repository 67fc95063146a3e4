"""The command `das-sim recover`: what is sound in a cut or damaged recording, as a new file that is whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy, tell
from sim.cli.options import RecordingArgument


def recover(
    file: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="New recording (.mcap) to write.")],
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Save what is sound in a cut or damaged recording into a new file, and say what is gone."""
    check_outputs(out, inputs=(file,), overwrite=overwrite)
    with busy(f"reading {file} …"):
        from sim.recording.check import utc
        from sim.recording.recover import recover as save

        found = save(file, out)
    if as_json:
        print(json.dumps(found.as_dict()))
        return
    for line in found.losses():
        tell(line)
    if found.health.sound:
        tell("nothing was wrong with this recording")
    elif not found.losses():
        tell("it was cut off between two records: all that was written is saved")
    tell(f"saved: {found.messages} messages up to {utc(found.last_ns)} UTC, {found.attachments} attached files")
    tell(f"written: {out}")

"""The program das-sim: its commands, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry, Group, application
from das.command_line.running import run_app

NAME: Final = "das-sim"
ENTRIES: Final = (
    Entry(
        name="replay",
        where="sim.cli.replay:replay",
        summary="Replay a recorded trip: the advice node answers every second, and everything is recorded.",
        examples=("das-sim replay trip.csv --route route.toml --vehicle train.toml --line posts.csv --reverse",),
    ),
    Entry(
        name="trip",
        where="sim.cli.trip:trip",
        summary="Look at a recorded trip: what was cleaned, how it fits the line, its energy.",
        examples=("das-sim trip trip.csv --route route.toml --vehicle train.toml --line posts.csv --plot trip.png",),
    ),
    Entry(
        name="run",
        where="sim.cli.run:run",
        summary="Simulate a day: a train, its driver and the advice node in a closed loop.",
        examples=("das-sim run departure-delay --driver human --advice vector --seed 3",),
    ),
    Entry(
        name="drive",
        where="sim.cli.external_driver:drive",
        summary="Drive a run from a process of its own, over the bus.",
        examples=("das-sim drive clear-day --driver human --seed 3",),
    ),
    Entry(
        name="batch",
        where="sim.cli.batch:batch",
        summary="Simulate many days on all cores, into one table.",
        examples=("das-sim batch clear-day signal-stop --seeds 0-9 --advice vector,none -o runs",),
    ),
    Group(
        name="experiment",
        summary="Human-factors experiments: check a design, drive its trials, analyse the data.",
        where="sim.cli.experiment_commands:ENTRIES",
    ),
    Entry(
        name="sensitivity",
        where="sim.cli.sensitivity:sensitivity",
        summary="Say how much each parameter of the human driver matters for the energy.",
        examples=("das-sim sensitivity clear-day --advice vector,coach --seeds 0-3",),
    ),
    Entry(
        name="view",
        where="sim.cli.view:view",
        summary="Look at a recording in the rerun viewer, or draw it as a picture.",
        examples=("das-sim view recordings/run.mcap --plot run.png",),
    ),
    Entry(
        name="check",
        where="sim.cli.check:check",
        summary="Check a recording: checksums, holes, topics, rates, gaps, late advice, versions, input files.",
        examples=("das-sim check recordings/run.mcap", "das-sim check run.mcap --json"),
    ),
    Entry(
        name="recover",
        where="sim.cli.recover:recover",
        summary="Save what is sound in a cut or damaged recording into a new file, and say what is gone.",
        examples=("das-sim recover cut.mcap -o saved.mcap",),
    ),
    Entry(
        name="reproduce",
        where="sim.cli.reproduce:reproduce",
        summary="Let today's cab hear a recording again, and compare all that it says with what was recorded.",
        examples=("das-sim reproduce recordings/run.mcap",),
    ),
    Entry(
        name="export",
        where="sim.cli.export:export",
        summary="Write a recording as tables: one a topic, one by time, one by position; units are in their columns.",
        examples=("das-sim export run.mcap -o tables", "das-sim export run.mcap -o shared --trim-ends --anonymous"),
    ),
    Entry(
        name="events",
        where="sim.cli.events:events",
        summary="List what happened on a recorded drive, when, where and why.",
        examples=("das-sim events run.mcap --kind withdrawal --kind overspeed",),
    ),
    Entry(
        name="energy",
        where="sim.cli.energy:energy",
        summary="Say where the energy of a recorded drive went, by cause and by place.",
        examples=("das-sim energy run.mcap --json",),
    ),
    Entry(
        name="report",
        where="sim.cli.report:report",
        summary="Write one page about recorded drives, for the screen and for paper.",
        examples=("das-sim report run.mcap -o report.html",),
    ),
    Entry(
        name="compare",
        where="sim.cli.compare:compare",
        summary="Compare recorded drives at the same places of the line.",
        examples=("das-sim compare before.mcap after.mcap --plot both.png",),
    ),
    Entry(
        name="what-if",
        where="sim.cli.what_if:what_if",
        summary="Ask what would have been: other advice for a recorded drive, or its day driven anew.",
        examples=(
            "das-sim what-if run.mcap --level l1 -o l1.mcap",
            "das-sim what-if run.mcap --advice coach --restriction 20-22:80",
        ),
    ),
    Entry(
        name="note",
        where="sim.cli.events:note",
        summary="Add a note to a recording, or list its notes.",
        examples=('das-sim note run.mcap --at 12:34 "braked late for the limit" --tag braking',),
    ),
    Entry(
        name="scenarios",
        where="sim.cli.run:scenarios",
        summary="List the bundled scenarios and where their files are.",
        examples=("das-sim scenarios --json",),
    ),
    Entry(
        name="drivers",
        where="sim.cli.drivers:drivers",
        summary="List who can drive, and the parameters of a human driver.",
        examples=("das-sim drivers --json",),
    ),
    Entry(
        name="example",
        where="sim.cli.example:example",
        summary="Write a working set of own files: route, vehicle, plan, trip, posts, scenario.",
        examples=("das-sim example my-line",),
    ),
    Entry(
        name="make-trip",
        where="sim.cli.make_trip:make_trip",
        summary="Make a recorded trip by simulation.",
        examples=("das-sim make-trip --route zurich-luzern --vehicle re460-ic --to Zug --delay 90 --out trip.mcap",),
    ),
)
ABOUT: Final = (
    "Replay a train's trip, or simulate a day, against a live advice node; record it and look at it.\n\n"
    "Without a command, das-sim replays the bundled recording and tells how to view it."
)


def _replay_bundled() -> None:
    from sim.cli.replay import replay_bundled

    replay_bundled()


app = application(NAME, ABOUT, ENTRIES, without_command=_replay_bundled)


def main() -> None:
    """Entry point of das-sim."""
    run_app(app, NAME)


if __name__ == "__main__":
    main()

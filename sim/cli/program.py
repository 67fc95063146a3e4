"""The program das-sim: its commands, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry, application, run_app

EXPERIMENTS: Final = (
    Entry(
        name="check",
        where="sim.cli.experiment:check",
        summary="Check a design: trials, balance, duration, factors without effect; freeze it.",
        examples=("das-sim experiment check smoke", "das-sim experiment check design.toml -o study"),
    ),
    Entry(
        name="run",
        where="sim.cli.experiment:run",
        summary="Simulate all trials of a design, or runs of scenarios, drivers, presentations and seeds.",
        examples=(
            "das-sim experiment run smoke -o study",
            "das-sim experiment run --scenario clear-day,signal-stop --seeds 0-9 --advice guide,none -o runs",
        ),
    ),
    Entry(
        name="desk",
        where="sim.cli.experiment:desk",
        summary="Run the session of a participant, who drives the trials of a design in the browser.",
        examples=("das-sim experiment desk design.toml -o people --participant P07",),
    ),
    Entry(
        name="analyse",
        where="sim.cli.experiment:analyse",
        summary="Analyse a completed study: differences with intervals, corrected p, effect sizes.",
        examples=(
            "das-sim experiment analyse study -o report.html",
            "das-sim experiment analyse people --with simulated -o report.html",
        ),
    ),
    Entry(
        name="rescore",
        where="sim.cli.experiment:rescore",
        summary="Recompute measures from the recordings of a study, for a new measure.",
        examples=("das-sim experiment rescore study -o again --measure my_measure_s",),
    ),
    Entry(
        name="fit",
        where="sim.cli.experiment:fit",
        summary="Fit a population of simulated drivers to the recordings of a study.",
        examples=("das-sim experiment fit study -o population.toml",),
    ),
    Entry(
        name="forget",
        where="sim.cli.experiment:forget",
        summary="Remove a participant from the folder of a study with people.",
        examples=("das-sim experiment forget study --participant P07",),
    ),
)


GONE_EXPERIMENTS: Final = {
    "studies": "das-sim list studies",
    "power": "the notebook docs/tutorials/notebook-study-statistics.ipynb, which simulates power",
}
"""Former commands of the group `experiment`, each with its replacement."""


NAME: Final = "das-sim"
ENTRIES: Final = (
    Entry(
        name="replay",
        where="sim.cli.trips:replay",
        summary="Replay a recorded trip: the advice node answers every second, and everything is recorded.",
        examples=("das-sim replay trip.csv --route route.toml --vehicle train.toml --posts posts.csv --reverse",),
    ),
    Entry(
        name="trip",
        where="sim.cli.trips:trip",
        summary="Analyse a recorded trip: cleaning, map matching, energy.",
        examples=("das-sim trip trip.csv --route route.toml --vehicle train.toml --posts posts.csv",),
    ),
    Entry(
        name="run",
        where="sim.cli.run:run",
        summary="Simulate a run: a train, its driver and the advice node in a closed loop, everything recorded.",
        examples=("das-sim run departure-delay --driver human --advice speed-and-effort --seed 3",),
    ),
    Entry(
        name="desk",
        where="sim.cli.desk:desk",
        summary="Drive a simulated train in the browser, replay a drive as its driver saw it, or watch any train.",
        examples=(
            "das-sim desk",
            "das-sim desk signal-stop --advice four-mode",
            "das-sim desk recordings/desk.mcap",
            "das-sim desk --watch --route flat-6km --vehicle re460-ic --train IC1",
        ),
    ),
    Entry(
        name="experiment",
        summary="Human-factors experiments: check a design, run its trials, analyse the data.",
        entries=EXPERIMENTS,
        gone=GONE_EXPERIMENTS,
    ),
    Entry(
        name="worth",
        where="sim.cli.worth:worth",
        summary="Estimate what advice would save a fleet, in five steps from the technical optimum to people.",
        examples=(
            "das-sim worth intercity",
            "das-sim worth my-line/fleet.toml --drivers 20",
        ),
    ),
    Entry(
        name="view",
        where="sim.cli.review:view",
        summary="Look at a recording in the rerun viewer.",
        examples=("das-sim view recordings/run.mcap --save run.rrd",),
    ),
    Entry(
        name="check",
        where="sim.cli.recordings:check",
        summary="Check a recording: checksums, missing messages, topics, rates, gaps, late advice, versions, inputs.",
        examples=("das-sim check recordings/run.mcap", "das-sim check cut.mcap --save saved.mcap"),
    ),
    Entry(
        name="reproduce",
        where="sim.cli.recordings:reproduce",
        summary="Feed a recording to the cab of this version, and compare its messages with the recorded ones.",
        examples=("das-sim reproduce recordings/run.mcap",),
    ),
    Entry(
        name="export",
        where="sim.cli.recordings:export",
        summary="Write a recording as tables: one per topic and one by time; column names state units.",
        examples=("das-sim export run.mcap -o tables", "das-sim export run.mcap -o shared --trim-ends --anonymous"),
    ),
    Entry(
        name="report",
        where="sim.cli.review:report",
        summary="Write a report on recorded drives; its first page is for an instructor.",
        examples=("das-sim report run.mcap -o report.html", "das-sim report before.mcap after.mcap --show energy"),
    ),
    Entry(
        name="what-if",
        where="sim.cli.recordings:what_if",
        summary="Try a what-if: other advice for a recorded drive, or its run simulated again.",
        examples=(
            "das-sim what-if run.mcap --level l1 -o l1.mcap",
            "das-sim what-if run.mcap --advice guide --restriction 20-22:80",
        ),
    ),
    Entry(
        name="list",
        where="sim.cli.listing:listing",
        summary="List scenarios, drivers, presentations, studies, measures and importers, including plug-ins.",
        examples=("das-sim list", "das-sim list scenarios", "das-sim list drivers --json"),
    ),
    Entry(
        name="example",
        where="sim.cli.example:example",
        summary="Write example files for a line of your own; or with --route and --vehicle, a scenario.",
        examples=(
            "das-sim example my-line",
            "das-sim example day.toml --route my.toml --vehicle train.toml --journey journey.toml",
        ),
    ),
)
EXTERNAL: Final = (
    "a class of your own (--driver package.module:Class), or a program like docs/examples/external_driver.py"
)
GONE: Final = {
    "batch": "das-sim experiment run --scenario LIST --driver LIST --advice LIST --seeds LIST -o DIR",
    "sensitivity": "das-sim experiment run with a design that has human_ factors",
    "compare": "das-sim report FIRST OTHER…, with --table for the table that --out wrote",
    "drive": EXTERNAL,
    "drivers": "das-sim list drivers",
    "energy": "das-sim report RECORDING --show energy",
    "events": "das-sim report RECORDING --show events, or --show bookmarks",
    "scenarios": "das-sim list scenarios",
    "make-scenario": "das-sim example SCENARIO.toml --route ROUTE --vehicle VEHICLE",
    "make-trip": "das-sim run SCENARIO --advice none, whose recording is a recorded trip for replay and trip",
    "recover": "das-sim check RECORDING --save NEW.mcap",
    "--beside": "das-sim report RECORDING OTHER -o page.html compares drives",
    "--strict": "cleaning is reported in the table, and under cleaning with --json",
    "--plot": "das-sim report RECORDING -o report.html draws a drive; replay a trip first",
    "note": "das-sim report RECORDING --note TEXT --at TIME",
    "--only-driver": EXTERNAL,
    "--point-mass": "length_m = 0 in the vehicle's file",
    "--planning-brake": "das-sim what-if --node with the options of das-node",
    "--below-limit": "das-sim what-if --node with the options of das-node",
}
"""Former commands and options, each with its replacement."""
ABOUT: Final = (
    "Replay a train's trip, or simulate a run, with a live advice node; record and review it.\n\n"
    "Without a command, das-sim replays the bundled recording, simulates its trip with the guide, and compares the two."
)


def _first_minute() -> None:
    from sim.cli.trips import first_minute

    first_minute()


app = application(NAME, ABOUT, ENTRIES, without_command=_first_minute, gone=GONE)


def main() -> None:
    """Entry point of das-sim."""
    run_app(app, NAME)

"""The program das-precompute: its commands, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry, Group, application, run_app

NAME = "das-precompute"
COMMANDS: tuple[Entry | Group, ...] = (
    Entry(
        name="solve",
        where="precompute.cli.solve:solve",
        summary="Find the least-energy run over a section in a given time, or the run of a simpler strategy.",
        examples=(
            "das-precompute solve flat-6km re460-ic --buffer 7 --plot run.png",
            "das-precompute solve zurich-luzern re460-ic --from Zug --to Luzern --time 1100",
        ),
    ),
    Entry(
        name="front",
        where="precompute.cli.solve:front",
        summary="Show the trade-off between time and energy: the least-energy run for each of a list of buffers.",
        examples=(
            "das-precompute front flat-6km re460-ic --buffers 0,5,10 --json",
            "das-precompute front flat-6km re460-ic --exact --max-buffer 10",
        ),
    ),
    Entry(
        name="journey",
        where="precompute.cli.journey:journey",
        summary="Plan a train's whole journey with the least energy: when to be where, and how to drive between.",
        examples=(
            "das-precompute journey zurich-luzern zurich-luzern re460-ic --plot journey.png",
            "das-precompute journey stops zurich-luzern re460-ic --buffer 7 --dwell 60",
        ),
        more="precompute.cli.journey_files:COMMANDS",
    ),
    Entry(
        name="build",
        where="precompute.tables.command:build",
        summary="Solve every section of a plan into a table for the cab.",
        examples=(
            "das-precompute build plan.toml -o tables",
            "das-precompute build plan.toml -o tables --scheduler tcp://10.0.0.1:8786",
        ),
    ),
    Entry(
        name="verify",
        where="precompute.tables.command:verify",
        summary="Check every byte of tables, that this release can use them, and that none is missing.",
        examples=("das-precompute verify tables",),
    ),
    Entry(
        name="show",
        where="precompute.tables.command:show",
        summary="Show what is in a folder of tables: sections, trains, sizes, times, energies and certificates.",
        examples=("das-precompute show tables --json",),
    ),
    Group(
        name="route",
        summary="Own lines: import them from maps and tables, show, check and merge them.",
        where="precompute.cli.route:COMMANDS",
    ),
    Entry(
        name="catalogue",
        where="precompute.cli.catalogue:catalogue",
        summary="List the bundled routes and vehicles.",
        examples=("das-precompute catalogue", "das-precompute catalogue --json"),
    ),
    Group(
        name="vehicle",
        where="precompute.cli.vehicle_files:COMMANDS",
        summary="Make vehicle files from those of other programs or from tables, and show and check them.",
    ),
    Entry(
        name="loss-map",
        where="precompute.cli.catalogue:loss_map",
        summary="Describe a loss map: coverage, fits of L1 and L2 with their errors, best efficiency, largest losses.",
        examples=("das-precompute loss-map re460-ic --plot map.png",),
    ),
)
"""Every command; a test compares its summary with the first line of its docstring."""
GONE: Final = {
    "bench": "python -m docs.studies.bench in a checkout",
    "few-switch": "python -m docs.studies.few_switch ROUTE VEHICLE in a checkout",
    "sensitivity": "python -m docs.studies.changed_world ROUTE VEHICLE in a checkout",
}
"""Former commands, each with what to run instead."""

app = application(NAME, "Solve the time–energy trade-off of a train on a section, offline.", COMMANDS, gone=GONE)


def main() -> None:
    """Entry point of das-precompute."""
    run_app(app, NAME)


if __name__ == "__main__":
    main()

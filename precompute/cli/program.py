"""The program das-precompute: its commands, each imported when it is called."""

from __future__ import annotations

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
        name="few-switch",
        where="precompute.cli.few_switch:few_switch",
        summary="Show the energy cost of few changes of the controller, for each of a list of prices of a change.",
        examples=(
            "das-precompute few-switch zurich-luzern re460-ic --from Zug --buffers 4,7",
            "das-precompute few-switch flat-6km re460-ic --prices 0,0.03,0.3 --json",
        ),
    ),
    Entry(
        name="journey",
        where="precompute.cli.journey:journey",
        summary="Plan a train's whole journey for the least energy: times at all points, and driving between them.",
        examples=(
            "das-precompute journey zurich-luzern zurich-luzern re460-ic --plot journey.png",
            "das-precompute journey stops zurich-luzern re460-ic --buffer 7 --dwell 60",
        ),
        more="precompute.cli.journey_files:COMMANDS",
    ),
    Entry(
        name="sensitivity",
        where="precompute.cli.sensitivity:sensitivity",
        summary="Show how time and energy of a planned run change when train, wind, line or rail differ from the plan.",
        examples=("das-precompute sensitivity zurich-luzern re460-ic --from Zug --buffer 7",),
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
        summary="Check tables: every byte, compatibility with this release, and completeness.",
        examples=("das-precompute verify tables",),
    ),
    Entry(
        name="show",
        where="precompute.tables.command:show",
        summary="Show the contents of a folder of tables: sections, trains, sizes, times, energies and certificates.",
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
        summary="Make vehicle files from other programs' files or from tables; show and check them.",
    ),
    Entry(
        name="loss-map",
        where="precompute.cli.catalogue:loss_map",
        summary="Describe a loss map: coverage, fits of L1 and L2 with their errors, best efficiency, largest losses.",
        examples=("das-precompute loss-map re460-ic --plot map.png",),
    ),
    Entry(
        name="bench",
        where="precompute.bench.command:bench",
        summary="Measure the solver's speed on this machine, and compare it with baselines and the machine's limits.",
        examples=("das-precompute bench --only front,trajectory --json",),
    ),
)
"""Every command; a test compares its summary with the first line of its docstring."""

app = application(NAME, "Solve the time–energy trade-off of a train on a section, offline.", COMMANDS)


def main() -> None:
    """Entry point of das-precompute."""
    run_app(app, NAME)


if __name__ == "__main__":
    main()

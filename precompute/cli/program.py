"""The program das-precompute: its commands, each imported when it is called."""

from __future__ import annotations

from typing import Final

from das.command_line.application import Entry, application, run_app

NAME = "das-precompute"
OF_ROUTES: Final = (
    Entry(
        name="import",
        where="precompute.cli.imports:import_route",
        summary="Make a route from a map of OpenStreetMap, or from tables of limits, gradients, curves and stops.",
        examples=(
            "das-precompute route import tracks.geojson --from A --to B --flat -o my.toml",
            "das-precompute route import limits.csv --altitudes heights.csv -o my.toml",
        ),
    ),
)
OF_VEHICLES: Final = (
    Entry(
        name="import",
        where="precompute.cli.imports:import_vehicle",
        summary="Make a vehicle file from rolling stock of OSRD or railtoolkit, or from a table of efforts.",
        examples=(
            "das-precompute vehicle import STOCK.json -o train.toml --losses re460-ic",
            "das-precompute vehicle import TRAIN.yaml -o train.toml --losses 0.85",
        ),
    ),
)
OF_JOURNEYS: Final = (
    Entry(
        name="import",
        where="precompute.cli.imports:import_journey",
        summary="Make a journey file from a trip of a GTFS feed.",
        examples=(
            "das-precompute journey import FEED.zip --trip 101 -o j.toml",
            "das-precompute journey import FEED.zip --trip 101 --route line.toml -o j.toml",
        ),
    ),
)
COMMANDS: tuple[Entry, ...] = (
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
            "das-precompute front flat-6km re460-ic --exact --buffers 0,5,10",
        ),
    ),
    Entry(
        name="journey",
        where="precompute.cli.journey:journey",
        summary="Plan a train's whole journey with the least energy: times at all points, and driving between them.",
        examples=(
            "das-precompute journey zurich-luzern zurich-luzern re460-ic --plot journey.png",
            "das-precompute journey stops zurich-luzern re460-ic --buffer 7 --dwell 60",
        ),
        entries=OF_JOURNEYS,
        gone={
            "show": "das-precompute show JOURNEY --route ROUTE",
            "check": "das-precompute show JOURNEY --route ROUTE --vehicle VEHICLE",
            "new": "das-sim example DIR, and change journey.toml in it",
        },
    ),
    Entry(
        name="build",
        where="precompute.cli.tables:build",
        summary="Solve every section of a plan into a table for the cab.",
        examples=(
            "das-precompute build plan.toml -o tables",
            "das-precompute build plan.toml -o tables --scheduler tcp://10.0.0.1:8786",
        ),
    ),
    Entry(
        name="verify",
        where="precompute.cli.tables:verify",
        summary="Check tables: every byte, compatibility with this release, and completeness.",
        examples=("das-precompute verify tables",),
    ),
    Entry(
        name="show",
        where="precompute.cli.show:show",
        summary="Show and check a route, vehicle, journey, loss map or tables; without a file, list what is bundled.",
        examples=(
            "das-precompute show",
            "das-precompute show zurich-luzern --plot line.png",
            "das-precompute show j.toml --route zurich-luzern --vehicle re460-ic",
            "das-precompute show tables --json",
        ),
    ),
    Entry(
        name="route",
        summary="Own lines: import them from maps and tables.",
        entries=OF_ROUTES,
        gone={
            "show": "das-precompute show ROUTE",
            "check": "das-precompute show ROUTE",
            "merge": "das-precompute route import of tables, or copy the rows from one TOML file to the other",
            "new": "das-sim example DIR, and change route.toml in it",
        },
    ),
    Entry(
        name="vehicle",
        summary="Own trains: import them from files of other programs or from tables.",
        entries=OF_VEHICLES,
        gone={
            "show": "das-precompute show VEHICLE",
            "check": "das-precompute show VEHICLE",
            "new": "das-sim example DIR, and change vehicle.toml in it",
        },
    ),
)
"""Every command; a test compares its summary with the first line of its docstring."""
_OF_VEHICLE = "--max-power-kw --max-force-kn --max-brake-force-kn --max-speed-kmh --no-friction-brake --point-mass"
_OF_SECTION = "--boundary-speed-mps --start-speed-mps --end-speed-mps --step"
GONE: Final = {
    "catalogue": "das-precompute show",
    "loss-map": "das-precompute show VEHICLE --losses, or das-precompute show MAP.csv",
    "bench": "das-precompute solve … --json, which states solve_s",
    "few-switch": "python -m docs.studies.few_switch ROUTE VEHICLE in a checkout",
    "sensitivity": "python -m docs.studies.changed_world ROUTE VEHICLE in a checkout",
    **dict.fromkeys(_OF_VEHICLE.split(), "change it in the vehicle's file"),
    **dict.fromkeys(_OF_SECTION.split(), "use das.solver.section.SectionOptions in Python"),
    "--join-m": "loose ends within 3 m of a track are joined; join others in the map",
    "--tunnel-area": "change cross_section_m2 in the route's file",
    "--max-buffer": "the largest of --buffers counts",
    "--bound": "use docs.studies.tight_bound.tightened in Python, in a checkout",
    "--bucket": "use precompute.exact.front.Limits in Python",
}
"""Former commands and options, each with its replacement."""

app = application(NAME, "Solve the time–energy trade-off of a train on a section, offline.", COMMANDS, gone=GONE)


def main() -> None:
    """Entry point of das-precompute."""
    run_app(app, NAME)


if __name__ == "__main__":
    main()

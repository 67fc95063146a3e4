"""The functions of `import das`: few parameters, plain results, and one-line error messages.

Each imports the code that does the work only when it is called, so that loading a route loads no compiled solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.braking import SiteBraking
from das.domain.errors import DasError, InputError, one_of
from das.domain.levels import Level
from das.domain.route import Route, Stop
from das.domain.units import PERCENT
from das.domain.vehicle import Vehicle

if TYPE_CHECKING:
    from enum import StrEnum

    import pandas as pd

    from das.domain.trajectory import Trajectory
    from das.drawing.picture import Picture
    from das.drawing.plotted import Plottable, PlottedFront, PlottedRun
    from das.offline.asked_journey import Journey
    from das.offline.chains import Split
    from das.offline.journey import JourneyPlan
    from das.solver.front import Front
    from das.solver.section import Section
    from das.solver.solution import Solution
    from das.table import Table

    _Word = TypeVar("_Word", bound=StrEnum)

DRAWN_BUFFERS_PERCENT = tuple(range(31))
"""Default buffers (%) of the points of a front; timetables have 3 to 10 %."""


def build_section(
    route: Route,
    vehicle: Vehicle,
    *,
    level: Level | str | None = None,
    start: str | int | None = None,
    end: str | int | None = None,
    between_m: tuple[float, float] | None = None,
) -> Section:
    """The part of a route that a train drives from standstill to standstill, ready to be solved.

    `start` and `end` are stops of the route: a name (case does not matter) or a number counted from 1. The defaults are
    the first and the last stop. `between_m` gives two positions on the route (m) instead. `level` is the loss model of
    the train ("l0-noreg", "l0-reg", "l1", "l2", "l3", "own"); the default is the level named in the vehicle's file. The
    section is planned with the train's full brakes; `das.in_service` plans it as the advice does.

    `route.reversed()` is the other direction of a line, `route.with_restrictions(…)` a line with temporary limits.
    `Conditions(…).train(vehicle)` and `.line(route)` are a train and a line under other conditions.

    Raises InputError for an unknown stop or level or a wrong order of stops, DasError if the vehicle has no data for
    the level, InfeasibleError if the train cannot brake or climb.

        >>> import das
        >>> route, train = das.load_route("zurich-luzern"), das.load_vehicle("re460-ic")
        >>> section = das.build_section(route, train, start="Zürich HB", end="Zug", level="l1")
        >>> das.build_section(route, train, between_m=(500.0, 4000.0)).end_m
        4000.0
        >>> das.build_section(route, train, start="Zug", end="Zürich HB")
        Traceback (most recent call last):
        ...
        das.domain.errors.InputError: ...: end = 'Zürich HB': expected a stop after Zug; route.reversed() leads back
    """
    from das.solver import section

    if between_m is not None:
        start_m, end_m = _positions(route, between_m, start, end)
    else:
        first, last = _stop(route, "start", start, 1), _stop(route, "end", end, len(route.stops))
        if last.position_m <= first.position_m:
            expected = f"a stop after {first.name}; route.reversed() leads back"
            raise InputError(route.source, "end", last.name, expected)
        start_m, end_m = first.position_m, last.position_m
    losses = None if level is None else chosen(Level, vehicle.source, "level", level)
    return section.build_section(route, vehicle, level=losses, start_m=start_m, end_m=end_m)


def in_service(section: Section, site: SiteBraking | None = None) -> Section:
    """The section with the braking of the advice: service braking of its train, or the braking of a site's drivers.

    Raises what `build_section` raises.

        >>> import das
        >>> section = das.build_section(das.load_route("flat-6km"), das.load_vehicle("re460-ic"))
        >>> planned = das.in_service(section, das.SiteBraking(deceleration_mps2=0.5))
        >>> bool((planned.envelope_mps <= planned.allowed_mps).all())
        True
    """
    from das.solver.section import with_braking

    return with_braking(section, (site or SiteBraking()).of(section.vehicle))


def solve(section: Section) -> Front:
    """The least energy for every trip time of a section, as a front.

    `front.fastest()` is the fastest solution, `front.trajectory(time_s)` the best one in that time. Both have
    `time_s`, `balance` (the energy balance, in J), `gap_ratio` (largest possible excess over the least energy; NaN
    if not proven) and `trajectory`, whose `columns()` are arrays over the distance. Solving takes 0.1 to
    3 s; a machine that has never solved a section first compiles for up to a minute.

        >>> import das
        >>> section = das.build_section(das.load_route("flat-6km"), das.load_vehicle("re460-ic"))
        >>> front = das.solve(section)
        >>> run = front.trajectory(240.0)
        >>> abs(run.time_s - 240.0) < 0.05, 0.0 <= run.gap_ratio < 0.05
        (True, True)
        >>> front.trajectory(float("nan"))
        Traceback (most recent call last):
        ...
        das.domain.errors.DasError: trip time nan s: expected a finite time > 0 s
    """
    from das.solver.solve import solve_front

    return solve_front(section)


def refined(run: Solution) -> Solution:
    """A solution of a front, improved beyond the grid of the front: the same time with less energy, if possible.

    On most lines this saves 0.1 to 0.4 %, on short, steep or uneven ones up to 1.5 %, and takes 0.1 to 0.5 s. The
    fastest solution is returned unchanged.

        >>> import das
        >>> front = das.solve(das.build_section(das.load_route("flat-6km"), das.load_vehicle("re460-ic")))
        >>> run = front.trajectory(240.0)
        >>> better = das.refined(run)
        >>> better.time_s <= run.time_s, better.balance.input < run.balance.input
        (True, True)
    """
    from das.offline import refinement

    return refinement.refined(run)


def front_points(front: Front, buffers_percent: ArrayLike = DRAWN_BUFFERS_PERCENT) -> dict[str, NDArray[np.float64]]:
    """Times and energies along a front, to draw it: arrays of shape (points,), fastest first.

    A point is the solution of least energy whose time is a buffer (`buffers_percent`, rising) above the least possible
    time. The last point is the solution of least energy overall: a slower one would need more. `time_s` and
    `buffer_percent` are those of the solution found, `energy_j` is its net energy at the current collector (without
    comfort systems), and `lambda_w` the price of time (W): the energy (J) that one second less would cost.

    Raises InputError for buffers that do not rise from 0 or more.

        >>> import das
        >>> front = das.solve(das.build_section(das.load_route("flat-6km"), das.load_vehicle("re460-ic")))
        >>> points = das.front_points(front, [0, 5, 10])
        >>> (points["energy_j"] / 3.6e6).round(0).tolist()
        [77.0, 64.0, 58.0]
    """
    try:
        buffers = np.atleast_1d(np.asarray(buffers_percent, dtype=float))
    except (TypeError, ValueError):
        raise InputError("front_points", "buffers_percent", buffers_percent, "numbers") from None
    if buffers.ndim != 1 or not len(buffers) or not (np.isfinite(buffers).all() and buffers[0] >= 0):
        raise InputError("front_points", "buffers_percent", buffers_percent, "a list of finite numbers >= 0")
    if (np.diff(buffers) <= 0).any():
        raise InputError("front_points", "buffers_percent", buffers_percent, "numbers that rise")
    fastest = front.fastest()
    runs = []
    for buffer in buffers:
        run = front.trajectory(fastest.time_s * (1.0 + PERCENT * float(buffer))) if buffer > 0 else fastest
        runs.append(run)
        if run.fit == "early":
            break
    return {
        "time_s": np.array([run.time_s for run in runs]),
        "buffer_percent": np.array([(run.time_s / fastest.time_s - 1.0) / PERCENT for run in runs]),
        "energy_j": np.array([run.balance.input for run in runs]),
        "lambda_w": np.array([run.lambda_w for run in runs]),
    }


def plot(
    *shown: Solution | Trajectory | Plottable | Front,
    over: str | None = None,
    labels: Sequence[str] | None = None,
    save: str | Path | None = None,
) -> Picture:
    """Draw one run or several over each other, or one front or several, as a picture that a notebook shows.

    A run is a solution, a trajectory, a planned journey, or a simulated run or drive of `sim`. Over the "distance" (the
    default) or the "time" since its beginning, the picture has the speed with the limit and the names of stops, and, as
    far as known, altitude, wheel forces, energy, the windows of a journey. Fronts are drawn over the "buffer" or the
    "time". `labels` are the names in the order of drawing; without it the names state the differences. `save` also
    writes the picture (.png, .pdf or .svg; existing files are not replaced).

    Raises InputError for anything else to draw, for an unknown axis or a wrong number of labels, and DasError if
    matplotlib is not installed or the file cannot be written.

        >>> import das
        >>> route = das.load_route("flat-6km")
        >>> trains = das.load_vehicle("re460-ic"), das.load_vehicle("re460-ic-igbt")
        >>> fronts = [das.solve(das.build_section(route, train)) for train in trains]
        >>> das.plot(*(front.trajectory(240.0) for front in fronts), over="time")
        <Picture: a notebook shows it; in a script, write it with .save('run.png')>
    """
    from das.drawing.picture import Over, draw_fronts, draw_runs
    from das.solver.front import Front

    if not shown:
        raise InputError("plot", "runs", "none", "at least one run or front")
    if labels is not None and len(labels) != len(shown):
        raise InputError("plot", "labels", f"{len(labels)} of them", f"{len(shown)}, one for each run")
    axis = None if over is None else chosen(Over, "plot", "over", over)
    fronts = [one for one in shown if isinstance(one, Front)]
    if len(fronts) not in (0, len(shown)):
        raise InputError("plot", "runs", "fronts and runs", "either fronts or runs")
    if axis is (Over.DISTANCE if fronts else Over.BUFFER):
        raise InputError("plot", "over", axis, "buffer or time for fronts, distance or time for runs")
    if fronts:
        picture = draw_fronts([_plotted_front(one) for one in fronts], axis or Over.BUFFER, labels)
    else:
        picture = draw_runs([_plotted(one) for one in shown], axis or Over.DISTANCE, labels)
    if save is not None:
        picture.save(save)
    return picture


def plan_journey(
    journey: Journey,
    route: Route,
    vehicle: Vehicle,
    *,
    level: Level | str | None = None,
    split: Split | str = "equal-marginal",
) -> JourneyPlan:
    """The journey of least energy: the times at all points and the trajectories from stop to stop.

    Every time of the plan is in its window. `split` sets how the time between two fixed times is allocated to the
    sections: "equal-marginal" (the optimum) or "proportional" (the same buffer in per cent on each). The plan has
    `sections` (one for each part from stop to stop, with `departure`, `arrival`, `trajectory`, `balance`), `input_j`,
    `gap_ratio` and `time_s`; `plan.trajectory().columns()` is the whole journey as arrays.

    Raises InputError for an unknown level or split, InfeasibleError if the windows cannot be kept.

        >>> import das
        >>> route = das.load_route("zurich-luzern")
        >>> plan = das.plan_journey(das.load_journey("zurich-luzern", route), route, das.load_vehicle("re460-ic"))
        >>> len(plan.sections), 0.0 <= plan.gap_ratio < 0.02
        (3, True)
    """
    from das.offline.chains import Split
    from das.offline.journey import JourneyPlanner

    losses = None if level is None else chosen(Level, vehicle.source, "level", level)
    shared = chosen(Split, journey.source, "split", split)
    return JourneyPlanner(journey, route, vehicle, level=losses).plan(shared)


def read_table(path: str | Path) -> Table:
    """A table written by `das-precompute build`: the front of a section, and its finished references.

    `front` has a row for each buffer, refined with the options of the build; `references.finished` are the schedules
    with which the guide departs. Raises DasError for a file that is not a table, is damaged, or is from another
    release.

        table = das.read_table("tables/flat-6km_a-b_re460-ic_l3_0a1b2c3d.json")
        das.to_pandas(table.columns())
    """
    from das.table import Table

    return Table.read(Path(path))


def to_pandas(columns: Mapping[str, ArrayLike]) -> pd.DataFrame:
    """Columns as a DataFrame: those of a trajectory, of a front's points or of a topic, or the terms of an energy
    balance.

    Nothing else in `das` needs pandas. Raises DasError if it is not installed, or if columns differ in length.

        das.to_pandas(run.trajectory.columns())
        das.to_pandas(run.balance.as_dict())
        das.to_pandas(recording.columns("truth"))
    """
    try:
        import pandas as pd
    except ImportError:
        raise DasError("pandas is not installed: pip install pandas") from None
    arrays = {name: np.atleast_1d(np.asarray(column)) for name, column in columns.items()}
    lengths = {name: len(column) for name, column in arrays.items()}
    if len(set(lengths.values())) > 1:
        raise DasError(f"columns of different lengths: {', '.join(f'{name} has {n}' for name, n in lengths.items())}")
    return pd.DataFrame(arrays)


def chosen(kind: type[_Word], source: str, key: str, word: Any) -> _Word:
    """The member of an enumeration with this name; if there is none, an InputError that lists all names."""
    try:
        return kind(word)
    except ValueError:
        raise InputError(source, key, word, one_of(list(kind), word)) from None


def _plotted_front(front: Front) -> PlottedFront:
    """A front in the form needed for a picture."""
    from das.drawing.plotted import PlottedFront

    points = front_points(front)
    return PlottedFront(
        names=front.section.titles,
        buffer_percent=points["buffer_percent"],
        time_s=points["time_s"],
        energy_j=points["energy_j"],
        credit=front.section.route.credit,
    )


def _plotted(shown: object) -> PlottedRun:
    """A run in the form needed for a picture; InputError for anything else."""
    from das.domain.trajectory import Trajectory
    from das.drawing.plotted import plotted, plotted_on
    from das.solver.solution import Solution

    if isinstance(shown, Solution):
        return plotted_on(shown.section, shown.trajectory)
    if isinstance(shown, Trajectory):
        return plotted(shown)
    own = getattr(shown, "plotted", None)
    if own is None:
        expected = "solutions, trajectories, planned journeys, days and drives, or fronts alone (of a list: *runs)"
        raise InputError("plot", "runs", type(shown).__name__, expected)
    found: PlottedRun = own()
    return found


def _stop(route: Route, key: str, wanted: object, default: int) -> Stop:
    """The stop with a name, or with a number counted from 1; InputError if there is none."""
    wanted = default if wanted is None else wanted
    names = ", ".join(f"{i}: {stop.name}" for i, stop in enumerate(route.stops, 1))
    expected = f"name or number of a stop ({names})"
    if isinstance(wanted, int) and not isinstance(wanted, bool):
        if not 1 <= wanted <= len(route.stops):
            raise InputError(route.source, key, wanted, expected)
        return route.stops[wanted - 1]
    if not isinstance(wanted, str):
        raise InputError(route.source, key, wanted, f"{expected}; positions are given as between_m")
    try:
        return route.stop(wanted)
    except DasError:
        raise InputError(route.source, key, wanted, expected) from None


def _positions(route: Route, between_m: object, start: object, end: object) -> tuple[float, float]:
    """The two positions (m) of `between_m`; InputError if they are unusable, or if a stop is given as well."""
    for key, stop in (("start", start), ("end", end)):
        if stop is not None:
            raise InputError(route.source, key, stop, "none with between_m, which gives both ends")
    numbers = isinstance(between_m, Sequence) and len(between_m) == 2
    if not numbers or not all(isinstance(x, int | float | np.number) for x in between_m):  # type: ignore[attr-defined]
        raise InputError(route.source, "between_m", between_m, "two positions (m)")
    start_m, end_m = (float(x) for x in between_m)  # type: ignore[attr-defined]
    if not 0 <= start_m < end_m <= route.length_m:  # written so that NaN is refused as well
        expected = f"two positions that rise, from 0 to {route.length_m:g} m"
        raise InputError(route.source, "between_m", between_m, expected)
    return start_m, end_m

"""How a drive came about: simulated, replayed or real, who drove, what he was shown; and what was shown at a moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from das.advice.modes import mode_name
from das.bus import topics
from das.bus.restrictions import meant
from das.domain.levels import Level
from das.domain.units import kmh
from sim.drive.drive import Drive
from sim.drive.events.event import EventKind
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.recording.metadata import WHAT_IF
from sim.runs.what_if.origin import CHANGED, OF
from sim.world.disturbances import NOTHING

DRIVERS: Final[Mapping[str, str]] = {
    DriverKind.PERFECT: "a driver who follows advice exactly",
    DriverKind.FAST: "a driver who runs as fast as he may",
    DriverKind.RMS: "a driver who keeps a reduced maximum speed",
    DriverKind.TIMETABLE: "a driver who keeps the timetable",
    DriverKind.HUMAN: "a simulated human",
}
NONE_TOLD: Final = "none (an empty list was told)"


def came_about(drive: Drive) -> list[str]:
    """Sentences about how the drive came about; none where the recording does not say."""
    run = drive.recording.metadata.get("run", {})
    told = []
    if run.get("kind") == "run":
        driver, shown = run.get("driver", ""), run.get("advice", "")
        told.append(
            f"The day was simulated (scenario {run.get('scenario', '?')}, seed {run.get('seed', '?')}): "
            f"{DRIVERS.get(driver, driver)} drove and was shown {_presentation(shown)}."
        )
        happens = run.get("happens", NOTHING)
        told.append("Nothing was to go wrong on this day." if happens == NOTHING else f"On this day: {happens}.")
    elif run.get("kind") == "replay":
        told.append(f"It is a replay of {run.get('trip', 'a trip')}: nobody saw the advice.")
    if WHAT_IF in run:
        of, changed = run.get(OF, "?"), run.get(CHANGED, "?")
        told.append(f"It is a what-if of {of}, {run[WHAT_IF]}; otherwise: {changed}.")
    return told


def _presentation(name: str) -> str:
    """A presentation in words; one that is not known by its name."""
    return presenter_of(Presentation(name)).phrase if name in list(Presentation) else name


def restrictions_told(drive: Drive) -> str:
    """The temporary restrictions that the node was told, in words; nothing where no list was heard."""
    lists = drive.recording.of(topics.RESTRICTION)
    if not lists:
        return ""
    told = dict.fromkeys(one for entry in lists for one in meant(entry.message.restrictions))
    words = (
        f"{kmh(one.limit_mps):.0f} km/h from km {one.start_m / 1000:.2f} to {one.end_m / 1000:.2f}{one.window_words()}"
        for one in told
    )
    nothing = "none that anybody can mean" if any(x.message.restrictions for x in lists) else NONE_TOLD
    return "; ".join(words) or nothing


def at_signals(drive: Drive) -> list[str]:
    """What the advice was worth at a signal at danger; nothing where the driver saw none, or no advice."""
    seen = [one for one in drive.events if one.kind is EventKind.SIGNAL]
    if not seen or not drive.shown.any_shown:
        return []
    return ["The advice knows of no signals: while one was at danger, the driver had to go by the signal alone."]


def rests_on(drive: Drive) -> list[tuple[str, str]]:
    """What the figures of the page rest on, by name."""
    run, account = drive.recording.metadata.get("run", {}), drive.account
    rows = []
    if run.get("kind") == "run":
        rows.append(("the day", "simulated: train, driver, sensors and what went wrong"))
    if "route" in run:
        rows.append(("line", run["route"]))
    if "vehicle" in run:
        rows.append(("train", run["vehicle"]))
    if account is not None:
        vehicle = account.inputs.vehicle
        rows.append(("planned mass", f"{vehicle.mass_kg / 1000:.0f} t, train length {vehicle.train_length_m:.0f} m"))
        measured = "measured by the simulator" if account.measured else "estimated from positions; nobody measured them"
        rows.append(("energies", measured))
        rows.append(("losses of the optimum", LOSSES.get(account.inputs.level, str(account.inputs.level))))
    friction = FRICTION.get(run.get("friction_policy", ""), "")
    if friction and run.get("driver") == DriverKind.HUMAN:
        rows.append(("who chose the friction brake", friction))
    rows.append(("wind, adhesion, passengers", "as the scenario says" if run.get("kind") == "run" else "not known"))
    rows.append(("times of day", "UTC"))
    return rows


FRICTION: Final[Mapping[str, str]] = {
    FrictionPolicy.AS_MEASURED: "the simulated driver's habit: he brakes a share by friction, whatever is shown",
    FrictionPolicy.ELECTRIC_FIRST: "the simulated driver brakes by friction only where the motors cannot",
    FrictionPolicy.BY_ADVICE: "the simulated driver's habit, but electric first while he follows advice on effort",
}
LOSSES: Final[Mapping[str, str]] = {
    Level.L0_NOREG: "none, and nothing is fed back (level L0 without regeneration)",
    Level.L0_REG: "none (level L0)",
    Level.L1: "a constant efficiency (level L1)",
    Level.L2: "of each component, by power (level L2)",
    Level.L3: "of each component, by speed and force (level L3)",
}


def moment_words(drive: Drive, time_ns: int) -> tuple[str, str]:
    """How fast the train was at a moment, and what the driver was shown then."""
    trip = drive.course
    driven = f"{kmh(float(trip.at(np.array([time_ns]), trip.speed_mps)[0])):.0f} km/h"
    seen = drive.shown.at(time_ns)
    if seen is None:
        return driven, "nothing"
    if seen.top_only:
        return driven, f"at most {kmh(seen.speed_mps):.0f} km/h"
    speed = "" if np.isnan(seen.speed_mps) else f", {kmh(seen.speed_mps):.0f} km/h"
    return driven, f"{mode_name(seen.mode)}{speed}"

"""A run, computed or driven, in the form that pictures show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from das.domain.journey import Window
from das.domain.route import Route
from das.domain.summary import Summary, needs

if TYPE_CHECKING:
    from das.domain.losses import LossModel
    from das.domain.trajectory import Trajectory
    from das.solver.section import Section

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlottedWindow:
    """The time window of a train at a position (m), on the time axis of its run, and its kind."""

    position_m: float
    window: Window
    of: str
    """"departure", "arrival" or "passing"."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlottedRun(Summary):
    """A run in the form that pictures show: arrays of shape (n,) with a value for each node; None for unknown values.

    The limit and the forces of motors and friction brake apply from a node to the next. `energy_j` is the net energy at
    the current collector since the first node. `names` identifies the run: its train, level, strategy or file.
    """

    names: tuple[str, ...]
    time_s: Floats
    s_m: Floats
    speed_mps: Floats
    limit_mps: Floats | None = None
    force_el_n: Floats | None = None
    force_friction_n: Floats | None = None
    energy_j: Floats | None = None
    route: Route | None = None
    windows: tuple[PlottedWindow, ...] = ()

    def facts(self) -> dict[str, str]:
        """The names of the run, and its time and energy."""
        return {"run": ", ".join(self.names), "needs": self.figures}

    @property
    def figures(self) -> str:
        """Time and energy as text; only the time if the energy is unknown."""
        took_s = float(self.time_s[-1] - self.time_s[0])
        return f"{took_s:.0f} s" if self.energy_j is None else needs(took_s, float(self.energy_j[-1]))

    @property
    def stops(self) -> list[tuple[str, float]]:
        """Names and positions (m) of the line's stops between the ends of the run; empty if the line is unknown."""
        if self.route is None:
            return []
        low_m, high_m = float(self.s_m.min()) - NEAR_M, float(self.s_m.max()) + NEAR_M
        return [(one.name, one.position_m) for one in self.route.stops if low_m <= one.position_m <= high_m]

    def named(self, *more: str) -> PlottedRun:
        """The run with additional names."""
        return replace(self, names=(*self.names, *more))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlottedFront:
    """Points of a front, fastest first, as arrays of shape (points,); `names` identifies the front.

    `credit` is the source and licence of the data, as stated in the file of the line.
    """

    names: tuple[str, ...]
    buffer_percent: Floats
    time_s: Floats
    energy_j: Floats
    credit: str = ""


class Plottable(Protocol):
    """Anything else that pictures can show as a run: a planned journey, a simulated run, a drive."""

    def plotted(self) -> PlottedRun:
        """The run for a picture."""


NEAR_M = 50.0
"""Distance (m) by which a stop of a run may lie beyond the run's ends: trains stop with an error of metres."""


def plotted(
    trajectory: Trajectory, loss: LossModel | None = None, route: Route | None = None, *names: str
) -> PlottedRun:
    """A trajectory for a picture. Its energy requires the losses; the names of stops require the line."""
    columns = trajectory.columns()
    energy_j = None
    if loss is not None:  # standing time between two sections has no energy, as in the balances of the sections
        drawn_j = np.where(np.diff(trajectory.s_m) > 0, trajectory.input_j(trajectory.loss_j(loss)), 0.0)
        energy_j = np.concatenate(([0.0], np.cumsum(drawn_j)))
    return PlottedRun(
        names=names,
        time_s=trajectory.t_s,
        s_m=trajectory.s_m,
        speed_mps=trajectory.v_mps,
        limit_mps=columns["limit_mps"],
        force_el_n=columns["force_el_n"],
        force_friction_n=columns["force_friction_n"],
        energy_j=energy_j,
        route=route,
    )


def plotted_on(section: Section, trajectory: Trajectory) -> PlottedRun:
    """A trajectory of any strategy on a section, for a picture, with its energy and the stops of its line."""
    return plotted(trajectory, section.loss, section.route, *section.titles)

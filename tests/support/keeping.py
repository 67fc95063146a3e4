"""A guide's reference on a bundled section, and trains that follow it or lose time against it."""

from __future__ import annotations

from concurrent.futures import Executor
from copy import deepcopy
from functools import cache

import numpy as np

from das.advice.goal import Goal, TrainState
from das.advice.guide.drift import UsualLoss
from das.advice.guide.keeping import Keeper, Kept
from das.advice.worker import AT_ONCE
from das.solver.guide.policies import GuideFront
from das.solver.guide.schedule import Prospect
from das.solver.section import Section
from tests.support.bundled_sections import Which, asked_s, guide_of, section_of
from tests.support.fixes import ns


class _NoLoss(UsualLoss):
    def between_s(self, s_m: float, to_m: float, takes_s: float) -> float:
        return 0.0


def sure(section: Section, front: GuideFront | None, worker: Executor = AT_ONCE) -> Keeper:
    """A keeper whose drivers lose no time; its references have no reserve."""
    keeper = Keeper(section, front, worker)
    keeper._usual = _NoLoss(section)
    return keeper


def keeper_of(which: Which, *, loses: bool = False) -> Keeper:
    """A keeper of a bundled section that has made no reference yet; its drivers lose no time, or the usual amount."""
    section, front = section_of(which), guide_of(which)
    return Keeper(section, front) if loses else sure(section, front)


def goal_of(which: Which, buffer_ratio: float, **more: object) -> Goal:
    """The goal of a section: its timetable with a buffer over the least time."""
    return Goal(departure_ns=ns(0), due_ns=ns(asked_s(which, buffer_ratio)), **more)  # type: ignore[arg-type]


class Keeping:
    """A train that runs exactly as forecast, from a given time and place on."""

    def __init__(self, forecast: Prospect, begin_s: float) -> None:
        self._times, self._node_m = forecast.times_s + begin_s, forecast.at_m
        self._speeds = forecast.ahead_mps
        self.end_s = float(self._times[-1])

    def at(self, second: float, *, behind_s: float = 0.0) -> TrainState:
        """The train's state at a second, `behind_s` later than forecast; constant acceleration between nodes."""
        there = min(max(second - behind_s, self._times[0]), self.end_s)
        i = min(int(np.searchsorted(self._times, there, side="right")) - 1, len(self._times) - 2)
        spent, span = there - self._times[i], self._times[i + 1] - self._times[i]
        v0, v1 = self._speeds[i], self._speeds[i + 1]
        v_mps = v0 + (v1 - v0) * spent / span
        return TrainState(ns(second), float(self._node_m[i] + 0.5 * (v0 + v_mps) * spent), float(v_mps))


def stood(keeper: Keeper, which: Which, goal: Goal) -> Kept:
    """The reference that a keeper has made, or makes now, for the train before its departure."""
    kept = keeper.keep(TrainState(ns(0), section_of(which).start_m, 0.0), goal)
    assert kept is not None
    return kept


def departed(keeper: Keeper, which: Which, goal: Goal) -> tuple[Kept, Keeping]:
    """The reference that a keeper makes for a train that departed 5 s ago, and a train that follows it."""
    standing = stood(keeper, which, goal)
    state = Keeping(standing.forecast, 0.0).at(5.0)
    keeper.forget()
    kept = keeper.keep(state, goal)
    assert kept is not None
    return kept, Keeping(kept.forecast, 5.0)


def copied(keeper: Keeper, which: Which) -> Keeper:
    """A copy of a keeper in its present state, with the same objects for the reference, the section and its front."""
    same = (section_of(which), guide_of(which), keeper.reference)
    return deepcopy(keeper, {id(one): one for one in same})


@cache
def _waiting(which: Which, goal: Goal, loses: bool) -> Keeper:
    keeper = keeper_of(which, loses=loses)
    stood(keeper, which, goal)
    return keeper


@cache
def _on_the_way(which: Which, goal: Goal, loses: bool) -> tuple[Keeper, Kept, Keeping]:
    keeper = waiting(which, goal, loses=loses)
    return keeper, *departed(keeper, which, goal)


def waiting(which: Which, goal: Goal, *, loses: bool = False) -> Keeper:
    """A keeper that has made the reference of a train that has not departed yet.

    A reference takes a quarter of a second: it is made once a process, and each caller has a copy of its keeper.
    """
    return copied(_waiting(which, goal, loses), which)


def started(which: Which, goal: Goal, *, loses: bool = False) -> tuple[Keeper, Kept, Keeping]:
    """A keeper whose train departed 5 s ago, its reference, and a train that follows it; made once as in `waiting`."""
    keeper, kept, train = _on_the_way(which, goal, loses)
    return copied(keeper, which), kept, train

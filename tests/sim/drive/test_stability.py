"""The measures of restless advice, on displays whose changes can be counted by hand."""

from __future__ import annotations

import dataclasses
import json
import math
from itertools import groupby, pairwise

import pytest

from das.advice.regimes import Regime
from das.bus import das_pb2
from sim.drive.drive import Drive
from sim.drive.figures import AdviceStability, DriveFigures, ShownWatch, stability
from sim.drive.instructions import InstructionFigures
from sim.drive.limits import Violations
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.presentations.presenter import Shown
from sim.review.tables import figures
from tests.support.crossing import few
from tests.support.flat_days import flat_day
from tests.support.hand_recorded import cab, recorded
from tests.support.recorded_days import run_and_recording

T, R, H, C, B, F, S = (
    *(Regime.FULL_TRACTION, Regime.REDUCED_TRACTION, Regime.CRUISE, Regime.COAST),
    *(Regime.REDUCED_BRAKE, Regime.FRICTION_BRAKE, Regime.STOP),
)


def found(shown: list[Shown | None], speeds_mps: list[float] | None = None) -> AdviceStability:
    """The measures of what is shown second by second to the driver of a train that moves, or has these speeds."""
    watch = ShownWatch()
    for second, (one, v) in enumerate(zip(shown, speeds_mps or [20.0] * len(shown), strict=True)):
        watch.look(float(second), v, one)
    return watch.found


def modes(*spells: tuple[Regime, int]) -> list[Shown | None]:
    """Modes that stand for so many seconds each."""
    return [Shown(mode=mode) for mode, seconds in spells for _ in range(seconds)]


def test_changes_in_one_second_are_one_change_per_minute_of_moving_time() -> None:
    shown: list[Shown | None] = [Shown(T, 100, 5)] * 30 + [Shown(C, 101, 0)] * 30 + [Shown(C, 102, 0)] * 61
    measured = found(shown)
    assert (measured.changes, measured.shown_s) == (2, 120.0)
    assert measured.changes_per_min == pytest.approx(1.0)
    by_effort = found([Shown(T, 100, 5)] * 30 + [Shown(T, 100, 4)] * 31)
    assert by_effort.changes_per_min == pytest.approx(1.0)


def test_a_standing_train_and_withdrawn_advice_count_neither_as_time_nor_as_change() -> None:
    shown: list[Shown | None] = [Shown(T, 50)] * 5 + [Shown(H, 60)] * 5 + [None] * 3 + [Shown(B, 70)] * 6
    speeds = [0.0] * 5 + [10.0] * 14
    measured = found(shown, speeds)
    assert (measured.changes, measured.reversals) == (0, 0)
    assert measured.shown_s == 5 + 5
    assert math.isnan(measured.shortest_mode_s)
    calm = found([None] * 10)
    assert math.isnan(calm.changes_per_min)
    assert calm.warning is None


def test_to_accelerate_after_being_told_to_depart_is_no_change() -> None:
    """The train moves already when the advice to accelerate comes."""
    shown: list[Shown | None] = [Shown(Regime.DEPART, 90, 0)] * 5 + [Shown(T, 90, 5)] * 21
    measured = found(shown, [0.0] * 3 + [0.2] * 2 + [5.0] * 21)
    assert (measured.changes, measured.shown_s) == (0, 20.0)
    assert math.isnan(measured.shortest_mode_s)


def test_looks_far_apart_have_nothing_to_do_with_each_other() -> None:
    watch = ShownWatch()
    for second, mode in ((0.0, T), (1.0, T), (9.0, B), (10.0, B)):
        watch.look(second, 20.0, Shown(mode=mode))
    assert (watch.found.shown_s, watch.found.changes, watch.found.reversals) == (2.0, 0, 0)


def test_reversals_are_traction_and_brake_with_less_than_10_s_of_others_in_between() -> None:
    assert found(modes((T, 20), (B, 20))).reversals == 1
    assert found(modes((F, 20), (R, 20))).reversals == 1
    assert found(modes((T, 20), (C, 5), (H, 4), (B, 20), (C, 9), (T, 20))).reversals == 2
    assert found(modes((T, 20), (C, 5), (H, 5), (B, 20), (C, 10), (T, 20))).reversals == 0
    assert found(modes((T, 20), (C, 3), (R, 20), (H, 3), (T, 5))).reversals == 0
    assert found(modes((B, 20), (F, 5), (C, 3), (B, 20))).reversals == 0
    stands = [20.0] * 20 + [0.0] + [20.0] * 20
    assert found(modes((B, 20), (S, 1), (T, 20)), stands).reversals == 0


def test_the_shortest_mode_is_one_that_another_mode_followed() -> None:
    assert found(modes((T, 20), (C, 7), (H, 30))).shortest_mode_s == 7.0
    assert found(modes((T, 4), (C, 9), (H, 3))).shortest_mode_s == 4.0  # the train moved since 4 s; H did not end
    assert math.isnan(found(modes((T, 4))).shortest_mode_s)
    # The speed shown may change: the mode stands.
    assert math.isnan(found([Shown(T, 50), Shown(T, 51), Shown(T, 52)]).shortest_mode_s)
    # Withdrawn, at the stop, and said to be at the stop: the mode before did not end by itself.
    assert found([*modes((T, 20), (C, 12)), None, None, *modes((C, 3), (H, 9), (T, 1))]).shortest_mode_s == 3.0
    assert found([*modes((T, 20), (C, 12), (H, 2)), None, *modes((C, 9))]).shortest_mode_s == 12.0
    assert found(modes((C, 12), (H, 2), (S, 3))).shortest_mode_s == 12.0
    assert found(modes((C, 12), (H, 2), (H, 1)), [20.0] * 14 + [0.0]).shortest_mode_s == 12.0
    # Brakes cannot wait: neither they nor the modes that they end count.
    assert found(modes((T, 20), (C, 12), (H, 15), (C, 2), (B, 3), (H, 30))).shortest_mode_s == 12.0


def test_it_agrees_with_a_count_by_lists() -> None:
    """Second witness: spells cut and counted as lists, for many drawn displays."""
    import numpy as np

    random = np.random.default_rng(3)
    for _ in range(50):
        length = 400
        order = [Shown(Regime(int(random.integers(1, 8))), int(random.integers(50, 53))) for _ in range(length)]
        keep = random.random(length) < 0.85
        held = [order[max(j for j in range(i + 1) if j == 0 or not keep[j])] for i in range(length)]
        shown = [None if random.random() < 0.01 else one for one in held]
        speeds = np.where(random.random(length) < 0.01, 0.0, 15.0).tolist()
        seen = [one if v > 0 else None for one, v in zip(shown, speeds, strict=True)]
        spells = [list(group) for there, group in groupby(seen, key=lambda one: one is not None) if there]
        changes = sum(a != b for spell in spells for a, b in pairwise(spell))
        grouped = [[list(g) for _, g in groupby(spell, key=lambda one: one.mode)] for spell in spells]
        pairs = [(a, b) for spell in grouped for a, b in pairwise(spell)]
        brakes = {Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE}
        blocks = [len(a) for a, b in pairs if not {a[0].mode, b[0].mode} & brakes]
        measured = found(shown, speeds)
        assert measured.changes == changes
        assert measured.shortest_mode_s == min(blocks)
        seconds = sum(one is not None for one in seen[:-1])
        assert measured.shown_s == seconds


def told(measured: AdviceStability) -> dict[str, float | bool | None]:
    """The figures of the display for programs."""
    figures = DriveFigures(violations=Violations(), stability=measured, instructions=InstructionFigures()).as_dict()
    names = ("advice_changes_per_min", "reversals", "shortest_mode_s", "advice_restless")
    return {name: figures[name] for name in names}


def test_restless_advice_is_told_and_calm_advice_is_not() -> None:
    calm = found(modes((T, 60), (C, 8), (H, 60), (C, 60)))
    assert calm.warning is None
    assert told(calm) == {
        "advice_changes_per_min": pytest.approx(3 * 60 / 187),
        "reversals": 0,
        "shortest_mode_s": 8.0,
        "advice_restless": False,
    }
    short = found(modes((T, 60), (C, 7), (H, 120)))
    assert short.warning == "the advice shown was restless: a mode that lasted 7 s (less than 8 s)"
    assert told(short)["advice_restless"] is True
    often = found([Shown(H, speed) for speed in (50, 51, 52, 53) for _ in range(20)])
    assert often.warning == "the advice shown was restless: 2.28 changes a minute (more than 2)"
    nothing = told(found([None] * 5))
    assert (nothing["advice_changes_per_min"], nothing["shortest_mode_s"]) == (None, None)
    json.dumps(nothing, allow_nan=False)


@pytest.mark.parametrize("presentation", few(Presentation, (Presentation.GUIDE, Presentation.NONE), pytest.mark.slow))
def test_a_recording_gives_the_measures_of_its_run(presentation: Presentation) -> None:
    day = flat_day('[[disturbances]]\nkind = "bus-outage"\nfrom_s = 60\nfor_s = 9\n')
    run, recording = run_and_recording(day, day.driver(DriverKind.HUMAN), presentation)
    measured, again = run.stability, stability(DriveTable.of(recording))
    assert dataclasses.asdict(again) == pytest.approx(dataclasses.asdict(measured), nan_ok=True)
    words = dict(figures(Drive(recording=recording)))
    if presentation is Presentation.NONE:
        assert measured.shown_s == 0
        assert "shortest mode" not in words
    else:
        assert measured.changes > 0
        assert words["advice changed, while moving"] == f"{measured.changes_per_min:.1f} times a minute"
        assert words.get("warning") == measured.warning


def test_a_recording_older_than_the_shown_speed_is_measured_by_the_advised_one() -> None:
    number = das_pb2.Cab.PRESENTATION_SPEED_AND_EFFORT
    shown = (cab(t, presentation=number, mode=3, advised_speed_mps=20.0 + (t >= 30)) for t in range(61))
    measured = stability(DriveTable.of(recorded(*shown)))
    assert (measured.changes, measured.shown_s) == (1, 60.0)

"""What an instruction asks of a driver: every driver gives it one meaning, and coasting is never traction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import sim
from das.advice.advice import Advice, Guidance, Instruction
from das.advice.regimes import Regime
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH
from docs.examples.weak_drivers import Attentive
from sim.bundled.recorded_driver import RecordedDriver
from sim.drive.instructions import InstructionWatch
from sim.drivers.cab import AdviceView, Asked, CabView, Driver, asked
from sim.drivers.drivers import LiteralDriver, PerfectDriver, make_driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import FORCE, LEVER, Command, demanded
from sim.plant.plant import Efforts, Plant
from tests.support.making import make_route

TRAIN = load_vehicle("re460-ic")
LINE = LineKnowledge(route=load_route("flat-6km"), vehicle=TRAIN)
ACCELERATE, HOLD, COAST, BRAKE = Regime.FULL_TRACTION, Regime.CRUISE, Regime.COAST, Regime.REDUCED_BRAKE
BOARD_MPS, BOARD_M, STOP_M = 30.0 * KMH, 3880.0, 4000.0
FOLLOWERS: dict[str, Callable[[LineKnowledge], Driver]] = {
    "perfect": PerfectDriver,
    "literal": LiteralDriver,
    "recorded": RecordedDriver,
    "attentive": Attentive,
}
"""The drivers who do what the guide says without an error or a choice of their own."""


@pytest.mark.parametrize(
    ("mode", "to_mps", "effort_ratio", "speed_mps", "reached", "expected"),
    [
        (ACCELERATE, 30.0, 1.0, 20.0, False, Asked.ACCELERATE),
        (ACCELERATE, 30.0, 1.0, 30.0, False, Asked.HOLD),
        (ACCELERATE, 30.0, 1.0, 29.0, True, Asked.HOLD),
        (HOLD, 30.0, math.nan, 20.0, False, Asked.HOLD),
        (COAST, 30.0, 0.0, 20.0, False, Asked.COAST),
        (COAST, 20.0, 0.0, 30.0, True, Asked.COAST),
        (BRAKE, 20.0, -0.4, 30.0, False, Asked.BRAKE),
        (BRAKE, 20.0, -0.4, 19.0, False, Asked.KEEP_BELOW),
        (BRAKE, 20.0, -0.4, 20.5, True, Asked.KEEP_BELOW),
        (BRAKE, 0.0, -0.4, 30.0, False, Asked.BRAKE),
        (BRAKE, 0.0, math.nan, 30.0, False, Asked.BRAKE_BY_EYE),
        (BRAKE, 20.0, math.nan, 30.0, False, Asked.BRAKE),
        (Regime.STOP, 0.0, math.nan, 0.0, False, None),
    ],
)
def test_an_instruction_has_one_meaning(
    mode: Regime, to_mps: float, effort_ratio: float, speed_mps: float, reached: bool, expected: Asked | None
) -> None:
    assert asked(mode, to_mps, effort_ratio, speed_mps, reached=reached) is expected


def cab(view: AdviceView, speed_mps: float = 25.0) -> CabView:
    return CabView(
        time_s=0.0, s_m=2000.0, speed_mps=speed_mps, limit_mps=160 * KMH, stop_m=6000.0, departure_s=-100.0,
        arrival_s=300.0, advice=view,
    )  # fmt: skip


def card(mode: Regime, to_mps: float, lever_ratio: float = math.nan, time_s: float = 0.0) -> AdviceView:
    return AdviceView(
        time_s=time_s, valid_until_s=time_s + 3.0, presentation=Presentation.GUIDE, mode=mode, speed_mps=to_mps,
        display_speed_mps=to_mps, lever_ratio=lever_ratio, force_n=-3e5 if lever_ratio < 0 else 3e5, target_way_m=500.0,
    )  # fmt: skip


def force_n(command: Command, speed_mps: float) -> float:
    """The wheel force (N) that a command asks for."""
    if command.law == LEVER:
        efforts = Efforts.at(speed_mps, LINE.train)
        return command.value * (efforts.traction_n if command.value > 0 else efforts.brakes_n)
    return command.value if command.law == FORCE else float(demanded(command, 0.0, speed_mps, LINE.train))


@pytest.mark.parametrize("name", FOLLOWERS)
@pytest.mark.parametrize("to_mps", [15.0, 35.0])
def test_coasting_is_neither_traction_nor_braking_whatever_its_speed(name: str, to_mps: float) -> None:
    """At 25 m/s, with every board far away: coasting to less and to more."""
    driver = FOLLOWERS[name](LINE)
    assert force_n(driver.command(cab(card(COAST, to_mps, 0.0))), 25.0) == 0.0


@pytest.mark.parametrize("name", FOLLOWERS)
def test_a_brake_to_a_speed_is_no_order_to_speed_up_to_it(name: str) -> None:
    driver = FOLLOWERS[name](LINE)
    assert force_n(driver.command(cab(card(BRAKE, 25.0, -0.4), speed_mps=20.0)), 20.0) <= 0.0
    assert force_n(FOLLOWERS[name](LINE).command(cab(card(HOLD, 25.0), speed_mps=20.0)), 20.0) > 0.0


# --- a board shortly before the stop ------------------------------------------------------------------------------


def past_the_board(driver: Driver, line: LineKnowledge) -> tuple[float, float, InstructionWatch]:
    """Drive on a level line where 30 km/h begin 120 m before the stop, and the card never says so.

    From 300 m on it says "brake to 0", without an effort. Returns by how much the train was above the limit (m/s), how
    far from the stop it stands (m), and what watched the advice.
    """
    plant, watch = Plant(line.route, TRAIN), InstructionWatch()
    state, worst_mps, advice_s = plant.at(3000.0, 17.0), -math.inf, 0.0
    view = card(HOLD, 17.0)
    for _ in range(1000):
        limit_mps, way_m = float(line.limits_mps.at(state.s_m)), STOP_M - state.s_m
        if state.time_s >= advice_s:
            mode, to_mps = (BRAKE, 0.0) if way_m < 300.0 else (HOLD, 17.0)
            now = Instruction(mode=mode, speed_mps=to_mps, effort_ratio=math.nan)
            guide = Guidance(now=now, target_m=way_m, force_n=-4e5, reference_force_n=-4e5, lever_ratio=math.nan)
            watch.look(
                Advice(
                    time_ns=round(1e9 * state.time_s), s_m=state.s_m, speed_mps=state.speed_mps, mode=mode,
                    limit_mps=limit_mps, guide=guide,
                ),
                state.force_el_n + state.force_friction_n,
            )  # fmt: skip
            view = replace(card(mode, to_mps, time_s=state.time_s), force_n=-4e5, target_way_m=way_m)
            advice_s += 1.0
        seen = CabView(
            time_s=state.time_s, s_m=state.s_m, speed_mps=state.speed_mps, limit_mps=limit_mps, stop_m=STOP_M,
            departure_s=-100.0, arrival_s=100.0, advice=view,
        )  # fmt: skip
        state = plant.advance(state, driver.command(seen), 0.2)
        worst_mps = max(worst_mps, state.speed_mps - float(line.limits_mps.at(state.s_m)))
        if state.speed_mps == 0:
            break
    return worst_mps, state.s_m - STOP_M, watch


@pytest.fixture(scope="module")
def with_board() -> LineKnowledge:
    return LineKnowledge(route=make_route(STOP_M, [(0.0, 120 * KMH), (BOARD_M, BOARD_MPS)]), vehicle=TRAIN)


def test_the_literal_driver_passes_a_board_that_the_card_hides_and_the_measure_finds_it(
    with_board: LineKnowledge,
) -> None:
    worst_mps, beyond_m, watch = past_the_board(LiteralDriver(with_board), with_board)
    assert worst_mps == pytest.approx(17.0 * math.sqrt(120.0 / 300.0) - BOARD_MPS, abs=1.0)
    assert beyond_m == pytest.approx(0.0, abs=1.0)
    found = watch.found.reliance
    assert found.hidden_limits == 1
    assert found.above_limit_s >= 3


def test_the_perfect_driver_keeps_a_board_on_the_way_to_the_mark(with_board: LineKnowledge) -> None:
    """He brakes for the board that he knows, not only for the mark behind it; the card's fault is found as well."""
    worst_mps, beyond_m, watch = past_the_board(PerfectDriver(with_board), with_board)
    assert worst_mps < 0.3
    assert beyond_m == pytest.approx(0.0, abs=1.0)
    assert watch.found.reliance.hidden_limits == 1


DAY = """
schema_version = 1
scenario = {id = "board", title = "A board before the stop", route = "line.toml", vehicle = "re460-ic"}
timetable = {departure = "2026-11-21T08:00:00Z", buffer_percent = 8, dwell_s = 30}
"""
BOARDS = """
schema_version = 1
route = {id = "board", name = "board", length_km = 2.5}
stops = [{name = "A", position_km = 0}, {name = "B", position_km = 2.5}]
speed_limits = {columns = ["position_km", "limit_kmh"], rows = [[0, 120], [2.38, 30]]}
gradients = {columns = ["position_km", "gradient_permille"], rows = [[0, 0]]}
"""


@pytest.mark.parametrize(
    ("driver", "board_km", "board_kmh"),
    [
        ("perfect", 2.38, 30),
        ("literal", 2.30, 40),
        *(pytest.param("literal", *one, marks=pytest.mark.slow) for one in ((2.38, 30), (2.22, 60))),
    ],
)
def test_whoever_does_what_the_card_says_keeps_a_board_before_the_stop(
    tmp_path: Path, driver: str, board_km: float, board_kmh: int
) -> None:
    """The literal driver knows nothing but the card, so it has to name the board, with an effort up to it."""
    (tmp_path / "line.toml").write_text(BOARDS.replace("[2.38, 30]", f"[{board_km}, {board_kmh}]"))
    (tmp_path / "day.toml").write_text(DAY)
    found = sim.run_day(tmp_path / "day.toml", driver=driver, advice="guide").outcome
    over_kmh, off_m = (1.0, 2.0) if driver == "perfect" else (0.5 * 3.6, 5.0)
    assert found["over_limit_kmh"] < over_kmh
    assert (found["hidden_limits"], found["above_limit_obeying_s"], found["last_word_acts"]) == (0, 0, 0)
    assert abs(found["stops"][-1]["stopping_error_m"]) < off_m


def test_the_literal_driver_without_the_guide_keeps_the_timetable_by_himself() -> None:
    literal, alone = make_driver(DriverKind.LITERAL, LINE), make_driver(DriverKind.TIMETABLE, LINE)
    seen = replace(card(COAST, 10.0), presentation=Presentation.SPEED_AND_EFFORT)
    assert literal.command(cab(seen)) == alone.command(cab(seen))


def test_the_literal_driver_waits_until_an_instruction_is_due() -> None:
    driver = LiteralDriver(LINE)
    held = driver.command(cab(card(HOLD, 25.0)))
    coming = replace(card(COAST, 15.0, 0.0), due_s=2.0, valid_until_s=9.0)
    assert driver.command(cab(coming)._replace(time_s=1.0)) == held
    assert force_n(driver.command(cab(coming)._replace(time_s=2.0)), 25.0) == 0.0


@pytest.mark.parametrize("rate_mps2", [0.5, 1.2])
def test_the_literal_driver_releases_traction_in_time_for_the_speed_of_the_card(rate_mps2: float) -> None:
    """Traction takes 0.8 s to decay, so a train that gains 1.2 m/s² gains half a metre per second more."""
    driver, to_mps, speeds_mps = LiteralDriver(LINE), 60 * KMH, []
    seen = replace(card(ACCELERATE, to_mps, 1.0), valid_until_s=9.0)
    for look in range(30):
        speed_mps = to_mps - 2.0 + 0.2 * look * rate_mps2
        command = driver.command(cab(seen)._replace(time_s=0.2 * look, speed_mps=speed_mps))
        if (command.law, command.value) != (LEVER, 1.0):
            break
        speeds_mps.append(speed_mps)
    assert to_mps - speeds_mps[-1] == pytest.approx(0.3 + 0.5 * rate_mps2, abs=0.11 * rate_mps2)

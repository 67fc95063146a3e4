"""The anonymous export: what it keeps of each table, and where its times and positions begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from sim.drive.export.tables import LOG_TIME, SINCE_START, TIME, Column, DataTable

KEPT: Final[Mapping[str, str]] = {
    "position": "s_m speed_mps uncertainty_m quality speed_uncertainty_mps",
    "delay": "delay_s",
    "effort": "force_el_n force_friction_n",
    "journey": "",
    "journey_stops": "number s_m arrival_ns departure_ns",
    "restriction": "",
    "restriction_restrictions": "number start_m end_m limit_mps valid_from_ns valid_until_ns",
    "target": "",
    "target_targets": "number s_m arrival_ns earliest_ns latest_ns",
    "control": "tick command restrictions_ns targets_ns",
    "advice": (
        "tick position_time_ns s_m speed_mps mode advised_speed_mps advised_force_n advised_force_ratio "
        "horizon_speed_mps horizon_force_n next_mode next_change_m next_change_s predicted_arrival_ns "
        "predicted_deviation_s buffer_ratio energy_to_go_j source valid_until_ns limit_mps position_sd_m "
        "display_speed_mps cause guide_now_mode "
        "guide_now_speed_mps guide_now_effort_ratio guide_now_way_m guide_now_in_s guide_target_m guide_target_s "
        "guide_force_n guide_replan_cause guide_replan_time_ns guide_replan_gain_j guide_replan_gain_s "
        "guide_reference_force_n guide_reason_code guide_reason_speed_mps guide_reason_at_m guide_reason_time_ns "
        "guide_reason_late_s guide_lever_ratio departure_speed_mps departure_force_ratio reason_code "
        "reason_speed_mps reason_at_m reason_time_ns reason_late_s replaced_parts"
    ),
    "advice_guide_following": "number mode speed_mps effort_ratio way_m in_s",
    "plan": "s_m t_s speed_mps force_n",
    "estimate": "mass_ratio mass_sd_ratio resistance_ratio resistance_sd_ratio samples usable differs",
    "status": "state solve_s last_advice_s advices cause",
    "event": "level",
    "truth": (
        "s_m speed_mps acceleration_mps2 force_el_n force_friction_n energy_input_j gradient_ratio limit_mps "
        "adhesion_ratio head_wind_mps resistance_j component_loss_j auxiliary_j friction_brake_j unreturned_j "
        "comfort_j blending_j"
    ),
    "cab": (
        "presentation mode advised_speed_mps advised_lever_ratio next_mode next_change_s limit_mps signal_m "
        "lever_ratio display_speed_mps look clock_s s_m speed_mps stop_m departure_s arrival_s may_depart advice_s "
        "valid_until_s advised_force_n due_s target_way_m friction_ratio deviation_s next_speed_mps "
        "next_effort_ratio horizon_speed_mps horizon_force_n reason_code reason_speed_mps reason_at_m "
        "reason_time_ns reason_late_s interlock late_s gradient_ratio force_el_n force_friction_n cause "
        "next_change_m second_mode second_change_s second_change_m second_speed_mps second_effort_ratio wall_ns"
    ),
    "cab_restrictions": "number start_m end_m limit_mps valid_from_ns valid_until_ns",
    "cab_limits_ahead": "number s_m limit_mps",
    "controls": "look lever_ratio force_n friction_ratio",
    "action": "number device lever_ratio look browser_ns server_ns bus_ns",
    "mark": "kind look browser_ns server_ns bus_ns",
    "decision": "kind value",
    "measures": "shown_s advice_changes_per_min reversals shortest_mode_s",
    "saving": "measured comparable driven_j optimum_j likely_low_j likely_high_j worst_low_j worst_high_j",
    "saving_sections": "number trip_s driven_j optimum_j faster_than_possible",
    "log": "level",
    "recorder": "tick messages advice_tick node_state",
}
"""Columns of each table that an anonymous export keeps beside the times of a row; all others are left out.

A new field is therefore left out until it is added here. A position on the route is added to `POSITIONS` as well.
Texts are not kept, since reasons and remarks may name stops.
"""
POSITIONS: Final = ("s_m", "start_m", "end_m", "signal_m", "stop_m", "reason_at_m", "guide_reason_at_m")
"""Columns that are positions on the route; in an anonymous export they count from the first stop."""
TIMES_END: Final = "_ns"
"""Ending of columns that are moments; in an anonymous export they count from the departure, which hides the date."""


def anonymous(table: DataTable, zero_ns: int, zero_m: float) -> DataTable | None:
    """The table without what identifies the train or the line; None for a table that is left out.

    `zero_ns` (ns since 1970) and `zero_m` become 0.
    """
    if table.name not in KEPT:
        return None
    kept = {LOG_TIME, TIME, SINCE_START, *KEPT[table.name].split()}
    return replace(table, columns=[_shifted(one, zero_ns, zero_m) for one in table.columns if one.name in kept])


def _shifted(column: Column, zero_ns: int, zero_m: float) -> Column:
    bare = column.name
    if bare.endswith(TIMES_END):
        values: list[Any] = [None if not value else value - zero_ns for value in column.values]
        return replace(column, values=values, meaning=f"{column.meaning or 'a moment'}; counted from the departure")
    if bare in POSITIONS:
        return replace(column, values=[_minus(value, zero_m) for value in column.values])
    return column


def _minus(value: Any, zero_m: float) -> Any:
    if isinstance(value, list):
        return [one - zero_m for one in value]
    return None if value is None else value - zero_m

"""What the printed energy shares would mean in kWh: a balance that fits them, and how sure it is.

With the printed formula of the running resistance the printed shares imply more energy, and more power for comfort,
than such a train can have. Here the shares are taken as they are, and the idle power and the time of the trip as
assumptions; the running resistance follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from das.domain.losses import EfficiencyLoss, Level
from das.domain.units import KW, PERCENT, kwh
from precompute.study.energy_shares import BUFFER_PERCENT, DrivenTrip, drive, energy_shares, shares
from precompute.study.output import Output, markdown_table
from precompute.study.printed import ENERGY_SHARES_PERCENT

MINUTE_S: Final = 60.0
ROUNDS: Final = 20
"""Rounds in which the share of the friction brake and the losses settle."""


@dataclass(frozen=True, kw_only=True)
class Assumed:
    """What is assumed of the measured trips.

    `idle_w` is lost in the traction chain and its auxiliaries whether the train runs or stands (the paper: up to
    150 kW); it takes the place of the constant of our map's L2 fit. `time_s` is from departure to arrival with every
    stand (the paper: less than an hour).
    """

    driver: str = "rms"
    buffer_percent: float = BUFFER_PERCENT
    idle_w: float = 150 * KW
    time_s: float = 55 * MINUTE_S


ASSUMED: Final = {
    "as assumed": Assumed(),
    "idle 115 kW, as the L2 fit": Assumed(idle_w=115 * KW),
    "50 min": Assumed(time_s=50 * MINUTE_S),
    "59 min": Assumed(time_s=59 * MINUTE_S),
    "four-mode driver": Assumed(driver="four-mode"),
    "buffer 25 %": Assumed(buffer_percent=25.0),
}
"""The balance, and what another assumption makes of it."""


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The whole energy (J) that fits the printed shares of losses, and what follows from the other shares.

    `resistance_ratio`: the running resistance, as a multiple of the printed formula's. `friction_ratio`: share of
    every brake force from the friction brake. `comfort_w`: mean power of the comfort systems.
    """

    whole_j: float
    resistance_ratio: float
    friction_ratio: float
    comfort_w: float


def balanced(trip: DrivenTrip, assumed: Assumed) -> Balance:
    """The balance for trips that move as `trip` does."""
    fit = trip.vehicle.loss_model(Level.L2)
    if not isinstance(fit, EfficiencyLoss):
        raise TypeError(f"{trip.vehicle.id}: its L2 losses are {type(fit).__name__}, not an EfficiencyLoss")
    printed = {name: share * PERCENT for name, share in ENERGY_SHARES_PERCENT.items()}
    more_idle_j = assumed.idle_w * assumed.time_s - fit.idle_w * sum(run.time_s for run in trip.runs)
    braked_j, ratio, whole_j = shares(trip, 1.0).friction_brake, 0.5, 0.0
    for _ in range(ROUNDS):
        whole_j = (shares(trip, ratio).component_loss + more_idle_j) / printed["component_loss"]
        ratio = min(printed["friction_brake"] * whole_j / braked_j, 1.0)
    return Balance(
        whole_j=whole_j,
        resistance_ratio=printed["resistance"] * whole_j / shares(trip, 0.0).resistance,
        friction_ratio=ratio,
        comfort_w=printed["comfort"] * whole_j / assumed.time_s,
    )


def balances() -> dict[str, Balance]:
    """The balance under each of the assumptions."""
    trips = {
        (one.driver, one.buffer_percent): drive(one.driver, buffer_percent=one.buffer_percent)
        for one in ASSUMED.values()
    }
    return {name: balanced(trips[one.driver, one.buffer_percent], one) for name, one in ASSUMED.items()}


def shares_and_balance(bench: object, output: Output) -> dict[str, Any]:
    """Write the energy shares, and beside them the balance; return what both say."""
    result, found = energy_shares(bench, output), balances()
    output.text("shares-balance.md", as_markdown(found))
    return {**result, "balance": as_json(found), "in_words": in_words(found)}


def in_words(found: dict[str, Balance]) -> str:
    """One sentence on the balance and its range."""
    base, ranges = next(iter(found.values())), list(found.values())
    ratio = [one.resistance_ratio for one in ranges]
    whole = [kwh(one.whole_j) for one in ranges]
    comfort = [one.comfort_w / KW for one in ranges]
    return (
        f"Printed energy shares: a balance with {base.resistance_ratio:.2f} times the printed formula's running "
        f"resistance fits ({kwh(base.whole_j):.0f} kWh, {base.comfort_w / KW:.0f} kW for comfort); by what is assumed "
        f"{min(ratio):.2f} to {max(ratio):.2f} times, {min(whole):.0f} to {max(whole):.0f} kWh, {min(comfort):.0f} to "
        f"{max(comfort):.0f} kW."
    )


def as_json(found: dict[str, Balance]) -> dict[str, Any]:
    """The balances, by assumption."""
    return {
        name: {
            "whole_kwh": kwh(one.whole_j),
            "resistance_ratio": one.resistance_ratio,
            "friction_ratio": one.friction_ratio,
            "comfort_kw": one.comfort_w / KW,
        }
        for name, one in found.items()
    }


def as_markdown(found: dict[str, Balance]) -> str:
    """The balances as a table."""
    rows = [
        [
            name,
            f"{one.resistance_ratio:.2f}",
            f"{kwh(one.whole_j):.0f}",
            f"{one.comfort_w / KW:.0f}",
            f"{100 * one.friction_ratio:.0f} %",
        ]
        for name, one in found.items()
    ]
    return (
        "A balance that fits the printed shares: 150 kW idle over 55 min with stands, a driver by reduced maximum "
        "speed, sections with a buffer of 7 %; and what another assumption makes of it.\n\n"
        + markdown_table(
            ["assumed", "times the printed resistance", "whole kWh", "comfort kW", "friction braking"], rows
        )
    )

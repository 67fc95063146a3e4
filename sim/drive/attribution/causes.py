"""The causes among which the energy above the optimum is divided, in plain words."""

from __future__ import annotations

from enum import StrEnum


class EnergyCause(StrEnum):
    """Why a drive took more energy than the optimum for the same times (docs/explanation/where-the-energy-went.md)."""

    TOO_FAST = "too-fast"
    LATE_COASTING = "late-coasting"
    TOO_SLOW = "too-slow"
    AGAINST_ADVICE = "against-advice"
    AS_ADVISED = "as-advised"
    LATENESS = "lateness"
    FRICTION = "friction"
    SIGNAL = "signal"
    RESTRICTION = "restriction"
    TRAIN = "train"
    REST = "rest"
    RECOVERED = "lateness-recovered"
    """Only against the timetable's optimum, as `ARRIVAL`: the optimum for the same times holds both."""
    ARRIVAL = "arrival-off-timetable"

    @property
    def label(self) -> str:
        """The cause in a few words."""
        return LABELS[self]

    @property
    def meaning(self) -> str:
        """One sentence about what is counted under the cause."""
        return MEANINGS[self]


LABELS = {
    EnergyCause.TOO_FAST: "too fast early",
    EnergyCause.LATE_COASTING: "coasting begun late",
    EnergyCause.TOO_SLOW: "too slow, made up later",
    EnergyCause.AGAINST_ADVICE: "against the advice",
    EnergyCause.AS_ADVISED: "driven as advised",
    EnergyCause.LATENESS: "hurried, and yet late",
    EnergyCause.FRICTION: "friction brake instead of the motors",
    EnergyCause.SIGNAL: "signal at danger",
    EnergyCause.RESTRICTION: "temporary restriction",
    EnergyCause.TRAIN: "train, wind, rail",
    EnergyCause.REST: "rest, not told apart",
    EnergyCause.RECOVERED: "lateness recovered",
    EnergyCause.ARRIVAL: "arrival off the timetable",
}

MEANINGS = {
    EnergyCause.TOO_FAST: "No advice was shown, and the driver gave more effort than the best continuation would have.",
    EnergyCause.LATE_COASTING: "The train should have coasted towards a stop or limit, and was still under traction.",
    EnergyCause.TOO_SLOW: "No advice was shown, and the driver gave less effort or braked sooner than best.",
    EnergyCause.AGAINST_ADVICE: "Advice was shown, and speed or effort were other than advised.",
    EnergyCause.AS_ADVISED: "The advice was followed. To hold and mend it, and to brake as in service, costs energy.",
    EnergyCause.LATENESS: "It was driven, by the advice or not, for an arrival that it missed by more than 10 s.",
    EnergyCause.FRICTION: "The friction brake took what the motors could have fed back: a habit, or its control.",
    EnergyCause.SIGNAL: "A signal at danger was in sight.",
    EnergyCause.RESTRICTION: "Restrictions that the optimum does not know were told or lifted.",
    EnergyCause.TRAIN: "Train, wind or rail were not as planned; errors of sampling once a second are in it as well.",
    EnergyCause.REST: "The driving was nearly the best, or what happened cannot be told apart.",
    EnergyCause.RECOVERED: "The train left late; to arrive by the timetable all the same takes so much more at best.",
    EnergyCause.ARRIVAL: "Arriving before the timetable's time costs energy, arriving after it saves some.",
}

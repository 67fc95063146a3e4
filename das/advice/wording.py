"""The texts of the advice in the drivers' languages. Programs read codes, causes and modes, never these texts.

The text of a withdrawal is in English only: the cab then shows nothing, and the text is for logs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime, tzinfo
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

from das.advice.advice import Cause, Withdrawal
from das.advice.reason import Reason, ReasonCode
from das.advice.regimes import KIND_OF, InstructionKind, Regime, mode_name
from das.domain.units import KM, KMH, NS
from das.estimate.estimate import Problem, ProblemKind

RESTRICTIONS_UNTOLD: Final = (
    "no list of restrictions received yet (if there are none, start das-node with --no-restrictions)"
)

STAMP_CURE: Final = "switch on timestamping in the sender's Zenoh configuration, and set its clock right"
"""Remedy for messages without their sender's time stamp."""

UNSTAMPED: Final = (
    "positions come without their sender's time stamp (or with one ahead of the clock), so that one publisher cannot "
    f"be distinguished from two: {STAMP_CURE}"
)


def withdrawal(why: Withdrawal) -> str:
    """The text that explains why there is no advice."""
    texts = {
        Cause.TWO_PUBLISHERS: f"two publishers of the position: {why.text}" if why.text else UNSTAMPED,
        Cause.TWO_OPERATORS: f"two publishers send different restrictions: {why.text}",
        Cause.RESTRICTIONS_UNHEEDED: f"restrictions cannot be applied: {why.text}",
        Cause.RESTRICTIONS_UNTOLD: RESTRICTIONS_UNTOLD,
        Cause.JOURNEY_REFUSED: f"journey refused: {why.text}",
        Cause.NO_JOURNEY: "no journey yet",
        Cause.MOVING_UP: "moving up to the stop",
        Cause.TWO_NODES: f"another node advises this train as well: {why.text}",
        Cause.STANDS_ON_LINE: "the train stands on the line",
        Cause.DRIVER_BRAKES: "the driver brakes against the advice",
    }
    return texts.get(why.cause, why.text)


_UNITS: Final = {
    3.6: "send m/s, not km/h",
    1.0 / 3.6: "send m/s, converted once",
    1000.0: "send speeds in m/s, not mm/s, and positions in m, not km",
    0.001: "send speeds in m/s, not km/s, and positions in m, not mm",
}
"""Remedies for speeds that are wrong by a factor."""


def problem(what: Problem) -> str:
    """The text that describes a problem of the position or the speed."""
    kind, value = what
    texts = {
        ProblemKind.NO_POSITION: "no position yet",
        ProblemKind.MARKED_UNUSABLE: "the position is marked unusable",
        ProblemKind.NOT_A_NUMBER: "the position is not a number",
        ProblemKind.SPEED_IMPOSSIBLE: f"a speed of {value / KMH:.4g} km/h is impossible",
        ProblemKind.POSITION_IMPOSSIBLE: f"a position of {value:.4g} m is impossible",
        ProblemKind.TOO_UNCERTAIN: f"the position is too uncertain: {value:.4g} m",
        ProblemKind.UNCERTAINTY_IMPOSSIBLE: f"an uncertainty of {value:.4g} is impossible",
        ProblemKind.SPEED_JUMPED: f"the speed jumped by {value / KMH:.0f} km/h",
        ProblemKind.SPEED_UNIT: f"the speeds are {value:.3g} times what the positions cover: {_UNITS.get(value, '')}",
        ProblemKind.SPEED_UNCONFIRMED: "the speed is not yet confirmed by the way",
        ProblemKind.JUMPED: f"the position jumped by {value:.0f} m",
        ProblemKind.JUMPED_BACK: f"the position jumped back by {value:.0f} m",
        ProblemKind.FROZEN: f"the position is frozen at {value:.0f} m",
        ProblemKind.STALE: f"the position is {value:.1f} s old",
        ProblemKind.RARE: f"positions come only every {value:.1f} s",
        ProblemKind.AHEAD_OF_CLOCK: f"the position is {value:.1f} s ahead of the clock",
        ProblemKind.POSITION_UNCERTAIN: f"the position is uncertain by {value:.0f} m",
        ProblemKind.SPEED_UNCERTAIN: f"the speed is uncertain by {value / KMH:.0f} km/h",
    }
    return texts[kind]


class Language(StrEnum):
    """The languages in which a display can show the advice; the values are those of the command line."""

    EN = "en"
    DE = "de"
    FR = "fr"


ARRIVAL_STEP_S: Final = 5.0
"""Step (s) of the lateness at arrival that is added to a reason, so that the words do not change every second."""


class _Words(NamedTuple):
    """The words of a language. `late` and `early` are templates with `{seconds}`, `arrives` is one with `{deviation}`.

    The templates of `reasons` may contain the limit or speed (`kmh`), the place (`km`), the time of day (`clock`), how
    late the train is (`deviation`), the stop with its preposition (`at_stop`), and the reason's own `text`, or
    `because`: the same text in brackets.
    """

    modes: Mapping[Regime, str]
    kinds: Mapping[InstructionKind, str]
    until: str
    reasons: Mapping[ReasonCode, str]
    at_stop: str
    on_time: str
    late: str
    early: str
    arrives: str
    top_speed: str


_WORDS: Final[Mapping[Language, _Words]] = {
    Language.EN: _Words(
        modes={**{mode: mode_name(mode) for mode in Regime}, Regime.DEPART: "depart when cleared"},
        kinds=dict(zip(InstructionKind, ("accelerate", "hold", "coast", "brake"), strict=True)),
        until="until",
        reasons={
            ReasonCode.TEXT: "{text}",
            ReasonCode.TOO_FAST: "too fast",
            ReasonCode.LIMIT: "{kmh} km/h from km {km}",
            ReasonCode.RESTRICTION: "restriction to {kmh} km/h from km {km}",
            ReasonCode.STOP: "stop{at_stop}",
            ReasonCode.POINT_EARLIEST: "km {km} not before {clock}{because}",
            ReasonCode.POINT_MISSED: "km {km} as soon as possible, wanted by {clock}{because}",
            ReasonCode.ARRIVED: "arrived, {deviation}",
            ReasonCode.DEPARTURE: "departure at {clock}",
            ReasonCode.NO_PLAN: "too fast; no plan from here ({text})",
            ReasonCode.FASTEST_SAFE: "no optimum yet: the fastest safe run",
            ReasonCode.AS_BEFORE: "no optimum yet: as before, no faster than is allowed now",
            ReasonCode.FASTEST: "fastest, {deviation}",
            ReasonCode.LEAST_ENERGY: "least energy, {deviation}",
            ReasonCode.WAITS_AT_STOP: "least energy, {deviation}: wait{at_stop}",
            ReasonCode.ON_TIME: "least energy on time",
            ReasonCode.ON_TIME_TOLD_LATE: "least energy on time, operator says {deviation}",
        },
        at_stop=" at {stop}",
        on_time="on time",
        late="{seconds} s late",
        early="{seconds} s early",
        arrives="arrives {deviation}",
        top_speed="top speed {speed}",
    ),
    Language.DE: _Words(
        modes={
            Regime.NONE: "keine Empfehlung",
            Regime.FULL_TRACTION: "volle Zugkraft",
            Regime.REDUCED_TRACTION: "verminderte Zugkraft",
            Regime.CRUISE: "Geschwindigkeit halten",
            Regime.COAST: "rollen lassen",
            Regime.REDUCED_BRAKE: "elektrisch bremsen",
            Regime.FULL_BRAKE: "elektrisch voll bremsen",
            Regime.FRICTION_BRAKE: "mit Druckluftbremse bremsen",
            Regime.STOP: "Halt",
            Regime.DEPART: "nach Zustimmung abfahren",
        },
        kinds=dict(zip(InstructionKind, ("beschleunigen", "Tempo halten", "rollen lassen", "bremsen"), strict=True)),
        until="bis",
        reasons={
            ReasonCode.TEXT: "{text}",
            ReasonCode.TOO_FAST: "zu schnell",
            ReasonCode.LIMIT: "{kmh} km/h ab km {km}",
            ReasonCode.RESTRICTION: "Langsamfahrstelle {kmh} km/h ab km {km}",
            ReasonCode.STOP: "Halt{at_stop}",
            ReasonCode.POINT_EARLIEST: "km {km} nicht vor {clock}{because}",
            ReasonCode.POINT_MISSED: "km {km} so bald wie möglich, gewünscht bis {clock}{because}",
            ReasonCode.ARRIVED: "angekommen, {deviation}",
            ReasonCode.DEPARTURE: "Abfahrt um {clock}",
            ReasonCode.NO_PLAN: "zu schnell; kein Plan von hier ({text})",
            ReasonCode.FASTEST_SAFE: "noch kein Optimum: schnellste sichere Fahrt",
            ReasonCode.AS_BEFORE: "noch kein Optimum: wie bisher, nicht schneller als jetzt erlaubt",
            ReasonCode.FASTEST: "schnellste Fahrt, {deviation}",
            ReasonCode.LEAST_ENERGY: "sparsamste Fahrt, {deviation}",
            ReasonCode.WAITS_AT_STOP: "sparsamste Fahrt, {deviation}: warten{at_stop}",
            ReasonCode.ON_TIME: "sparsamste Fahrt, pünktlich",
            ReasonCode.ON_TIME_TOLD_LATE: "sparsamste Fahrt, pünktlich; Leitstelle meldet {deviation}",
        },
        at_stop=" in {stop}",
        on_time="pünktlich",
        late="{seconds} s verspätet",
        early="{seconds} s zu früh",
        arrives="Ankunft {deviation}",
        top_speed="Höchstgeschwindigkeit {speed}",
    ),
    Language.FR: _Words(
        modes={
            Regime.NONE: "pas de conseil",
            Regime.FULL_TRACTION: "pleine traction",
            Regime.REDUCED_TRACTION: "traction réduite",
            Regime.CRUISE: "maintenir la vitesse",
            Regime.COAST: "marche sur l'erre",
            Regime.REDUCED_BRAKE: "frein électrique réduit",
            Regime.FULL_BRAKE: "frein électrique à fond",
            Regime.FRICTION_BRAKE: "frein à air",
            Regime.STOP: "arrêt",
            Regime.DEPART: "départ après assentiment",
        },
        kinds=dict(zip(InstructionKind, ("accélérer", "maintenir", "marche sur l'erre", "freiner"), strict=True)),
        until="jusqu'à",
        reasons={
            ReasonCode.TEXT: "{text}",
            ReasonCode.TOO_FAST: "trop vite",
            ReasonCode.LIMIT: "{kmh} km/h dès le km {km}",
            ReasonCode.RESTRICTION: "ralentissement à {kmh} km/h dès le km {km}",
            ReasonCode.STOP: "arrêt{at_stop}",
            ReasonCode.POINT_EARLIEST: "km {km} pas avant {clock}{because}",
            ReasonCode.POINT_MISSED: "km {km} dès que possible, souhaité avant {clock}{because}",
            ReasonCode.ARRIVED: "arrivé, {deviation}",
            ReasonCode.DEPARTURE: "départ à {clock}",
            ReasonCode.NO_PLAN: "trop vite ; aucun plan d'ici ({text})",
            ReasonCode.FASTEST_SAFE: "pas encore d'optimum : la marche sûre la plus rapide",
            ReasonCode.AS_BEFORE: "pas encore d'optimum : comme avant, sans dépasser ce qui est permis",
            ReasonCode.FASTEST: "marche la plus rapide, {deviation}",
            ReasonCode.LEAST_ENERGY: "marche économique, {deviation}",
            ReasonCode.WAITS_AT_STOP: "marche économique, {deviation} : attendre{at_stop}",
            ReasonCode.ON_TIME: "marche économique, à l'heure",
            ReasonCode.ON_TIME_TOLD_LATE: "marche économique, à l'heure ; la régulation annonce {deviation}",
        },
        at_stop=" à {stop}",
        on_time="à l'heure",
        late="{seconds} s de retard",
        early="{seconds} s d'avance",
        arrives="arrivée avec {deviation}",
        top_speed="vitesse maximale {speed}",
    ),
}
_WITH_ARRIVAL: Final = frozenset({
    *(ReasonCode.LIMIT, ReasonCode.RESTRICTION, ReasonCode.STOP, ReasonCode.ARRIVAL),
    *(ReasonCode.POINT_EARLIEST, ReasonCode.POINT_MISSED),
})  # fmt: skip
"""Reasons to which the lateness at arrival is added, if it is known."""


@lru_cache(maxsize=16)  # Advice gives the same reason for many seconds.
def words(reason: Reason, language: Language = Language.EN, zone: tzinfo = UTC) -> str:
    """A reason in words, with times of day in a time zone; empty if there is nothing to say."""
    said = _WORDS[language]
    text = said.reasons.get(reason.code, "").format(
        kmh=f"{reason.speed_mps / KMH:.0f}",
        km=f"{reason.at_m / KM:.1f}".replace(".", "." if language is Language.EN else ","),
        clock=f"{datetime.fromtimestamp(reason.time_ns * NS, zone):%H:%M:%S}",
        deviation=deviation(reason.late_s, language),
        at_stop=said.at_stop.format(stop=reason.stop) if reason.stop else "",
        text=reason.text,
        because=f" ({reason.text})" if reason.text else "",
    )
    states_arrival = reason.code in _WITH_ARRIVAL and math.isfinite(reason.late_s)
    steps = round(reason.late_s / ARRIVAL_STEP_S) if states_arrival else 0
    arrival = said.arrives.format(deviation=deviation(steps * ARRIVAL_STEP_S, language)) if steps else ""
    return ", ".join(filter(None, (text, arrival)))


def deviation(late_s: float, language: Language = Language.EN) -> str:
    """A lateness (s; early < 0) in words; a train within 0.5 s is on time."""
    said = _WORDS[language]
    seconds = f"{abs(late_s):.0f}"
    if seconds == "0":
        return said.on_time
    return (said.late if late_s > 0 else said.early).format(seconds=seconds)


def lateness(language: Language = Language.EN) -> dict[str, str]:
    """The words of `deviation` for a display that inserts the time itself in place of "{seconds} s"."""
    said = _WORDS[language]
    return {"on_time": said.on_time, "late": said.late, "early": said.early}


def mode_words(mode: Regime, language: Language = Language.EN) -> str:
    """The words that a display shows for a driving mode."""
    return _WORDS[language].modes[mode]


def instruction_words(mode: Regime, language: Language = Language.EN) -> str:
    """The verb that a display of the guide shows for a mode; the effort of the instruction is shown next to it."""
    kind = KIND_OF.get(mode)
    return mode_words(mode, language) if kind is None else _WORDS[language].kinds[kind]


def words_before_speed(mode: Regime, language: Language = Language.EN) -> str:
    """The words before the speed of an instruction on a display of the guide; those for coasting end with "until"."""
    verb = instruction_words(mode, language)
    return f"{verb} {_WORDS[language].until}" if mode is Regime.COAST else verb


def top_speed(speed: str, language: Language = Language.EN) -> str:
    """The words that a display shows for a speed that is not to be exceeded."""
    return _WORDS[language].top_speed.format(speed=speed)

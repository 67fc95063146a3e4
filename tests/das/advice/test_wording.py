"""The words of reasons and modes: every code in every language, times in the line's time zone, and what is left out."""

from __future__ import annotations

import re
from datetime import UTC, tzinfo
from zoneinfo import ZoneInfo

import pytest

from das.advice.reason import NO_REASON, Reason, ReasonCode
from das.advice.regimes import KIND_OF, InstructionKind, Regime
from das.advice.wording import (
    Language,
    deviation,
    instruction_words,
    mode_words,
    problem,
    top_speed,
    words,
    words_before_speed,
)
from das.domain.units import KMH
from das.estimate.estimate import Problem, ProblemKind
from das.estimate.plausibility import FACTORS

DE, EN, FR = Language.DE, Language.EN, Language.FR
ZURICH = ZoneInfo("Europe/Zurich")
WINTER_NS = 1_800_001_950 * 10**9
"""2027-01-15 08:32:30 UTC."""


def full(code: ReasonCode) -> Reason:
    """A reason that has all figures and names."""
    return Reason(
        code=code,
        speed_mps=80 * KMH,
        at_m=20_100.0,
        time_ns=WINTER_NS,
        late_s=40.0,
        stop="Zug",
        text="signal at km 46.0",
    )


@pytest.mark.parametrize("language", Language)
def test_every_code_has_words_in_every_language(language: Language) -> None:
    """Only the code for nothing to say has none; no two codes read alike, and nothing is left to fill in."""
    said = {code: words(full(code), language, ZURICH) for code in ReasonCode}
    assert [code for code, text in said.items() if not text] == [ReasonCode.NONE]
    assert len(set(said.values())) == len(ReasonCode)
    assert not any(re.search(r"[{}]|nan", text) for text in said.values())


@pytest.mark.parametrize("code", [code for code in ReasonCode if code not in (ReasonCode.NONE, ReasonCode.TEXT)])
def test_the_words_of_the_languages_differ(code: ReasonCode) -> None:
    """A limit reads alike but for the word before its place."""
    assert len({words(full(code), language) for language in Language}) == len(Language)


def test_a_wrong_unit_is_named_with_what_to_send_instead() -> None:
    said = [problem(Problem(ProblemKind.SPEED_UNIT, factor)) for factor in FACTORS]
    assert all(": send " in text for text in said)
    assert len(set(said)) == len(FACTORS)


@pytest.mark.parametrize("language", Language)
def test_every_mode_has_words_of_its_own_in_every_language(language: Language) -> None:
    assert len({mode_words(mode, language) for mode in Regime}) == len(Regime)
    assert all(mode_words(mode, language) for mode in Regime)
    assert len({instruction_words(mode, language) for mode in KIND_OF}) == len(InstructionKind)
    assert "80 km/h" in top_speed("80 km/h", language)


def test_a_coasting_train_is_told_no_speed_that_reads_like_one_to_hold() -> None:
    said = {language: words_before_speed(Regime.COAST, language) for language in Language}
    assert said == {EN: "coast until", DE: "rollen lassen bis", FR: "marche sur l'erre jusqu'à"}
    assert words_before_speed(Regime.CRUISE) == instruction_words(Regime.CRUISE) == "hold"
    assert instruction_words(Regime.COAST) == "coast", "no speed follows"


@pytest.mark.parametrize(
    ("reason", "language", "zone", "expected"),
    [
        (NO_REASON, EN, UTC, ""),
        (Reason(code=ReasonCode.LIMIT, speed_mps=90 * KMH, at_m=20_100.0), EN, UTC, "90 km/h from km 20.1"),
        (Reason(code=ReasonCode.STOP, stop="Zug"), EN, UTC, "stop at Zug"),
        (Reason(code=ReasonCode.STOP, stop="Zug"), DE, UTC, "Halt in Zug"),
        (Reason(code=ReasonCode.STOP, stop="Zug"), FR, UTC, "arrêt à Zug"),
        (Reason(code=ReasonCode.STOP), DE, UTC, "Halt"),
        (Reason(code=ReasonCode.STOP, stop="Zug", late_s=41.0), EN, UTC, "stop at Zug, arrives 40 s late"),
        (Reason(code=ReasonCode.ARRIVAL, late_s=-20.0), EN, UTC, "arrives 20 s early"),
        (Reason(code=ReasonCode.ARRIVAL, late_s=40.0), DE, UTC, "Ankunft 40 s verspätet"),
        (Reason(code=ReasonCode.DEPARTURE, time_ns=WINTER_NS), EN, UTC, "departure at 08:32:30"),
        (Reason(code=ReasonCode.DEPARTURE, time_ns=WINTER_NS), DE, ZURICH, "Abfahrt um 09:32:30"),
        (
            Reason(code=ReasonCode.POINT_EARLIEST, at_m=44_800.0, time_ns=WINTER_NS, text="signal at km 46.0"),
            *(FR, ZURICH, "km 44,8 pas avant 09:32:30 (signal at km 46.0)"),
        ),
        (Reason(code=ReasonCode.TOO_FAST, speed_mps=5.0), DE, UTC, "zu schnell"),
        (Reason.of_text("solving failed"), FR, UTC, "solving failed"),
    ],
)
def test_reasons_are_what_a_driver_would_say(reason: Reason, language: Language, zone: tzinfo, expected: str) -> None:
    assert words(reason, language, zone) == expected


def test_a_summer_time_is_said_in_summer() -> None:
    summer_ns = WINTER_NS + 180 * 86_400 * 10**9
    assert words(Reason(code=ReasonCode.DEPARTURE, time_ns=summer_ns), zone=ZURICH) == "departure at 10:32:30"


@pytest.mark.parametrize(("late_s", "said"), [(0.4, "on time"), (12.4, "12 s late"), (-3.0, "3 s early")])
def test_a_deviation(late_s: float, said: str) -> None:
    assert deviation(late_s) == said

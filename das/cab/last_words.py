"""The last word on every advice, as the cab uses it: in the situation of the leg under way, counted, and said."""

from __future__ import annotations

import math
from collections import Counter

from das.advice.advice import Advice
from das.advice.braking_model import BrakingBasis
from das.advice.last_word import Act, LastWord, Part
from das.cab.learning import is_fresh
from das.cab.situation import Situation
from das.domain.units import KMH, KN
from das.estimate.estimate import Estimate

SAID_EVERY_S = 30.0
"""The last word on one part of the advice is said once, and again only after so long without the same."""


class LastWords:
    """Judges advices, counts what was replaced, and keeps what there is to say of it."""

    def __init__(self) -> None:
        self.acts: Counter[Part] = Counter()
        """How often each part of an advice was replaced since the start."""
        self._word = LastWord()
        self._replaced_ns: dict[Part, int] = {}
        self._news: list[str] = []

    def judged(self, advice: Advice, here: Estimate, situation: Situation, ends_m: tuple[float, float]) -> Advice:
        """The advice after the last word on it, on the section between two positions: the same, or what is safe."""
        basis = BrakingBasis(
            route=situation.route,
            vehicle=situation.vehicle,
            brakes=situation.vehicle.brakes_at(situation.level or situation.vehicle.default_level),
            restrictions=situation.restrictions,
            conditions=situation.conditions,
            start_m=ends_m[0],
            end_m=ends_m[1],
            point_mass=situation.point_mass,
        )
        said, acts = self._word.judge(advice, here, basis)
        for act in acts:
            self.acts[act.part] += 1
            if not is_fresh(self._replaced_ns.get(act.part), advice.time_ns, SAID_EVERY_S):
                self._news.append(words_of(act))
            self._replaced_ns[act.part] = advice.time_ns
        return said

    def take_news(self) -> list[str]:
        """What was replaced since this was last asked, in words."""
        news, self._news = self._news, []
        return news


def words_of(act: Act) -> str:
    """What the last word replaced in an advice, and by what."""
    value = "not a number" if math.isnan(act.value_mps) else f"{act.value_mps / KMH:.1f} km/h"
    bound = "" if math.isnan(act.bound_mps) else f" where {act.bound_mps / KMH:.1f} km/h is the most"
    if math.isfinite(act.instead_n):
        instead = f"{act.instead_n / KN:.0f} kN is said instead"
    elif math.isfinite(act.instead_mps):
        instead = f"{act.instead_mps / KMH:.1f} km/h is said instead"
    else:
        instead = "it is left out"
    return f"last word: {act.part}: {value}{bound}; {instead}"

"""The safety assessment: random days in closed loop, judged by a witness that reads the raw files.

`DAS_ASSESSMENT_DAYS=1000 pytest tests/property/test_assessment.py` drives more days; `DAS_ASSESSMENT_FIRST=500` begins
with another one.

Drivers do exactly what one of the presentations shows (the guide's, the full advice, the top speed, the four modes) up
to 2 s late, and have no eyes of their own. On each day restrictions come, overlap and go, often nearer than the train
can brake for; operators are lost, doubled or replaced; the journey is changed, the node restarted, the force sensor
has a gain of 0.5 to 1.5; on four days of ten positions, speeds or clocks are wrong as well. No part of any advice may
be above limit or brake curve; who follows it is nowhere more than 1 m/s too fast, and stops within 10 m. Positions
count within twice the deviation that the advice states.

An act of the last word spoils a day as well, unless wrong clocks, positions or speeds were drawn for it.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from das.advice.advice import Cause
from tests.support.assessment import Assessor
from tests.support.drawn_day import draw

FIRST, DAYS = int(os.environ.get("DAS_ASSESSMENT_FIRST", "0")), int(os.environ.get("DAS_ASSESSMENT_DAYS", "50"))
FAILED_ONCE = (97, 100)
"""Days that failed before a mend: a stop 11 m short, an announcement that the last word left out."""
QUICK = (1, 3, 4, 6, 9, 11, *FAILED_ONCE)
"""The days of the default run: every presentation, wrong speeds, jumps, frozen positions, a rival operator."""


def numbers() -> list[Any]:
    """The numbers of days, as parameters: the quick ones, and the rest marked; all if the environment says how many."""
    days = range(FIRST, FIRST + DAYS)
    if "DAS_ASSESSMENT_DAYS" in os.environ:
        return [pytest.param(days, id="all")]
    rest = [day for day in days if day not in QUICK]
    return [pytest.param(QUICK, id="quick"), pytest.param(rest, id="rest", marks=pytest.mark.nightly)]


@pytest.mark.parametrize("days", numbers())
def test_no_advice_is_above_limit_or_brakes_whatever_fails(tmp_path: Path, days: Sequence[int]) -> None:
    """Random days with failures: none of them has an advice that the witness refuses, or a stop that is missed."""
    assessor = Assessor(tmp_path)
    verdicts = [assessor.assess(draw(day)) for day in days]
    counts: Counter[str] = sum((one.counts for one in verdicts), Counter())
    print(dict(counts))
    bad = [one.said() for one in verdicts if one.problems]
    assert not bad, "\n".join(bad)
    assert counts["advised"] > 0.3 * sum(counts[cause.label] for cause in Cause) + 1

"""The guide in the cab: it shows what the coach shows, and its instructions are made by `das.advice.guide`."""

from __future__ import annotations

from typing import Final

from sim.drivers.presentations.coach import CoachPresenter


class GuidePresenter(CoachPresenter):
    """Shows the guide's present instruction with its speed, effort and reason, and the next change."""

    number = 7
    phrase = "the guide in the cab (what to do now, up to which speed, and what comes next)"
    needs_guide = True


PRESENTER: Final = GuidePresenter()

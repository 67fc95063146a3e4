"""A recording as one picture, without a viewer or a screen: over distance, over time, and what happened."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from das.bus.recording import Recording
from das.command_line.outputs import check_picture, save_figure
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from sim.drive.drive import Drive
from sim.review.colors import LIGHT, Theme
from sim.review.series import on_trip
from sim.review.story import Story

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim.review.account_view import CostSpan

TITLE_IN, LINE_IN = 0.35, 0.19
"""Height (in) of the title, and of each line below it."""
AXIS_IN = 0.45
"""Room (in) for the name and the numbers of a horizontal axis."""
CLOCK_AXIS_IN = 0.6
"""Room (in) for the name of a time axis, the clock and the time of day."""


def save_picture(recording: Recording, picture_path: Path, theme: Theme = LIGHT) -> None:
    """Write the picture of a recording; the suffix (.png, .pdf, .svg) decides its kind.

    Raises DasError for a recording without positions, a place that cannot be written to, or where matplotlib is not
    installed.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise DasError("matplotlib is not installed: pip install '.[view]' in the checkout")
    check_picture(picture_path)
    check_writable(picture_path, overwrite=True)
    from sim.review.canvas import DPI

    save_figure(picture_path, picture_of(recording, theme), dpi=DPI, facecolor=theme.background)


def picture_of(recording: Recording, theme: Theme = LIGHT) -> Figure:
    """The picture of a recording as a matplotlib figure; DasError for a recording without positions."""
    from sim.review import distance_panels, time_panels
    from sim.review.canvas import SMALL, figure_of, list_height_in, listed
    from sim.review.summary import headline, on_this_day

    drive = Drive(source=recording)
    story, costs = _with_costs(Story.of(drive))
    speed, *rest = distance_panels.PANELS
    day = [*on_this_day(recording), *filter(None, [story.filled_from])]
    first = (speed._replace(above_in=speed.above_in + TITLE_IN + LINE_IN * len(day)), *rest)
    below = time_panels.panels(story, costs)
    below["speed"] = below["speed"]._replace(above_in=AXIS_IN + distance_panels.PANELS[0].above_in)
    figure, axes = figure_of((*first, *below.values()), CLOCK_AXIS_IN + list_height_in(story.happenings), theme)
    distance_panels.over_distance(axes[: len(first)], story, theme)
    time_panels.over_time(dict(zip(below, axes[len(first) :], strict=True)), story, theme, costs)
    top = 1.0 - 0.7 * TITLE_IN / figure.get_figheight()
    figure.text(0.5, top, headline(drive), color=theme.ink, ha="center", fontsize=11.0)
    for number, line in enumerate(day):
        y = 1.0 - (TITLE_IN + (number + 0.55) * LINE_IN) / figure.get_figheight()
        figure.text(0.5, y, line, color=theme.ink, ha="center", fontsize=SMALL)
    listed(figure, story.trip, story.clock, story.happenings, theme)
    return figure


def _with_costs(story: Story) -> tuple[Story, tuple[CostSpan, ...]]:
    """The story with the curves of the energy lost and of the optimum's, and the times that cost energy.

    They are left out where it is not known where the energy went, as of a recording without a line or a train.
    """
    from sim.review.account_view import AccountView

    if story.drive.account is None:
        return story, ()
    shown = AccountView.of(story.drive.account)
    within = {name: on_trip(story.trip, *one, held=False) for name, one in shown.series.items()}
    return replace(story, series={**story.series, **within}), shown.worth

"""The trip over distance as one picture for the viewer: rerun's own plots always follow its active timeline."""

from __future__ import annotations

import io
from dataclasses import dataclass

from das.domain.units import KM
from sim.review.canvas import BACKGROUND, figure_of, list_height_in, listed
from sim.review.distance_panels import PANELS, over_distance
from sim.review.series import Floats
from sim.review.story import Story

AXIS_IN = 0.45
"""Room (in) for the name and the numbers of a horizontal axis."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG picture, and where things are in it: pixel = origin + scale · (position in km, speed in km/h)."""

    png: bytes
    origin_px: tuple[float, float]
    scale_px: tuple[float, float]
    top_px: float
    bottom_px: float

    def pixel(self, s_m: Floats, speed_kmh: Floats) -> tuple[Floats, Floats]:
        """Columns and rows of pixels at which points of the speed panel lie."""
        (x0, y0), (dx, dy) = self.origin_px, self.scale_px
        return x0 + dx * s_m / KM, y0 + dy * speed_kmh


def draw(story: Story) -> Picture:
    """Draw the trip over distance: what was driven, advised and allowed, and what happened where."""
    figure, axes = figure_of(PANELS, AXIS_IN + list_height_in(story.happenings))
    over_distance(axes, story)
    listed(figure, story.trip, story.clock, story.happenings)
    png = io.BytesIO()
    figure.savefig(png, format="png", facecolor=BACKGROUND)
    height, speed = figure.bbox.height, axes[0]
    (x0, y0), (x1, y1) = speed.transData.transform(((0.0, 0.0), (1.0, 1.0)))
    return Picture(
        png=png.getvalue(),
        origin_px=(x0, height - y0),
        scale_px=(x1 - x0, y0 - y1),
        top_px=height - speed.bbox.y1,
        bottom_px=height - axes[-1].bbox.y0,
    )

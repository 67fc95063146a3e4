"""What the driver saw, in the viewer: a speedometer with the limit and the advised speed, and the words of the display.

The speedometer is a drawing in a plane whose hands move with the time. Its scale ends above all that was driven and
allowed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import rerun as rr

from sim.meanings import VIEWER, Meaning, rgba
from sim.recording.course import Floats, Times
from sim.review.scene import NOTHING, ReviewScene
from sim.review.words import DisplayWords, cards

DIAL, CAB_CARD = "dial", "cab"
"""Entities of the speedometer, and of the words of the display."""
STEP_KMH: Final = 20.0
"""Distance (km/h) of the figures on the scale."""
START_DEG, SWEEP_DEG = 220.0, -260.0
"""Start of the scale, anticlockwise from the right, and its extent."""
RADIUS: Final = 100.0
"""Radius of the scale in the plane."""
EXTENT: Final = 128.0
"""Half the width of the plane that the view shows."""
HANDS: Final = {
    "limit": (Meaning.LIMIT, (1.02, 1.14), 4.0),
    "shown": (Meaning.SHOWN, (0.80, 1.0), 5.0),
    "driven": (Meaning.DRIVEN, (0.0, 0.76), 3.0),
}
"""The hands by the speeds that they show, where each begins and ends (shares of the radius), and its width (px). A hand
without a speed, as when nothing is shown, stands at 0."""


def send_cab(
    out: rr.RecordingStream, timeline: Callable[[Times], list[rr.TimeColumn]], scene: ReviewScene, said: DisplayWords
) -> None:
    """Send what the driver saw: the speedometer, and the words of the display; `timeline` puts moments on the time."""
    found = cards(scene.drive.table, said)
    if found:
        markdown = [rr.MediaType.MARKDOWN] * len(found)
        columns = rr.TextDocument.columns(text=[card.text for card in found], media_type=markdown)
        out.send_columns(CAB_CARD, timeline(np.array([card.time_ns for card in found])), columns)
    top_kmh = STEP_KMH * np.ceil(1.02 * max((scene.extent("speed") or (0.0, 0.0))[1], 5.0 * STEP_KMH) / STEP_KMH)
    _scale(out, top_kmh)
    for name, (meaning, ends, width) in HANDS.items():
        time_ns, speed_kmh = scene.series.get(f"speed/{name}", NOTHING)
        if not len(time_ns):
            continue
        looks = rr.LineStrips2D.from_fields(colors=rgba(VIEWER.of[meaning]), radii=rr.Radius.ui_points(0.5 * width))
        out.log(f"{DIAL}/{name}", looks, static=True)
        strips = np.stack([on_dial(np.nan_to_num(speed_kmh) / top_kmh, RADIUS * share) for share in ends], axis=1)
        out.send_columns(f"{DIAL}/{name}", timeline(time_ns), rr.LineStrips2D.columns(strips=strips.astype(np.float32)))


def on_dial(share: Floats, radius: float) -> Floats:
    """Places in the plane at shares of the scale, in shape (shares, 2)."""
    angle = np.radians(START_DEG + SWEEP_DEG * np.clip(share, 0.0, 1.0))
    return np.column_stack((radius * np.cos(angle), -radius * np.sin(angle)))


def _scale(out: rr.RecordingStream, top_kmh: float) -> None:
    """Send the scale with its figures."""
    shares = np.arange(0.0, top_kmh + 1.0, STEP_KMH) / top_kmh
    ticks = np.stack([on_dial(shares, RADIUS), on_dial(shares, 0.9 * RADIUS)], axis=1)
    lines = [on_dial(np.linspace(0.0, 1.0, 121), RADIUS), *ticks]
    ink, thin = rgba(VIEWER.ink), rr.Radius.ui_points(0.7)
    out.log(f"{DIAL}/scale", rr.LineStrips2D(lines, colors=ink, radii=thin), static=True)
    labels, nothing = [f"{share * top_kmh:.0f}" for share in shares], rr.Radius.ui_points(0.0)
    figures = rr.Points2D(on_dial(shares, 0.64 * RADIUS), labels=labels, colors=ink, radii=nothing, show_labels=True)
    out.log(f"{DIAL}/figures", figures, static=True)

"""Tracks of a receiver in formats of other programs."""

from __future__ import annotations

import numpy as np


def as_gpx(rows: list[list[str]]) -> str:
    """A GPS record as GPX without speeds."""
    points = "".join(
        f'<trkpt lat="{a}" lon="{b}"><time>{np.datetime64(int(float(ms)), "ms")}Z</time></trkpt>\n'
        for a, b, _, ms in rows
    )
    return f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n{points}</trkseg></trk></gpx>\n'

"""Draws the pictures of the cab desk for the documents: `python -m tests.support.desk_pictures` (some minutes).

The browser tests of the page draw what they look at; this takes some of it, in 256 colours, into
`docs/results/0.2/screens`.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest
from PIL import Image

from tests.support.making import REPOSITORY

IMAGES: Final = REPOSITORY / "docs" / "results" / "0.2" / "screens"
TAKEN: Final = {
    "desk-en-restriction": "restriction", "desk-en-arriving": "arriving", "desk-en-braked": "braked",
    "tablet-fr-signal": "tablet-fr", "upright-de-coasting": "upright-de", "replay": "replay",
    "shown-rms": "rms", "shown-four-mode": "four-mode", "shown-vector": "vector", "shown-deviation": "deviation",
}  # fmt: skip
"""The pictures by the names that the tests give them, and their names in the documents."""
COLORS: Final = 256


def main() -> int:
    """Run the tests of the page with pictures, and keep some; returns pytest's exit code."""
    with TemporaryDirectory() as folder:
        os.environ["DAS_DESK_PICTURES"] = folder
        pages = [str(REPOSITORY / "tests" / "sim" / "desk" / name) for name in ("test_page.py", "test_replay.py")]
        code = pytest.main(["-q", "-n", "0", "-m", "browser", *pages])
        if not code:
            IMAGES.mkdir(parents=True, exist_ok=True)
            for name, kept in TAKEN.items():
                drawn = Image.open(Path(folder) / f"{name}.png").convert("RGB")
                drawn.quantize(COLORS, dither=Image.Dither.NONE).save(IMAGES / f"{kept}.png", optimize=True)
    return int(code)


if __name__ == "__main__":
    sys.exit(main())

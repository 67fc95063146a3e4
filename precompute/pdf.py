"""Prints an HTML page as PDF with an installed Chromium."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from das.domain.errors import DasError
from das.domain.files.writing import write_whole

BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
LONGEST_S: Final = 120.0
"""Longest time (s) for printing a page."""


def browser() -> str:
    """The program of an installed Chromium; DasError if there is none."""
    for name in BROWSERS:
        found = shutil.which(name)
        if found is not None:
            return found
    raise DasError(f"a PDF needs one of {', '.join(BROWSERS)}, and none is installed; print the page instead")


def write_pdf(page: str, path: Path) -> None:
    """Write a page as PDF; DasError if the browser does not print it, or the file cannot be written."""
    program = browser()
    with tempfile.TemporaryDirectory(prefix="das-page-") as folder:
        source, target = Path(folder) / "page.html", Path(folder) / "page.pdf"
        source.write_text(page, encoding="utf-8")
        command = [
            program,
            "--headless",
            "--disable-gpu",
            "--no-pdf-header-footer",
            f"--user-data-dir={folder}/profile",
        ]
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium refuses to run as root with its sandbox
        try:
            done = subprocess.run(
                [*command, f"--print-to-pdf={target}", source.as_uri()],
                capture_output=True,
                timeout=LONGEST_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise DasError(f"{path}: {program} did not print the page within {LONGEST_S:.0f} s") from None
        if done.returncode or not target.is_file():
            raise DasError(f"{path}: {program} did not print the page (exit code {done.returncode})")
        write_whole(path, target.read_bytes())

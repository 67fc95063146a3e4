"""The page of a report about one drive or several: as HTML, as JSON for programs, and as PDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Any, Final, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from das import __version__
from das.bus.recording import recording_of
from das.domain.units import kwh
from sim.drive.attribution import as_dict as energy_dict
from sim.drive.calls import as_rows as stops_as_rows
from sim.drive.calls import passings_as_rows
from sim.drive.comparison import AlignedDrives, sentences
from sim.drive.comparison import as_dict as comparison_dict
from sim.drive.drive import Drive
from sim.drive.events import as_rows
from sim.meanings import LIGHT
from sim.recording.check import RATE_COLUMNS, Checked, check_contents
from sim.recording.opening import open_contents
from sim.review import pictures, tables
from sim.review.first_page import findings, first_page_dict, in_lines, page_dict, title, where_time_went
from sim.review.scene import ReviewScene

TEMPLATE: Final = "page.html.j2"


class ReviewedDrive(NamedTuple):
    """A drive with all its figures, and the result of `das-sim check` on its recording."""

    drive: Drive
    checked: Checked


def subject_of(path: Path) -> ReviewedDrive:
    """Read a recording; DasError if it cannot be used."""
    contents = open_contents(path)
    drive = Drive(recording=recording_of(contents))
    return ReviewedDrive(drive, check_contents(contents, drive.recording))


def page(subjects: Sequence[ReviewedDrive], aligned: AlignedDrives | None, not_compared: str) -> str:
    """The page as HTML, which needs no other file."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    names = "; ".join(title(subject.drive) for subject in subjects)
    return environment.get_template(TEMPLATE).render(
        title=f"Report: {names}",
        version=__version__,
        theme=LIGHT,
        zones=", ".join(dict.fromkeys(str(subject.drive.table.zone) for subject in subjects)),
        drives=[_drive(subject) for subject in subjects],
        comparison=None if aligned is None else _comparison(aligned),
        not_compared=not_compared,
        rate_columns=RATE_COLUMNS,
    )


def _drive(subject: ReviewedDrive) -> dict[str, Any]:
    drive, attribution = subject.drive, subject.drive.energy.attribution
    return {
        "name": drive.name,
        "title": title(drive),
        "first": page_dict(drive),
        "lateness": " ".join(where_time_went(drive)),
        "figures": tables.figures(drive),
        "stops": tables.stop_rows(drive),
        "passings": tables.passing_rows(drive),
        "causes": [] if attribution is None else tables.cause_rows(attribution),
        "legs": [] if attribution is None else tables.leg_rows(attribution),
        "why_not": drive.energy.why_no_attribution,
        "events": tables.event_rows(drive),
        "advice": tables.advice_rows(drive),
        "bookmarks": tables.bookmark_rows(drive),
        "timed": any(one.timed for one in drive.calls),
        "zero_is": drive.table.clock.zero_is,
        "at_desk": f"das-sim desk {quote(drive.recording.path.name)}" if drive.table.has("cab") else "",
        "health": subject.checked,
        "inputs": tables.input_rows(drive),
        "images": _images(drive),
    }


def _images(drive: Drive) -> dict[str, str]:
    scene, known = ReviewScene.of(drive), drive.energy.attribution is not None
    made = {
        "first": pictures.first_figure(scene, findings(drive)),
        "speed": pictures.drive_figure(scene),
        "places": pictures.place_figure(scene) if known else None,
    }
    return {name: "" if figure is None else pictures.as_image(figure) for name, figure in made.items()}


def _comparison(aligned: AlignedDrives) -> dict[str, Any]:
    others = range(1, len(aligned.drives))
    return {
        "sentences": [line for index in others for line in sentences(aligned, index)],
        "image": pictures.as_image(pictures.comparison_figure(aligned)),
        "tables": [
            {
                "label": aligned.drives[index].label,
                "rows": [one.cells for one in aligned.pairs[index].stretches(1)],
            }
            for index in others
            if not aligned.pairs[index].is_same(1)
        ],
    }


def as_dict(subjects: Sequence[ReviewedDrive], aligned: AlignedDrives | None, not_compared: str) -> dict[str, Any]:
    """The report for programs."""
    return {
        "drives": [_drive_dict(subject) for subject in subjects],
        "comparison": None if aligned is None else comparison_dict(aligned),
        "not_compared": not_compared or None,
    }


def _drive_dict(subject: ReviewedDrive) -> dict[str, Any]:
    drive, zero_ns = subject.drive, subject.drive.table.clock.zero_ns
    return {
        "recording": str(drive.recording.path),
        "complete": drive.recording.complete,
        "in_words": " ".join(in_lines(drive)),
        "zero_ns": zero_ns,
        "first_page": first_page_dict(drive),
        "within_shown_speed_ratio": tables.compliance(drive)[0],
        "figures": drive.figures.as_dict(),
        "stops": stops_as_rows(drive.calls, zero_ns),
        "passings": passings_as_rows(tables.passings(drive), zero_ns),
        "above_optimum_likely_low_kwh": None if drive.energy.likely is None else kwh(drive.energy.likely.low_j),
        "above_optimum_likely_high_kwh": None if drive.energy.likely is None else kwh(drive.energy.likely.high_j),
        "energy": None if drive.energy.attribution is None else energy_dict(drive.energy.attribution),
        "not_comparable": drive.energy.not_comparable or None,
        "no_energy_because": drive.energy.why_no_attribution or None,
        "events": as_rows(drive.events, drive.table.clock),
        "health": subject.checked.as_dict(),
    }

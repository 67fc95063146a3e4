"""The driver's sheet of a journey as a page to print or to read on a tablet: instructions by place.

Like the lists of speeds that railways issue hours before a departure, it does not change during the trip. The
instructions of a section are the guide's timeline for the planned running time, with a higher price of a change, to
keep the paper short. Places are given by kilometre and speed board.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from das import __version__
from das.advice.guide.planning import Wanted, planned
from das.advice.guide.timeline import timeline
from das.advice.regimes import InstructionKind
from das.domain.braking import USUAL
from das.domain.journey import Window
from das.domain.route import Floats, Route
from das.domain.units import KM, KMH, kmh, kwh_words
from das.drawing.colors import LIMIT, MODES
from das.offline.asked_journey import Held, Passing
from das.offline.journey import JourneyPlan, JourneyPlanner, SectionPlan
from das.solver.guide.policies import GuideFront, PolicySettings
from das.solver.guide.schedule import Prospect, Schedule
from das.solver.section import Section, with_braking

CHANGE_S = PolicySettings().young_s
"""Time (s) of full power whose energy a change of regime must save: as much as a change of an instruction that has just
been shown, because every line of a sheet has to be found, read and remembered."""
PLACE_M = 100.0
"""Step (m) of places on a sheet: posts and boards do not allow the driver a finer one."""
SETTINGS = PolicySettings(change_s=CHANGE_S, young_s=2.0 * CHANGE_S)


@dataclass(frozen=True, kw_only=True)
class SheetLine:
    """An instruction: the action from a place (m) on, the speed (m/s) to reach or to hold, and the planned time.

    `after_s` counts from the departure. For a coast, the speed is the one at its end. `effort_ratio` is the share of
    the largest effort of traction; 0 without traction.
    """

    kind: InstructionKind
    s_m: float
    speed_mps: float
    after_s: float
    effort_ratio: float = 0.0

    @property
    def posted_m(self) -> float:
        """The place (m) as printed, in tenths of a kilometre: rounded so that brakes come earlier and traction later.

        Braking later would be too hard; with traction earlier, the train would exceed the limit that is ending.
        """
        place = self.s_m / PLACE_M
        if self.kind is InstructionKind.BRAKE:
            return math.floor(place + 0.1) * PLACE_M
        return (math.ceil(place - 0.1) if self.kind is InstructionKind.TRACTION else round(place)) * PLACE_M


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionSheet:
    """The instructions of a section in the order of the line, and the run of a train that follows them.

    `s_m`, `t_s` (from the departure) and `v_mps` are that run; `energy_j` is its energy at the current collector.
    """

    section: Section
    lines: tuple[SheetLine, ...]
    s_m: Floats
    t_s: Floats
    v_mps: Floats
    energy_j: float

    def speed_at(self, s_m: float) -> float:
        """The speed (m/s) of that run at a place (m); v² is linear between the nodes."""
        return float(np.sqrt(np.interp(s_m, self.s_m, self.v_mps**2)))


def section_sheet(
    section: Section, time_s: float, point_m: float | None = None, window: Window | None = None
) -> SectionSheet:
    """The sheet of a section for a running time (s); a window (s from the departure) at a point is kept.

    `section` is planned with the braking of its drivers (`das.solver.section.with_braking`). Raises DasError if the
    train cannot drive the section.
    """
    start_m = float(section.node_m[0])
    wanted = Wanted(s_m=start_m, v_mps=section.start_speed_mps, left_s=time_s)
    if point_m is not None and window is not None:
        wanted = replace(wanted, point_m=point_m, window=window)
    found = planned(GuideFront(section, SETTINGS), wanted)
    return SectionSheet(
        section=section,
        lines=_lines(found.schedule, found.forecast),
        s_m=found.forecast.at_m,
        t_s=found.forecast.times_s,
        v_mps=found.forecast.speeds_mps,
        energy_j=found.forecast.energy_j,
    )


def _lines(schedule: Schedule, forecast: Prospect) -> tuple[SheetLine, ...]:
    """The steps of a schedule as lines. A step that only continues to coast or brake has no line."""
    found: list[SheetLine] = []
    for step in timeline(schedule):
        slows = step.kind in (InstructionKind.COAST, InstructionKind.BRAKE)
        line = SheetLine(
            kind=step.kind,
            s_m=step.from_m,
            speed_mps=forecast.passes_mps(step.by_m) if slows else step.speed_mps,
            after_s=forecast.passes_s(step.from_m),
            effort_ratio=step.effort if step.kind is InstructionKind.TRACTION else 0.0,
        )
        if slows and found and line.kind is found[-1].kind:
            found[-1] = replace(found[-1], speed_mps=line.speed_mps)
        else:
            found.append(line)
        if slows and step.by_m < step.to_m:
            after_s = forecast.passes_s(step.by_m)
            found.append(SheetLine(kind=InstructionKind.HOLD, s_m=step.by_m, speed_mps=step.speed_mps, after_s=after_s))
    return tuple(found)


HALF_MINUTE_S = 30.0
HELD_MPS, HELD_S = 1.0, 10.0
"""Difference (m/s) below which two speeds count as equal, and time (s) above which a speed reached is held."""
NEAR_M, AT_M = 1500.0, 60.0
"""Distances (m) from a board or tunnel: within `NEAR_M` a place is named by it; within `AT_M` it is "at" it."""
STRIP, LABEL = (600.0, 84.0), 15.0
"""Width and height of a section's picture, and the width of a number in it, in the picture's units."""
SYMBOLS = {
    InstructionKind.TRACTION: "▲",
    InstructionKind.HOLD: "■",
    InstructionKind.COAST: "○",
    InstructionKind.BRAKE: "▼",
}
PASSED = "◆"


@dataclass(frozen=True, kw_only=True)
class PlannedSheet:
    """A section of a plan, and its sheet."""

    plan: SectionPlan
    sheet: SectionSheet


def sheets_of(planner: JourneyPlanner, plan: JourneyPlan) -> Iterator[PlannedSheet]:
    """The sheet of each section of a plan, for drivers who brake as usual."""
    for journey_section, part in zip(planner.sections, plan.sections, strict=True):
        section = with_braking(journey_section.whole, USUAL.of(journey_section.whole.vehicle))
        tight = next((x for x in part.passings if x.timing.held is not Held.FREE and not x.passing.wish), None)
        if tight is None:
            sheet = section_sheet(section, part.trajectory.time_s)
        else:
            bounds, departs_s = tight.passing.window, part.departure.time_s
            window = Window(earliest_s=bounds.earliest_s - departs_s, latest_s=bounds.latest_s - departs_s)
            sheet = section_sheet(section, part.trajectory.time_s, tight.passing.position_m, window)
        yield PlannedSheet(plan=part, sheet=sheet)


class Landmark(NamedTuple):
    """A landmark that a driver sees next to the line: its place (m) and its name."""

    s_m: float
    name: str


def landmarks(route: Route) -> list[Landmark]:
    """The speed boards, tunnels and stops of a line."""
    limits = route.limits_mps
    changes = np.flatnonzero(np.diff(limits.value)) + 1  # the line of a plan has breakpoints at passings as well
    boards = [Landmark(float(limits.start_m[i]), f"board {kmh(limits.value[i]):.0f}") for i in changes]
    tunnels = [
        Landmark(s_m, name)
        for tunnel in route.tunnels
        for s_m, name in ((tunnel.start_m, "tunnel"), (tunnel.start_m + tunnel.length_m, "end of tunnel"))
    ]
    return [*boards, *tunnels, *(Landmark(stop.position_m, stop.name) for stop in route.stops)]


def place_words(s_m: float, known: Sequence[Landmark]) -> str:
    """A place by the nearest landmark: "400 m after board 90"; empty if none is near."""
    near = min(known, key=lambda one: abs(one.s_m - s_m), default=None)
    if near is None or abs(near.s_m - s_m) > NEAR_M:
        return ""
    away_m = round(abs(s_m - near.s_m), -2)
    if abs(near.s_m - s_m) <= AT_M or not away_m:
        return f"at {near.name}"
    far = f"{away_m:.0f} m" if away_m < KM else f"{away_m / KM:.1f} km"
    return f"{far} {'after' if s_m > near.s_m else 'before'} {near.name}"


def half_minutes(time_s: float) -> str:
    """A time of day to the half minute: "7:12½"."""
    halves = round(time_s / HALF_MINUTE_S)
    return f"{halves // 120 % 24}:{halves // 2 % 60:02}{'½' if halves % 2 else ''}"


def span_words(time_s: float) -> str:
    """A duration to the half minute: "9½ min"."""
    halves = round(time_s / HALF_MINUTE_S)
    whole = f"{halves // 2}" if halves > 1 or halves == 0 else ""
    return f"{whole}{'½' if halves % 2 else ''} min"


class SaidLine(NamedTuple):
    """A line as printed, and the place (m) from which its speed is held without another line; None if it is not held.

    `end_m` is the place where the next line begins, `begin_mps` the speed at the beginning of `line`.
    """

    line: SheetLine
    held_m: float | None
    end_m: float
    begin_mps: float


def said_lines(sheet: SectionSheet) -> list[SaidLine]:
    """The lines of a sheet without those that only hold the speed to which the line before leads."""
    found: list[SaidLine] = []
    ends_m = [line.s_m for line in sheet.lines[1:]] + [float(sheet.s_m[-1])]
    for line, end_m in zip(sheet.lines, ends_m, strict=True):
        before = found[-1] if found else None
        slows = before is not None and before.line.kind in (InstructionKind.COAST, InstructionKind.BRAKE)
        holds = line.kind is InstructionKind.HOLD
        if before is not None and slows and holds and abs(line.speed_mps - before.line.speed_mps) < HELD_MPS:
            kept = replace(before.line, speed_mps=line.speed_mps)
            found[-1] = before._replace(line=kept, held_m=line.s_m, end_m=end_m)
        else:
            found.append(SaidLine(line, _held_m(sheet, line, end_m), end_m, sheet.speed_at(line.s_m)))
    return found


def _held_m(sheet: SectionSheet, line: SheetLine, end_m: float) -> float | None:
    """The place (m) from which an accelerating train holds the speed reached; None if the next line is too near."""
    if line.kind is not InstructionKind.TRACTION:
        return None
    at = (sheet.s_m > line.s_m) & (sheet.s_m < end_m) & (sheet.v_mps > line.speed_mps - HELD_MPS)
    if not at.any():
        return None
    reached_m = float(sheet.s_m[np.argmax(at)])
    return reached_m if (end_m - reached_m) / line.speed_mps > HELD_S else None


def line_words(said: SaidLine, *, last: bool) -> str:
    """The instruction as the driver reads it."""
    line, speed = said.line, f"<b>{kmh(said.line.speed_mps):.0f}</b>"
    then = ", hold" if said.held_m is not None else ""
    if line.kind is InstructionKind.TRACTION:
        gently = f" at {20 * max(round(line.effort_ratio * 5), 1)}\N{NO-BREAK SPACE}%"
        return f"accelerate to {speed}{gently if line.effort_ratio < 0.9 else ''}{then}"
    if line.kind is InstructionKind.HOLD:
        return f"hold {speed}"
    if line.kind is InstructionKind.COAST:
        if not then:
            return f"<b>coast</b> until {said.end_m / KM:.1f}, about {round(kmh(line.speed_mps) / 5) * 5}"
        return f"<b>coast</b> {'up' if line.speed_mps > said.begin_mps + HELD_MPS else 'down'} to {speed}{then}"
    return "<b>brake</b> for the stop" if last else f"<b>brake</b> to {speed}{then}"


def sheet_page(plan: JourneyPlan, sheets: Sequence[PlannedSheet], source: str) -> str:
    """The page as HTML, which needs no other file: A4 landscape in print, one or two columns on a screen.

    `source` names the journey's file at the foot of the page.
    """
    whole = sheets[0].sheet.section
    known = landmarks(whole.route)
    top_mps = max(float(one.sheet.section.limit_mps.max()) for one in sheets)
    blocks = "".join(_block(one, known, top_mps) for one in sheets)
    first, last = sheets[0].plan, sheets[-1].plan
    more_j = sum(one.sheet.energy_j for one in sheets)
    facts = [
        ("train", whole.vehicle.name),
        ("leaves", f"{first.start.name} {half_minutes(first.departure.time_s)}"),
        ("arrives", f"{last.end.name} {half_minutes(last.arrival.time_s)}"),
        ("stops", f"{len(sheets) + 1}"),
        ("energy", f"{kwh_words(more_j, finer=-1)} if followed"),
    ]
    head = "".join(f"<div><span>{name}</span>{html.escape(text)}</div>" for name, text in facts)
    name = html.escape(plan.journey.name)
    key = "".join(f'<span><i class="{kind}">{SYMBOLS[kind]}</i>{text}</span>' for kind, text in KEY.items())
    if any(one.plan.passings for one in sheets):
        key += f"<span><i>{PASSED}</i>pass in this time</span>"
    return PAGE.format(
        title=name,
        style=STYLE,
        head=head,
        blocks=blocks,
        key=key,
        made=html.escape(f"journey {source}, das-precompute {__version__}"),
    )


KEY = {
    InstructionKind.TRACTION: "accelerate with all traction, or with the share named",
    InstructionKind.HOLD: "hold the speed",
    InstructionKind.COAST: "coast: no effort",
    InstructionKind.BRAKE: "brake, with the motors first",
}


def _block(one: PlannedSheet, known: Sequence[Landmark], top_mps: float) -> str:
    plan, sheet = one.plan, one.sheet
    run_s = plan.arrival.time_s - plan.departure.time_s
    spare_s = run_s - plan.least_time_s
    spare = f"reserve {span_words(spare_s)}" if spare_s >= HALF_MINUTE_S / 2 else "no reserve"
    rows = "".join(_rows(one, known))
    return (
        f'<section><header><div class="from"><b>{html.escape(plan.start.name)}</b>'
        f"<time>{half_minutes(plan.departure.time_s)}</time></div>"
        f'<div class="to"><b>{html.escape(plan.end.name)}</b><time>{half_minutes(plan.arrival.time_s)}</time></div>'
        f'<div class="run">{(plan.end.position_m - plan.start.position_m) / KM:.1f} km, {span_words(run_s)}<br>'
        f"{spare}</div></header>{_strip(sheet, top_mps)}<table>{rows}</table></section>"
    )


def _rows(one: PlannedSheet, known: Sequence[Landmark]) -> Iterator[str]:
    plan, lines = one.plan, said_lines(one.sheet)
    start_m = plan.start.position_m
    known = [*(one for one in known if abs(one.s_m - start_m) > AT_M), Landmark(start_m, "the departure")]
    events: list[tuple[float, str]] = []
    said = half_minutes(plan.departure.time_s)
    for number, told in enumerate(lines, 1):
        line = told.line
        at = half_minutes(plan.departure.time_s + line.after_s)
        shown, said = ("" if at == said else at), at
        last = number == len(lines)
        where = "departure" if number == 1 else place_words(line.posted_m, known)
        if last and line.kind is InstructionKind.BRAKE:
            where = f"{round(plan.end.position_m - line.posted_m, -2):.0f} m before it"
        text = line_words(told, last=last) + (boards_words(one.sheet, line.s_m) if last else "")
        events.append((line.s_m, _row(line.kind, line.posted_m, (f"{number}", SYMBOLS[line.kind], text, where, shown))))
    for passed in plan.passings:
        place, at_m = passed.passing, passed.passing.position_m
        cells = ("", PASSED, html.escape(place.name), due_words(place), half_minutes(passed.timing.time_s))
        events.append((at_m, _row("pass", at_m, cells)))
    return (row for _, row in sorted(events, key=lambda event: event[0]))


def _row(css: str, s_m: float, cells: tuple[str, str, str, str, str]) -> str:
    """A row of the table: number, symbol, action, place and time; all but the action is plain text."""
    number, symbol, what, where, at = cells
    return (
        f'<tr class="{css}"><td class="n">{number}</td><td class="km">{s_m / KM:.1f}</td>'
        f'<td class="what"><i>{symbol}</i>{what}</td>'
        f'<td class="where">{html.escape(where)}</td><td class="t">{at}</td></tr>'
    )


def boards_words(sheet: SectionSheet, from_m: float) -> str:
    """The speed boards to observe while braking for the stop, in small HTML type: "(100 at 28.1)"; empty if none."""
    limits, end_m = sheet.section.route.limits_mps, float(sheet.s_m[-1])
    falls = np.flatnonzero(np.diff(limits.value) < 0) + 1
    places = [(float(limits.start_m[i]), kmh(limits.value[i])) for i in falls if from_m < limits.start_m[i] < end_m]
    boards = ", ".join(f"{limit:.0f} at {s_m / KM:.1f}" for s_m, limit in places)
    return f" <small>({boards})</small>" if boards else ""


def due_words(passing: Passing) -> str:
    """The time for passing a point, in half minutes inside its window; empty for a timing point."""
    if passing.wish:
        return "wish"
    earliest_s, latest_s = passing.window.earliest_s, passing.window.latest_s
    earliest = half_minutes(math.ceil(earliest_s / HALF_MINUTE_S) * HALF_MINUTE_S) if math.isfinite(earliest_s) else ""
    latest = half_minutes(math.floor(latest_s / HALF_MINUTE_S) * HALF_MINUTE_S) if math.isfinite(latest_s) else ""
    if earliest and latest:
        shorter = latest_s - earliest_s < HALF_MINUTE_S
        return f"at {half_minutes((earliest_s + latest_s) / 2)}" if shorter else f"{earliest} to {latest}"
    return f"not before {earliest}" if earliest else f"not after {latest}" if latest else ""


def _strip(sheet: SectionSheet, top_mps: float) -> str:
    """The speed of a section over its kilometres, in the colours of the instructions, below the limit."""
    width, height = STRIP
    start_m, end_m = float(sheet.s_m[0]), float(sheet.s_m[-1])
    floor, top = height - 12.0, 10.0

    def x(s_m: float) -> float:
        return (s_m - start_m) / (end_m - start_m) * width

    def y(speed_mps: float) -> float:
        return floor - (floor - top) * speed_mps / top_mps

    said = said_lines(sheet)
    numbers = {one.line.s_m: f"{number}" for number, one in enumerate(said, 1)}
    parts, named = [], -math.inf
    begun = [(one.line.s_m, one.line.kind) for one in said]
    begun += [(one.held_m, InstructionKind.HOLD) for one in said if one.held_m is not None]
    begins, kinds = zip(*sorted(begun), strict=True)
    for kind, (first_m, last_m) in zip(kinds, pairwise((*begins, end_m)), strict=True):
        inside = [float(s) for s in sheet.s_m if first_m < s < last_m]
        places = [first_m, *inside, last_m]
        speeds = np.interp(places, sheet.s_m, sheet.v_mps)
        points = " ".join(f"{x(s):.1f},{y(float(v)):.1f}" for s, v in zip(places, speeds, strict=True))
        area = f"{x(first_m):.1f},{floor:.1f} {points} {x(last_m):.1f},{floor:.1f}"
        parts.append(f'<polygon class="{kind}" points="{area}"/><polyline class="{kind}" points="{points}"/>')
        number = numbers.get(first_m, "") if x(first_m) > named + LABEL else ""
        named = x(first_m) if number else named
        parts.append(f'<text class="no" x="{x(first_m) + 2:.1f}" y="{height - 1:.1f}">{number}</text>')
    limit = sheet.section.limit_mps
    nodes = sheet.section.node_m
    steps = " ".join(
        f"{x(float(a)):.1f},{y(float(v)):.1f} {x(float(b)):.1f},{y(float(v)):.1f}"
        for a, b, v in zip(nodes[:-1], nodes[1:], limit, strict=True)
    )
    labels = [0, *(int(i) + 1 for i in np.flatnonzero(np.abs(np.diff(limit)) > KMH))]
    boards, reached = [], -math.inf
    for i in labels:
        if x(float(nodes[i])) > reached + 1.5 * LABEL:
            reached = x(float(nodes[i]))
            place = f'x="{reached + 2:.1f}" y="{y(float(limit[i])) - 2:.1f}"'
            boards.append(f'<text class="limit" {place}>{kmh(limit[i]):.0f}</text>')
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="speed over distance">{"".join(parts)}'
        f'<polyline class="limit" points="{steps}"/>{"".join(boards)}</svg>'
    )


STYLE = (
    f":root{{--limit:{LIMIT};--traction:{MODES['full traction']};--hold:{MODES['cruise']};--coast:{MODES['coast']};"
    f"--brake:{MODES['full brake']}}}"
    + """
:root{--ink:#1a1a1a;--soft:#5c6166;--rule:#c9cdd1}
*{box-sizing:border-box}
body{margin:0;background:#fff;color:var(--ink);font:15px/1.35 "Helvetica Neue",Arial,"Liberation Sans","DejaVu Sans",
sans-serif;font-variant-numeric:tabular-nums}
main{max-width:1500px;margin:0 auto;padding:18px 22px}
h1{font-size:1.5em;margin:0 0 .25em}
.facts{display:flex;flex-wrap:wrap;gap:.3em 2.2em;border-top:3px solid var(--ink);border-bottom:1px solid var(--rule);
padding:.45em 0;margin-bottom:.9em}
.facts span{color:var(--soft);margin-right:.5em}
.blocks{columns:2;column-gap:2.2em}
section{break-inside:avoid;margin:0 0 1.15em;border-top:2px solid var(--ink)}
header{display:grid;grid-template-columns:1fr 1fr auto;gap:1em;align-items:start;padding:.3em 0 .1em}
header b{display:block;font-size:1.02em;line-height:1.15}
time{font-size:1.45em;font-weight:700;line-height:1.1}
.to::before{content:"→ ";color:var(--soft);float:left;margin-right:.35em}
.run{color:var(--soft);text-align:right;font-size:.86em;white-space:nowrap}
svg{width:100%;display:block}
polyline{fill:none;stroke:var(--ink);stroke-width:1.4}
polyline.limit{stroke:var(--limit);stroke-width:1.1}polyline.coast{stroke-dasharray:5 3}
polygon.traction{fill:var(--traction)}polygon.hold{fill:var(--hold)}
polygon.coast{fill:var(--coast)}polygon.brake{fill:var(--brake)}
text{font-size:10.5px;fill:var(--soft)}text.limit{fill:var(--limit)}text.no{fill:var(--ink);font-weight:700}
table{width:100%;border-collapse:collapse}
td{padding:.16em .3em;border-bottom:1px solid var(--rule);vertical-align:baseline}
tr:last-child td{border-bottom:0}
.n{width:1.6em;color:var(--soft);text-align:right;font-weight:700}
.km{width:3.4em;text-align:right;font-weight:700}
.what{white-space:nowrap}
.what i{font-style:normal;display:inline-block;width:1.35em;margin-right:.3em;text-align:center}
.where{color:var(--soft);font-size:.88em}
.t{width:3.9em;text-align:right;font-weight:700;white-space:nowrap}
.traction i,i.traction{background:var(--traction)}.hold i,i.hold{background:var(--hold)}
.coast i,i.coast{background:var(--coast)}.brake i,i.brake{background:var(--brake)}
.pass td{background:#f1f2f3}
footer{border-top:1px solid var(--rule);padding-top:.6em;color:var(--soft);font-size:.88em}
footer p{margin:.25em 0}
footer strong{color:var(--ink)}
.key{display:flex;flex-wrap:wrap;gap:.2em 1.8em}
.key i{font-style:normal;color:var(--ink);display:inline-block;width:1.3em;margin-right:.4em;text-align:center}
@media screen and (max-width:1050px){.blocks{columns:1}body{font-size:18px}}
@page{size:A4 landscape;margin:11mm 12mm}
@media print{body{font-size:9.6pt}main{padding:0;max-width:none}section{margin-bottom:.8em}
*{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
"""
)
PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Driver's sheet: {title}</title><style>{style}</style></head>
<body><main><h1>{title}</h1><div class="facts">{head}</div>
<div class="blocks">{blocks}</div>
<footer><p class="key">{key}</p>
<p><strong>Signals, boards and orders come first.</strong> Up to a minute late or early, follow each line at its
kilometre, even if the train is slower or faster than the line states. If you are later than that, drive as the boards
allow, and use the sheet again from the next stop. Wait for the time of departure. Times are to the half minute; the
reserve is the time that driving as fast as the boards allow would gain. A limit rises when the whole train has passed
its board.</p>
<p>{made}</p></footer></main></body></html>
"""

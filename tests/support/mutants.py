# ruff: noqa: E501 (lines of the product are quoted whole)
"""`python -m tests.support.mutants`: change the product in one place at a time, and see whether a test notices.

Each mutant is one text in one file of the advice, the cab, the few-switch solver or the kernels, put in the place of
another (a sign, a constant, a comparison). It is tried on a copy of the working tree with the tests that are nearest to
it. A mutant that no test notices survives; the command names the survivors and returns 1 if there are any.

    python -m tests.support.mutants                # all of them: about an hour on one core
    python -m tests.support.mutants --only named   # those whose name has this in it
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from tests.support.making import REPOSITORY

COPIED = ("das", "precompute", "sim", "tests", "recordings", "docs", "pyproject.toml", "README.md", "mkdocs.yml")
LIMIT_S = 900.0
"""A test that runs longer than this (s) hangs, and counts as having noticed the mutant."""
DAYS = "50"
"""The number of days of the assessment to drive if no nearer test has noticed the mutant; as many as in CI."""

BRAKES = "tests/das/advice/test_braking.py tests/das/advice/test_planner.py tests/das/advice/coach tests/das/advice/test_advice.py"
LAST = "tests/das/advice/test_last_word.py"
FEW_SWITCH = (
    "tests/das/solver/few_switch tests/das/advice/coach/test_planning.py tests/das/advice/coach/test_showing.py"
)
CAB = "tests/das/cab tests/das/advice/test_advice.py"
SOLVER = "tests/das/solver tests/das/cab/test_own_braking.py"
ASSESSED = "tests/property/test_assessment.py"


class Mutant(NamedTuple):
    """A change of one file: the text replaced, its replacement, and the tests nearest to it."""

    name: str
    file: str
    old: str
    new: str
    tests: str


def _of(file: str, tests: str, *changes: tuple[str, str, str]) -> list[Mutant]:
    return [Mutant(name, file, old, new, tests) for name, old, new in changes]


MUTANTS = [
    *_of(
        "das/advice/coach/shown_brakes.py",
        BRAKES,
        ("named: effort rounded down", "math.ceil(effort / step_ratio", "math.floor(effort / step_ratio"),
        ("named: half the reference force", "return ahead.force_n(-now.effort_ratio, s_m, v)", "return 0.5 * ahead.force_n(-now.effort_ratio, s_m, v)"),
        ("less effort at once", "kept * (1.0 - settings.less_ratio)", "kept * (1.0 + settings.less_ratio)"),
        ("effort stands far from the mark", "left_m > AT_MARK_M", "left_m > 10.0 * AT_MARK_M"),
        ("effort stands beyond the mark", "return -settings.beyond_mark_m <= left_m", "return -5.0 * settings.beyond_mark_m <= left_m"),
        ("a brake grows for who answers at once", "state.v_mps * settings.answered_in_s", "state.v_mps * 0.0 * settings.answered_in_s"),
        ("a brake grows without end", "min(answered, settings.grown_ratio * needed.effort, most)", "min(answered, most)"),
        ("friction before it is needed", "most = math.inf if slows and needed.effort > 1.0 else 1.0", "most = math.inf"),
        ("a brake begins for who answers at once", "elif kept is not None or slows:", "elif kept is not None:"),
        ("a brake ends above its speed", "(needed.target_mps + SAME_MPS) ** 2", "(needed.target_mps + 3.0 * SAME_MPS) ** 2"),
        ("a lower limit on the way of a brake is not named", "for_more = needed.target_mps > wanted.speed_mps + SAME_MPS", "for_more = needed.target_mps > 1e9"),
        ("more effort waits", "needed.effort <= kept * (1.0 + lacks_ratio)", "needed.effort <= kept * 1.5"),
        ("no build-up", "0.5 * braking.build_up_s", "0.0 * braking.build_up_s"),
        ("safe brakes never", "if not ahead.is_due(state.braked_m, soon_mps, lead_s):", "if True:"),
        ("safe looks at no position ahead", "ahead.is_due(state.braked_m, soon_mps, lead_s)", "ahead.is_due(state.s_m, v_mps, 0.0)"),
        ("weak brakes stay", "-wanted.effort_ratio >= wanted_for.effort", "-wanted.effort_ratio <= wanted_for.effort"),
        ("traction carries beyond the speed", "(now.speed_mps - v) / self._settings.limit.closes_in_s", "(now.speed_mps - v) / 0.5"),
        ("above the limit is coasted", "in BRAKES else settings.braked_mps):", "in BRAKES else 9.0 * settings.braked_mps):"),
        ("no full brake above the curve", "effort = max(needed.effort, self.ahead.full(state.s_m, v_mps)) if falls", "effort = needed.effort if falls"),
    ),
    *_of(
        "das/advice/coach/announcing.py",
        BRAKES,
        ("a brake that has begun is announced", "first.speed_mps > now.speed_mps - SAME_MPS:", "first.speed_mps > 9.0 * now.speed_mps:"),
        ("named: aim without the cap of the curve", "limit_mps, min(highest, limit_mps))", "limit_mps, math.inf)"),
        ("a brake that follows is announced late", "begins_m, brake, after = min(begins_m, before_m), planned", "begins_m, brake, after = before_m, planned"),
    ),
    *_of(
        "das/advice/coach/showing.py",
        BRAKES,
        ("coasting above its end stands", "min(place.limit_mps, ends_mps) if by_its_end else", "place.limit_mps if by_its_end else"),
        ("harder brakes wait", "braked = (less and (wanted.mode in BRAKES or too_fast)) or (wanted.mode in BRAKES and harder)", "braked = less and too_fast"),
        ("brakes are shown late", "soon_m = state.s_m + state.v_mps * leads.get(after.kind, 0.0)", "soon_m = state.s_m - state.v_mps * leads.get(after.kind, 0.0)"),
    ),
    *_of(
        "das/advice/coach/phase_now.py",
        BRAKES,
        ("rolls back where it never slows", "return slows_mps >= away_mps and", "return slows_mps >= -9.0 and"),
        ("rolls on just above its speed", "target + settings.brake.rolls_above_mps", "target + 0.0 * settings.brake.rolls_above_mps"),
    ),
    *_of(
        "das/advice/braking.py",
        BRAKES,
        ("the stop is a foot behind", "to_m = to_m + STOP_SLACK_M if stops else to_m", "to_m = to_m + 30.0 if stops else to_m"),
        ("a lower limit is kept loosely", "0.0 if stops else target_mps + SPEED_SLACK_MPS", "0.0 if stops else target_mps + 1.5"),
        ("due only far above", "if v_mps <= least_mps + ABOVE_MPS:", "if v_mps <= least_mps + 2.0:"),
        ("only the nearest speed asks", "most = max(rivals).effort", "most = rivals[0].effort"),
        ("supply is forgotten", "here = on_supply(train, section.supply[interval])", "here = train"),
        ("rolls the other way", "return -self.section.resistance_n(s_m, v_mps)", "return self.section.resistance_n(s_m, v_mps)"),
        ("back under in a minute", "BACK_IN_S = 4.0", "BACK_IN_S = 60.0"),
    ),
    *_of(
        "das/advice/kernels.py",
        BRAKES,
        ("the least effort is not enough", "    return high\n", "    return low\n"),
        ("the gradient is forgotten", "held = (mean_resistance(v0, v1, q, here) + g)", "held = (mean_resistance(v0, v1, q, here))"),
        ("v² grows", "w1 = w0 - 2.0 * h * rate", "w1 = w0 - h * rate"),
    ),
    *_of(
        "das/advice/braking.py",
        f"{BRAKES} tests/property/test_advice_property.py",
        ("needed force is less", "BRAKED_MORE = 1.1", "BRAKED_MORE = 0.6"),
    ),
    *_of(
        "das/advice/shown_safely.py",
        f"{BRAKES} tests/property/test_advice_property.py",
        ("traction before a brake", "pulls = force_n > 0.0 and gained_mps2 > GAINS_MPS2", "pulls = False"),
        ("above the plan nothing changes", "if effort > 0.0 and needed_n < force_n else (mode, force_n)", "if False else (mode, force_n)"),
        ("the horizon stays above", "kept[i] = min(kept[i], planner.lowest_allowed_mps(at_m, max(at_m, to_m)))", "kept[i] = kept[i]"),
    ),
    *_of(
        "das/advice/braking.py",
        f"{BRAKES} tests/property/test_advice_property.py",
        ("needed force is less", "BRAKED_MORE = 1.1", "BRAKED_MORE = 0.6"),
    ),
    *_of(
        "das/advice/shown_safely.py",
        f"{BRAKES} tests/property/test_advice_property.py",
        ("four modes brake late", "else four_settings.before_s", "else 0.2"),
    ),
    *_of(
        "das/advice/display.py",
        f"{BRAKES} tests/property/test_advice_property.py",
        ("the advised speed is the plan's", "advised = min(place.speed_mps, allowed)", "advised = place.speed_mps"),
        ("the display rounds up", "min(steady_mps, step_below(allowed_mps))", "steady_mps"),
        ("brakes wait for the hold", "urgent = EFFORT_ORDER.index(wanted) > EFFORT_ORDER.index(self._mode)", "urgent = EFFORT_ORDER.index(wanted) < EFFORT_ORDER.index(self._mode)"),
    ),
    *_of(
        "das/advice/display.py",
        "tests/property/test_coach_property.py",
        ("coach and message differ in force", "scene.state, coach.now.mode, coach.reference_force_n", "scene.state, coach.now.mode, float(plan.shown_force_n[place.interval])"),
        ("coach and message differ in what is due", "coach.now.mode is Regime.DEPART or coach.now.in_s > 0.0", "coach.now.mode is Regime.DEPART or coach.now.in_s >= 0.0"),
    ),
    *_of(
        "das/advice/planner.py",
        f"{BRAKES} {CAB}",
        ("allowed is at the train alone", "return self.lowest_allowed_mps(state.s_m, feared_m)", "return self.allowed_mps(state.s_m)"),
        ("the end is no stop", "if to_m >= self.section.end_m:\n            return 0.0", "if to_m >= self.section.end_m:\n            return self.allowed_mps(from_m)"),
    ),
    *_of(
        "das/advice/last_word.py",
        LAST,
        ("infinite figures pass", "if math.isinf(getattr(self._advice, name))", "if math.isnan(getattr(self._advice, name)) and False"),
        ("speeds pass", "if not shown_mps <= self._bound_mps + SAME_READING_MPS:", "if not shown_mps <= self._bound_mps + 20.0:"),
        ("the reference force is not looked at", "for force_n in {self._train.by_eye_n() if by_eye else coach.force_n, coach.reference_force_n}:", "for force_n in {coach.force_n}:"),
        ("announcements pass", "if one.speed_mps > limit_mps + SAME_READING_MPS:", "if one.speed_mps > limit_mps + 20.0:"),
        ("four modes are trusted", "if advice.four_mode in (Regime.NONE, *_STANDS):", "if True:"),
    ),
    *_of(
        "das/advice/braking_model.py",
        LAST,
        ("the train is where it seems", "deviation_m = SDS_AHEAD * here.position_sd_m", "deviation_m = 0.0"),
        ("any force is there", "abs(force_n) > FORCE_RATIO * most_n + 1.0", "abs(force_n) > 10.0 * FORCE_RATIO * most_n + 1.0"),
        ("holding far above is enough", "HELD_ABOVE_MPS = 1.0", "HELD_ABOVE_MPS = 8.0"),
    ),
    *_of(
        "das/advice/braking_model.py",
        LAST,
        ("a point mass", "length_m = 0.0 if basis.point_mass else train.train_length_m", "length_m = 0.0"),
        ("no tolerance is enough", "LIMIT_TOLERANCE_MPS = 0.5", "LIMIT_TOLERANCE_MPS = 3.0"),
        ("the stop is far", "STOP_TOLERANCE_M = 5.0", "STOP_TOLERANCE_M = 40.0"),
        ("downhill is uphill", "found += factor * over", "found -= factor * over"),
        ("a lighter train", "mass_ratio=max(measured.mass_ratio, 1.0)", "mass_ratio=min(measured.mass_ratio, 1.0)"),
    ),
    *_of(
        "das/advice/last_word_kernels.py",
        LAST,
        ("excess is never found", "if v > bound and step * STEP_S >= since:", "if v > bound + 9.0 and step * STEP_S >= since:"),
        ("the curve is steeper", "w = max(w + step * (later +", "w = max(w + 2.0 * step * (later +"),
    ),
    *_of(
        "das/cab/leg.py",
        CAB,
        ("the deviation of the position is forgotten", "ahead_m = min(stop.deviations * here.position_sd_m - planned_m,", "ahead_m = min(0.0 * here.position_sd_m - planned_m,"),
        ("traction at a stand", "return self.display.departing(scene, plan) if stands else", "return"),
    ),
    *_of(
        "das/cab/situation.py",
        CAB,
        ("a lighter train may be faster", "mass_ratio=max(self.conditions.mass_ratio, AS_PLANNED.mass_ratio)", "mass_ratio=self.conditions.mass_ratio"),
        ("service braking is forgotten", "braking=self.braking.of(self.vehicle)", "braking=None"),
    ),
    *_of(
        "das/domain/braking.py",
        f"{SOLVER} {CAB}",
        ("named: the reserve dropped", "return self.reaction_s + 0.5 * self.build_up_s", "return 0.0"),
        ("no deviation", "DEVIATION_M = 5.0", "DEVIATION_M = 0.0"),
    ),
    *_of(
        "das/solver/kernels/driving.py",
        SOLVER,
        ("the delay makes brakes stronger", "rate / (1.0 + rate * service.delay_s / max", "rate * (1.0 + rate * service.delay_s / max"),
        ("service deceleration is no bound", "rate = min(rate, service.deceleration_mps2)", "rate = max(rate, service.deceleration_mps2)"),
        ("no reserve of force on descents", "share_n = service.force_share *", "share_n = 2.0 *"),
    ),
    *_of(
        "das/solver/kernels/few_switch_schedule.py",
        FEW_SWITCH,
        ("named: brakes go unsaid", "UNSAID_MPS = 0.05", "UNSAID_MPS = 1.0"),
        ("unsaid brakes of a coasting train", "and v[i + 1] < v[i]", "and v[i + 1] > v[i]"),
    ),
    *_of(
        "das/solver/few_switch/schedule.py",
        FEW_SWITCH,
        ("unsaid brakes are taken", "MOST_UNSAID_S = 0.5", "MOST_UNSAID_S = 50.0"),
    ),
    *_of(
        "das/solver/few_switch/as_run.py",
        FEW_SWITCH,
        ("brakes by limits are not seen", "met = np.isfinite(speeds) & (speeds > envelope - NEAR_MPS)", "met = np.isfinite(speeds) & (speeds > envelope + 1.0)"),
        ("early brakes begin late", "later_m = (squares[met] - squares[end]) * m_per_square - (node_m[end] - node_m[met])", "later_m = 0.0 * m_per_square"),
        ("another effort does not wait", "run.lasts_s(begin, risen) < WAITS_S", "run.lasts_s(begin, risen) < 0.0"),
        ("accelerates just before a brake", "held_mps - lasts_s < GAINS_S", "held_mps - lasts_s < 0.0"),
    ),
]  # fmt: skip


def changed(mutant: Mutant) -> str:
    """The text of the mutant's file; ValueError if the text to replace does not occur exactly once."""
    text = (REPOSITORY / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise ValueError(f"{mutant.file}: {mutant.old!r} is there {text.count(mutant.old)} times, expected once")
    return text.replace(mutant.old, mutant.new)


def noticed(mutant: Mutant, tree: Path) -> str:
    """The first test that fails with the mutant in the tree; empty if none does. The tree is restored afterwards."""
    file = tree / mutant.file
    before = file.read_text(encoding="utf-8")
    file.write_text(changed(mutant), encoding="utf-8")
    environment = {**os.environ, "DAS_ASSESSMENT_DAYS": DAYS, "PYTHONPATH": str(tree)}
    try:
        for tests in (mutant.tests, ASSESSED):
            words = ["-x", "-q", "-n", "0", "-m", "", "-p", "no:cacheprovider", *tests.split()]
            command = [sys.executable, "-m", "pytest", *words]
            done = subprocess.run(
                command, cwd=tree, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
            )
            if done.returncode:
                failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return failed[0].split(" - ")[0] if failed else done.stdout.strip().splitlines()[-1]
    except subprocess.TimeoutExpired:
        return f"no end after {LIMIT_S:.0f} s"
    finally:
        file.write_text(before, encoding="utf-8")
    return ""


def main(arguments: list[str] | None = None) -> int:
    """Try the mutants and print what noticed each; returns 1 if one survived."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.mutants", description=__doc__)
    parser.add_argument("--only", default="", help="those mutants whose name or file has this in it")
    options = parser.parse_args(arguments)
    chosen = [one for one in MUTANTS if options.only in one.name or options.only in one.file]
    survivors = []
    with tempfile.TemporaryDirectory(prefix="das-mutants-") as folder:
        tree = Path(folder)
        for name in COPIED:
            source = REPOSITORY / name
            copy = shutil.copytree if source.is_dir() else shutil.copy
            copy(source, tree / name)
        for number, mutant in enumerate(chosen, 1):
            began = time.monotonic()
            by = noticed(mutant, tree)
            survivors += [] if by else [mutant]
            lasted_s = time.monotonic() - began
            print(
                f"{number}/{len(chosen)} {mutant.file}: {mutant.name}: {by or 'SURVIVES'} ({lasted_s:.0f} s)",
                flush=True,
            )
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} noticed")
    return int(bool(survivors))


if __name__ == "__main__":
    sys.exit(main())

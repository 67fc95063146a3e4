"""Phases corrected to agree with the trajectory of their schedule, if limits ahead or hills make it differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KMH
from das.solver.few_switch.few_switch import NotchRegime
from das.solver.few_switch.phases import BRAKES, NEAR_MPS, STEADY_MPS, Phase, RunAtNodes, ends_of

FASTER_MPS = 1.0 * KMH
"""A limit is held if the target speed is higher by more than this (m/s)."""
HELD_S = 10.0
"""No phase is inserted that would be shorter than this (s), or would leave a shorter rest of another phase."""
SLOWER_MPS = 5.0 * KMH
"""A train that is slower than the speed to hold by more than this (m/s) accelerates to it."""
HARDLY_MPS = 2.5 * KMH
"""A train that is slower than the speed to hold by less than this (m/s) holds it without a phase of acceleration.
For the first phase of a schedule, `SLOWER_MPS` counts instead."""
ABOVE_MPS = 1.0 * KMH
"""If a train is faster than the speed to hold by more than this (m/s) and slows down, it coasts to that speed."""
SAME_MPS = 0.5
"""Two successive target speeds that differ by less than this (m/s) count as one: no driver tells them apart."""
SAME_SHARE = 0.15
"""Two successive efforts that differ by less than this share of the largest count as one."""

WAITS_S = 15.0
"""A change of the traction effort is put off until the limit rises, if the limit rises within this time (s)."""
BRIEF_S = 30.0
"""An acceleration that a brake ends within this time (s) is left out unless it gains at least `GAINS_S`."""
GAINS_S = 1.5
"""The least time (s) that a brief acceleration before a brake must gain over holding the speed."""


def speeds_as_held(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases with the speeds that their trajectory reaches and holds.

    A train that is to hold a much higher speed accelerates to it with `back_share` of its traction, and a train that
    slows down to the speed to hold coasts. If a limit keeps the train below its target speed, the limit is held, and
    left by accelerating. An acceleration that a limit ends at once begins where this limit ends. A change of effort
    shortly before a limit rises is put off until then. A short acceleration that gains no time before a brake is left
    out. If the train never slows down to the speed to hold, as on a descent, that speed is raised to its lowest there.
    """
    said = _with_coasting(_with_accelerations(phases, run, back_share), run)
    said = _with_limits_held(_without_vain_traction(said, run), run, back_share)
    said = _without_brief_traction(_with_effort_at_limit(said, run), run)
    for k, (one, end) in enumerate(zip(said, ends_of(said, run), strict=True)):
        if one.kind in (NotchRegime.HOLD, NotchRegime.TRACTION):
            least_mps = float(run.speeds_mps[one.begin : end + 1].min())
            said[k] = one._replace(target_mps=max(one.target_mps, least_mps))
    return _without_likes(said, run)


def _with_accelerations(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases; a train accelerates to a speed to hold only if it is much slower."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        if one.kind is not NotchRegime.HOLD:
            found.append(one)
        elif found and _hardly_faster(found[-1], one, run, SLOWER_MPS if len(found) == 1 else HARDLY_MPS):
            found[-1] = one._replace(begin=found[-1].begin)
        elif run.speeds_mps[one.begin] < one.target_mps - SLOWER_MPS:
            first = one._replace(kind=NotchRegime.TRACTION, share=back_share)
            found += _one_after_another(first, one, one.target_mps - STEADY_MPS < run.speeds_mps, end, run)
        else:
            found.append(one)
    return found


def _one_after_another(first: Phase, held: Phase, reached: NDArray[np.bool_], end: int, run: RunAtNodes) -> list[Phase]:
    """The phase that leads to a speed to hold, and the phase that holds it from the first node where it is reached.

    If the first would be short, the speed is held at once; if the second would be short, it is left out.
    """
    nodes = np.flatnonzero(reached[held.begin : end])
    last = held.begin + int(nodes[0]) if nodes.size else end
    if run.lasts_s(held.begin, last) < HELD_S:
        return [held]
    return [first] if run.lasts_s(last, end) < HELD_S else [first, held._replace(begin=last)]


def _hardly_faster(one: Phase, held: Phase, run: RunAtNodes, by_mps: float) -> bool:
    """Whether a phase only accelerates a little, to the speed held next: the driver does so without being told."""
    same = one.kind is NotchRegime.TRACTION and abs(one.target_mps - held.target_mps) < SAME_MPS
    return bool(same and run.speeds_mps[one.begin] > one.target_mps - by_mps)


def _with_coasting(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases; a train that slows down to the speed to hold coasts until it has reached it."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        speeds = run.speeds_mps
        above = one.kind is NotchRegime.HOLD and speeds[one.begin] > one.target_mps + ABOVE_MPS
        if not (above and speeds[one.begin + 1] < speeds[one.begin]):
            found.append(one)
            continue
        first = one._replace(kind=NotchRegime.COAST)
        said = _one_after_another(first, one, speeds < one.target_mps + STEADY_MPS, end, run)
        goes_on = bool(found) and found[-1].kind is NotchRegime.COAST and said[0] is first
        found += said[1:] if goes_on else said
    return found


def _without_vain_traction(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases; an acceleration that a limit ends at once begins at the end of this limit instead."""
    found = phases[:1]
    for one, end in list(zip(phases, ends_of(phases, run), strict=True))[1:]:
        begin = one.begin
        if one.kind is NotchRegime.TRACTION and found[-1].kind not in BRAKES:
            stretch = slice(one.begin, end)
            met = run.speeds_mps[stretch] > run.envelope_mps[stretch] - NEAR_MPS
            slow = run.speeds_mps[stretch] - run.speeds_mps[begin] < FASTER_MPS
            soon = run.elapsed_s[stretch] - run.elapsed_s[begin] < HELD_S
            waits = np.max(np.flatnonzero(met & slow & soon), initial=0)
            begin += int(waits) if run.lasts_s(begin + int(waits), end) >= HELD_S else 0
        found.append(one._replace(begin=begin))
    return found


def _with_effort_at_limit(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases; a change of effort shortly before a limit rises is put off until then: one change instead of two."""
    found = phases[:1]
    for one, end in list(zip(phases, ends_of(phases, run), strict=True))[1:]:
        begin = one.begin
        if one.kind is found[-1].kind is NotchRegime.TRACTION:
            stretch = slice(begin, end)
            waits = run.envelope_mps[stretch] < run.envelope_mps[begin] + NEAR_MPS
            waits &= run.envelope_mps[stretch] < one.target_mps - FASTER_MPS
            risen = begin + int(np.argmin(waits))
            if not waits.all() and run.lasts_s(begin, risen) < WAITS_S and run.lasts_s(risen, end) >= HELD_S:
                begin = risen
        found.append(one._replace(begin=begin))
    return found


def _without_brief_traction(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases without accelerations that soon end in a brake and gain hardly any time over holding the speed.

    The same holds for the rest of an acceleration from where a limit rises.
    """
    found: list[Phase] = []
    for k, (one, end) in enumerate(zip(phases, ends_of(phases, run), strict=True)):
        braked = k + 1 < len(phases) and phases[k + 1].kind in BRAKES
        if one.kind is NotchRegime.TRACTION and braked and _is_vain(one.begin, end, run):
            if not found or found[-1].kind is not NotchRegime.HOLD:
                found.append(Phase(NotchRegime.HOLD, 0.0, one.begin, float(run.speeds_mps[one.begin])))
            continue
        rises = one.kind in (NotchRegime.TRACTION, NotchRegime.HOLD) and braked
        found.append(_without_vain_rise(one, end, run) if rises else one)
    return found


def _is_vain(first: int, end: int, run: RunAtNodes) -> bool:
    """Whether a trajectory gains hardly any time over holding its speed between two nodes that follow soon."""
    lasts_s, held_mps = run.lasts_s(first, end), max(float(run.speeds_mps[first]), 1.0)
    return lasts_s < BRIEF_S and (run.node_m[end] - run.node_m[first]) / held_mps - lasts_s < GAINS_S


def _without_vain_rise(one: Phase, end: int, run: RunAtNodes) -> Phase:
    """A phase before a brake; if going faster after the last rise of a limit gains hardly any time, it does not."""
    envelope = run.envelope_mps[one.begin : end]
    rises = np.flatnonzero(np.diff(envelope) > FASTER_MPS)
    if not rises.size:
        return one
    last, held_mps = one.begin + int(rises[-1]) + 1, float(envelope[: rises[-1] + 1].max())
    faster = held_mps < one.target_mps - FASTER_MPS and run.speeds_mps[last] > held_mps - FASTER_MPS
    return one._replace(target_mps=held_mps) if faster and _is_vain(last, end, run) else one


def _with_limits_held(phases: list[Phase], run: RunAtNodes, back_share: float) -> list[Phase]:
    """The phases; a limit that keeps the train below its target speed is held, and left by accelerating."""
    found: list[Phase] = []
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        found.append(one)
        if one.kind not in (NotchRegime.TRACTION, NotchRegime.HOLD):
            continue
        for begin, last in _held_by_limits(run, one.begin, end):
            held_mps = float(run.speeds_mps[begin])
            if one.target_mps - held_mps < FASTER_MPS or run.lasts_s(begin, last) < HELD_S:
                continue
            before, held = _up_to(found, begin, run)
            if held is None:
                continue
            found = [*before, Phase(NotchRegime.HOLD, 0.0, held, held_mps)]
            if run.lasts_s(last, end) >= HELD_S:
                found.append(Phase(NotchRegime.TRACTION, one.share or back_share, last, one.target_mps))
    return found


def _up_to(phases: list[Phase], node: int, run: RunAtNodes) -> tuple[list[Phase], int | None]:
    """The phases up to a node where a limit is reached, and the node from which the limit is held.

    A last phase that would be too short to be shown becomes part of the acceleration before it, or of the phase that
    holds the limit if the speed hardly changes in it. Otherwise the limit is not held (None).
    """
    found, begin = list(phases), phases[-1].begin
    if run.lasts_s(begin, node) < HELD_S:
        goes_on = len(found) > 1 and found[-2].kind is NotchRegime.TRACTION
        if not goes_on and abs(run.speeds_mps[node] - run.speeds_mps[begin]) > FASTER_MPS:
            return found, None
        found.pop()
        node = node if goes_on else begin
    if found and found[-1].kind is NotchRegime.TRACTION:
        found[-1] = found[-1]._replace(target_mps=float(run.speeds_mps[node]))
    return found, node


def _held_by_limits(run: RunAtNodes, first: int, end: int) -> list[tuple[int, int]]:
    """Where a limit holds a trajectory between two nodes: first and last nodes of every such stretch."""
    speeds = run.speeds_mps[first : end + 1]
    met = speeds > run.envelope_mps[first : end + 1] - NEAR_MPS
    held = met[1:] & met[:-1] & (np.abs(np.diff(speeds)) < STEADY_MPS)
    return [(first + begin, first + last) for begin, last in _stretches(held)]


def _stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last nodes of every stretch of successive intervals where the mask is set."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _without_likes(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases, with like neighbours merged: a speed reached and then held, or held twice, and like efforts.

    Two efforts stay apart if the train holds the speed of the first for a while before the second begins.
    """
    found = phases[:1]
    for one in phases[1:]:
        before = found[-1]
        same = one.kind is NotchRegime.HOLD and abs(one.target_mps - before.target_mps) < SAME_MPS
        if same and before.kind is NotchRegime.HOLD:
            continue
        alike = one.kind is before.kind is NotchRegime.TRACTION and abs(one.share - before.share) < SAME_SHARE
        alike = alike and not _holds(before, one.begin, run)
        if alike or (same and before.kind is NotchRegime.TRACTION):
            found[-1] = before._replace(target_mps=one.target_mps)
        if not alike:
            found.append(one)
    return found


def _holds(one: Phase, end: int, run: RunAtNodes) -> bool:
    """Whether a train that accelerates in a phase then holds its speed for at least `HELD_S` before the phase ends."""
    reached = np.flatnonzero(run.speeds_mps[one.begin : end] > one.target_mps - STEADY_MPS)
    return bool(reached.size) and run.lasts_s(one.begin + int(reached[0]), end) >= HELD_S


IDLE_MPS = 1.0 * KMH
"""A brake that lowers the speed by less than this (m/s) is left out."""


def phases_as_run(
    phases: tuple[Phase, ...], kinds: NDArray[np.int64], run: RunAtNodes, back_share: float
) -> tuple[Phase, ...]:
    """The phases of a schedule, corrected to agree with its trajectory.

    `kinds` are the kinds of the phases, with `NotchRegime.CURVE` for a brake along the braking curve. Where a limit
    ahead makes the trajectory brake, a brake begins. A brake without effect is left out, and a brake that at first only
    holds a speed begins later. Then `speeds_as_held` corrects the speeds; a train that is slower than the speed to hold
    gets back to it with `back_share` of its traction.
    """
    said = _without_early_brakes(_without_idle_brakes(phases, kinds, run), run)
    for begin, end in _braked_by_limits(run):
        said = _with_brake(said, begin, end, run)
    return tuple(speeds_as_held(said, run, back_share))


def with_all_brakes(phases: tuple[Phase, ...], run: RunAtNodes) -> tuple[Phase, ...]:
    """The phases with a brake wherever a limit ahead demands one; the interrupted phase goes on after it."""
    found = list(phases)
    for begin, end in _braked_by_limits(run):
        here = max((k for k, one in enumerate(found) if one.begin <= begin), default=0)
        ends = [*(one.begin for one in found[1:]), len(run.node_m) - 1]
        if found[here].kind in BRAKES and found[here].share == 0.0 and ends[here] >= end:
            continue
        before = [one for one in found if one.begin < begin]
        brake = Phase(NotchRegime.BRAKE, 0.0, begin, float(run.speeds_mps[end]))
        after = _from(found, end) if end < len(run.node_m) - 1 else []
        if len(after) > 1 and run.lasts_s(end, after[1].begin) < HELD_S:
            after = [after[1]._replace(begin=end), *after[2:]]
        found = [*before, brake, *after]
    return with_one_brake(tuple(found), run)


def with_one_brake(phases: tuple[Phase, ...], run: RunAtNodes) -> tuple[Phase, ...]:
    """The phases, with two brakes along the curve merged if hardly any time lies between them."""
    found: list[Phase] = []
    for one in phases:
        curve = one.kind in BRAKES and one.share == 0.0
        behind = found[-2] if len(found) > 1 else None
        goes_on = behind is not None and behind.kind in BRAKES and behind.share == 0.0
        between = found[-1] if found else one
        if curve and goes_on and between.kind not in BRAKES and run.lasts_s(between.begin, one.begin) < HELD_S:
            found[-2:] = [found[-2]._replace(target_mps=one.target_mps)]
        else:
            found.append(one)
    return tuple(found)


def with_boards(phases: tuple[Phase, ...], run: RunAtNodes) -> tuple[Phase, ...]:
    """The phases, with a brake along the curve for each limit at which it stops falling, so that each is named.

    A limit that the trajectory passes well below it stays part of the brake for what lies behind it.
    """
    found: list[Phase] = []
    falls = np.diff(run.envelope_mps) < 0.0
    feet = np.flatnonzero(falls[:-1] & ~falls[1:]) + 1
    binding = feet[run.speeds_mps[feet] > run.envelope_mps[feet] - HARDLY_MPS].tolist()
    for one, end in zip(phases, ends_of(phases, run), strict=True):
        found.append(one)
        if one.kind not in BRAKES or one.share > 0.0:
            continue
        for foot in binding:
            if found[-1].begin < foot < end and run.speeds_mps[foot] > one.target_mps + SLOWER_MPS:
                found[-1] = found[-1]._replace(target_mps=float(run.envelope_mps[foot]))
                found.append(one._replace(begin=foot))
    return tuple(found)


def _without_idle_brakes(phases: tuple[Phase, ...], kinds: NDArray[np.int64], run: RunAtNodes) -> list[Phase]:
    """The phases without brakes that hardly change the speed; the phase before goes on instead."""
    found, speeds = list(phases[:1]), run.speeds_mps
    for one, kind, end in list(zip(phases, kinds, ends_of(phases, run), strict=True))[1:]:
        idle = speeds[one.begin] - speeds[end] < IDLE_MPS and speeds[end] > IDLE_MPS
        if not (kind >= NotchRegime.BRAKE and idle):
            found.append(one)
    return _without_repeats(found)


def _without_repeats(phases: list[Phase]) -> list[Phase]:
    """The phases, with neighbours merged that both coast, or that hold the same speed."""
    found = phases[:1]
    for one in phases[1:]:
        before = found[-1]
        if one.kind is NotchRegime.COAST and before.kind is NotchRegime.COAST:
            found[-1] = before._replace(target_mps=one.target_mps)
        elif one.kind is not NotchRegime.HOLD or one != before._replace(begin=one.begin):
            found.append(one)
    return found


def _braked_by_limits(run: RunAtNodes) -> list[tuple[int, int]]:
    """Where a trajectory brakes along the braking curve, or down to it: first and last nodes of every such stretch."""
    speeds, envelope = run.speeds_mps, run.envelope_mps
    met = np.isfinite(speeds) & (speeds > envelope - NEAR_MPS)
    above = speeds[:-1] > envelope[:-1] + NEAR_MPS
    brakes = met[1:] & (speeds[1:] < speeds[:-1]) & ((envelope[1:] < envelope[:-1]) | above)
    return [(begin, end) for begin, end in _stretches(brakes) if speeds[begin] - speeds[end] > IDLE_MPS]


def _with_brake(phases: list[Phase], begin: int, end: int, run: RunAtNodes) -> list[Phase]:
    """The phases with a brake along the braking curve between two nodes, if there is none yet.

    A brake whose effort is too small begins earlier. A phase that would begin before the last node begins at it.
    """
    here = max(k for k, one in enumerate(phases) if one.begin <= begin or k == 0)
    one, after = phases[here], phases[here + 1] if here + 1 < len(phases) else None
    said = one.kind in BRAKES and one.share == 0.0
    if said or one.begin > begin:
        return phases
    before = phases[: here + (one.begin < begin)]
    if after is not None and after.begin <= end and after.kind in BRAKES and after.share == 0.0:
        return [
            *before,
            after._replace(begin=begin),
            *phases[here + 2 :],
        ]  # The brake that follows only begins earlier.
    if one.kind in BRAKES and one.begin < begin:
        earlier = _early_enough(one.begin, begin, end, run)
        if not here or earlier > phases[here - 1].begin:
            return [*phases[:here], one._replace(begin=earlier), *phases[here + 1 :]]
    brake = Phase(NotchRegime.BRAKE, 0.0, begin, float(run.speeds_mps[end]))
    return [*before, brake, *(_from(phases[here:], end) if end < len(run.node_m) - 1 else [])]


def _early_enough(begin: int, met: int, end: int, run: RunAtNodes) -> int:
    """The node where a brake of one effort must begin; begun at `begin`, it meets the braking curve at `met`."""
    squares, node_m = run.speeds_mps**2, run.node_m
    m_per_square = (node_m[met] - node_m[begin]) / max(squares[begin] - squares[met], 1e-9)
    later_m = (squares[met] - squares[end]) * m_per_square - (node_m[end] - node_m[met])
    return max(int(np.searchsorted(node_m, node_m[begin] - later_m)) - 1, 0)


def _from(phases: list[Phase], node: int) -> list[Phase]:
    """The phases that hold from a node on; the first of them begins there."""
    first = max((k for k, one in enumerate(phases) if one.begin <= node), default=0)
    return [phases[first]._replace(begin=node), *phases[first + 1 :]]


def _without_early_brakes(phases: list[Phase], run: RunAtNodes) -> list[Phase]:
    """The phases; a brake that follows a speed to hold begins no sooner than the trajectory slows down."""
    found = phases[:1]
    for one, end in list(zip(phases, ends_of(phases, run), strict=True))[1:]:
        slows = np.flatnonzero(np.diff(run.speeds_mps[one.begin : end + 1]) < -STEADY_MPS)
        waits = one.kind in BRAKES and found[-1].kind is NotchRegime.HOLD and slows.size > 0
        found.append(one._replace(begin=one.begin + int(slows[0])) if waits else one)
    return found

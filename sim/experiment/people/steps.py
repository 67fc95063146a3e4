"""The steps of a participant, from a design; and the present one, from the journal of the session.

Nothing here has a state of its own: a session that was killed reads its journal and goes on at the same step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from das.domain.errors import DasError
from das.domain.units import KMH
from sim.drivers.kinds import DESK, DriverKind
from sim.experiment.design import Design
from sim.experiment.driving import StudyTrial
from sim.experiment.people_plan import Interrupted, PeoplePlan, form_id
from sim.experiment.trials import trials_of

CONSENT_ITEM: Final = "consent"
YES, NO = "yes", "no"
"""The answers to the request for consent."""
Entry = Mapping[str, Any]
"""A line of a journal: `wall_ns` (ns since 1970), `step`, `what`, and what belongs to it."""


class StepKind(StrEnum):
    """The kinds of steps, as the page distinguishes them."""

    TEXT = "text"
    CONSENT = "consent"
    FORM = "form"
    READY = "ready"
    """The question whether the participant is ready; the trial follows."""
    BREAK = "break"
    END = "end"


@dataclass(frozen=True, kw_only=True)
class SessionStep:
    """A step of a participant. No text of it names a condition, because `id` and `kind` are sent to the page.

    `about` is the subject of its title, `file` a Markdown text, `form` a questionnaire, `wait_s` the length of a break;
    each is empty where a step has none. `trial` is the trial that is driven, or that a questionnaire follows.
    """

    id: str
    kind: StepKind
    about: str
    file: str = ""
    form: str = ""
    wait_s: float = 0.0
    trial: StudyTrial | None = None
    to_criterion: bool = False
    """Whether a practice trial is repeated until its criterion is met."""


def plan_of(design: Design) -> PeoplePlan:
    """The procedure of a design with people; DasError for a design that simulated drivers must drive."""
    other = {str(setting.driver) for setting in design.settings()} - {DriverKind.HUMAN, DESK}
    if other:
        where = f"{design.source}: driver = {', '.join(sorted(other))}"
        raise DasError(f"{where}: expected fixed.driver = 'desk', or no driver, for people at the desk")
    return design.desk or PeoplePlan(folder=design.source.parent)


def steps_of(design: Design, who: int) -> list[SessionStep]:
    """All steps of a participant (from 1), in order; the page is told only their number."""
    plan, trials = plan_of(design), [trial for trial in trials_of(design) if trial.who == who]
    return [
        *_text(plan.consent, StepKind.CONSENT, "consent"),
        *_text(plan.instructions, StepKind.TEXT, "instructions"),
        *_forms(plan.before, "before"),
        *(step for i in range(len(trials)) for step in _around(design, plan, trials, i)),
        *_forms(plan.after, "after"),
        *_text(plan.debriefing, StepKind.TEXT, "debriefing"),
        SessionStep(id="end", kind=StepKind.END, about="end"),
    ]


def _text(file: str, kind: StepKind, name: str) -> Iterator[SessionStep]:
    if file:
        yield SessionStep(id=name, kind=kind, about=name, file=file)


def _forms(names: Sequence[str], when: str, trial: StudyTrial | None = None) -> Iterator[SessionStep]:
    for name in names:
        yield SessionStep(id=f"{when}-{form_id(name)}", kind=StepKind.FORM, about="form", form=name, trial=trial)


def _around(design: Design, plan: PeoplePlan, trials: Sequence[StudyTrial], i: int) -> Iterator[SessionStep]:
    """The steps of a participant's trial `i`: the break before it, the trial, the questionnaires after it."""
    trial, name = trials[i], f"trial-{trials[i].position}"
    if i and trial.session != trials[i - 1].session:
        yield SessionStep(
            id=f"break-{trial.session - 1}", kind=StepKind.BREAK, about="break", wait_s=design.procedure.break_s
        )
    last = trial.practice and not (i + 1 < len(trials) and trials[i + 1].practice)
    about = "practice" if trial.practice else "trial"
    to_criterion = last and plan.practice_criterion_mps > 0
    yield SessionStep(id=name, kind=StepKind.READY, about=about, trial=trial, to_criterion=to_criterion)
    if not trial.practice:
        yield from _forms(plan.after_trial, name, trial)


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The state of a session: the present step and its entries, and the number of trials `done` `of` all.

    Practice trials are not counted. `running`: the step's trial has begun, and has neither been driven to the end nor
    interrupted.
    """

    step: SessionStep
    done: int
    of: int
    running: bool
    entries: tuple[Entry, ...]

    @property
    def given(self) -> dict[str, str]:
        """The last answer to each item of the present step."""
        return {one["item"]: one["value"] for one in self.entries if one["what"] == "answered"}

    def wait_s(self, now_ns: int) -> float:
        """The time (s) of a break that remains at a time (ns since 1970); 0 for other steps."""
        began = [one["wall_ns"] for one in self.entries if one["what"] == "entered"]
        return max(self.step.wait_s - (now_ns - began[0]) * 1e-9, 0.0) if began else self.step.wait_s


def standing(steps: Sequence[SessionStep], entries: Sequence[Entry], plan: PeoplePlan) -> Standing:
    """The state of a session, from all steps of its participant and the entries of its journal."""
    of_step: dict[str, list[Entry]] = {step.id: [] for step in steps}
    for entry in entries:
        of_step.setdefault(entry["step"], []).append(entry)
    left = [step for step in steps if _applies(step, of_step, plan)]
    if any(entry["what"] == "stopped" for entry in entries):
        left = [step for step in left if step.about in ("debriefing", "end") or _is_done(step, of_step[step.id], plan)]
    elif _refused(of_step.get("consent", [])):
        left = [step for step in left if step.about in ("consent", "end")]
    done = [_is_done(step, of_step[step.id], plan) for step in left]
    at = done.index(False)
    mine, counted = of_step[left[at].id], [step.about == "trial" for step in left]
    running = left[at].kind is StepKind.READY and is_running(mine)
    return Standing(
        step=left[at], done=sum(counted[:at]), of=sum(counted), running=running, entries=tuple(mine)
    )  # fmt: skip


def is_running(entries: Sequence[Entry]) -> bool:
    """Whether the entries of a trial say that it has begun, and not that it has ended."""
    states = [one["what"] for one in entries if one["what"] in ("left", "driven", "interrupted")]
    return states[-1:] == ["left"]


def _refused(entries: Sequence[Entry]) -> bool:
    answers = [one["value"] for one in entries if one["what"] == "answered"]
    return any(one["what"] == "left" for one in entries) and answers[-1:] == [NO]


def _applies(step: SessionStep, of_step: Mapping[str, Sequence[Entry]], plan: PeoplePlan) -> bool:
    """Whether a step is for this participant: the questionnaires after a trial that was skipped are not."""
    if step.kind is not StepKind.FORM or step.trial is None or plan.interrupted is Interrupted.REPEAT:
        return True
    return not any(one["what"] == "interrupted" for one in of_step[f"trial-{step.trial.position}"])


def _is_done(step: SessionStep, entries: Sequence[Entry], plan: PeoplePlan) -> bool:
    if step.kind is StepKind.END:
        return False
    if step.kind is not StepKind.READY:
        return any(one["what"] == "left" for one in entries)
    if plan.interrupted is Interrupted.SKIP and any(one["what"] == "interrupted" for one in entries):
        return True
    driven = [one for one in entries if one["what"] == "driven"]
    if not driven or not step.to_criterion:
        return bool(driven)
    return driven[-1]["held_s"] >= plan.practice_hold_s or len(driven) >= plan.practice_most


def described(design: Design) -> str:
    """The steps of a participant, counted, in one line."""
    plan, steps = plan_of(design), steps_of(design, 1)
    shown = [str(step.trial.setting.presentation) for step in steps if step.trial and step.about == "practice"]
    practice, trials = len(shown), sum(step.about == "trial" for step in steps)
    breaks = sum(step.kind is StepKind.BREAK for step in steps)
    band, hold = f"±{plan.practice_criterion_mps / KMH:g} km/h", f"{plan.practice_hold_s:g} s"
    drives = f"{plan.practice_most} {'drive' if plan.practice_most == 1 else 'drives'}"
    until = f" ({band} for {hold}, or {drives})" if plan.practice_criterion_mps else ""
    others = f", after practice with {', '.join(shown[:-1])}" if practice > 1 else ""
    said = [
        plan.consent and "consent",
        plan.instructions and "instructions",
        ", ".join(plan.before),
        practice and f"practice with {shown[-1]}{until}{others}",
        f"{trials} trials" + (f", each with {', '.join(plan.after_trial)}" if plan.after_trial else ""),
        ", ".join(plan.tasks),
        plan.probes and f"{plan.probes} {'probe' if plan.probes == 1 else 'probes'} in each ({plan.probe})",
        breaks and f"{breaks} {'break' if breaks == 1 else 'breaks'} of {design.procedure.break_s:g} s",
        ", ".join(plan.after),
        plan.debriefing and "debriefing",
    ]
    return "; ".join(str(one) for one in said if one)

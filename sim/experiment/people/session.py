"""The session of a participant: it shows the steps on the page, keeps the journal, and runs the trials.

The command's own process is the server. Each trial is a child process; if one is killed, the trial is interrupted, and
if the server is killed, the same command goes on at the same step.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import uvicorn
from markdown_it import MarkdownIt

from das.bus.session import endpoint, free_ports
from das.command_line.printing import say, warn
from das.command_line.process import interrupted_by_termination
from das.domain.errors import DasError
from das.domain.files.reading import read_text
from das.domain.route import Route
from das.domain.units import NS
from sim.desk.host import address_of, listening, new_token
from sim.desk.line import hello_of
from sim.desk.messages import Acted, Answered, DeskBus, Marked, PageSettings, Ready, Said, Stopped, WentOn, encoded
from sim.desk.peer import MARKED, SILENCE
from sim.desk.server import WATCH, Desk, PageLink, server_of
from sim.experiment.design import Design
from sim.experiment.driving import AtDesk, StudyTrial
from sim.experiment.people.forms import load_form, text_for
from sim.experiment.people.journal import JOURNAL, PersonJournal, read_journal, write_tables
from sim.experiment.people.steps import (
    CONSENT_ITEM,
    NO,
    YES,
    SessionStep,
    Standing,
    StepKind,
    is_running,
    plan_of,
    standing,
    steps_of,
)
from sim.experiment.people.tasks import SideTasks, TaskEvent, probe_times
from sim.experiment.people.trial import GIVEN, TrialGiven
from sim.experiment.people.watching import Abort, WatcherMark, Watchers, WatcherSaid
from sim.experiment.people_plan import SideTask
from sim.experiment.study_files import PEOPLE_FOLDER, pseudonym, recording_file
from sim.world.lockstep import Process
from sim.world.service import lay_out

TRAIN: Final = "train-1"
DOOR: Final = "door.json"
"""Port and tokens of a session that has not ended; only the user of the machine can read it."""
LOOK_S: Final = 0.2
"""Interval (s) at which the session checks whether a trial is still running."""
GOES_S: Final = 3.0
"""Time (s) for which the last step shows before the command ends."""
_EVENTS: Final = ("mark", "note", "left", "braked", "driven", "interrupted", "stopped")
"""The entries of the journal that the experimenter's page shows."""
_markdown: Final = MarkdownIt("commonmark", {"html": False})


@dataclass(frozen=True, kw_only=True)
class Sitting:
    """A participant (from 1) of a design, the study's folder, the language of the page, and the typed command.

    `lsl`: the trials are also streamed over LSL, under the pseudonym.
    """

    design: Design
    folder: Path
    who: int
    language: str
    command: str
    lsl: bool = False

    @property
    def name(self) -> str:
        """The pseudonym of the participant."""
        return pseudonym(self.who)

    @property
    def own(self) -> Path:
        """The folder of the participant."""
        return self.folder / PEOPLE_FOLDER / self.name


class RunningTrial:
    """A trial under way: its child process, and the desk at which the participant drives it."""

    def __init__(self, sitting: Sitting, trial: StudyTrial, link: PageLink) -> None:
        plan, setting = plan_of(sitting.design), trial.setting
        page = PageSettings(notches=plan.notches, punctuality=setting.punctuality)
        scenario, places = setting.read_scenario(), [endpoint(port) for port in free_ports(2)]
        line = lay_out(scenario)
        hello = hello_of(line, scenario.departure_ns, sitting.language, page) | {"session": True}
        bus = DeskBus(train=TRAIN, connect=tuple(places), lsl=sitting.name if sitting.lsl else "")
        self._row = sitting.own / "trial.json"
        self._row.unlink(missing_ok=True)
        desk = AtDesk(times_real=plan.pace, driver_at=places[0], recorder_at=places[1], metadata=page.metadata)
        settings = TrialGiven(
            design=str(sitting.design.source), folder=str(sitting.folder), number=trial.number, row=str(self._row),
            command=sitting.command, desk=desk,
        )  # fmt: skip
        self.desk = Desk(bus, hello, line[0], link)
        probes_s = probe_times(trial.seed, plan.probes, _least_s(line[0], line[1].max_speed_mps))
        self.tasks, self.probe = SideTasks(plan.tasks, trial.seed, probes_s), 0
        """The tasks beside driving; the number of the probe that stops the run (0: none)."""
        self.braked = False
        """Whether the dead-man brake stops the moving train."""
        self.stopped_by = ""
        """The reason for which the trial was stopped; empty if it was not."""
        self._child = Process("trial", "sim.experiment.people.trial", (), given={GIVEN: encoded(settings)})

    async def row(self) -> dict[str, Any]:
        """The row of the trial when it has been driven; DasError with the reason if it was interrupted."""
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                self._child.check()
            except DasError as error:
                if self._row.exists():
                    found: dict[str, Any] = json.loads(self._row.read_bytes())
                    return found
                raise DasError(self.stopped_by or str(error)) from None

    async def stop(self, why: str) -> None:
        """Ask the trial to end."""
        self.stopped_by = why
        await asyncio.to_thread(self._child.stop)

    def close(self) -> None:
        """End the trial's process, if it is still running, and leave the bus."""
        self._child.__exit__()
        self.desk.peer.close()
        self._row.unlink(missing_ok=True)


class Session:
    """The session of a participant. `link` is the link to the page; `over` is set when the last step has shown.

    Each step is in the journal before the page shows it. Messages about another step than the present one are ignored.
    """

    def __init__(self, sitting: Sitting, journal: PersonJournal) -> None:
        self.sitting, self._journal = sitting, journal
        self.plan = plan_of(sitting.design)
        self._steps_of = cache(partial(steps_of, sitting.design))
        self._steps = self._steps_of(sitting.who)
        self._forms = {name: load_form(name, self.plan.folder) for name in self.plan.forms}
        self._texts = {one.id: _text(self.plan.folder / one.file) for one in self._steps if one.file}
        self.link, self.watchers, self.over = PageLink(self), Watchers(self.state, self.on_watch), asyncio.Event()
        self.trial: RunningTrial | None = None
        """The trial under way."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._others: dict[int, tuple[int, dict[str, Any]]] = {}
        self.failed: BaseException | None = None
        """The error that ended the session."""
        for step in self._steps:  # the server was killed during this trial
            entries = [one for one in journal.entries if one["step"] == step.id]
            if step.kind is StepKind.READY and is_running(entries):
                self._keep_interrupted(step, "the session ended")

    @property
    def standing(self) -> Standing:
        """The present state; a probe is a questionnaire in the middle of a trial."""
        now = standing(self._steps, self._journal.entries, self.plan)
        if self.trial is None or not self.trial.probe:
            return now
        name = f"{now.step.id}-probe-{self.trial.probe}"
        probe = SessionStep(
            id=name, kind=StepKind.FORM, about=now.step.about, form=self.plan.probe, trial=now.step.trial
        )
        began = max(i for i, one in enumerate(self._journal.entries) if one["what"] == "probe")
        mine = [one for one in self._journal.entries[began:] if one["step"] == name]
        return replace(now, step=probe, running=False, entries=tuple(mine))

    def opened(self) -> Sequence[dict[str, Any]]:
        """The present step, or the trial under way, for a new page."""
        driving = self.trial is not None and not self.trial.probe
        return self.trial.desk.opened() if self.trial is not None and driving else [self._step_message()]

    def closed(self) -> None:
        """Record in the trial under way that the page is closed."""
        if self.trial is not None:
            self.trial.desk.closed()

    def on_page(self, said: Said) -> None:
        """Do what the page says."""
        if isinstance(said, Stopped):
            self._stop()
        elif isinstance(said, Answered | WentOn):
            now = self.standing
            if said.step != now.step.id or now.running:
                return
            if isinstance(said, WentOn):
                self._leave(now)
            elif self._accepts(now.step, said):
                self._add(now.step, "answered", item=said.item, value=said.value, browser_ms=said.at)
        elif self.trial is not None and isinstance(said, Acted):
            if said.what in self.plan.tasks:
                self._tell(self.trial.tasks.answered(SideTask(said.what), said.number, said.at, said.shown))
        elif self.trial is not None:
            self.trial.desk.on_page(said)

    def on_watch(self, said: WatcherSaid) -> None:
        """Do what the experimenter says: a mark is also in the recording; an abort ends the trial as interrupted."""
        if not isinstance(said, Abort):
            self._add(self.standing.step, "mark" if isinstance(said, WatcherMark) else "note", text=said.text)
        if self.trial is not None and isinstance(said, WatcherMark):
            self.trial.desk.peer.mark(MARKED, Marked(at=time.time() * 1000, text=said.text))
        elif self.trial is not None and isinstance(said, Abort):
            self._run(self.trial.stop("ended by the experimenter"))

    def state(self) -> dict[str, Any]:
        """The state of this session, and of the others, for the experimenter's page."""
        now = self.standing
        trial = now.step.trial
        cab = None if self.trial is None else self.trial.desk.cab
        return {
            "language": self.sitting.language, "participant": self.sitting.name, "step": now.step.id, "of": now.of,
            "practice": now.step.about == "practice", "trial": now.done + (now.step.about == "trial"),
            "condition": "" if trial is None else trial.condition,
            "driven_s": None if self.trial is None else 0.0 if cab is None else cab["clock_s"], "cab": cab,
            "events": list(self._events()), "others": list(self._participants()),
        }  # fmt: skip

    def close(self) -> None:
        """End the trial under way; the next session of the participant marks it as interrupted."""
        if self.trial is not None:
            self.trial.close()

    def _events(self) -> Iterator[dict[str, Any]]:
        entries = self._journal.entries
        for one in entries:
            if one["what"] in _EVENTS:
                at_s, said = (one["wall_ns"] - entries[0]["wall_ns"]) * NS, one.get("text", one.get("why", ""))
                yield {"at_s": at_s, "step": one["step"], "what": one["what"], "said": said}

    def _participants(self) -> Iterator[dict[str, Any]]:
        """The participants of the design, and what each has done; only journals that have grown are read."""
        for who in range(1, self.sitting.design.people.count + 1):
            path, length = self.sitting.folder / PEOPLE_FOLDER / pseudonym(who) / JOURNAL, 0
            with suppress(FileNotFoundError):
                length = path.stat().st_size
            if self._others.get(who, (-1,))[0] != length:
                stands = self._stands(who, path) if length else {"done": 0, "of": 0, "state": "not_begun"}
                self._others[who] = length, stands
            yield {"participant": pseudonym(who), **self._others[who][1]}

    def _stands(self, who: int, path: Path) -> dict[str, Any]:
        try:
            now = standing(self._steps_of(who), read_journal(path)[0], self.plan)
        except DasError as error:  # the session of this participant goes on
            warn(str(error))
            return {"done": 0, "of": 0, "state": "altered"}
        return {"done": now.done, "of": now.of, "state": now.step.id}

    def _add(self, step: SessionStep, what: str, **more: Any) -> None:
        """Write a line to the journal; if that fails, the session ends."""
        trial = {} if step.trial is None else {"trial": step.trial.number}
        try:
            self._journal.add(step.id, what, **trial, **more)
        except DasError as error:  # nothing may show that is not in the journal
            self._fail(error)
            raise
        self.watchers.changed()

    def _accepts(self, step: SessionStep, said: Answered) -> bool:
        if step.kind is StepKind.CONSENT:
            return said.item == CONSENT_ITEM and said.value in (YES, NO)
        return step.kind is StepKind.FORM and self._forms[step.form].accepts(said.item, said.value)

    def _may_leave(self, now: Standing) -> bool:
        if now.step.kind is StepKind.CONSENT:
            return CONSENT_ITEM in now.given
        if now.step.kind is StepKind.FORM:
            return self._forms[now.step.form].is_complete(now.given)
        return now.step.kind is not StepKind.END and now.wait_s(time.time_ns()) <= 0

    def _leave(self, now: Standing) -> None:
        step = now.step
        if not self._may_leave(now):
            return
        if step.kind is StepKind.READY:
            self._add(step, "left")
            self._run(self._drive(step))
            return
        form = self._forms.get(step.form)
        self._add(step, "left", **({} if form is None else {"scores": form.scores(now.given)}))
        if self.trial is not None:  # a probe: the run goes on
            self.trial.probe = 0
            self.trial.desk.peer.pause(False)
            for message in self.trial.desk.opened():
                self.link.put(message)
            return
        self._write_tables()
        self._show()

    def _look(self, cab: dict[str, Any]) -> None:
        """Record the dead-man brake, show and withdraw requests of the tasks, and stop for a probe, at a look."""
        trial = self.trial
        if trial is None or trial.probe or self.failed is not None:
            return
        braked = cab["interlock"] == SILENCE and cab["speed_mps"] > 0
        if braked and not trial.braked:
            self._add(self.standing.step, "braked", clock_s=cab["clock_s"])
        trial.braked = braked
        for event in trial.tasks.look(cab["clock_s"], time.time() * 1000):
            self._tell(event)
        if trial.tasks.probe_due(cab["clock_s"]):
            trial.desk.peer.pause(True)
            for event in trial.tasks.withdraw(time.time() * 1000):
                self._tell(event)
            step = self.standing.step
            self._add(step, "probe")
            trial.probe = self._count(step, "probe")
            self._show()

    def _tell(self, event: TaskEvent) -> None:
        """Write an event of a task to the journal, and show it."""
        self._add(self.standing.step, "act", **event._asdict())
        self.link.put(event.message)

    def _stop(self) -> None:
        step = self.standing.step
        if step.kind is StepKind.END or any(one["what"] == "stopped" for one in self._journal.entries):
            return
        self._add(step, "stopped")
        if self.trial is None:
            self._write_tables()
            self._show()
        else:
            self._run(self.trial.stop("the participant stopped"))

    def _show(self) -> None:
        """Show the present step."""
        self.link.put(self._step_message())

    def _step_message(self) -> dict[str, Any]:
        """The message of the present step, which is journalled as entered before."""
        now = self.standing
        states = [one["what"] for one in now.entries if one["what"] in ("entered", "driven", "interrupted")]
        if states[-1:] != ["entered"]:
            self._add(now.step, "entered")
            now = self.standing
        if now.step.kind is StepKind.END and self.link.is_open:
            self.over.set()
        form, language = self._forms.get(now.step.form), self.sitting.language
        title, html = self._texts.get(now.step.id, ("", ""))
        if form is not None:
            title, html = text_for(form.title, language), _markdown.render(text_for(form.intro, language))
        return {
            "t": "step", "id": now.step.id, "kind": str(now.step.kind), "about": now.step.about, "title": title,
            "html": html, "language": language, "done": now.done, "of": 0 if now.step.about == "practice" else now.of,
            "items": [] if form is None else [item.words(language) for item in form.items], "given": now.given,
            "wait_s": now.wait_s(time.time_ns()), "tasks": self.plan.tasks,
        }  # fmt: skip

    async def _drive(self, step: SessionStep) -> None:
        """Run a trial to its end, and show the next step."""
        assert step.trial is not None
        if driven := self._count(step, "driven"):
            self._renamed(step, f"practice-{driven}")
        try:
            if any(one["what"] == "stopped" for one in self._journal.entries):  # since the step was left
                raise DasError("the participant stopped")
            self.trial = RunningTrial(self.sitting, step.trial, self.link)
            self.trial.desk.looks = self._look
            self.trial.desk.on_page(Ready())
            for message in self.trial.desk.opened():
                self.link.put(message)
            row = await self.trial.row()
        except DasError as error:
            warn(f"trial {step.trial.number} ({self.sitting.name}): interrupted: {error}")
            self._keep_interrupted(step, str(error))
        else:
            self._add(step, "driven", **row)
        finally:
            self.close()
            self.trial = None
        self._write_tables()
        self._show()

    def _keep_interrupted(self, step: SessionStep, why: str) -> None:
        """Keep the recording of an interrupted trial under another name, and write it to the journal."""
        kept = self._renamed(step, f"interrupted-{1 + self._count(step, 'interrupted')}")
        self._add(step, "interrupted", why=why, recording=kept)

    def _renamed(self, step: SessionStep, suffix: str) -> str:
        """Rename the recording of a trial that will be driven again; returns its new name, empty if there is none."""
        assert step.trial is not None
        path = self.sitting.folder / recording_file(step.trial)
        if not path.exists():  # the recorder had not started
            return ""
        return path.rename(path.with_stem(f"{path.stem}_{suffix}")).name

    def _count(self, step: SessionStep, what: str) -> int:
        return sum(one["step"] == step.id and one["what"] == what for one in self._journal.entries)

    def _write_tables(self) -> None:
        try:
            write_tables(self.sitting.design, self.sitting.folder)
        except DasError as error:  # nothing is lost: the tables are made from the journals
            warn(f"{error}; the tables are written after the next trial")

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a task; its failure ends the session."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        self.failed = self.failed or error
        self.over.set()


def serve(sitting: Sitting, port: int, tell: Callable[[str, str], None]) -> None:
    """Serve the session of a participant until its last step has shown, or until Ctrl-C or SIGTERM.

    `tell` is called with the addresses of the participant's and the experimenter's page. `port` 0 is that of the
    participant's last session if it did not end, else any free one. Raises DasError for files that cannot be used, and
    while another command has the participant.
    """
    with PersonJournal(sitting.own) as journal, interrupted_by_termination():
        session, path = Session(sitting, journal), sitting.own / DOOR
        kept = _kept(path)
        with _listening(port, kept["port"]) as door:
            _write_privately(path, kept | {"port": door.getsockname()[1]})
            page = address_of(door, kept["token"])
            tell(page, address_of(door, kept["watch_token"]).replace("/?", f"{WATCH}?"))
            asyncio.run(_serve(session, door, kept))
        path.unlink()


def _kept(path: Path) -> dict[str, Any]:
    """Port and tokens of the participant's last session; new ones if it ended, or the file was altered."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        kept = json.loads(path.read_bytes())
        if type(kept["port"]) is int and all(isinstance(kept[key], str) for key in ("token", "watch_token")):
            return dict(kept)
    return {"port": 0, "token": new_token(), "watch_token": new_token()}


def _listening(port: int, kept: int) -> socket.socket:
    """The socket at a port; without one (0), at the last session's, or at any if another program has taken that."""
    if port or not kept:
        return listening(port)
    try:
        return listening(kept)
    except DasError as error:
        warn(f"{error}; open pages do not reconnect: use the new address")
        return listening(0)


def _write_privately(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whole, which only the user of the machine can read."""
    new = path.with_suffix(".new")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        json.dump(content, file)
    new.replace(path)


async def _serve(session: Session, door: socket.socket, kept: dict[str, Any]) -> None:
    routes = [*session.watchers.routes(), *session.link.routes()]
    server = server_of(routes, door.getsockname()[1], kept["token"], kept["watch_token"])
    ending = asyncio.create_task(_end(session, server))
    try:
        await server.serve(sockets=[door])
    finally:
        ending.cancel()
        session.close()
    if session.failed is not None:
        raise session.failed
    if not session.over.is_set():
        say("the same command goes on at the same step")
        raise KeyboardInterrupt


async def _end(session: Session, server: uvicorn.Server) -> None:
    """End the server when the last step has shown for a while, or when the session has failed."""
    await session.over.wait()
    await asyncio.sleep(GOES_S if session.failed is None else 0.0)
    server.should_exit = True


def _least_s(route: Route, top_mps: float) -> float:
    """The time (s) of a line at its limits; every drive takes longer, so that its probes come before its end."""
    starts_m, limits_mps = route.limits_mps.start_m, route.limits_mps.value
    ends_m = np.append(starts_m[1:], route.length_m)
    return float(np.sum((ends_m - starts_m) / np.minimum(limits_mps, top_mps)))


def _text(path: Path) -> tuple[str, str]:
    """The title of a Markdown text (the heading on its first line; else empty), and the rest of the text as HTML."""
    first, _, rest = read_text(path).lstrip().partition("\n")
    if first.startswith("# "):
        return first.removeprefix("# ").strip(), str(_markdown.render(rest))
    return "", str(_markdown.render(f"{first}\n{rest}"))

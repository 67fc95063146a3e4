"""A worker of a batch runs one job after another, and solves a service only if the next job needs another one."""

from __future__ import annotations

import json
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader

from das.domain.errors import DasError
from sim.drivers.diary import DriverEvent
from sim.drivers.presentations.presenter import presenter_of
from sim.jobs.memory import ServiceMemory
from sim.jobs.plan import BatchJob
from sim.world.day import Day, make_day
from sim.world.disturbances import described
from sim.world.in_process import InProcess
from sim.world.loop import Run, World
from sim.world.outcome import outcome
from sim.world.over_bus import How, make_crew, run_over_bus
from sim.world.scenario import read_scenario

_services = ServiceMemory()
"""A worker is a process: this is its memory between jobs."""


def work(job: BatchJob) -> dict[str, Any]:
    """Make a run and return its row; if the run fails, the row says why."""
    row: dict[str, Any] = {
        "scenario": job.scenario_id,
        "seed": job.seed,
        "driver": str(job.driver),
        "friction_policy": str(job.friction),
        "participant": None if job.participant is None else job.participant.number,
        "population": None if job.participant is None else job.participant.population.id,
        "advice": str(job.advice),
        **dict(job.versions),
        "inputs_sha256": job.inputs_sha256,
        "recording": None if job.record is None else str(job.record),
    }
    try:
        return row | _run(job)
    except DasError as error:
        return row | {"error": " ".join(str(error).split())}
    except Exception as error:  # one run that fails must not end a batch of thousands
        return row | {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def _run(job: BatchJob) -> dict[str, Any]:
    day = make_day(_services.of(read_scenario(job.scenario), job.level), job.seed, job.participant)
    run = _driven(day, job)
    figures = outcome(day, run, job.driver).as_dict()
    stops = figures.pop("stops")
    return {
        **figures,
        "happens": described(day.disturbances),
        "drawn": json.dumps(day.drawn),
        "stops": [stop["name"] for stop in stops],
        **{f"stop_{name}": [stop[name] for stop in stops] for name in STOP_COLUMNS},
        **{f"decision_{name}": [getattr(one, name) for one in run.decisions] for name in DriverEvent._fields},
    }


STOP_COLUMNS = ("due_s", "arrived_s", "departed_s", "late_s", "missed_m")
"""Figures of the stops, as lists in the order of the way."""


def _driven(day: Day, job: BatchJob) -> Run:
    driver = day.driver(job.driver, job.friction)
    if job.record is None:
        return World(day, driver, job.advice, InProcess(day.service, coach=presenter_of(job.advice).needs_coach)).run()
    how = How(driver=job.driver, friction=job.friction, advice=job.advice, train="train-1", command=_command(job))
    run, traffic = run_over_bus(day, driver, job.advice, make_crew(day, how, job.record))
    if traffic.lost:
        raise DasError(f"{job.record}: {traffic.lost} messages were lost")
    return run


def recorded(job: BatchJob) -> bool:
    """Whether the recording that a job asks for is there, whole, and made from the job's inputs."""
    if job.record is None:
        return True
    try:
        with job.record.open("rb") as file:
            return any(kept.metadata.get("command") == _command(job) for kept in make_reader(file).iter_metadata())
    except (OSError, ValueError, McapError):
        return False


def _command(job: BatchJob) -> str:
    return f"das-sim batch: {job.name}, inputs {job.inputs_sha256}"

"""Common helpers of tests: small routes, trains and a loss chain, and commands run in this process or another."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from types import MappingProxyType
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray

import precompute.cli.program
import sim.cli.program
from das.command_line.printing import COMPILING
from das.command_line.process import EXIT_INTERRUPTED, STOP_SIGNALS
from das.domain.effort import EffortEnvelope
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.loss_chain import Auxiliaries, Converter, Gear, LossChain, Motors, Transformer
from das.domain.losses import LOSSLESS, LossMap, LossModel
from das.domain.route import Route, Stop, Stretches
from das.domain.trajectory import Trajectory
from das.domain.vehicle import BrakePolicy, Resistance, Vehicle

REPOSITORY = Path(__file__).parents[2]

CHAIN = LossChain(
    auxiliaries=Auxiliaries(base_w=10e3, fan_w=8e3, rated_heat_w=100e3),
    transformer=Transformer(no_load_w=5e3, copper_w=40e3, rated_power_w=2e6),
    converter=Converter(
        fixed_w=4e3,
        line_ratio=0.02,
        line_brake_ratio=0.03,
        conduction_w=12e3,
        switching_w=6e3,
        snubber_w=3e3,
        asynchronous_hz=200.0,
        stator_hz_per_mps=1.8,
        clock_speeds_mps=(10.0, 20.0),
        clock_pulses=(7.0, 1.0),
    ),
    motors=Motors(
        base_speed_mps=20.0,
        rated_force_n=90e3,
        magnetising_ratio=0.25,
        pull_out_ratio=2.0,
        brake_current_ratio=1.1,
        copper_w=20e3,
        iron_w=6e3,
    ),
    gear=Gear(mesh_ratio=0.03, churning_w=2e3, churning_speed_mps=40.0),
)
"""A loss chain with round numbers."""


def make_route(
    length_m: float, limits: list[tuple[float, float]], grades: list[tuple[float, float]] | None = None
) -> Route:
    """A straight line from stop A to stop B, with limits (m/s) and gradients (ratio; default: 0) from positions (m)."""

    def stretches(rows: list[tuple[float, float]]) -> Stretches:
        return Stretches(start_m=np.array([r[0] for r in rows]), value=np.array([r[1] for r in rows]))

    return Route(
        id="test",
        name="test",
        source="test",
        illustrative=True,
        length_m=length_m,
        stops=(Stop(name="A", position_m=0.0), Stop(name="B", position_m=length_m)),
        limits_mps=stretches(limits),
        gradients_ratio=stretches(grades or [(0.0, 0.0)]),
        curvature_per_m=stretches([(0.0, 0.0)]),
    )


def make_train(
    *, resistance: tuple[float, float, float] = (0.0, 0.0, 0.0), power_w: float = 1e12, loss: LossModel = LOSSLESS
) -> Vehicle:
    """A point mass of 100 t with 100 kN of traction and of brakes; R = c0 + c1·v + c2·v² (N, v in m/s)."""
    effort = EffortEnvelope(max_force_n=1e5, max_power_w=power_w)
    return Vehicle(
        id="test",
        name="test",
        source="test",
        mass_kg=1e5,
        rotating_mass_ratio=0.0,
        train_length_m=0.0,
        max_speed_mps=60.0,
        resistance=Resistance(c0_n=resistance[0], c1_n_per_mps=resistance[1], c2_n_per_mps2=resistance[2]),
        traction=effort,
        electric_brake=effort,
        friction_brake_force_n=0.0,
        brake_policy=BrakePolicy.ELECTRIC,
        losses=MappingProxyType({Level.OWN: loss}),
    )


def flat(length_m: float, limit_mps: float = 60.0) -> Route:
    """A level line with one limit."""
    return make_route(length_m, [(0.0, limit_mps)])


def csv_rows(run: Trajectory) -> NDArray[np.float64]:
    """A trajectory as the rows of its CSV: (nodes, 7)."""
    forces = [np.append(force, 0.0) for force in (run.force_el_n, run.force_friction_n)]
    line = [np.append(value, value[-1]) for value in (run.grade_ratio, run.limit_mps)]
    return np.column_stack([run.s_m, run.t_s, run.v_mps, *forces, *line])


def das_precompute(folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    """Run das-precompute in a folder, within this process, which avoids loading imports and kernels again."""
    return run_here(precompute.cli.program.main, precompute.cli.program.__file__, args, folder)


def printed(folder: Path, *args: str) -> str:
    """The output of das-precompute in a folder; it must succeed, with nothing on standard error."""
    done = das_precompute(folder, *args)
    assert (done.returncode, done.stderr) == (0, ""), done
    return done.stdout


def refused(folder: Path, *args: str) -> str:
    """The one-line error of das-precompute in a folder, with nothing on standard output."""
    done = das_precompute(folder, *args)
    assert (done.returncode, done.stdout) == (2, ""), done
    assert done.stderr.count("\n") == 1, done
    return done.stderr


def das_sim(*args: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run das-sim in a folder, within this process; it still starts a node, a recorder and workers as processes."""
    return run_here(sim.cli.program.main, sim.cli.program.__file__, args, cwd)


def das_sim_json(*args: str, cwd: Path) -> Any:
    """The output of das-sim with --json; it must succeed."""
    done = das_sim(*args, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def refusal(*args: str, cwd: Path) -> str:
    """The one-line error of das-sim for these arguments."""
    done = das_sim(*args, cwd=cwd)
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert line.startswith("error: ")
    return line


def wait_until(done: Callable[[], bool], for_s: float = 120.0) -> bool:
    """Call `done` every 50 ms for at most `for_s`; returns whether it became true."""
    deadline = time.monotonic() + for_s
    while time.monotonic() < deadline:
        if done():
            return True
        time.sleep(0.05)
    return False


def write_loss_map(path: Path, train: str) -> None:
    """Write the loss map of a bundled train as CSV."""
    model = load_vehicle(train).loss_model(Level.L3)
    assert isinstance(model, LossMap)
    rows = [
        f"{speed * 3.6:.10g},{force:.10g},{loss:.9g}"
        for speed, losses in zip(model.speed_mps, model.loss_w_table, strict=True)
        for force, loss in zip(model.force_n, losses, strict=True)
        if np.isfinite(loss)
    ]
    path.write_text("\n".join(["speed_kmh,force_n,loss_w", *rows, ""]))


def started(*words: str, cwd: Path, **pipes: Any) -> subprocess.Popen[str]:
    """Python of this checkout as a process in a folder, with its standard error."""
    paths = os.pathsep.join([str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])])
    given: dict[str, Any] = {"stderr": subprocess.PIPE, "encoding": "utf-8", **pipes}
    return subprocess.Popen([sys.executable, *words], cwd=cwd, env={**os.environ, "PYTHONPATH": paths}, **given)


def in_a_process(module: str, *args: str, cwd: Path, timeout_s: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Run a command of this checkout as a process, as users do; one test of each command uses this.

    The message before compilation is removed, because its occurrence depends on earlier tests.
    """
    paths = os.pathsep.join([str(REPOSITORY), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", module, *args],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": paths, "PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        encoding="utf-8",
        timeout=timeout_s,
        check=False,
    )
    done.stderr = done.stderr.replace(f"{COMPILING}\n", "")
    return done


def run_here(
    main: Callable[[], object], program: str, args: Sequence[str], cwd: Path
) -> subprocess.CompletedProcess[str]:
    """Call an entry point as if it were a process, with arguments, folder and output; restore signal handlers."""
    command = [program, *args]
    output, errors = io.StringIO(), io.StringIO()
    handlers = [(number, signal.getsignal(number)) for number in STOP_SIGNALS]
    try:
        with (
            patch.object(sys, "argv", command), chdir(cwd), redirect_stdout(output), redirect_stderr(errors),
            pytest.raises(SystemExit) as ended,
        ):  # fmt: skip
            main()
    finally:
        for number, handler in handlers:
            signal.signal(number, handler)
    if ended.value.code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt  # meant for pytest
    return subprocess.CompletedProcess(command, int(ended.value.code or 0), output.getvalue(), errors.getvalue())

"""What a node loads before it is ready: every kernel it advises with, and neither the compiler's library nor scipy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

WARMED = """
import sys
from das.cab.cab import warm_up
from das.command_line.printing import loading_solver
with loading_solver():
    warm_up()
print(*(name for name in ("numba.np.linalg", "numba.np.arraymath", "scipy.linalg") if name in sys.modules))
"""
DRIVEN = """
import gc
from numba.core.dispatcher import Dispatcher
from das.bus import das_pb2
from das.bus.topics import RESTRICTION, TARGET
from das.cab.cab import CabSettings
from das.cab.cab import warm_up
from tests.support.driven_node import START_NS, DrivenNode, S, restrictions

def compiled():
    kernels = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.py_func.__module__, one.py_func.__name__, str(kind)) for one in kernels for kind in one.overloads}

warm_up()
before = compiled()
driven = DrivenNode(CabSettings(calibrate=True, guide=True))
guided = 0
for second in range(2, 60):
    if second == 20:
        driven.tell(RESTRICTION, restrictions(second, 25.0))
    if second == 40:
        late = das_pb2.Targets.Target(s_m=3000.0, earliest_ns=START_NS + 200 * S)
        driven.tell(TARGET, das_pb2.Targets(time_ns=START_NS + second * S, targets=[late]))
    guided += driven.tick(second).HasField("guide")
assert guided > 20 and len(before) > 20
print(*(name for _, name, _ in sorted(compiled() - before)))
"""


LATE = """
import gc
import das
from das.cab.cab import warm_up
from precompute import late_kernels
from numba.core.dispatcher import Dispatcher
from sim.plant.plant import COAST, Plant
from sim.world import late_kernels as late_kernels_of_a_day

def compiled():
    kernels = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.py_func.__name__, str(kind)) for one in kernels for kind in one.overloads}

late_kernels.main()
late_kernels_of_a_day.main()
late = compiled()
route, train = das.load_route("flat-6km"), das.load_vehicle("re460-ic")
run = das.solve(das.build_section(route, train)).trajectory(400.0)
run.certificate
das.refined(run)
warm_up()
Plant(route, train).advance(Plant(route, train).at(0.0), COAST)
again = {name for name, _ in compiled() - late} & {name for name, _ in late}
print(len(late) > 30, *sorted(again))
"""


def run(program: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_no_kernel_is_compiled_once_a_node_is_ready() -> None:
    """On a slow machine the first advice would come too late: one kernel of the guide took 10 s."""
    assert run(DRIVEN).split() == []


@pytest.mark.nightly
def test_kept_kernels_bring_neither_linear_algebra_nor_scipy_along() -> None:
    # The first start may have to compile the kernels, and the compiler needs it all.
    said = [run(WARMED) for _ in range(2)]
    assert said[1].split() == []


@pytest.mark.slow
def test_what_is_compiled_beside_a_command_is_what_the_command_needs() -> None:
    """A kernel compiled for other types would be compiled in vain."""
    assert run(LATE) == "True\n"

"""The names of the library and the modules that define them: for type checkers, and for `das/__init__.py` itself."""

from .bus.recording import Recording as Recording
from .bus.recording import read_recording as read_recording
from .domain.braking import SiteBraking as SiteBraking
from .domain.conditions import Conditions as Conditions
from .domain.errors import DasError as DasError
from .domain.errors import InfeasibleError as InfeasibleError
from .domain.errors import InputError as InputError
from .domain.files.load import load_journey as load_journey
from .domain.files.load import load_route as load_route
from .domain.files.load import load_vehicle as load_vehicle
from .domain.levels import Level as Level
from .domain.restriction import Restriction as Restriction
from .domain.route import Route as Route
from .domain.trajectory import EnergyBalance as EnergyBalance
from .domain.trajectory import Trajectory as Trajectory
from .domain.vehicle import Vehicle as Vehicle
from .front_door import build_section as build_section
from .front_door import front_points as front_points
from .front_door import in_service as in_service
from .front_door import plan_journey as plan_journey
from .front_door import plot as plot
from .front_door import read_table as read_table
from .front_door import refined as refined
from .front_door import solve as solve
from .front_door import to_pandas as to_pandas
from .offline.asked_journey import Journey as Journey
from .offline.chains import Split as Split
from .offline.journey import JourneyPlan as JourneyPlan
from .solver.front import Front as Front
from .solver.section import Section as Section
from .solver.solution import Solution as Solution

__version__: str

"""The names of the library and the module that defines them: for type checkers, and for `sim/__init__.py` itself."""

from .front_door import SimulatedDay as SimulatedDay
from .front_door import run_day as run_day

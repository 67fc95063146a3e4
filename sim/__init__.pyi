"""The names of the library and the modules that define them: for type checkers, and for `sim/__init__.py` itself."""

from .drive.comparison import AlignedDrives as AlignedDrives
from .drive.drive import Drive as Drive
from .front_door import SimulatedDay as SimulatedDay
from .front_door import StudyTables as StudyTables
from .front_door import compare as compare
from .front_door import record_day as record_day
from .front_door import replay as replay
from .front_door import report as report
from .front_door import run_day as run_day
from .front_door import run_experiment as run_experiment
from .front_door import write_example as write_example

"""The simulator as a library: runs in closed loop of a simulated train, driver and adviser.

    >>> import sim
    >>> day = sim.run_day("clear-day", seed=1, driver="perfect")
    >>> round(day.outcome["over_limit_s"]), len(day.outcome["stops"])
    (0, 4)

`__init__.pyi` lists the names; the functions are explained in `sim.front_door`. As in `das`, a name's module is
imported when the name is first used.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

"""The driver advisory system as a library: lines and trains in, trajectories of least energy out.

    >>> import das
    >>> route, train = das.load_route("flat-6km"), das.load_vehicle("re460-ic")
    >>> section = das.build_section(route, train, start="A", end="B")
    >>> front = das.solve(section)
    >>> run = front.trajectory(1.07 * front.fastest().time_s)
    >>> print(f"{run.time_s:.0f} s, {run.balance.input / 3.6e6:.1f} kWh")
    223 s, 61.0 kWh

`__init__.pyi` lists the names and where they live; the functions are explained in `das.front_door`. A name's module is
imported when the name is first used, so that `import das` itself is quick. Values are in SI units, and names carry
their unit. A `DasError` states in one line why something cannot be done.
"""

from lazy_loader import attach_stub

__version__ = "0.2.0"
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

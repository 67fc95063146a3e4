"""Display of the objects that the library returns: one line in a terminal, a small table in a notebook."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping

from das.domain.units import kwh_words


class Summary(ABC):
    """An object with a `repr` of one line, which a notebook shows as a table of a few rows instead of its arrays.

    A dataclass that inherits from this class needs `repr=False`; otherwise its `repr` contains all fields.
    """

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """The values that identify the object, as texts with units under their names; shown by `repr` and notebooks."""

    def __repr__(self) -> str:
        told = "; ".join(f"{name}: {value}" for name, value in self.facts().items())
        return f"<{type(self).__name__} {told}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><th style="text-align:left">{html.escape(name)}</th>'
            f'<td style="text-align:left">{html.escape(value)}</td></tr>'
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption><tbody>{rows}</tbody></table>"


def needs(time_s: float, energy_j: float) -> str:
    """Time and energy of a run as text, "571 s, 117.3 kWh"."""
    return f"{time_s:.0f} s, {kwh_words(energy_j)}"

"""How the objects that the library returns show themselves: one line in a terminal, a small table in a notebook."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping

from das.domain.units import kwh_words


class Summary(ABC):
    """An object whose `repr` is one line, and which a notebook shows as a table of a few rows, instead of its arrays.

    A dataclass that inherits from it needs `repr=False`, because it would otherwise get a `repr` of all its fields.
    """

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """What tells the object from others, in words with units, by what it is; `repr` and notebooks show it."""

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
    """Time and energy of a run in words, "571 s, 117.3 kWh"."""
    return f"{time_s:.0f} s, {kwh_words(energy_j)}"

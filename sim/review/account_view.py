"""The account of the energy as views and pictures show it: by cause, over time, and as a lane of what driving cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from das.domain.units import NS, kwh
from sim.drive.attribution.account import Account, LegAccount
from sim.drive.attribution.causes import EnergyCause
from sim.review.colors import Meaning
from sim.review.lanes import COST, Change, Lane
from sim.review.series import Found

LEAST_KWH: Final = 0.05
"""A span that cost less than this (kWh) is not in the lane."""
OTHER_THAN_ADVISED: Final = (EnergyCause.AGAINST_ADVICE, EnergyCause.LATE_COASTING)
"""The causes by which the effort set differed from the effort advised."""
COLORS: Final = {
    EnergyCause.SIGNAL: Meaning.DANGER,
    EnergyCause.RESTRICTION: Meaning.LIMIT,
    EnergyCause.AS_ADVISED: Meaning.ADVISED,
    EnergyCause.LATENESS: Meaning.WARNING,
    EnergyCause.REST: Meaning.NO_ADVICE,
    **dict.fromkeys(OTHER_THAN_ADVISED, Meaning.AGAINST),
}
"""What the colours of the lane mean; the other causes are energy lost."""


class CostSpan(NamedTuple):
    """A time (ns since 1970) to which energy above the optimum (J) belongs, all of it by one cause."""

    start_ns: int
    end_ns: int
    cause: EnergyCause
    energy_j: float

    @property
    def meaning(self) -> Meaning:
        """What the colour of the span says."""
        return COLORS.get(self.cause, Meaning.LOST)


@dataclass(frozen=True, kw_only=True)
class AccountView:
    """The account as it is shown: a text (Markdown), series by the names of `STYLES`, and the spans of the lane."""

    text: str
    series: Found
    spans: tuple[CostSpan, ...]

    @classmethod
    def of(cls, account: Account) -> AccountView:
        """What of an account is shown."""
        return cls(
            text=_text(account),
            series=_series(account),
            spans=tuple(span for leg in account.legs for span in spans_of(leg)),
        )

    @property
    def worth(self) -> tuple[CostSpan, ...]:
        """The spans that are worth a word."""
        return tuple(span for span in self.spans if abs(kwh(span.energy_j)) >= LEAST_KWH)

    @property
    def lane(self) -> Lane:
        """The lane of what the driving cost: a cause and its energy where it is worth a word, else nothing."""
        changes: list[Change] = []
        colors: dict[str, str | Meaning] = {}
        for span in self.spans:
            worth = abs(kwh(span.energy_j)) >= LEAST_KWH
            text = f"{kwh(span.energy_j):+.1f} kWh {span.cause.label}" if worth else ""
            if text:
                colors[text] = span.meaning
            while changes and changes[-1].time_ns >= span.start_ns:
                changes.pop()
            changes += [Change(span.start_ns, text), Change(span.end_ns, "")]
        return Lane(COST, tuple(changes), colors)


def spans_of(leg: LegAccount) -> Iterator[CostSpan]:
    """The times of a leg with one cause each, in order of time."""
    time_ns = leg.leg.motion.time_ns[leg.committed.sample]
    open_: CostSpan | None = None
    for rise in leg.committed.rises():
        start_ns, end_ns = int(time_ns[rise.first]), int(time_ns[rise.last])
        if open_ is not None and open_.cause is rise.cause:
            open_ = open_._replace(end_ns=end_ns, energy_j=open_.energy_j + rise.energy_j)
            continue
        if open_ is not None:
            yield open_
        open_ = CostSpan(start_ns, end_ns, rise.cause, rise.energy_j)
    if open_ is not None:
        yield open_


def _series(account: Account) -> Found:
    """Energy above the optimum over time: all that the driving cost, and what was other than advised; the optimum's."""
    found: dict[str, tuple[list[int], list[float]]] = {"lost/driving": ([], []), "lost/advice": ([], [])}
    total_j = other_j = before_j = 0.0
    best: tuple[list[int], list[float]] = [], []
    for leg in account.legs:
        time_ns = leg.leg.motion.time_ns[leg.committed.sample]
        for rise in leg.committed.rises():
            total_j += rise.energy_j
            other_j += rise.energy_j if rise.cause in OTHER_THAN_ADVISED else 0.0
            for name, energy_j in (("lost/driving", total_j), ("lost/advice", other_j)):
                found[name][0].append(int(time_ns[rise.last]))
                found[name][1].append(kwh(energy_j))
        run = leg.optimum.trajectory
        drawn_j = np.concatenate(([0.0], np.cumsum(run.input_j(run.loss_j(leg.optimum.section.loss)))))
        start_ns = int(leg.leg.motion.time_ns[0])
        best[0].extend((start_ns + np.rint(run.t_s / NS).astype(np.int64)).tolist())
        best[1].extend(kwh(before_j + drawn_j).tolist())
        before_j += float(drawn_j[-1])
    if not account.advice_shown:
        del found["lost/advice"]
    # Of the true train the energy of the optimum is known, not its way: the planned train's curve leads to that energy.
    to_known = account.optimum_j / before_j if before_j > 0.0 else 1.0
    found["energy/optimum"] = best[0], [to_known * energy_kwh for energy_kwh in best[1]]
    return {name: (np.array(at, dtype=np.int64), np.array(values)) for name, (at, values) in found.items()}


def _text(account: Account) -> str:
    """The account as a table (Markdown)."""
    rows = [f"| {cause.label} | {kwh(energy_j):+.1f} |" for cause, energy_j in account.by_cause.items()]
    meanings = [f"- **{cause.label}.** {cause.meaning}" for cause in account.by_cause]
    source = "measured by the simulator" if account.measured else "estimated from positions; nobody measured it"
    return "\n".join(
        [
            f"### Above the optimum for the same times: {account.above.words}",
            "",
            "| | kWh |",
            "|---|---:|",
            f"| optimum for the same times | {kwh(account.optimum_j):.1f} |",
            *rows,
            f"| **as driven** | **{kwh(account.driven_j):.1f}** |",
            "",
            f"Energy at the current collector, {source}.",
            "",
            *meanings,
        ]
    )

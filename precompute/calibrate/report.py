"""What `das-precompute calibrate` prints: every target with what is reached."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from das.command_line.printing import print_table, tell
from das.domain.loss_chain import LossChain
from precompute.calibrate import targets as paper
from precompute.calibrate.targets import Figures

LEGEND = {
    "printed": "in the paper",
    "accepted": "for the figure that is reached",
    "cells of Table 2": "row at column, in % of what the fastest run consumes at L3 GTO",
}


def report(figures: Figures, chains: Mapping[str, LossChain], written: Sequence[Path], *, as_json: bool) -> None:
    """Print every target with what is reached, and the files that were written."""
    if as_json:
        print(json.dumps(_as_json(figures, chains, written)))
        return
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("target")
    for name in ("printed", "reached", "accepted"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("")
    for target in paper.TARGETS:
        reached = figures[target.name]
        unit = f" {target.unit}" if target.unit else ""
        table.add_row(
            target.name,
            f"{target.printed}{unit}" if target.printed[0].isdigit() else target.printed,
            f"{reached:.4g}{unit}" if "%" not in unit else f"{reached:.2f}{unit}",
            _interval(target),
            "" if target.met(reached) else "missed",
        )
    print_table(table, LEGEND)
    missed = sum(not target.met(figures[target.name]) for target in paper.TARGETS)
    print(f"{len(paper.TARGETS) - missed} of {len(paper.TARGETS)} targets met")
    for path in written:
        tell(f"written: {path}")


def _interval(target: paper.PublishedFigure) -> str:
    if math.isinf(target.high):
        return f">= {target.low:.4g}"
    if target.low == target.high:
        return f"{target.low:.4g}"
    return f"{target.low:.4g} … {target.high:.4g}"


def _as_json(figures: Figures, chains: Mapping[str, LossChain], written: Sequence[Path]) -> dict[str, Any]:
    return {
        "targets": [
            {
                "name": target.name,
                "printed": target.printed,
                "low": target.low,
                "high": target.high if math.isfinite(target.high) else None,
                "unit": target.unit,
                "source": target.source,
                "reached": figures[target.name],
                "met": target.met(figures[target.name]),
            }
            for target in paper.TARGETS
        ],
        "parameters": {
            name: {
                component.name: {
                    item.name: getattr(getattr(chain, component.name), item.name)
                    for item in fields(getattr(chain, component.name))
                }
                for component in fields(chain)
            }
            for name, chain in chains.items()
        },
        "written": [str(path) for path in written],
    }

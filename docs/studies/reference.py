"""The reference pages' tables that are generated from the code, written to the working folder for the site.

`python -m docs.studies.reference` writes the commands of each program with their options (das-sim.md and so on, for
commands.md), the parameters of a human driver (parameters.md), the default population (population.md), and the measures
and factors of experiments (measures.md, factors.md); for bus.md also topics.md, causes.md and reasons.md. The CSV files
in docs/studies/tables become tables as well.
"""

from __future__ import annotations

import ast
import csv
import inspect
import re
from collections.abc import Iterable
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

import das.node.command
import das.recorder.command
import precompute.cli.program
import sim.cli.program
from das.advice.advice import Cause
from das.advice.reason import ReasonCode
from das.bus.topics import TOPICS
from das.command_line.application import single_command
from sim.drivers.parameters import DEFAULT, NORMAL, HumanParameters, Population, load_population, parameter_table
from sim.experiment.factors import FACTORS, OF_HUMAN
from sim.experiment.measures import MEASURES

EVERYWHERE = {"--help", "-h", "--version", "--install-completion", "--show-completion"}
"""Options common to all commands, which commands.md explains at the top."""

TABLES = Path(__file__).parent / "tables"
PROGRAMS = ("das-precompute", "das-sim", "das-node", "das-record")


def commands() -> dict[str, Any]:
    """Every command by the words that start it, joined by hyphens: `das-sim-replay`."""
    found: dict[str, Any] = {}
    programs = {"das-precompute": precompute.cli.program.COMMANDS, "das-sim": sim.cli.program.ENTRIES}
    for program, entries in programs.items():
        for entry in entries:
            if entry.where:
                found[f"{program}-{entry.name}"] = entry.load()
            found |= {f"{program}-{entry.name}-{one.name}": one.load() for one in entry.entries}
    found["das-node"] = single_command("das-node", das.node.command.advise, ())
    found["das-node-tls-init"] = single_command("das-node tls-init", das.node.command.tls_init, ())
    found["das-record"] = single_command("das-record", das.recorder.command.record, ())
    return found


def options(command: TyperCommand) -> str:
    """The arguments and options of a command as a Markdown table."""
    rows = []
    for parameter in sorted(command.params, key=lambda one: one.param_type_name):  # arguments before options
        text = str(getattr(parameter, "help", None) or "")
        names = [one for one in (*parameter.opts, *parameter.secondary_opts) if one not in EVERYWHERE]
        if parameter.param_type_name == "argument":
            rows.append((f"`{parameter.metavar or str(parameter.name).upper()}`", text))
        elif names:
            rows.append((", ".join(f"`{one}`" for one in names) + _value(parameter), text + _default(parameter)))
    return _table(("argument or option", "meaning"), "|---|---|", rows)


def _value(option: Any) -> str:
    """The value of an option on the command line: empty for a flag, the allowed words, or a placeholder."""
    kind = option.type_descriptor.annotation
    if option.is_flag:
        return ""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return " " + " | ".join(f"`{word.value}`" for word in kind)
    return f" {option.metavar or {int: 'N', float: 'X', Path: 'PATH'}.get(kind, 'TEXT')}"


def _default(option: Any) -> str:
    """The default, unless the help text states it; empty for flags and for options without a default."""
    default = getattr(option.default, "value", option.default)
    if option.required:
        return " Required."
    if option.is_flag or default is None or "[default:" in str(option.help):
        return ""
    return f" [default: {default:g}]" if isinstance(default, float) else f" [default: {default}]"


def program(name: str) -> str:
    """The commands of a program, each with a heading, the first line of its help, and its options."""
    parts = []
    for one, command in commands().items():
        if one.startswith(name):
            words = one.replace(f"{name}-", f"{name} ", 1)
            for group in ("journey", "route", "vehicle", "experiment"):
                words = words.replace(f" {group}-", f" {group} ")
            said = " ".join(str(command.help).split("\n\n")[0].split())
            parts.append(f"### {words}\n\n{said}\n\n{options(command)}")
    return "\n".join(parts)


def measures() -> str:
    """The measures of a trial."""
    rows = ((f"`{one.name}`", one.unit, one.formula, one.source) for one in MEASURES.values())
    return _table(("measure", "unit", "formula", "source"), "|---|---|---|---|", rows)


def factors() -> str:
    """The factors of an experiment, without the parameters of the driver."""
    some = [one for one in FACTORS.values() if not one.name.startswith(OF_HUMAN)]
    rows = ((f"`{one.name}`", one.meaning, one.expected) for one in some)
    return _table(("factor", "what it varies", "levels"), "|---|---|---|", rows)


def rows_of(name: str) -> list[list[str]]:
    """The rows of a CSV table."""
    with (TABLES / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def as_markdown(name: str) -> str:
    """A CSV table as Markdown."""
    head, *rows = rows_of(name)
    return _table(head, "|---" * len(head) + "|", rows)


def topics() -> str:
    """The topics of the bus."""
    rows = (
        (
            f"`{one.key('<train>')}`",
            f"`{one.message.DESCRIPTOR.full_name}`",
            one.publisher,
            "yes" if one.latched else "",
        )
        for one in TOPICS
    )
    return _table(("key", "message", "publisher", "kept for late subscribers"), "|---|---|---|---|", rows)


def causes() -> str:
    """The causes of a withdrawal, in the order in which they are decided."""
    said = _members(Cause)
    rows = ((str(int(one)), f"`{one.label}`", said[one.name]) for one in Cause)
    return _table(("number", "cause", "meaning"), "|---:|---|---|", rows)


def reasons() -> str:
    """The codes of reasons."""
    said = _members(ReasonCode)
    rows = ((str(int(one)), f"`{one.name}`", said[one.name]) for one in ReasonCode)
    return _table(("number", "code", "meaning"), "|---:|---|---|", rows)


def _members(kind: type[Enum]) -> dict[str, str]:
    """The docstring of each member of an enumeration."""
    names, body = list(kind.__members__), ast.parse(inspect.getsource(kind)).body[0].body  # type: ignore[attr-defined]
    said = [after.value.value for one, after in pairwise(body) if isinstance(one, ast.Assign)]
    return dict(zip(names, said, strict=True))


def parameters() -> str:
    """The parameters of a human driver."""
    rows = ((f"`{name}`", *others) for name, *others in parameter_table())
    return _table(("parameter", "default", "unit", "range", "meaning", "source"), "|---|---:|---|---|---|---|", rows)


def population(people: Population) -> str:
    """The parameters drawn by a population, and their correlations."""
    spreads = [
        (
            f"`{one.name}`", f"{one.shape}, {one.sd:g}",
            *(f"{one.at(NORMAL.inv_cdf(share)):.3g}" for share in (0.05, 0.5, 0.95)),
            HumanParameters.__dataclass_fields__[one.name].metadata["unit"], one.source,
        )
        for one in people.spreads
    ]  # fmt: skip
    pairs = [(f"`{one}`", f"`{other}`", f"{value:+g}", source) for one, other, value, source in people.correlations]
    head = ("parameter", "distribution", "5 %", "median", "95 %", "unit", "source")
    return (
        _table(head, "|---|---|---:|---:|---:|---|---|", spreads)
        + "\n"
        + _table(("parameter", "correlated with", "correlation", "source"), "|---|---|---:|---|", pairs)
    )


def _table(head: Iterable[str], aligned: str, rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; bars in cells are escaped."""
    cells = ((re.sub(r"(?<!\\)\|", r"\\|", " ".join(cell.split())) for cell in row) for row in (head, *rows))
    first, *others = (f"| {' | '.join(row)} |" for row in cells)
    return "".join(f"{line}\n" for line in (first, aligned, *others))


if __name__ == "__main__":
    tables = {name: program(name) for name in PROGRAMS}
    tables |= {"parameters": parameters(), "population": population(load_population(DEFAULT))}
    tables |= {"measures": measures(), "factors": factors()}
    tables |= {name: as_markdown(name) for name in ("plausibility", "safety-rules", "seam", "trips")}
    tables |= {"topics": topics(), "causes": causes(), "reasons": reasons()}
    for name, table in tables.items():
        Path(f"{name}.md").write_text(table, encoding="utf-8")

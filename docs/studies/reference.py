"""The tables of the reference pages that the code decides, written into the working folder when the site is built.

`python -m docs.studies.reference` writes the options of every command (das-sim-run.md and so on, for commands.md), the
parameters of a human driver (parameters.md, for drivers.md), and the default population (population.md).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import Any

from typer.core import TyperCommand
from typer.main import get_command

import das.node.command
import das.recorder.command
import precompute.cli.program
import sim.cli.program
from das.command_line.application import Entry, single_command
from sim.drivers.parameters import DEFAULT, NORMAL, HumanParameters, Population, load_population, parameter_table

EVERYWHERE = {"--help", "-h", "--version", "--install-completion", "--show-completion"}
"""Options that the top of commands.md explains for all commands."""


def commands() -> dict[str, TyperCommand]:
    """Every command by the words that start it, joined by hyphens: `das-sim-replay`."""
    found: dict[str, TyperCommand] = {}
    programs = {"das-precompute": precompute.cli.program.COMMANDS, "das-sim": sim.cli.program.ENTRIES}
    for program, entries in programs.items():
        for entry in entries:
            if isinstance(entry, Entry):
                found[f"{program}-{entry.name}"] = entry.load()
            found |= {f"{program}-{entry.name}-{one.name}": one.load() for one in entry.entries()}
    found["das-node"] = single_command("das-node", das.node.command.advise, ())
    (tls_init,) = get_command(das.node.command.tls_app).commands.values()  # type: ignore[attr-defined]
    found["das-node-tls-init"] = tls_init
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
    """What follows the option on the command line: nothing, one of several words, or a value."""
    kind = option.type_descriptor.annotation
    if option.is_flag:
        return ""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return " " + " | ".join(f"`{word.value}`" for word in kind)
    return f" {option.metavar or {int: 'N', float: 'X', Path: 'PATH'}.get(kind, 'TEXT')}"


def _default(option: Any) -> str:
    """The default, unless the help text names it; empty for flags and for options without a default."""
    default = getattr(option.default, "value", option.default)
    if option.required:
        return " Required."
    if option.is_flag or default is None or "[default:" in str(option.help):
        return ""
    return f" [default: {default:g}]" if isinstance(default, float) else f" [default: {default}]"


def parameters() -> str:
    """The parameters of a human driver."""
    rows = ((f"`{name}`", *others) for name, *others in parameter_table())
    return _table(("parameter", "default", "unit", "range", "meaning", "source"), "|---|---:|---|---|---|---|", rows)


def population(people: Population) -> str:
    """The parameters that a population draws, and their correlations."""
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
        + _table(("parameter", "goes with", "correlation", "source"), "|---|---|---:|---|", pairs)
    )


def _table(head: Iterable[str], aligned: str, rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; bars in its cells are escaped, because a bar would end the cell."""
    cells = ((re.sub(r"(?<!\\)\|", r"\\|", " ".join(cell.split())) for cell in row) for row in (head, *rows))
    first, *others = (f"| {' | '.join(row)} |" for row in cells)
    return "".join(f"{line}\n" for line in (first, aligned, *others))


if __name__ == "__main__":
    tables = {name: options(command) for name, command in commands().items()}
    tables |= {"parameters": parameters(), "population": population(load_population(DEFAULT))}
    for name, table in tables.items():
        Path(f"{name}.md").write_text(table, encoding="utf-8")

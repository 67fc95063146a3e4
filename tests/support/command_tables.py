"""The commands and options of the four programs, as tables for docs/reference/commands.md.

`python -m tests.support.command_tables` updates these tables in the page after an option has changed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

from typer.core import TyperCommand
from typer.main import get_command

import das.node.command
import das.recorder.command
import precompute.cli.program
import sim.cli.program
from das.command_line.application import Group, single_command

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "commands.md"
BLOCK = re.compile(r"(<!-- options of (?P<command>[a-z -]+): begin -->\n).*?(<!-- options: end -->)", re.DOTALL)
EVERYWHERE = {"--help", "-h", "--version", "--install-completion", "--show-completion"}
"""Options that the top of the page explains for all commands."""


def commands() -> dict[str, TyperCommand]:
    """Every command, keyed by the words that start it, e.g. `das-sim replay`."""
    found: dict[str, TyperCommand] = {}
    programs = (("das-precompute", precompute.cli.program.COMMANDS), ("das-sim", sim.cli.program.ENTRIES))
    for program, entries in programs:
        for entry in entries:
            if isinstance(entry, Group):
                found |= {f"{program} {entry.name} {one.name}": one.load() for one in entry.entries()}
            else:
                found[f"{program} {entry.name}"] = entry.load()
                found |= {f"{program} {entry.name} {one.name}": one.load() for one in entry.entries()}
    found["das-node"] = single_command("das-node", das.node.command.advise, ())
    (tls_init,) = get_command(das.node.command.tls_app).commands.values()  # type: ignore[attr-defined]
    assert isinstance(tls_init, TyperCommand)
    found["das-node tls-init"] = tls_init
    found["das-record"] = single_command("das-record", das.recorder.command.record, ())
    return found


def table(command: TyperCommand) -> str:
    """The arguments and options of a command as a Markdown table."""
    rows = [f"| {_cell(names)} | {_cell(text)} |" for names, text in _rows(command)]
    return "\n".join(["| argument or option | meaning |", "|---|---|", *rows])


def _rows(command: TyperCommand) -> Iterator[tuple[str, str]]:
    for parameter in sorted(command.params, key=lambda one: one.param_type_name):  # arguments before options
        text = str(getattr(parameter, "help", None) or "")
        if parameter.param_type_name == "argument":
            yield f"`{parameter.metavar or str(parameter.name).upper()}`", text
            continue
        names = [one for one in (*parameter.opts, *parameter.secondary_opts) if one not in EVERYWHERE]
        if names:
            yield ", ".join(f"`{one}`" for one in names) + _value(parameter), text + _default(parameter)


def _value(option: Any) -> str:
    """What follows the option on the command line: nothing, one of several words, or a value."""
    kind = option.type_descriptor.annotation
    if option.is_flag:
        return ""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return " " + " \\| ".join(f"`{word.value}`" for word in kind)
    return f" {option.metavar or {int: 'N', float: 'X', Path: 'PATH'}.get(kind, 'TEXT')}"


def _default(option: Any) -> str:
    """The default, unless the help text names it; empty for flags and for options without a default."""
    default = getattr(option.default, "value", option.default)
    if option.required:
        return " Required."
    if option.is_flag or default is None or "[default:" in str(option.help):
        return ""
    return f" [default: {default:g}]" if isinstance(default, float) else f" [default: {default}]"


def _cell(text: str) -> str:
    """Text for a cell of a Markdown table, with bars escaped, because a bar would end the cell."""
    return re.sub(r"(?<!\\)\|", r"\\|", " ".join(text.split()))


def with_tables(page: str, all_commands: Mapping[str, TyperCommand]) -> str:
    """The page with every command's table up to date; ValueError if it names a command that does not exist."""

    def written(block: re.Match[str]) -> str:
        name = block["command"]
        if name not in all_commands:
            raise ValueError(f"{PAGE.name}: options of {name}: there is no such command")
        return f"{block[1]}{table(all_commands[name])}\n{block[3]}"

    return BLOCK.sub(written, page)


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), commands()), encoding="utf-8")

"""Programs with uniform command lines and a fast start: a command's module is imported when the command is called.

A command takes frozen dataclasses, called groups; the fields of a group are options of the command, declared once: the
`Annotated` type of a field holds type, spelling and help. Groups may hold groups.
"""

from __future__ import annotations

import errno
import importlib
import inspect
import io
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, is_dataclass
from inspect import Parameter, Signature
from types import MappingProxyType
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from das import __version__
from das.command_line.printing import one_line
from das.command_line.process import EXIT_INTERRUPTED, STOP_SIGNALS, ended_by_signals, interrupted_by_termination
from das.domain.errors import DasError, now_called

_given: ContextVar[Mapping[str, str]] = ContextVar("given", default=MappingProxyType({}))
"""The options that the user typed for the running command: each spelling of an option, with its words."""


def is_given(option: str) -> bool:
    """Whether the user typed an option of the running command, even with its default value."""
    return option in _given.get()


def refuse_given(why: str, *options: str) -> None:
    """Raise DasError for the first of some options that the user typed; `why` states what that option needs.

    Nothing is refused if a function is called without a command line.
    """
    for option in options:
        if is_given(option):
            raise DasError(f"{_given.get()[option]}: {why}")


def _typed(context: typer.Context) -> dict[str, str]:
    """The options that the user typed for the command of a context, with their words."""
    found: dict[str, str] = {}
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is not None and source.name == "COMMANDLINE":
            value = context.params.get(parameter.name or "")
            found |= {option: _words(option, parameter.secondary_opts, value) for option in parameter.opts}
    return found


def _words(option: str, opposites: list[str], value: Any) -> str:
    """An option as it was typed, with its value; a flag that was turned off has its negative form."""
    if isinstance(value, bool) or value is None:
        return opposites[0] if value is False and opposites else option
    return f"{option} {' '.join(map(str, value)) if isinstance(value, list | tuple) else value}"


EXIT_BAD_INPUT = 2
HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}


def imported(where: str) -> Callable[..., Any]:
    """The function "module:name"; the module is imported now, and Ctrl-C meanwhile ends the process in one line."""
    module, _, name = where.partition(":")
    with ended_by_signals():
        function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One command of a program, or the word under which commands belong together: `das-sim experiment run`.

    `name`: the word the user types. `summary`: its line in the program's help, and the first line of the docstring of
    its function. `where`: module and function, like "precompute.cli.solve:solve", imported only when the command is
    called; empty for a word that only has `entries`, the commands that begin with it. `examples`: command lines that a
    user can copy. `gone`: see `application`.
    """

    name: str
    summary: str
    where: str = ""
    examples: tuple[str, ...] = ()
    entries: tuple[Entry, ...] = ()
    gone: Mapping[str, str] = field(default_factory=dict)

    def load(self) -> TyperCommand | TyperGroup:
        """The command with its options and its help, or the group of the entries, none of which is imported yet."""
        if self.where:
            return _command(self.name, imported(self.where), self.examples, [one.name for one in self.entries])
        app = _typer(no_args_is_help=True, add_completion=False)
        app.callback(help=self.summary, epilog="-h after a command explains it.")(lambda: None)
        return _filled(app, self.name, self.entries, self.gone)


class _Program(TyperGroup):
    """A program of several commands, with its former commands and options (see `application`)."""

    gone: Mapping[str, str] = MappingProxyType({})


def _filled(app: typer.Typer, name: str, entries: Sequence[Entry], gone: Mapping[str, str]) -> TyperGroup:
    """The group of an application, with its name, its commands, and the former ones as errors."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    group.name = name
    for entry in entries:
        group.add_command(_LazyCommand(entry) if entry.where else entry.load())
    for word, instead in gone.items():
        if not word.startswith("-"):
            group.add_command(_GoneCommand(word, instead))
    return group


def application(
    name: str,
    about: str,
    entries: Sequence[Entry],
    *,
    gone: Mapping[str, str] = MappingProxyType({}),
    without_command: Callable[[], None] | None = None,
) -> TyperGroup:
    """A program of several commands; `without_command` is called when none is given (default: print the help).

    `gone`: former commands, which are refused, each with what to run instead, and former options of its commands
    (`--bucket`), each with what to do instead. The help does not list them.
    """
    bare = without_command is not None
    app = _typer(cls=_Program, no_args_is_help=not bare, invoke_without_command=bare)

    @app.callback(help=about, epilog=f"{name} COMMAND -h explains a command.")
    def nothing_yet(context: typer.Context) -> None:
        if context.invoked_subcommand is None and without_command is not None:
            without_command()

    group = _filled(app, name, entries, gone)
    assert isinstance(group, _Program)
    group.gone = gone
    group.params.append(_version_parameter())
    return group


def single_command(name: str, function: Callable[..., Any], examples: Sequence[str]) -> TyperCommand:
    """A program that is one command: the function's parameters are its options, its docstring is its help."""
    command = _command(name, function, examples, add_completion=True)
    command.params.append(_version_parameter())
    return command


class _Command(TyperCommand):
    """A command whose function can refuse an option without effect (`refuse_given`)."""

    def invoke(self, ctx: Any) -> Any:
        """Call the function; the typed options are known during the call."""
        before = _given.set(_typed(ctx))
        try:
            return super().invoke(ctx)
        finally:
            _given.reset(before)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse what the user typed; DasError for an option or a word that has been renamed."""
        try:
            return super().parse_args(ctx, args)
        except TyperException as error:
            words = re.findall(r"[\w-]+", error.format_message())
            for word in words if "No such option" in error.format_message() else ():
                program = ctx.find_root().command
                if isinstance(program, _Program) and (instead := program.gone.get(word)):
                    raise DasError(f"{word} is no longer an option of this command: {instead}") from None
            known = {*words, *(option for parameter in self.params for option in parameter.opts)}
            for word in words:
                if new := now_called(word, known):
                    raise DasError(f"{word} is now called {new}") from None
            raise


class _LazyCommand(TyperCommand):
    """Stand-in for a command in lists and completions; the command itself is loaded when it is called."""

    def __init__(self, entry: Entry) -> None:
        super().__init__(name=entry.name, help=entry.summary, short_help=entry.summary, rich_markup_mode=None)
        self.entry = entry

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """The context of the real command, or of the one below it that the first argument names; imported here."""
        for entry in self.entry.entries if args else ():
            if args[0] == entry.name:
                return entry.load().make_context(f"{info_name} {entry.name}", args[1:], parent=parent, **extra)
        if args and args[0] in self.entry.gone:
            return _GoneCommand(args[0], self.entry.gone[args[0]]).make_context(f"{info_name} {args[0]}", args[1:])
        return self.entry.load().make_context(info_name, args, parent=parent, **extra)


class _GoneCommand(TyperCommand):
    """Stand-in for a former command; its error states what to run instead, whatever arguments follow."""

    def __init__(self, name: str, instead: str) -> None:
        super().__init__(name=name, hidden=True, rich_markup_mode=None)
        self.instead = instead

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Raise DasError."""
        raise DasError(f"{info_name} is no longer a command of this program; run instead: {self.instead}")


def _typer(**settings: Any) -> typer.Typer:
    return typer.Typer(
        **{"add_completion": True, **settings},
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings=dict(HELP_OPTIONS),
    )


def _command(
    name: str,
    function: Callable[..., Any],
    examples: Sequence[str],
    others: Sequence[str] = (),
    *,
    add_completion: bool = False,
) -> TyperCommand:
    app = _typer(add_completion=add_completion)
    more = f"\n\nMore commands: {name} {' | '.join(others)} (-h explains each)." if others else ""
    # The first character keeps typer from joining the lines.
    epilog = "\b\n" + "\n".join(["Example:" if len(examples) == 1 else "Examples:", *examples]) + more
    app.command(name, cls=_Command, epilog=epilog, context_settings=dict(HELP_OPTIONS))(with_options(function))
    command = get_command(app)
    assert isinstance(command, TyperCommand)
    return command


def _version_parameter() -> Any:
    app = _typer(add_completion=False)
    app.command()(_only_version)
    parameter = get_command(app).params[0]
    parameter.expose_value = False  # no function has to take it
    return parameter


def _print_version(context: typer.Context, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        print(f"{context.find_root().info_name} {__version__}")
        raise typer.Exit


def _only_version(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Declare the option `--version`, which every program has."""


def with_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a parameter for each field of its groups, as typer reads them.

    Two options with the same name are a programming error and raise TypeError.
    """
    parameters = list(_options(function))
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise TypeError(f"{function.__name__}: two of these options have the same name: {', '.join(names)}")

    def flat(**given: Any) -> Any:
        return _called(function, given)

    flat.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    flat.__name__, flat.__doc__, flat.__module__ = function.__name__, function.__doc__, function.__module__
    return flat


def _options(taker: Callable[..., Any]) -> Iterator[Parameter]:
    """The options that a function or a group takes, with those of the groups in it."""
    hints = get_type_hints(taker, include_extras=True)
    for one in inspect.signature(taker).parameters.values():
        if is_dataclass(hints[one.name]):
            yield from _options(hints[one.name])
        else:
            yield one.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[one.name])


def _called(taker: Callable[..., Any], given: Mapping[str, Any]) -> Any:
    """The result of a function, or the group, made from the options that were given."""
    hints = get_type_hints(taker, include_extras=True)
    return taker(
        **{
            name: _called(hints[name], given) if is_dataclass(hints[name]) else given[name]
            for name in inspect.signature(taker).parameters
        }
    )


def run_app(app: TyperGroup | TyperCommand, name: str) -> None:
    """Run a program; see `run_command`. A mistyped option ends in one line as well.

    `name` is the word with which the user starts the program; its own help uses it.
    """
    run_command(lambda: app(standalone_mode=False, prog_name=name))


def run_command(main: Callable[[], object]) -> None:
    """Run a command's main function; user errors become one line and exit code 2.

    Ctrl-C, SIGTERM and SIGHUP end it with 130.
    """
    _replace_unprintable_letters()
    try:
        with interrupted_by_termination():
            code = main()
        if code == EXIT_INTERRUPTED:  # typer turns Ctrl-C into this code
            raise KeyboardInterrupt
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except TyperException as error:
        message = error.format_message()
        print(message if message.startswith("Usage:") else f"error: {one_line(message)}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except DasError as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        for number in STOP_SIGNALS:  # a second request changes nothing
            signal.signal(number, signal.SIG_IGN)
        print("stopped", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone (`… | head`).
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EIO) or error.filename is not None:
            raise
        print(f"error: the output cannot be written ({error.strerror})", file=sys.stderr)
        os._exit(EXIT_BAD_INPUT)  # Python would try to write the rest again and print another error


def _replace_unprintable_letters() -> None:
    """Print a question mark for each character (–, λ, ü) that the terminal's encoding lacks, rather than fail.

    If a stream is closed (`>&-`), what would be printed is dropped.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, io.StringIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")

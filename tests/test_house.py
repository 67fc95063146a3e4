"""The limits of the house: how large a package, how long a function and its parameters may get; words of docstrings.

The modules are read as text and parsed, nothing is imported, so that the test costs a second.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.crossing import crossed, numbered

ROOT = Path(__file__).parents[1]
PACKAGES = ("das", "precompute", "sim", "docs/studies")
LONGEST_FUNCTION, MOST_PARAMETERS = 50, 6
GENERATED = {"das/bus/das_pb2.py"}


class Budget(NamedTuple):
    """The most lines and modules that a package may have."""

    lines: int
    modules: int


BUDGETS = {
    "das": Budget(26_680, 139),
    "precompute": Budget(10_521, 47),
    "sim": Budget(35_591, 150),
    "docs/studies": Budget(6_204, 37),
}
"""What each package may come to: what it is now, rounded up. A commit that takes away lowers it."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


def modules() -> list[Path]:
    """Every module that people wrote, of the packages and of the studies behind the documents."""
    found = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return [path for path in found if path.relative_to(ROOT).as_posix() not in GENERATED]


def is_kernel(node: Function) -> bool:
    """Whether numba compiles the function."""
    names = {_name(decorator) for decorator in node.decorator_list}
    return bool(names & {"njit", "kernel", "compiled", "jit", "vectorize"})


def _name(node: ast.expr) -> str:
    """The last name of a decorator or of what is called as one: `command` of `app.command("run")`; else empty."""
    called = node.func if isinstance(node, ast.Call) else node
    return called.id if isinstance(called, ast.Name) else called.attr if isinstance(called, ast.Attribute) else ""


def functions(tree: ast.Module) -> Iterator[tuple[str, Function, bool]]:
    """Every function with its qualified name, and whether it is public: not private, and in nothing private."""

    def walk(node: ast.AST, prefix: str, public: bool) -> Iterator[tuple[str, Function, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, Function):
                named = public and (not child.name.startswith("_") or child.name == "__init__")
                yield f"{prefix}{child.name}", child, named
                yield from walk(child, f"{prefix}{child.name}.", False)
            elif isinstance(child, ast.ClassDef):
                yield from walk(child, f"{prefix}{child.name}.", public and not child.name.startswith("_"))
            else:
                yield from walk(child, prefix, public)

    yield from walk(tree, "", True)


def parameters(node: Function) -> list[str]:
    """The names of a function's parameters, without self and cls."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    names = [one.arg for one in given]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def is_command(node: Function, registered: set[str]) -> bool:
    """Whether typer calls the function: its parameters are the options that users give."""
    decorated = any(_name(one) in ("command", "callback") for one in node.decorator_list)
    return decorated or node.name in registered


def registered_commands(trees: dict[str, ast.Module]) -> set[str]:
    """Names of functions handed to typer.

    That is `app.command(...)(name)`, `Entry(where="module:name")` of a program's list of commands, and
    `single_command("program", name, ...)`.
    """
    found: set[str] = set()
    for node in (node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if isinstance(node.func, ast.Call) and _name(node.func) in ("command", "callback"):
            found |= {_name(one) for one in node.args}
        elif _name(node) == "Entry":
            where = [one.value for one in node.keywords if one.arg == "where"]
            found |= {str(one.value).partition(":")[2] for one in where if isinstance(one, ast.Constant)}
        elif _name(node) == "single_command" and len(node.args) > 1:
            found.add(_name(node.args[1]))
    return found


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """The parsed modules by their path from the root."""
    return {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8")) for path in modules()}


def classes(trees: dict[str, ast.Module]) -> Iterator[tuple[str, ast.ClassDef]]:
    """Every class with the path of its module."""
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                yield path, node


def report(found: list[str]) -> str:
    """One line for each breach, under each other."""
    return "\n" + "\n".join(found)


@pytest.mark.parametrize("package", BUDGETS)
def test_a_package_keeps_its_budget(package: str) -> None:
    """A package grows by nothing but a new budget: what is added somewhere is taken away elsewhere."""
    found = [path for path in modules() if path.relative_to(ROOT).as_posix().startswith(f"{package}/")]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in found)
    print(f"{package}: {lines} of {BUDGETS[package].lines} lines, {len(found)} of {BUDGETS[package].modules} modules")
    assert lines <= BUDGETS[package].lines
    assert len(found) <= BUDGETS[package].modules


def test_functions_are_short_and_public_ones_take_few_parameters(trees: dict[str, ast.Module]) -> None:
    registered, found = registered_commands(trees), []
    for path, tree in trees.items():
        for name, node, public in functions(tree):
            length, names = (node.end_lineno or 0) - node.lineno + 1, parameters(node)
            if is_kernel(node):
                continue
            if length > LONGEST_FUNCTION:
                found.append(f"{path}:{node.lineno} {name}: {length} lines")
            if public and not is_command(node, registered) and len(names) > MOST_PARAMETERS:
                found.append(f"{path}:{node.lineno} {name}: {len(names)} parameters")
    assert not found, report(found)


def test_no_two_public_classes_have_one_name(trees: dict[str, ast.Module]) -> None:
    places: dict[str, list[str]] = {}
    for path, node in classes(trees):
        if not node.name.startswith("_"):
            places.setdefault(node.name, []).append(f"{path}:{node.lineno}")
    found = [f"{name}: {', '.join(where)}" for name, where in places.items() if len(where) > 1]
    assert not found, report(found)


def test_locals_are_not_passed_on(trees: dict[str, ast.Module]) -> None:
    found = [
        f"{path}:{node.lineno}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "locals"
    ]
    assert not found, report(found)


def test_what_is_crossed_is_whole_and_has_every_pair_of_values_in_the_default_run() -> None:
    lists = (range(3), range(9), range(2), range(2))
    assert [one.values for one in crossed(*lists)] == list(product(*lists))
    kept = [one.values for one in crossed(*lists) if not one.marks]
    assert len(kept) == 27
    for i, j in combinations(range(len(lists)), 2):
        assert {(one[i], one[j]) for one in kept} == set(product(lists[i], lists[j]))
    of_two = [one.values for one in crossed(range(16), range(4)) if not one.marks]
    assert len(of_two) == 16
    assert {one[1] for one in of_two} == set(range(4))


def test_numbered_cases_are_all_there_a_quarter_of_them_in_the_default_run(monkeypatch: pytest.MonkeyPatch) -> None:
    first, rest = numbered("DAS_NO_SUCH", 10, first=3)
    assert (first.values, first.marks, rest.values) == ((range(3, 6),), (), (range(6, 13),))
    assert [mark.name for mark in rest.marks] == ["nightly"]
    monkeypatch.setenv("DAS_NO_SUCH", "5")
    assert [one.values for one in numbered("DAS_NO_SUCH", 10)] == [(range(5),)]


NOUN_FIRST = re.compile(
    r"\b(this|these)\b|^(as|but|by|from|how|it|so|such|they|what|when|where|which|who)\b", re.IGNORECASE
)
"""Words for the documented thing itself, and first words that are no noun."""
TRANSLATED = re.compile(r"\b(advices|an advice|hangs? on|(?<!driven )anew)\b(?!`)", re.IGNORECASE)
"""Words that are right in another language: advice is no count noun; say again, and depends on."""


def docstrings(tree: ast.Module) -> Iterator[tuple[ast.Constant, bool]]:
    """Every docstring, and whether it documents a constant or a field."""
    for body in (body for node in ast.walk(tree) if isinstance(body := getattr(node, "body", None), list)):
        for before, node in zip([None, *body], body, strict=False):
            if (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                yield node.value, isinstance(before, ast.Assign | ast.AnnAssign)


def stumbles(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """The lines of docstrings that do not read well, each with the word at which a reader stumbles."""
    for node, of_a_constant in docstrings(tree):
        text = str(node.value)
        for found in (NOUN_FIRST.search(text) if of_a_constant else None, TRANSLATED.search(text)):
            if found is not None:
                yield node.lineno, found[0]


def test_docstrings_begin_with_the_noun_and_speak_english(trees: dict[str, ast.Module]) -> None:
    found = [f"{path}:{line}: {word}" for path, tree in trees.items() for line, word in stumbles(tree)]
    assert not found, report(found)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ('X = 1\n"""Largest speed."""\ndef f(): """How fast this train is, driven anew."""', []),
        ('X = 1\n"""No train is faster than this."""', ["this"]),
        ('class A:\n    x: int = 1\n    """What a job left."""', ["What"]),
        ('"""Two advices hang on it."""\nX = 1\n"""Speed, computed anew."""', ["advices", "anew"]),
    ],
)
def test_a_docstring_with_such_a_word_is_found(source: str, words: list[str]) -> None:
    assert [word for _, word in stumbles(ast.parse(source))] == words

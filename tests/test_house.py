"""The limits of the house: how long a module, a function, a class and a list of parameters may get.

The modules are read as text and parsed, nothing is imported, so that the test costs a second.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import combinations, product
from pathlib import Path

import pytest

from tests.support.crossing import crossed, numbered

ROOT = Path(__file__).parents[1]
PACKAGES = ("das", "precompute", "sim", "docs/studies")
LONGEST_MODULE, LONGEST_FUNCTION = 450, 50
MOST_METHODS, MOST_ATTRIBUTES, MOST_PARAMETERS = 20, 12, 6
GENERATED = {"das/bus/das_pb2.py"}
Function = ast.FunctionDef | ast.AsyncFunctionDef

MIRRORS: dict[str, str] = {
    "das/advice/advice.py:Advice": "the fields of the message Advice",
    "das/domain/route.py:Route": "the lists of a route file, one field each",
    "das/domain/vehicle.py:Vehicle": "the keys of a vehicle file, one field each",
    "das/estimate/track_filter.py:Track": "a mean of five and the upper half of its covariance",
    "das/solver/kernels/tuples.py:TrainParams": "an argument of the kernels: one figure of the vehicle's file each",
    "sim/drivers/cab.py:AdviceView": "what any presentation may show",
    "sim/drivers/cab.py:CabView": "what a driver may see: the fields of the message Cab without the advice",
    "sim/drivers/parameters.py:HumanParameters": "the keys of the table [human] of a scenario, one field each",
    "sim/plant/kernels.py:PlantState": "the fields of the message Truth, and an argument of the kernels",
    "sim/plant/kernels.py:TrainNumbers": "an argument of the kernels: one figure of the vehicle's file each",
    "sim/trips/record.py:Record": "the columns of a recorded trip",
    "sim/world/scenario.py:Scenario": "the keys of a scenario file",
}
"""Classes that may have more attributes than a reader holds in mind, each with the reason."""


def modules() -> list[Path]:
    """Every module that people wrote, of the packages and of the studies behind the documents."""
    found = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return [path for path in found if path.relative_to(ROOT).as_posix() not in GENERATED]


def is_kernel(node: Function) -> bool:
    """Whether numba compiles the function."""
    names = {_name(decorator).split(".")[-1] for decorator in node.decorator_list}
    return bool(names & {"njit", "kernel", "compiled", "jit", "vectorize"})


def _name(node: ast.expr) -> str:
    """The dotted name of a decorator or of what is called as one."""
    return ast.unparse(node.func if isinstance(node, ast.Call) else node)


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
    decorated = any(_name(one).split(".")[-1] in ("command", "callback") for one in node.decorator_list)
    return decorated or node.name in registered


def registered_commands(trees: dict[str, ast.Module]) -> set[str]:
    """Names of functions handed to typer.

    That is `app.command(...)(name)`, `Entry(where="module:name")` of a program's list of commands, and
    `single_command("program", name, ...)`.
    """
    found: set[str] = set()
    for node in (node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if isinstance(node.func, ast.Call) and _name(node.func).split(".")[-1] in ("command", "callback"):
            found |= {ast.unparse(one).split(".")[-1] for one in node.args}
        elif _name(node) == "Entry":
            where = [one.value for one in node.keywords if one.arg == "where"]
            found |= {str(one.value).partition(":")[2] for one in where if isinstance(one, ast.Constant)}
        elif _name(node) == "single_command" and len(node.args) > 1:
            found.add(ast.unparse(node.args[1]).split(".")[-1])
    return found


def class_attributes(node: ast.ClassDef) -> set[str]:
    """Fields of instances: annotated in the class body, or set on self in a method.

    Members of an enumeration and constants of the class are none.
    """
    fields = (one for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name))
    found = {ast.unparse(one.target) for one in fields if "ClassVar" not in ast.unparse(one.annotation)}
    stored = (
        one.attr
        for one in ast.walk(node)
        if isinstance(one, ast.Attribute) and isinstance(one.ctx, ast.Store)
        if isinstance(one.value, ast.Name) and one.value.id == "self"
    )
    return found | set(stored)


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


def test_modules_are_short() -> None:
    lengths = {path.relative_to(ROOT): len(path.read_text(encoding="utf-8").splitlines()) for path in modules()}
    found = [f"{path}: {lines} lines" for path, lines in lengths.items() if lines > LONGEST_MODULE]
    assert not found, report(found)


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


def test_classes_have_few_methods_and_attributes(trees: dict[str, ast.Module]) -> None:
    found = []
    for path, node in classes(trees):
        methods, attributes = sum(isinstance(one, Function) for one in node.body), len(class_attributes(node))
        if methods > MOST_METHODS:
            found.append(f"{path}:{node.lineno} {node.name}: {methods} methods")
        if attributes > MOST_ATTRIBUTES and f"{path}:{node.name}" not in MIRRORS:
            found.append(f"{path}:{node.lineno} {node.name}: {attributes} attributes")
    assert not found, report(found)


def test_exceptions_are_needed(trees: dict[str, ast.Module]) -> None:
    large = {f"{path}:{node.name}" for path, node in classes(trees) if len(class_attributes(node)) > MOST_ATTRIBUTES}
    assert not set(MIRRORS) - large


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

"""Small changes of the product that the nearest tests do not notice: `<` becomes `>=`, `+` becomes `-`, 2.0 becomes 20.

`uv run python .ci/mutants.py --count 40 --seed 7` draws 40 of them from the whole product, in a clone that may be
spoiled. Those that no test notices are listed: each is a test that is missing, or a change that changes nothing.
`--under das/solver/guide das/advice/guide` draws from these files and folders alone.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import grimp

PACKAGES = ("das", "sim", "precompute")
KERNELS = 1 / 8  # the share of the mutants: most of the arithmetic is in kernels, and each mutant is compiled
TIERS = {"default": (60, "not slow and not nightly"), "slow": (30, "slow and not nightly")}  # CPU s of tests, marks
OTHER: dict[Any, Any] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


def changed(node: Any) -> bool:
    """Change a node in place, where there is something to change."""
    if isinstance(node, ast.Compare) and (other := OTHER.get(type(node.ops[0]))):
        node.ops[0] = other()
    elif isinstance(node, ast.BinOp | ast.BoolOp) and (other := OTHER.get(type(node.op))):
        node.op = other()
    elif isinstance(node, ast.Constant) and type(node.value) is float and node.value:
        node.value *= 10.0
    else:
        return False
    return True


def nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a syntax tree, without what is for programmers alone: `__repr__` and annotations."""
    for child in ast.iter_child_nodes(tree):
        if getattr(child, "name", "") != "__repr__" and child is not getattr(tree, "annotation", None):
            yield child
            yield from nodes(child)


def drawn(count: int, seed: int, under: list[str]) -> Iterator[tuple[Path, str, str]]:
    """Mutants drawn at random: the file, its new text, and what was changed in words."""
    paths = sorted(one for package in PACKAGES for one in Path(package).rglob("*.py") if "_pb2" not in one.name)
    paths = [one for one in paths if not under or any(one.is_relative_to(place) for place in under)]
    texts = {path: path.read_bytes() for path in paths}
    spots = [(path, at) for path in paths for at, node in enumerate(nodes(ast.parse(texts[path]))) if changed(node)]
    random.Random(seed).shuffle(spots)
    kernels = round((sum("kernels" in str(path) for path, _ in spots) / len(spots) if under else KERNELS) * count)
    wanted = {True: kernels, False: count - kernels}
    for path, at in (spot for spot in spots if wanted["kernels" in str(spot[0])]):
        tree = ast.parse(text := texts[path])
        node: Any = list(nodes(tree))[at]
        old, _ = ast.get_source_segment(text.decode(), node) or "", changed(node)
        new = f"({ast.unparse(node)})"
        begin = len(b"".join(text.splitlines(keepends=True)[: node.lineno - 1])) + node.col_offset
        whole = text[:begin] + new.encode() + text[begin + len(old.encode()) :]
        with suppress(SyntaxError):  # Python 3.11 does not know the places of all that is in f-strings
            if ast.unparse(ast.parse(whole)) == ast.unparse(tree):
                wanted["kernels" in str(path)] -= 1
                yield path, whole.decode(), f"{path}:{node.lineno}: {' '.join(old.split())}  →  {new}"


def nearest(path: Path, tier: str, graph: grimp.ImportGraph) -> list[str]:
    """The test files nearest to a module: those named alike, then by imports in between and by seconds."""
    module = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    away = {str(one): 2 for one in Path("tests", path.parent).glob("test_*.py")}
    for one in graph.find_downstream_modules(module):
        if ".test_" in one:
            away[f"{one.replace('.', '/')}.py"] = len(graph.find_shortest_chain(one, module) or ())
    known_s = {name: int(s) for s, name in map(str.split, Path("tests/data/file_seconds.txt").read_text().splitlines())}
    seconds = {file: known_s.get(f"{tier}:{file}", 1) for file in away}
    chosen, left_s = list[str](), TIERS[tier][0]
    for file in sorted(away, key=lambda one: (path.stem not in Path(one).stem, away[one], seconds[one], one)):
        if seconds[file] <= left_s:
            chosen, left_s = [*chosen, file], left_s - seconds[file]
    return chosen


def noticed(path: Path, text: str, graph: grimp.ImportGraph) -> bool:
    """Whether a test fails, or does not end, with this text in the file."""
    whole, times = path.read_text(encoding="utf-8"), path.stat()
    path.write_text(text, encoding="utf-8")
    try:
        for tier, (_, marks) in TIERS.items():
            command = ["pytest", "-x", "-q", "-n", "0", "-p", "no:randomly", "-m", marks, *nearest(path, tier, graph)]
            if subprocess.run(command, capture_output=True, timeout=900, check=False).returncode not in {0, 5}:
                return True  # 5: none of these tests is of this tier
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_text(whole, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # numba compiles a newer file anew


def main() -> None:
    """Draw mutants, try them, and print those that nobody noticed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--under", nargs="+", default=[])
    asked = parser.parse_args()
    graph = grimp.build_graph(*PACKAGES, "tests", cache_dir=None)
    mutants = list(drawn(asked.count, asked.seed, asked.under))
    if noticed(path := mutants[0][0], path.read_text(encoding="utf-8"), graph):
        raise SystemExit(f"the tests nearest to {path} fail without a mutant")
    missed = 0
    for path, text, said in mutants:
        if not noticed(path, text, graph):
            missed += 1
            print(said, flush=True)
    print(f"{asked.count - missed} of {asked.count} mutants noticed")


if __name__ == "__main__":
    main()

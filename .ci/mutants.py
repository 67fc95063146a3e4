"""Small changes of the source that the nearest tests do not notice: `<` becomes `>=`, `+` becomes `-`, 2.0 becomes 20.

`uv run python .ci/mutants.py --count 40 --seed 7` draws 40 of them from the advice and the cab, in a clone that may be
spoiled. Those that no test notices are listed: each is a test that is missing, or a change that changes nothing.
"""

from __future__ import annotations

import argparse
import ast
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

FOLDERS = ("das/advice", "das/cab")
TIMEOUT_S = 600
OTHER = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


def changed(node: ast.AST) -> bool:
    """Change a node in place, where there is something to change."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        node.ops[0] = OTHER[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in OTHER:
        node.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.Constant) and type(node.value) is float and node.value:
        node.value *= 10.0
    else:
        return False
    return True


def mutants() -> Iterator[tuple[Path, str, str]]:
    """Every mutant: its file, the text of the file, and what was changed in words."""
    for path in sorted(one for folder in FOLDERS for one in Path(folder).rglob("*.py") if "kernels" not in one.name):
        text = path.read_text(encoding="utf-8")
        starts = [0]
        for line in text.splitlines(keepends=True):
            starts.append(starts[-1] + len(line.encode()))
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.expr) or (old := ast.get_source_segment(text, node)) is None:
                continue
            if changed(node):
                begin = starts[node.lineno - 1] + node.col_offset
                new = f"({ast.unparse(node)})"
                raw = text.encode()
                mutant = raw[:begin] + new.encode() + raw[begin + len(old.encode()) :]
                yield path, mutant.decode(), f"{path}:{node.lineno}: {' '.join(old.split())}  →  {new}"


def pass_with(path: Path, text: str) -> bool:
    """Whether the tests of the folders pass, in time, with this text in the file."""
    whole = path.read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    try:
        tests = [f"tests/{folder}" for folder in FOLDERS]
        done = subprocess.run(["pytest", "-x", *tests], capture_output=True, timeout=TIMEOUT_S, check=False)
        return done.returncode == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        path.write_text(whole, encoding="utf-8")


def main() -> None:
    """Draw mutants, try them, and print those that nobody noticed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    drawn = random.Random(asked.seed).sample(list(mutants()), asked.count)
    path = drawn[0][0]
    if not pass_with(path, path.read_text(encoding="utf-8")):
        sys.exit("the tests fail without a mutant")
    missed = [said for path, text, said in drawn if pass_with(path, text)]
    print("\n".join(missed))
    print(f"{len(drawn) - len(missed)} of {len(drawn)} mutants noticed")


if __name__ == "__main__":
    main()

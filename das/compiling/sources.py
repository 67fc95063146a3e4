"""The source text of our own modules, and hashes of it.

A compiled kernel depends on the text of every module that it imports, and a table on disk depends on the code that
solved it. Both are keyed by the hashes made here.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import re
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path

from das.domain.errors import DasError

OUR_PACKAGES = frozenset({"das", "precompute", "sim"})
_FROM = re.compile(rb"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n#]*)", re.MULTILINE)
_IMPORT = re.compile(rb"^[ \t]*import[ \t]+([^\n#]*)", re.MULTILINE)
_WITHOUT_MEANING = frozenset({"ctx", "kind", "type_comment", "type_ignores", "type_params"})
"""Fields of a syntax tree that say nothing more, or that only some versions of Python have."""


class SourcesMissingError(DasError):
    """The source file of a module is not installed, so nobody can tell which code this is."""


def sources_of(modules: Collection[str], *, packages: Collection[str] = OUR_PACKAGES) -> dict[str, bytes]:
    """The source text of modules and of all modules of `packages` that they import, directly or not, by name.

    Imports inside functions count as well. A package counts where something is imported from it by name. Raises
    SourcesMissingError where a source file is not installed.
    """
    found: dict[str, bytes] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found[name], imported = _read(name)
        waiting += [module for module in imported if module.partition(".")[0] in packages]
    return dict(sorted(found.items()))


def text_sha256(sources: Mapping[str, bytes]) -> str:
    """SHA-256 of names and texts; every byte counts."""
    digest = hashlib.sha256()
    for name, text in sources.items():
        digest.update(f"{name} {len(text)}\n".encode())
        digest.update(text)
    return digest.hexdigest()


def code_sha256(sources: Mapping[str, bytes]) -> str:
    """SHA-256 of what the texts do: comments, docstrings and formatting do not count. It takes some 0.1 s.

    It is the same under every version of Python that reads the texts.
    """
    digest = hashlib.sha256()
    for name, text in sources.items():
        digest.update(f"module {name}\0".encode())
        digest.update("\0".join(_tokens(ast.parse(text))).encode())
    return digest.hexdigest()


def _tokens(tree: ast.AST) -> Iterator[str]:
    """A syntax tree as words, node by node; bare texts (docstrings) are left out."""
    waiting: list[object] = [tree]
    while waiting:
        thing = waiting.pop()
        if isinstance(thing, ast.AST):
            yield type(thing).__name__
            for field in thing._fields:
                value = getattr(thing, field, None)
                if value is not None and value != [] and field not in _WITHOUT_MEANING:
                    yield field
                    waiting.append(value)
        elif isinstance(thing, list):
            kept = [item for item in thing if not _is_bare_text(item)]
            yield str(len(kept))
            waiting += kept
        else:
            yield repr(thing)


def _is_bare_text(thing: object) -> bool:
    return isinstance(thing, ast.Expr) and isinstance(thing.value, ast.Constant) and isinstance(thing.value.value, str)


@cache
def _read(name: str) -> tuple[bytes, tuple[str, ...]]:
    """The source text of a module, and the modules that it may import."""
    path = _path(name)
    if path is None:
        raise SourcesMissingError(f"{name}: its source file is not installed")
    text = path.read_bytes()
    return text, tuple(_imported(text, name if path.name == "__init__.py" else name.rpartition(".")[0]))


def _imported(text: bytes, package: str) -> Iterator[str]:
    """Names of modules that a text imports; `from a import b` may mean the module a.b, where there is one."""
    for match in _FROM.finditer(text):
        base = match[1].decode()
        if base.startswith("."):
            base = importlib.util.resolve_name(base, package)
        yield base
        if base.partition(".")[0] in OUR_PACKAGES | {package.partition(".")[0]}:
            for name in re.findall(r"\w+", match[2].decode()):
                if _path(f"{base}.{name}") is not None:
                    yield f"{base}.{name}"
    for match in _IMPORT.finditer(text):
        for name in match[1].decode().split(","):
            yield from name.split()[:1]


@cache
def _path(name: str) -> Path | None:
    """The source file of a module; None where there is none. Raises SourcesMissingError for one compiled alone."""
    root, *inner = name.split(".")
    for folder in importlib.import_module(root).__path__:
        place = Path(folder, *inner)
        for path in (place.with_name(f"{place.name}.py"), place / "__init__.py"):
            if inner and path.is_file():
                return path
            if not inner and path.name == "__init__.py" and path.is_file():
                return path
        if any(place.parent.glob(f"{place.name}.*")) or (place / "__init__.pyc").is_file():
            raise SourcesMissingError(f"{name}: its source file is not installed, only a compiled one")
    return None

"""Reading YAML files of strangers: plain data only, without references, of a limited size and depth."""

from __future__ import annotations

from pathlib import Path

import yaml  # type: ignore[import-untyped]

from das.domain.errors import DasError
from das.domain.files.reading import Fields, read_text

MOST_BYTES = 1_000_000
"""Largest YAML file (bytes) that is read; a train with a point of its effort curve at every km/h has 0.005 MB."""
MOST_NODES, MOST_DEPTH = 100_000, 30
"""Largest number of values of a YAML file, and of tables within tables."""
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> Fields:
    """Parse a YAML document that is a table of keys; DasError if the file cannot be read or holds something else.

    References (`*name`) are refused: a small file with many of them becomes a huge one.
    """
    text = read_text(path, MOST_BYTES)
    try:
        _check(path, text)
        data = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise DasError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    return Fields.of(path, data)


def _check(path: Path, text: str) -> None:
    depth, nodes = 0, 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise DasError(f"{path}: the reference *{event.anchor} in the YAML, expected plain data without references")
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if nodes > MOST_NODES or depth > MOST_DEPTH:
            raise DasError(f"{path}: more than {MOST_NODES} values or {MOST_DEPTH} tables within tables")

"""What a recording's metadata say of how it was made: their keys, and the command as it was typed."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from typing import Final

NODE_ARGUMENTS: Final = "node_arguments"
"""The key that says with what the node was started (JSON list)."""
WHAT_IF: Final = "what_if"
"""The key that says of which kind a what-if is."""


class WhatIfKind(StrEnum):
    """What a what-if is of."""

    OPEN_LOOP = "open loop"
    """The recorded drive as it was heard, and other advice on it."""
    DRIVEN_ANEW = "driven anew"
    """The recorded day's disturbances, and a simulated driver who drives it again."""


def typed_command() -> str:
    """The command as the user typed it."""
    return shlex.join(["das-sim", *sys.argv[1:]])

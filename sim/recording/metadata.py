"""The metadata that say how a recording was made: their keys, and the command as it was typed."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from typing import Final

NODE_ARGUMENTS: Final = "node_arguments"
"""Key of the arguments with which the node was started (JSON list)."""
WHAT_IF: Final = "what_if"
"""Key of the kind of a what-if (`WhatIfKind`)."""


class WhatIfKind(StrEnum):
    """How a what-if is made from a recording."""

    OPEN_LOOP = "open loop"
    """The drive stays as it was recorded; only the advice on it is different."""
    DRIVEN_ANEW = "driven anew"
    """A simulated driver drives again, on a day with the recorded disturbances."""


def typed_command() -> str:
    """The command as the user typed it."""
    return shlex.join(["das-sim", *sys.argv[1:]])

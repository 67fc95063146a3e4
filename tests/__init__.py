"""The tests: where Python was told to keep no bytecode, they and their child processes keep it where the programs do.

Each of some hundred child processes would otherwise compile all libraries anew, and each worker would rewrite all tests
anew.
"""

from __future__ import annotations

import os
import sys

from das.command_line.process import keep_bytecode

if os.environ.get("PYTHONDONTWRITEBYTECODE"):
    keep_bytecode()
    if sys.pycache_prefix and not sys.dont_write_bytecode:
        del os.environ["PYTHONDONTWRITEBYTECODE"]
        os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix

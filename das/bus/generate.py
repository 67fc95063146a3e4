"""Generate das_pb2.py and das_pb2.pyi from das.proto: python -m das.bus.generate (needs the dev dependencies)."""

from __future__ import annotations

import sys
from importlib.resources import files
from pathlib import Path


def main() -> int:
    """Run protoc; returns its exit code."""
    from grpc_tools import protoc

    root = Path(str(files("das"))).parent
    well_known = Path(str(files("grpc_tools"))) / "_proto"
    arguments = ["protoc", f"-I{root}", f"-I{well_known}", f"--python_out={root}", f"--mypy_out={root}"]
    return int(protoc.main([*arguments, "das/bus/das.proto"]))


if __name__ == "__main__":
    sys.exit(main())

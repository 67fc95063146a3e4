"""Generate das_pb2.py, das_pb2.pyi and das_comments.json from das.proto: python -m tests.support.generated_messages.

It needs the dev dependencies. das_comments.json holds the comments of all fields, which das_pb2.py does not have.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet

PROTO = "das/bus/das.proto"


def main(to: Path | None = None) -> int:
    """Run protoc; returns its exit code. `to` is the folder that gets das/bus/das_pb2.py … (None: this source)."""
    from grpc_tools import protoc

    root = Path(str(files("das"))).parent
    to = to or root
    well_known = Path(str(files("grpc_tools"))) / "_proto"
    arguments = ["protoc", f"-I{root}", f"-I{well_known}"]
    with TemporaryDirectory() as folder:
        kept = Path(folder) / "das.desc"
        with_comments = [f"--descriptor_set_out={kept}", "--include_source_info"]
        code = int(protoc.main([*arguments, f"--python_out={to}", f"--mypy_out={to}", *with_comments, PROTO]))
        if code == 0:
            (file,) = FileDescriptorSet.FromString(kept.read_bytes()).file
            text = json.dumps(dict(comments_of(file)), indent=1, ensure_ascii=False)
            (to / "das" / "bus" / "das_comments.json").write_text(f"{text}\n", encoding="utf-8")
    return code


def comments_of(file: FileDescriptorProto) -> Iterator[tuple[str, str]]:
    """The full name and the comment of every field that has one, in the order of the file."""
    found = {
        tuple(one.path): " ".join(f"{one.leading_comments} {one.trailing_comments}".split())
        for one in file.source_code_info.location
    }
    for number, message in enumerate(file.message_type):
        yield from _of_message(message, file.package, (FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, number), found)


def _of_message(
    message: DescriptorProto, outer: str, place: tuple[int, ...], found: dict[tuple[int, ...], str]
) -> Iterator[tuple[str, str]]:
    name = f"{outer}.{message.name}"
    for number, field in enumerate(message.field):
        text = found.get((*place, DescriptorProto.FIELD_FIELD_NUMBER, number))
        if text:
            yield f"{name}.{field.name}", text
    for number, inner in enumerate(message.nested_type):
        yield from _of_message(inner, name, (*place, DescriptorProto.NESTED_TYPE_FIELD_NUMBER, number), found)


if __name__ == "__main__":
    sys.exit(main())

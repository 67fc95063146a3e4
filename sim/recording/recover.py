"""Saves the sound parts of a cut or damaged recording in a new, complete file, and reports the losses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from das.bus.recorder import CHUNK_BYTES, LIBRARY, schema_of
from das.bus.recording import RECOVERED, Raw, read_raw
from das.bus.scanning import UNCHECKED, Health
from das.bus.sealing import CHANNELS, NUMBERED, RECORDING, sealed
from das.bus.topics import topic_of
from das.domain.errors import DasError
from das.domain.files.writing import whole_file


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """The saved and the lost parts. `undescribed` counts the messages of unknown channels, which are left out."""

    source: Path
    out: Path
    health: Health
    messages: int
    attachments: int
    undescribed: int
    unchecked_metadata: tuple[str, ...]
    last_ns: int

    @property
    def skipped_bytes(self) -> int:
        """Number of bytes in damaged stretches and in the cut end, from which nothing was saved."""
        lost = sum(one.end_byte - one.start_byte for one in self.health.damage if one.lost)
        return lost + (self.health.size_bytes - self.health.cut_byte if self.health.cut_byte >= 0 else 0)

    def losses(self) -> list[str]:
        """Sentences about losses; empty if everything was saved."""
        health = self.health
        lines = [f"left out: {one}" for one in health.damage if one.lost]
        lines += [f"mended: {one}" for one in health.damage if not one.lost]
        if health.missing:
            lines.append(f"{health.missing} messages are missing, according to their sequence numbers")
        if self.undescribed:
            lines.append(f"{self.undescribed} messages are left out: their channels are not described")
        if health.cut_byte >= 0:
            lines.append(f"the last {health.size_bytes - health.cut_byte} bytes are a record without its end")
        for name in self.unchecked_metadata:
            lines.append(f"metadata {name!r} have no checksum: kept as {UNCHECKED + name!r}, which no command uses")
        return lines

    def as_dict(self) -> dict[str, Any]:
        """The result for programs."""
        return {
            "file": str(self.source),
            "written": str(self.out),
            "sound": self.health.sound,
            "messages": self.messages,
            "attachments": self.attachments,
            "messages_missing": self.health.missing,
            "skipped_bytes": self.skipped_bytes,
            "last_time_ns": self.last_ns,
            "losses": self.losses(),
        }


def recover(source: Path, out: Path) -> Recovered:
    """Write the sound parts of `source` to `out`, which is written whole or not at all.

    Raises DasError if `source` cannot be read or holds no message, or if `out` cannot be written.
    """
    raw, health = read_raw(source)
    if not raw.messages:
        raise DasError(f"{source}: holds no message that could be saved")
    homeless = [one for one in raw.messages if one.channel_id not in raw.channels]
    unchecked = tuple(record.name for record, right in raw.metadata if right is None)
    found = Recovered(
        source=source,
        out=out,
        health=health,
        messages=len(raw.messages) - len(homeless),
        attachments=len(raw.attachments),
        undescribed=len(homeless),
        unchecked_metadata=unchecked,
        last_ns=max(one.log_time for one in raw.messages),
    )
    with whole_file(out) as file:
        _write(file, raw, found)
    return found


def _write(file: IO[bytes], raw: Raw, found: Recovered) -> None:
    writer: Any = McapWriter(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="", library=LIBRARY)
    for one in raw.attachments:
        writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
    for record, right in raw.metadata:
        if right is not False:
            name = record.name if right else f"{UNCHECKED}{record.name}"
            writer.add_metadata(name, sealed(name, record.metadata))
    losses = [*found.losses(), *([] if found.health.complete else ["it was cut off"])]
    if losses:
        writer.add_metadata(RECOVERED, sealed(RECOVERED, {"file": found.source.name, "lost": "; ".join(losses)}))
    channels = _channels(writer, raw)
    for message in raw.messages:
        if message.channel_id in channels:
            new = channels[message.channel_id]
            writer.add_message(new, message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()


def _channels(writer: Any, raw: Raw) -> dict[int, int]:
    """The new numbers of the channels that have messages, by their old ones, with their schemas and descriptions."""
    channels: dict[int, int] = {}
    schemas: dict[int, int] = {}
    for old in dict.fromkeys(one.channel_id for one in raw.messages):
        channel = raw.channels.get(old)
        if channel is None:
            continue
        schema, ours = raw.schemas.get(channel.schema_id), topic_of(channel.topic)
        if schema is not None and schema.id not in schemas:
            # A schema of ours is known even if its chunk was lost.
            data = schema_of(ours.message) if ours is not None and not schema.data else schema.data
            schemas[schema.id] = int(writer.register_schema(schema.name, schema.encoding, data))
        number = 0 if schema is None else schemas[schema.id]
        new = writer.register_channel(channel.topic, channel.message_encoding, number, channel.metadata)
        channels[old] = int(new)
        if ours is not None:
            described = {"topic": channel.topic, "schema": schema.name if schema else "", "schema_id": str(number)}
            described |= {NUMBERED: "yes"} if raw.numbered else {}
            described |= {RECORDING: channel.metadata[RECORDING]} if RECORDING in channel.metadata else {}
            writer.add_metadata(f"{CHANNELS}{new}", sealed(f"{CHANNELS}{new}", described))
    return channels

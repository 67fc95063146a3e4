"""A recording as tables: what is in them is what was recorded, and nobody is named where nobody is to be."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from das.bus import topics
from das.bus.recording import Stamped, read_recording
from das.domain.errors import DasError
from das.domain.units import NS
from sim.cli.trips import bundled_recording
from sim.drive import message_tables as writing
from sim.drive.export import KEPT, ExportSettings, FileFormat, anonymous, export
from sim.drive.message_tables import UNITS, Column, DataTable, tables_of
from tests.support.recordings import SECONDS, START_NS, at_ns, position_m, speed_mps, write_recording
from tests.support.reference_recordings import FOLDER

CSV = ExportSettings(format=FileFormat.CSV)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap")


@pytest.fixture(scope="module")
def exported(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports") / "tables"
    export(recorded, folder, ExportSettings())
    return folder


def read(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(folder / f"{name}.parquet")


def test_every_topic_is_a_table_of_what_was_recorded(recorded: Path, exported: Path) -> None:
    recording = read_recording(recorded)
    for name in recording.topics:
        table = read(exported, name)
        assert len(table) == len(recording.of(name))
        assert table["log_time_ns"].tolist() == recording.columns(name)["log_time_ns"].tolist()
    truth, wanted = read(exported, "truth"), recording.columns(topics.TRUTH)
    for name in ("time_ns", "s_m", "speed_mps", "force_el_n", "limit_mps"):
        np.testing.assert_array_equal(truth[name], wanted[name])
    assert read(exported, "advice")["mode"].tolist()[0] == "full_traction"
    plan = read(exported, "plan")
    np.testing.assert_allclose(plan["s_m"][3], [position_m(30), position_m(30) + 100.0])
    assert read(exported, "journey_stops")["name"].tolist() == ["A", "B"]
    assert read(exported, "location")["latitude_deg"][0] == pytest.approx(47.0)


def test_csv_and_parquet_say_the_same(exported: Path) -> None:
    for path in sorted(exported.glob("*.parquet")):
        ours = pd.read_parquet(path)
        theirs = pd.read_csv(path.with_suffix(".csv"), keep_default_na=False)
        assert list(ours.columns) == list(theirs.columns)
        for name in ours.columns:
            if ours[name].dtype == np.float64:
                found = pd.to_numeric(theirs[name], errors="coerce").to_numpy(dtype=float)
                np.testing.assert_array_equal(found, ours[name].to_numpy())


def test_units_and_meanings_are_in_the_metadata(exported: Path) -> None:
    schema = parquet.read_schema(exported / "advice.parquet")
    assert schema.field("advised_force_n").metadata == {
        b"unit": b"N",
        b"meaning": b"wheel force of motors and friction brake together",
    }
    assert schema.metadata[b"recording"] == b"whole.mcap"
    with (exported / "columns.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["table"] for row in rows} == {path.stem for path in exported.glob("*.parquet")}
    for row in rows:
        if row["kind"] == "float":
            assert row["unit"] in UNITS.values(), row


def test_by_time_there_is_a_row_a_second(exported: Path) -> None:
    table = read(exported, "by_time")
    assert table["time_ns"].tolist() == [at_ns(t) for t in range(SECONDS)]
    np.testing.assert_allclose(table["truth_speed_mps"], [speed_mps(t) for t in range(SECONDS)])
    assert table["advice_mode"].tolist() == read(exported, "advice")["mode"].tolist()
    # A delay is said once a minute and holds; before the first nothing is known of it.
    assert table["delay_delay_s"].tolist() == [30.0] * SECONDS


def test_from_and_to(recorded: Path, tmp_path: Path) -> None:
    day = f"{pd.Timestamp(at_ns(100)).isoformat()}"
    export(recorded, tmp_path / "part", ExportSettings(start=day, end="3:20", format=FileFormat.PARQUET))
    times = read(tmp_path / "part", "truth")["time_ns"]
    assert times.min() == at_ns(100)
    assert times.max() == at_ns(200)  # the clock shows 0 at the first position: no timetable says a departure


def test_trimmed_ends_leave_out_the_standing(recorded: Path, tmp_path: Path) -> None:
    bundled = bundled_recording()
    export(bundled, tmp_path / "all", CSV)
    export(bundled, tmp_path / "moving", ExportSettings(trim_ends=True, format=FileFormat.CSV))
    whole, part = (pd.read_csv(tmp_path / name / "position.csv") for name in ("all", "moving"))
    assert len(part) < len(whole)
    assert part["speed_mps"].iloc[0] > 0.1
    assert part["speed_mps"].iloc[-1] > 0.1
    assert whole["speed_mps"].iloc[[0, -1]].tolist() == [0.0, 0.0]


def everything(folder: Path) -> str:
    """All that is written, as text: CSV and JSON as they are, Parquet with its metadata."""
    texts = [path.read_text(encoding="utf-8") for path in folder.glob("*.csv")]
    texts += [path.read_text(encoding="utf-8") for path in folder.glob("*.json")]
    for path in folder.glob("*.parquet"):
        table = parquet.read_table(path)
        texts += [str(table.to_pylist()), str(table.schema.metadata), path.name]
    return "\n".join(texts)


def test_an_anonymous_export_says_neither_who_nor_where(tmp_path: Path) -> None:
    """Of a real run: the names of train, driver, line, vehicle, stops, the day, and the command are not in it."""
    source = FOLDER / "clear-day.mcap"
    recording = read_recording(source)
    export(source, tmp_path / "open", ExportSettings())
    export(source, tmp_path / "closed", ExportSettings(anonymous=True))
    stops = recording.of(topics.JOURNEY)[0].message.stops
    secrets = [*(stop.name for stop in stops), "T1", "zurich", "re460", "human", "clear-day"]
    secrets.append(str(stops[0].departure_ns)[:9])
    said, hidden = everything(tmp_path / "open"), everything(tmp_path / "closed")
    assert [secret for secret in secrets if secret not in said] == []
    assert [secret for secret in secrets if secret in hidden] == []
    truth = pd.read_csv(tmp_path / "closed" / "position.csv")
    assert abs(truth["s_m"].iloc[0]) < 10.0
    assert truth["time_ns"].iloc[0] == -10 * 10**9
    np.testing.assert_allclose(truth["speed_mps"], pd.read_csv(tmp_path / "open" / "position.csv")["speed_mps"])


def moved(message: Any, by_m: float) -> Any:
    """A message with a number in every field, and its positions on the route further on."""
    for one in message.DESCRIPTOR.fields:
        if one.message_type is not None and one.message_type.full_name.startswith("das."):
            moved(getattr(message, one.name).add() if one.is_repeated else getattr(message, one.name), by_m)
        elif one.name in {"s_m", "start_m", "end_m", "signal_m", "stop_m", "at_m"}:
            value = 20_000.0 + by_m
            getattr(message, one.name).append(value) if one.is_repeated else setattr(message, one.name, value)
        elif one.cpp_type == one.CPPTYPE_DOUBLE and not one.is_repeated:
            setattr(message, one.name, 3.0)
    return message


@pytest.mark.parametrize("topic", topics.TOPICS, ids=lambda one: one.name)
def test_an_anonymous_export_hides_where_the_route_begins(topic: topics.Topic) -> None:
    """The same drive on a line that begins 57 km earlier gives the same tables."""

    def hidden(by_m: float) -> list[tuple[str, list[Any]]]:
        tables = tables_of(topic.name, [Stamped(5, moved(topic.message(), by_m))], 0)
        kept = [found for one in tables if (found := anonymous(one, 0, by_m)) is not None]
        return [(f"{table.name}.{one.name}", one.values) for table in kept for one in table.columns]

    assert hidden(57_000.0) == hidden(0.0)
    assert (hidden(0.0) == []) is (topic.name == "location")


def test_a_field_or_table_that_nobody_decided_on_is_left_out() -> None:
    known = Column(name="speed_mps", kind="float", values=[1.0])
    new = Column(name="platform_m", kind="float", values=[57_000.0])
    kept = anonymous(DataTable(name="cab", columns=[known, new]), 0, 0.0)
    assert kept is not None
    assert [one.name for one in kept.columns] == ["speed_mps"]
    assert anonymous(DataTable(name="new_topic", columns=[known]), 0, 0.0) is None


def test_an_anonymous_export_keeps_the_numbers_of_the_topics() -> None:
    """Each column in the list is a column of its table, so that a renamed field does not vanish unseen."""
    for topic in topics.TOPICS:
        for table in tables_of(topic.name, [Stamped(5, moved(topic.message(), 0.0))], 0):
            names = {one.name for one in table.columns}
            assert set(KEPT.get(table.name, "").split()) <= names


def test_places_on_the_map_are_left_out(recorded: Path, tmp_path: Path) -> None:
    export(recorded, tmp_path / "closed", ExportSettings(anonymous=True, format=FileFormat.CSV))
    assert not (tmp_path / "closed" / "location.csv").exists()
    assert "latitude" not in everything(tmp_path / "closed")


def test_nothing_is_written_over(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "mine.txt").write_text("mine")
    for folder, expected in (
        (tmp_path / "there", "exists already"),
        (tmp_path / "there" / "mine.txt", "exists already"),
        (tmp_path / "nowhere" / "x", "no such folder"),
    ):
        with pytest.raises(DasError, match=expected):
            export(recorded, folder, CSV)
    for settings, expected in (
        (ExportSettings(start="20:00", format=FileFormat.CSV), "there is nothing between --from and --to"),
        (ExportSettings(start="5", end="4", format=FileFormat.CSV), "expected a time after --from"),
    ):
        with pytest.raises(DasError, match=expected):
            export(recorded, tmp_path / "new", settings)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["there"]


def test_without_pyarrow_there_is_csv(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = writing.importlib.util.find_spec

    def without(name: str, package: str | None = None) -> Any:
        return None if name == "pyarrow" else found(name, package)

    monkeypatch.setattr(writing.importlib.util, "find_spec", without)
    with pytest.raises(DasError, match="pyarrow is not installed"):
        export(recorded, tmp_path / "x", ExportSettings())
    assert export(recorded, tmp_path / "x", CSV)["truth"] == SECONDS


def test_damage_is_told_in_the_export(recorded: Path, tmp_path: Path) -> None:
    content = bytearray(recorded.read_bytes())
    chunk = content.index(b"\x04\0\0\0zstd", len(content) // 3)
    content[chunk + 40] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(content)
    export(tmp_path / "damaged.mcap", tmp_path / "x", CSV)
    about = json.loads((tmp_path / "x" / "export.json").read_text())
    assert len(about["damage"]) == 1
    assert "a chunk" in about["damage"][0]
    assert len(pd.read_csv(tmp_path / "x" / "truth.csv")) < SECONDS


def test_nothing_is_made_up_where_a_piece_is_lost(recorded: Path, tmp_path: Path) -> None:
    """Ten seconds are lost: there are no rows of that time, and the numbers on both sides are those of before."""
    content = bytearray(recorded.read_bytes())
    places = [i for i in range(len(content) // 2) if content.startswith(b"\x04\0\0\0zstd", i)]
    for place in places[200:210]:
        content[place + 40] ^= 0x10
    (tmp_path / "damaged.mcap").write_bytes(content)
    export(tmp_path / "damaged.mcap", tmp_path / "x", CSV)
    table = pd.read_csv(tmp_path / "x" / "by_time.csv")
    moments = (table["time_ns"] - START_NS) * NS
    assert moments.diff().max() > 10
    np.testing.assert_allclose(table["truth_speed_mps"], [speed_mps(t) for t in moments], atol=0.01)

"""A what-if with nothing otherwise is the recorded day byte for byte; with something otherwise it is what was asked."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections import defaultdict
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from das.bus.recording import Recording, read_contents, read_recording
from das.bus.topics import ADVICE, JOURNEY, RESTRICTION
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_vehicle
from das.domain.levels import Level
from das.domain.restriction import Restriction
from sim.cli.trips import bundled_recording
from sim.drive.comparison import AlignedDrives, drives_on_track
from sim.drive.drive import Drive
from sim.drivers.kinds import DriverKind, Presentation
from sim.options import NodeSaid
from sim.recording.check import check_file
from sim.recording.opening import inputs_of, sha256
from sim.runs.reproduce import reproduce
from sim.runs.what_if.anew import _on_the_day, attached_scenario, day_again, drive_again, scenario_of_drive
from sim.runs.what_if.open_loop import advice_apart, advise_otherwise
from sim.runs.what_if.origin import Origin
from sim.runs.what_if.otherwise import CabOtherwise, DrivenOtherwise, Otherwise, read_restriction
from sim.world.disturbances import AnnouncedRestriction, DepartureDelay
from sim.world.driving import How, drive_day
from sim.world.scenario import read_scenario
from sim.world.service import lay_out, make_day, prepare_service, scenario_files
from tests.sim.world.test_drawn import write_map
from tests.support.flat_days import FLAT
from tests.support.recordings import with_run
from tests.support.reference_recordings import FOLDER

DAY = f"""{FLAT}
[[disturbances]]
kind = "restriction"
from_km = 3.0
to_km = 3.5
speed_kmh = {{min = 60, max = 90}}
announced_m = 2000
[[disturbances]]
kind = "departure-delay"
stop = "A"
delay_s = {{min = 5, max = 20}}
[[disturbances]]
kind = "node-restart"
at_s = 100
"""
REPLAY = FOLDER / "replay.mcap"
ONE_MORE = Restriction(1000.0, 2000.0, 25.0)


def quiet(_done: float, _all: float) -> None:
    """Progress that nobody looks at."""


def payloads(path: Path) -> dict[str, list[bytes]]:
    """The bytes of every message, by topic and in the order of the file."""
    found: dict[str, list[bytes]] = defaultdict(list)
    for one in read_contents(path).messages:
        found[one.topic.name].append(one.message.SerializeToString())
    return found


def origin_of(path: Path) -> Origin:
    return Origin.read(path, None, Path(mkdtemp()))


def open_loop(path: Path, out: Path, new: Otherwise | None = None) -> Path:
    advise_otherwise(origin_of(path), new or Otherwise(), NodeSaid(), out, quiet)
    return out


def anew(path: Path, out: Path, new: Otherwise | None = None) -> Path:
    drive_again(*day_again(origin_of(path), new or Otherwise()), out, quiet)
    return out


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated day with a restriction, a late departure and a restart of the node, over the bus.

    Line and train are files of the user's own. They are gone afterwards: the recording brings along what is needed.
    """
    folder = tmp_path_factory.mktemp("what-if")
    inputs = folder / "inputs"
    inputs.mkdir()
    for kind, name in (("routes", "flat-6km"), ("vehicles", "re460-ic")):
        shutil.copy(catalogue(kind)[name], inputs)
    scenario = inputs / "flat.toml"
    own = DAY.replace('"flat-6km"', '"flat-6km.toml"').replace('"re460-ic"', '"re460-ic.toml"')
    scenario.write_text(own, encoding="utf-8")
    day = make_day(prepare_service(read_scenario(scenario)), 3)
    how = How(driver=DriverKind.HUMAN, advice=Presentation.SPEED_AND_EFFORT, train="T1", command="test")
    out = folder / "day.mcap"
    drive_day(day, day.driver(DriverKind.HUMAN), how, out)
    shutil.rmtree(inputs)
    return out


@pytest.mark.nightly
@pytest.mark.parametrize("again", [open_loop, anew])
def test_with_nothing_otherwise_every_message_is_the_same_byte_for_byte(
    recorded: Path, again: type[None], tmp_path: Path
) -> None:
    new = again(recorded, tmp_path / "again.mcap")  # type: ignore[call-arg]
    before, after = payloads(recorded), payloads(new)
    assert set(before) == set(after) >= {"advice", "plan", "status", "event", "truth", "cab", "decision", "restriction"}
    assert {topic: len(found) for topic, found in before.items()} == {
        topic: len(found) for topic, found in after.items()
    }
    assert [topic for topic in before if before[topic] != after[topic]] == []
    assert check_file(new).recording.metadata["run"]["what_if_changed"] == "nothing"
    assert advice_apart(recorded, new, "T1").sentence == "The advice is the same at every moment."
    assert AlignedDrives.of(drives_on_track([Drive.read(recorded), Drive.read(new)])).is_same(1)


@pytest.mark.nightly
def test_an_open_loop_keeps_the_drive_and_changes_the_advice(recorded: Path, tmp_path: Path) -> None:
    new = open_loop(recorded, tmp_path / "level.mcap", Otherwise(cab=CabOtherwise(level=Level.L0_NOREG)))
    before, after = payloads(recorded), payloads(new)
    assert all(before[topic] == after[topic] for topic in ("truth", "position", "cab", "journey", "control"))
    assert before["advice"] != after["advice"]
    assert len(before["advice"]) == len(after["advice"])
    apart = advice_apart(recorded, new, "T1")
    assert apart.moments == len(before["advice"]) > apart.differing > 0
    assert apart.sentence.startswith(
        f"The advice differs at {apart.differing} of {apart.moments} moments, first at km "
    )
    run = read_contents(new).metadata["run"]
    assert (run["what_if"], run["level"], run["what_if_of"]) == ("open loop", "l0-noreg", "day.mcap")
    assert not Drive.read(new).energy.shown.any_shown  # no driver saw this advice
    assert not check_file(new).findings
    assert reproduce(new, quiet).same  # its node arguments are those that it was advised with


@pytest.mark.nightly
def test_another_train_and_restriction_are_in_the_new_recording(recorded: Path, tmp_path: Path) -> None:
    new = Otherwise(cab=CabOtherwise(vehicle="re460-ic-igbt"), restrictions=(ONE_MORE,), without_restrictions=True)
    found = read_recording(open_loop(recorded, tmp_path / "train.mcap", new))
    assert found.of(JOURNEY)[0].message.vehicle_id == "re460-ic-igbt"
    assert all(told(found, i) == [ONE_MORE] for i in range(len(found.of(RESTRICTION))))
    assert "re460-ic-igbt.toml" in found.attachments
    assert "re460-ic.toml" not in found.attachments
    slow = [one.message.limit_mps for one in found.of(ADVICE) if 1000.0 <= one.message.s_m <= 2000.0]
    assert max(slow) <= ONE_MORE.limit_mps + 1e-9
    assert reproduce(found.path, quiet).same


def told(recording: Recording, index: int) -> list[Restriction]:
    listed = recording.of(RESTRICTION)[index].message.restrictions
    return [Restriction(one.start_m, one.end_m, one.limit_mps) for one in listed]


@pytest.mark.nightly
def test_a_day_driven_again_keeps_the_losses_of_its_train_and_is_compared_with_its_brakes(
    recorded: Path, tmp_path: Path
) -> None:
    """The train keeps its true losses where its advice is planned with others."""
    new = Otherwise(
        cab=CabOtherwise(level=Level.L1),
        driven=DrivenOtherwise(driver="perfect", advice=Presentation.SPEED_AND_EFFORT),
        restrictions=(ONE_MORE,),
    )
    day, _ = day_again(origin_of(recorded), new)
    assert day.service.level is Level.L1
    assert day.plant.level is Level.L3
    once = anew(recorded, tmp_path / "once.mcap", new)
    drives = AlignedDrives.of(drives_on_track([Drive.read(recorded), Drive.read(once)]))
    before_j, after_j = (one.drive.energy.driven_j or 0.0 for one in drives.drives)
    assert after_j < 0.8 * before_j  # nobody brakes with friction for nothing
    assert not drives.own_energies  # the drives are compared without that
    assert drives.energy_j[1, -1] > 0.8 * drives.energy_j[0, -1]


def test_a_what_if_is_not_driven_again(tmp_path: Path) -> None:
    path = with_run(FOLDER / "clear-day.mcap", tmp_path / "day.mcap", what_if="driven anew", what_if_of="first.mcap")
    with pytest.raises(DasError, match=r"day.mcap: is a what-if: start from first.mcap, with all changes in one"):
        day_again(origin_of(path), Otherwise())


@pytest.mark.slow
def test_the_day_of_a_drive_without_a_simulator_is_made_from_what_was_heard() -> None:
    day, _ = day_again(origin_of(bundled_recording()), Otherwise())
    assert [stop.name for stop in day.service.stops] == ["Zürich HB", "Zug"]  # it passes Thalwil without stopping
    (delay,) = day.of(DepartureDelay)
    assert delay.delay_s == pytest.approx(90.0, abs=2.0)
    (table,) = day.service.timetables
    assert (table.arrival_ns - table.departure_ns) * 1e-9 == pytest.approx(1248.0)


def test_the_window_of_a_recorded_restriction_is_on_the_clock_of_the_day_driven_anew() -> None:
    departure_ns, s = 1_800_000_000 * 10**9, 10**9

    def window_of(from_s: int | None, until_s: int | None) -> tuple[float | None, float | None] | None:
        window = (0 if moment_s is None else departure_ns + moment_s * s for moment_s in (from_s, until_s))
        one = Restriction(0.0, 1.0, 5.0, *window)
        found = _on_the_day(AnnouncedRestriction.of(one, 9.0, lambda at_ns: (at_ns - departure_ns) / s))
        return None if found is None else (found.valid_from_s, found.valid_until_s)

    assert window_of(None, None) == window_of(-60, None) == window_of(None, 90_000) == (None, None)
    assert window_of(60, 120) == (60.0, 120.0)
    assert window_of(-60, 120) == (None, 120.0)
    assert window_of(-60, -1) is window_of(90_000, None) is None


@pytest.mark.slow
def test_a_node_with_a_loss_map_is_driven_anew_with_it(tmp_path: Path) -> None:
    """The recording brings the map along, and the day, its new recording and its energy attribution have it."""
    own_map = tmp_path / "own.csv"
    write_map(own_map, 1.2)
    run = read_contents(REPLAY).metadata["run"]
    words = json.dumps([*json.loads(run["node_arguments"]), "--loss-map", "/nowhere/own.csv"])
    of_map = ("own.csv", own_map.read_bytes())
    path = with_run(
        REPLAY, tmp_path / "replay.mcap", of_map, node_arguments=words, loss_map_sha256=sha256(own_map)
    )  # fmt: skip
    own_map.unlink()
    scenario = scenario_of_drive(origin_of(path), None)
    _, vehicle, _ = lay_out(scenario)
    planned, given = load_vehicle("re460-ic").loss_model(Level.L3), vehicle.loss_model(Level.L3)
    at = np.array([1e5]), np.array([20.0])
    np.testing.assert_allclose(given.loss_w(*at), 1.2 * planned.loss_w(*at), rtol=0.02)
    assert scenario_files(scenario)["loss_map"].name == "own.csv"
    inputs = inputs_of(read_recording(path))
    np.testing.assert_allclose(inputs.vehicle.loss_model(Level.L3).loss_w(*at), given.loss_w(*at))


@pytest.mark.nightly
def test_a_repeated_open_loop_of_a_replay_is_the_same_file(tmp_path: Path) -> None:
    once, twice = (open_loop(REPLAY, tmp_path / name) for name in ("once.mcap", "twice.mcap"))
    assert once.read_bytes() == twice.read_bytes()
    assert payloads(once) == payloads(open_loop(once, tmp_path / "of-it.mcap"))


def test_a_class_that_a_recording_names_is_not_run_unless_the_user_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Importing a module runs it: the recording may come from anybody, and the folder may hold anything."""
    (tmp_path / "planted.py").write_text("from pathlib import Path\nPath('has-run').touch()\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    path = with_run(FOLDER / "clear-day.mcap", tmp_path / "day.mcap", driver="planted:Driver")
    for new in (Otherwise(), Otherwise(driven=DrivenOtherwise(advice=Presentation.GUIDE))):
        with pytest.raises(
            DasError, match=r"class planted:Driver, which is run only if you name it: expected --driver plan"
        ):
            day_again(origin_of(path), new)
    assert not Path("has-run").exists()
    with pytest.raises(DasError, match="has no class Driver"):
        day_again(origin_of(path), Otherwise(driven=DrivenOtherwise(driver="planted:Driver")))
    assert Path("has-run").exists()


@pytest.mark.parametrize("key", ["route", "vehicle"])
def test_a_file_that_an_attached_scenario_names_is_not_opened(key: str, tmp_path: Path) -> None:
    """A pipe at the place would keep its reader waiting for ever; a regular file there would be read."""
    source = FOLDER / "clear-day.mcap"
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    (scenario,) = (one.data.decode() for one in read_contents(source).attachments if one.name == "clear-day.toml")
    changed_text = re.sub(rf'(?m)^{key} = ".*"$', f'{key} = "{pipe}"', scenario).encode()
    path = with_run(
        source, tmp_path / "day.mcap", ("clear-day.toml", changed_text), without=True,
        scenario_sha256=hashlib.sha256(changed_text).hexdigest(),
    )  # fmt: skip
    with pytest.raises(DasError, match=f"day.mcap: does not contain its {key}"):
        attached_scenario(origin_of(path))


def test_a_drive_without_advice_has_no_open_loop(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"the recording holds no advice: use --driven-anew"):
        open_loop(bundled_recording(), tmp_path / "new.mcap")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5", "expected km-km:km/h"),
        ("2-1:80", "expected an end beyond the start"),
        ("1-2:0.1", "expected a limit of 5 to 700 km/h"),
        ("-1-2:80", "expected km-km:km/h"),
        ("1-2:80@08:10-08:20", "expected km-km:km/h"),
    ],
)
def test_a_restriction_that_cannot_be_meant_is_refused(text: str, expected: str) -> None:
    with pytest.raises(DasError, match=expected):
        read_restriction(text)


def test_a_restriction_off_the_way_is_refused() -> None:
    with pytest.raises(DasError, match="expected on the way, km 0 to 29"):
        origin_of(bundled_recording()).check_on_the_way(Otherwise(restrictions=(read_restriction("40-41:80"),)))

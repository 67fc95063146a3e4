"""Old names of options, words and keys: each is refused in one line that has the new one; old recordings are read."""

from __future__ import annotations

from pathlib import Path

import pytest

from das.domain.errors import DasError, InputError
from das.domain.files.reading import Fields
from precompute.cli.program import COMMANDS
from sim.cli.program import ENTRIES, EXPERIMENTS
from sim.drive.drive import Drive
from sim.drivers.kinds import as_now_called
from sim.experiment.factors import FACTORS
from sim.front_door import run_day
from tests.support.reference_recordings import FOLDER

BY_NAME = {entry.name: entry for entry in (*ENTRIES, *COMMANDS) if entry.where}
BY_NAME |= {f"experiment-{entry.name}": entry for entry in EXPERIMENTS}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run clear-day --advice rms", "rms is now called top-speed"),
        ("run clear-day --advice=coach", "coach is now called guide"),
        ("what-if x.mcap --advice vector", "vector is now called speed-and-effort"),
        (
            "experiment-run --scenario clear-day -o x --advice vector,none",
            "--advice vector: expected speed-and-effort, as",
        ),
        (
            "experiment-run --scenario clear-day -o x --driver rms",
            "--driver rms: expected top-speed, as rms is now called, or a class",
        ),
        ("run clear-day --driver rms", "--driver rms: expected top-speed, as rms is now called, or a class"),
        ("solve flat-6km re460-ic --buffer 7 --strategy rms", "rms is now called top-speed"),
        ("run clear-day --speed 2", "--speed is now called --pace"),
        ("desk --speed 2", "--speed is now called --pace"),
        ("replay x.csv --line=posts.csv", "--line is now called --posts"),
        ("replay x.csv --arrival 600", "--arrival is now called --running-time"),
    ],
)
def test_an_old_name_on_a_command_line_is_refused_with_the_new_one(words: str, said: str) -> None:
    name, *rest = words.split()
    with pytest.raises(DasError) as caught:
        BY_NAME[name].load()(rest, standalone_mode=False)
    assert str(caught.value).startswith(said)


def test_an_old_word_in_a_file_or_a_call_is_refused_with_the_new_one() -> None:
    table = Fields.of(Path("design.toml"), {"presentation": "coach", "driver": "rms"})
    with pytest.raises(InputError, match=r"presentation = 'coach': expected guide, as coach is now called$"):
        FACTORS["presentation"].read(table, "presentation", "coach")
    with pytest.raises(InputError, match=r"driver = 'rms': expected top-speed, as rms is now called, or a class"):
        FACTORS["driver"].read(table, "driver", "rms")
    with pytest.raises(InputError, match=r"advice = 'vector': expected speed-and-effort, as vector is now called$"):
        run_day("clear-day", advice="vector")


def test_a_recording_with_old_names_was_driven_as_they_are_called_now() -> None:
    assert as_now_called({"driver": "rms", "advice": "coach", "title": "rms"}) == {
        "driver": "top-speed",
        "advice": "guide",
        "title": "rms",
    }
    assert as_now_called({"driver": "a.b:Own", "advice": "sextant"}) == {"driver": "a.b:Own", "advice": "sextant"}
    assert as_now_called({"kind": "replay"}) == {"kind": "replay"}
    assert Drive.read(FOLDER / "head-wind.mcap").table.run["advice"] == "speed-and-effort"

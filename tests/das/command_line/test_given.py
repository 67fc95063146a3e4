"""Options that a command would not use as it is called: each is an error that names the option and what it needs."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import pytest
import typer

from das.command_line.application import is_given, refuse_given, single_command
from das.domain.errors import DasError
from das.domain.files.load import locate_vehicle
from sim.cli.trips import bundled_recording
from tests.support import dirt
from tests.support.making import das_precompute, das_sim
from tests.support.recordings import with_run

SEEN: list[str] = []
OPTIONS = ("--count", "--light", "--tag")


def paint(
    count: Annotated[int, typer.Option("--count", "-c")] = 1,
    light: Annotated[bool, typer.Option("--light/--dark")] = True,
    tag: Annotated[list[str] | None, typer.Option("--tag")] = None,
) -> None:
    """Note which options were typed, and how an error would name them."""
    assert count >= 0, (light, tag)
    SEEN.clear()
    for option in OPTIONS:
        try:
            refuse_given("why", option)
        except DasError as error:
            SEEN.append(str(error))


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        ([], []),
        (["--count", "1"], ["--count 1: why"]),  # the default value, but the user said it
        (["-c", "0"], ["--count 0: why"]),
        (["--light"], ["--light: why"]),
        (["--dark"], ["--dark: why"]),
        (["--tag", "a", "--tag", "b"], ["--tag a b: why"]),
    ],
)
def test_what_was_typed_is_known_while_the_command_runs_and_named_as_it_was_typed(
    typed: list[str], named: list[str]
) -> None:
    single_command("das-try", paint, ())(typed, standalone_mode=False)
    assert named == SEEN
    assert not any(is_given(option) for option in OPTIONS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trip with positions on its route, one line of posts, two recordings and a train without an electric brake."""
    folder = tmp_path_factory.mktemp("options")
    dirt.write(folder, dirt.clean(), on_route=True).rename(folder / "trip.csv")
    dirt.long_posts(folder).rename(folder / "posts.csv")
    shutil.copy(bundled_recording(), folder / "replay.mcap")
    with_run(folder / "replay.mcap", folder / "run.mcap", kind="run")
    text = locate_vehicle("re460-ic").read_text(encoding="utf-8")
    begin = text.index("[electric_brake]")
    without = text[:begin] + text[text.index("\n[", begin) :]
    (folder / "rubs.toml").write_text(without.replace('policy = "electric"', 'policy = "friction"'), encoding="utf-8")
    modes = "\n[modes.dry]\nweather = 'dry'\n[modes.dry.traction]\nmax_force_kn = 90\nmax_power_kw = 1000\n"
    (folder / "modes.toml").write_text(text + modes, encoding="utf-8")
    return folder


FLAT = ("flat-6km", "re460-ic")
DRIVE, TO_SEE = ("run", "clear-day"), "is a recording to look at; nothing is driven, nothing is recorded"
DAYS = ("experiment", "run", "--scenario", "clear-day", "-o", "b")
OF_SIM = [
    ((*DRIVE, "--driver", "perfect", "--friction", "as-measured"), "--friction as-measured: needs --driver human"),
    ((*DRIVE, "--driver", "external", "--friction", "by-advice"), "--friction by-advice: needs --driver human"),
    ((*DRIVE, "--driver-at", "tcp/127.0.0.1:1"), "--driver-at tcp/127.0.0.1:1: needs --driver external"),
    ((*DRIVE, "--in-process", "--train", "IC1"), "--train IC1: a run --in-process has no bus"),
    ((*DRIVE, "--in-process", "--overwrite"), "--overwrite: a run --in-process records nothing"),
    ((*DRIVE, "--in-process", "-o", "a.mcap"), "--out a.mcap: a run --in-process records nothing"),
    ((*DRIVE, "--overwrite"), "--overwrite: no file to write is named"),
    (("desk", "--overwrite"), "--overwrite: no file to write is named"),
    (("desk", "clear-day", "--at", "1:00"), "--at 1:00: clear-day is a scenario"),
    *(
        (("desk", "run.mcap", *words.split()), f"{words}: run.mcap {TO_SEE}")
        for words in (
            *("--journey zurich-luzern", "--advice guide", "--seed 0", "--level l3", "--train train-1", "--pace real"),
            *("--notches 10", "--punctuality", "--no-punctuality", "--out a.mcap", "--overwrite", "--bus bus"),
            *("--insecure-bus", "--json"),
        )
    ),
    ((*DAYS, "--driver", "fast", "--friction", "by-advice"), "needs --driver human"),
    ((*DAYS, "--driver", "fast", "--participants", "1"), "needs --driver human"),
    ((*DAYS, "--population", "usual"), "--population usual: needs --participants"),
    (("experiment", "run", "smoke", "-o", "b", "--seeds", "1"), "--seeds 1: needs --scenario"),
    (("trip", "trip.csv", "--route", "flat-6km", "--level", "l1"), "--level l1: needs --vehicle or --vehicles"),
    (("trip", "trip.csv", "--of-train", "IC1"), "--of-train IC1: trip.csv is no recording"),
    (("trip", "trip.csv", "--route", "flat-6km", "--posts", "posts.csv"), "trip.csv has positions on the route"),
    (("trip", "trip.csv", "--overwrite"), "--overwrite: no file to write is named"),
    (("replay", "trip.csv", "--overwrite"), "--overwrite: no file to write is named"),
    (("replay", "run.mcap", "--vehicle", "", "-o", "a.mcap"), "not a bundled vehicle"),
    (("what-if", "replay.mcap", "--driven-anew", "--tables", "t"), "--tables t: a run driven anew solves its sections"),
    (("what-if", "run.mcap", "--driven-anew", "--node", "--guide"), "--node --guide: a simulated run is driven"),
    (
        ("what-if", "replay.mcap", "--driven-anew", "--driver", "perfect", "--friction", "by-advice"),
        "--friction by-advice: needs --driver human",
    ),
    (("what-if", "replay.mcap", "--driver", "perfect", "--population", ""), "--population : needs --participant"),
    (("what-if", "replay.mcap", "--driver", "human", "--participant", "1", "--population", ""), "population"),
    *(
        (("what-if", "replay.mcap", "--open-loop", *word), "in an open loop")
        for word in (
            ("--driver", "human"),
            ("--participant", "1"),
            ("--population", "usual"),
            ("--advice", "top-speed"),
        )
    ),
    (("report", "run.mcap", "--overwrite"), "--overwrite: no file to write is named"),
]
OF_PRECOMPUTE = [
    (
        ("solve", *FLAT, "--buffer", "5", "--strategy", "top-speed", "--refine", "on"),
        "--refine on: needs --strategy optimal",
    ),
    (("solve", *FLAT, "--strategy", "fastest", "--time", "300"), "--time 300.0: the fastest run has no time to keep"),
    (("solve", *FLAT, "--buffer", "5", "--overwrite"), "--overwrite: no file to write is named"),
    (
        ("solve", "flat-6km", "modes.toml", "--buffer", "5", "--mode", "dry", "--load", "dry"),
        "--mode dry: --load dry also names a mode",
    ),
    (("front", *FLAT, "-o", "a.csv"), "--out a.csv: needs --exact"),
    (("front", *FLAT, "--exact", "--refine", "on"), "--refine on: with --exact the solver's runs are not refined"),
    (("front", *FLAT, "--exact", "--plot", "a.png"), "--plot a.png: draws the solver's front"),
    (("journey", "zurich-luzern", "zurich-luzern", "re460-ic", "--dwell", "30"), "--dwell 30.0: needs 'stops'"),
    (("show", "re460-ic", "--overwrite"), "--overwrite: no file to write is named"),
]


@pytest.mark.parametrize(
    ("words", "said"),
    [(("das-sim", *a), b) for a, b in OF_SIM] + [(("das-precompute", *a), b) for a, b in OF_PRECOMPUTE],
)
def test_an_option_that_would_have_no_effect_is_refused_in_one_line(
    folder: Path, words: tuple[str, ...], said: str
) -> None:
    before = sorted(folder.iterdir())
    program, *rest = words
    done = das_sim(*rest, cwd=folder) if program == "das-sim" else das_precompute(folder, *rest)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, "")
    assert line.startswith("error: ")
    assert said in line
    assert sorted(folder.iterdir()) == before

"""Files of commands: no output replaces a file that must stay; unusual values are reported once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from matplotlib.figure import Figure

from das.bus.recording import read_recording
from das.command_line.files import (
    check_outputs,
    check_picture,
    load_route,
    load_vehicle,
    save_figure,
    warn_of_braking,
)
from das.domain.errors import DasError
from das.domain.files import load
from das.domain.vehicle import BrakePolicy, Vehicle
from tests.support.making import REPOSITORY, das_precompute, das_sim

DAY = str(REPOSITORY / "recordings" / "references" / "clear-day.mcap")
REPLAY = str(REPOSITORY / "recordings" / "references" / "replay.mcap")
WRITERS = {
    "run": ("das-sim", "run", "clear-day", "--out", "out.mcap"),
    "replay": ("das-sim", "replay", DAY, "--out", "out.mcap"),
    "check --save": ("das-sim", "check", DAY, "--save", "out.mcap"),
    "what-if": ("das-sim", "what-if", DAY, "-o", "out.mcap"),
    "report": ("das-sim", "report", DAY, "-o", "out.html"),
    "report --table": ("das-sim", "report", DAY, REPLAY, "--table", "out.csv"),
    "view --save": ("das-sim", "view", DAY, "--save", "out.rrd"),
    "trip": ("das-sim", "trip", DAY, "--out", "out.csv"),
    "analyse": ("das-sim", "experiment", "analyse", "study", "-o", "out.html"),
    "solve": ("das-precompute", "solve", "flat-6km", "re460-ic", "--buffer", "10", "--out", "out.csv"),
    "solve --plot": ("das-precompute", "solve", "flat-6km", "re460-ic", "--buffer", "10", "--plot", "out.pdf"),
    "front": ("das-precompute", "front", "flat-6km", "re460-ic", "--exact", "--out", "out.csv"),
    "show": ("das-precompute", "show", "re460-ic", "--plot", "out.png"),
}
"""Every command that writes a file which the user names, with that file last."""


@pytest.mark.parametrize("name", WRITERS)
def test_no_command_replaces_a_file_or_follows_a_link_unasked(name: str, tmp_path: Path) -> None:
    program, *args = WRITERS[name]

    def call(*more: str) -> CompletedProcess[str]:
        return das_sim(*args, *more, cwd=tmp_path) if program == "das-sim" else das_precompute(tmp_path, *args, *more)

    out, target = tmp_path / args[-1], tmp_path / "target"
    out.write_bytes(b"mine")
    done = call()
    said = f"error: {out.name}: exists already; --overwrite replaces it\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)
    assert out.read_bytes() == b"mine"
    out.rename(target)
    for to in (target, tmp_path / "nowhere"):
        out.symlink_to(to)
        done = call("--overwrite")
        said = f"error: {out.name}: is a symbolic link, expected the file itself or a new name\n"
        assert (done.returncode, done.stdout, done.stderr) == (2, "", said)
        assert out.is_symlink()
        out.unlink()
    assert target.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [target]


def test_what_is_to_be_overwritten_is(tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    out.write_bytes(b"mine")
    done = das_precompute(tmp_path, "show", "re460-ic", "--plot", "out.png", "--overwrite")
    assert done.returncode == 0, done.stderr
    assert out.read_bytes().startswith(b"\x89PNG")
    saved = tmp_path / "saved.mcap"
    saved.write_bytes(b"mine")
    assert "written: saved.mcap" in das_sim("check", REPLAY, "--save", "saved.mcap", "--overwrite", cwd=tmp_path).stdout
    assert read_recording(saved).of("advice")


def test_outputs_replace_neither_inputs_nor_one_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.toml").write_text("mine")
    one, other = tmp_path / "a.csv", tmp_path / "b.png"
    check_outputs(one, None, other, inputs=["flat-6km", None, "in.toml"])
    for overwrite in (False, True):
        with pytest.raises(DasError, match=r"in\.toml: the output file is also an input"):
            check_outputs(tmp_path / "in.toml", inputs=["in.toml"], overwrite=overwrite)
    (tmp_path / "link.toml").symlink_to("in.toml")
    with pytest.raises(DasError, match=r"link\.toml: the output file is also an input"):
        check_outputs(tmp_path / "link.toml", inputs=["in.toml"])
    with pytest.raises(DasError, match=r"a\.csv: two outputs name the same file"):
        check_outputs(one, tmp_path / "." / "a.csv")


@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")])
def test_the_suffix_is_the_kind_of_a_picture_and_bytes_repeat(tmp_path: Path, suffix: str, begins: bytes) -> None:
    contents = []
    for i in range(2):
        figure = Figure()
        figure.subplots().plot([1, 2])
        save_figure(tmp_path / f"{i}{suffix}", figure)
        contents.append((tmp_path / f"{i}{suffix}").read_bytes())
    assert contents[0].startswith(begins)
    assert contents[0] == contents[1]


@pytest.mark.parametrize("name", ["run.gif", "run", "png", "run.png.txt"])
def test_other_pictures_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(DasError, match=r"expected a file name that ends in \.png, \.pdf or \.svg"):
        check_picture(tmp_path / name)


def test_unusual_values_are_warned_about_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A train that brakes harder than most, and a line with a limit of 450 km/h; the bundled ones are usual."""
    folder = Path(load.__file__).parents[1] / "catalogue"
    vehicle = (folder / "vehicles" / "re460-ic.toml").read_text(encoding="utf-8")
    (tmp_path / "light.toml").write_text(vehicle.replace("mass_t = 440.0", "mass_t = 400.0"), encoding="utf-8")
    route = (folder / "routes" / "flat-6km.toml").read_text(encoding="utf-8")
    (tmp_path / "quick.toml").write_text(
        route.replace("rows = [[0.0, 160.0]]", "rows = [[0.0, 450.0]]"), encoding="utf-8"
    )
    load_vehicle("re460-ic")
    load_route("zurich-luzern")
    assert capsys.readouterr().err == ""
    for _ in range(2):
        load_vehicle(str(tmp_path / "light.toml"))
        load_route(str(tmp_path / "quick.toml"))
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("warning: ") for line in lines)
    assert sum("quick.toml: speed_limits[0] = 450 km/h" in line for line in lines) == 1
    assert sum("light.toml: all brakes over mass = 1.75" in line for line in lines) == 1
    assert len(set(lines)) == len(lines)


def train(policy: BrakePolicy, name: str, **changes: float) -> Vehicle:
    return replace(load.load_vehicle("re460-ic"), brake_policy=policy, source=name, **changes)


def test_a_train_that_blends_and_states_no_deceleration_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    blended = train(BrakePolicy.BLENDED, "blended.toml", max_deceleration_mps2=float("inf"))
    warn_of_braking(blended)
    warn_of_braking(blended)
    told = capsys.readouterr().err
    assert told.count("blended.toml: max_deceleration is missing") == 1


@pytest.mark.parametrize(
    "vehicle",
    [
        train(BrakePolicy.BLENDED, "stated.toml", max_deceleration_mps2=0.6),
        train(BrakePolicy.ELECTRIC, "electric.toml", max_deceleration_mps2=float("inf")),
        train(BrakePolicy.BLENDED, "bare.toml", max_deceleration_mps2=float("inf"), friction_brake_force_n=0.0),
    ],
)
def test_others_are_not(vehicle: Vehicle, capsys: pytest.CaptureFixture[str]) -> None:
    warn_of_braking(vehicle)
    assert capsys.readouterr().err == ""

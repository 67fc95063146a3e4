"""Where commands write: no output replaces an input, another output, or a file that the user did not give up."""

from __future__ import annotations

from pathlib import Path
from subprocess import CompletedProcess

import pytest

from das.bus.recording import read_recording
from das.command_line.outputs import check_outputs
from das.domain.errors import DasError
from tests.support.making import REPOSITORY, das_precompute, das_sim

DAY = str(REPOSITORY / "recordings" / "references" / "clear-day.mcap")
REPLAY = str(REPOSITORY / "recordings" / "references" / "replay.mcap")
WRITERS = {
    "run": ("das-sim", "run", "clear-day", "--out", "out.mcap"),
    "replay": ("das-sim", "replay", DAY, "--out", "out.mcap"),
    "make-trip": ("das-sim", "make-trip", "--route", "flat-6km", "--vehicle", "re460-ic", "--out", "out.mcap"),
    "recover": ("das-sim", "recover", DAY, "-o", "out.mcap"),
    "what-if": ("das-sim", "what-if", DAY, "-o", "out.mcap"),
    "report": ("das-sim", "report", DAY, "-o", "out.html"),
    "compare": ("das-sim", "compare", DAY, REPLAY, "-o", "out.csv"),
    "compare --plot": ("das-sim", "compare", DAY, REPLAY, "--plot", "out.png"),
    "view --plot": ("das-sim", "view", DAY, "--plot", "out.png"),
    "view --save": ("das-sim", "view", DAY, "--save", "out.rrd"),
    "trip": ("das-sim", "trip", DAY, "--out", "out.csv"),
    "trip --plot": ("das-sim", "trip", DAY, "--plot", "out.svg"),
    "analyse": ("das-sim", "experiment", "analyse", "study", "-o", "out.html"),
    "solve": ("das-precompute", "solve", "flat-6km", "re460-ic", "--buffer", "10", "--out", "out.csv"),
    "solve --plot": ("das-precompute", "solve", "flat-6km", "re460-ic", "--buffer", "10", "--plot", "out.pdf"),
    "front": ("das-precompute", "front", "flat-6km", "re460-ic", "--exact", "--out", "out.csv"),
    "sensitivity": ("das-precompute", "sensitivity", "flat-6km", "re460-ic", "--buffer", "10", "--out", "out.csv"),
    "loss-map": ("das-precompute", "loss-map", "re460-ic", "--out", "out.csv"),
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
    said = f"error: {out.name}: is there already, expected a new file (--overwrite replaces it)\n"
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
    out = tmp_path / "out.csv"
    out.write_bytes(b"mine")
    done = das_precompute(tmp_path, "loss-map", "re460-ic", "--out", "out.csv", "--overwrite")
    assert done.returncode == 0, done.stderr
    assert out.read_text(encoding="utf-8").startswith("speed_kmh,")
    saved = tmp_path / "saved.mcap"
    saved.write_bytes(b"mine")
    assert das_sim("recover", REPLAY, "-o", "saved.mcap", "--overwrite", cwd=tmp_path).returncode == 0
    assert read_recording(saved).of("advice")


def test_outputs_replace_neither_inputs_nor_one_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.toml").write_text("mine")
    one, other = tmp_path / "a.csv", tmp_path / "b.png"
    check_outputs(one, None, other, inputs=["flat-6km", None, "in.toml"])
    for overwrite in (False, True):
        with pytest.raises(DasError, match=r"in\.toml: the file to write is one that is read"):
            check_outputs(tmp_path / "in.toml", inputs=["in.toml"], overwrite=overwrite)
    (tmp_path / "link.toml").symlink_to("in.toml")
    with pytest.raises(DasError, match=r"link\.toml: the file to write is one that is read"):
        check_outputs(tmp_path / "link.toml", inputs=["in.toml"])
    with pytest.raises(DasError, match=r"a\.csv: two outputs name the same file"):
        check_outputs(one, tmp_path / "." / "a.csv")

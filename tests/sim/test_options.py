"""What commands of das-sim say of the recordings that they begin."""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from das.command_line.files import load_route
from das.domain.errors import DasError
from das.domain.route import Altitudes
from sim.cli.options import naming_recorded, new_recording, tell_energy_range
from sim.cli.trips import first_minute


def _interrupted(path: Path, *named: Path | None) -> None:
    with ExitStack() as blocks:
        for one in named:
            blocks.enter_context(naming_recorded(one))
        path.write_bytes(b"something")
        raise KeyboardInterrupt


def test_an_interrupt_names_only_recordings_in_which_there_is_something(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty, begun, earlier = (tmp_path / f"{name}.mcap" for name in ("empty", "begun", "earlier"))
    empty.touch()
    earlier.write_bytes(b"of yesterday")
    os.utime(earlier, (1e9, 1e9))
    with pytest.raises(KeyboardInterrupt):
        _interrupted(begun, empty, None, tmp_path / "none.mcap", begun, earlier)
    assert capsys.readouterr().err == f"recorded so far: {begun}\n"
    with pytest.raises(KeyboardInterrupt), naming_recorded(empty):
        raise KeyboardInterrupt
    assert capsys.readouterr().err == ""


def test_where_nothing_can_be_recorded_the_first_minute_names_no_option_that_it_has_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recordings").touch()
    with pytest.raises(DasError, match=r"expected a folder to write to; start das-sim in a folder where it can write$"):
        first_minute()
    with pytest.raises(DasError, match=r"say where with --out$"):
        new_recording("run")


def test_how_wrong_energies_may_be_is_told_for_a_line_without_altitudes(capsys: pytest.CaptureFixture[str]) -> None:
    for altitudes, told in ((Altitudes.NONE, "No altitudes: energies are"), (Altitudes.LEVEL, "")):
        tell_energy_range(replace(load_route("flat-6km"), altitudes=altitudes))
        said = capsys.readouterr().out
        assert said.startswith(told) if told else not said

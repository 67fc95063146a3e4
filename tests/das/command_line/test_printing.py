"""What is printed: markup and control characters of data do nothing, tables keep their figures, errors are one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich import box
from rich.table import Table

from das.command_line.loading import load_route, load_vehicle
from das.command_line.outputs import check_picture, offscreen_pyplot, save_figure
from das.command_line.printing import LONGEST_LINE, one_line, paragraph, print_table, tell, visible, warn
from das.command_line.running import run_command
from das.domain.errors import DasError
from das.domain.files import load

HOSTILE = "[/red] [bold]Bern[/bold] :warning: \x1b[31mred\x1b[0m \x9b2J \u202eneB"


def test_control_characters_are_shown_and_letters_stay() -> None:
    assert visible("Zürich – λ\t∞\n") == "Zürich – λ\t∞\n"
    assert visible("\x1b[2J\x07\x7f\x9b\u202e\u2028\r") == r"\x1b[2J\x07\x7f\x9b\u202e\u2028\r"


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_name_cannot_break_a_table(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    table = Table(title=HOSTILE, box=box.SIMPLE_HEAD)
    table.add_column("[/blue]", no_wrap=True)
    table.add_column("figure", justify="right", no_wrap=True)
    table.add_row(HOSTILE, "123456789.123")
    print_table(table, {"[/x]": "\x1b[1m a legend"})
    said = capsys.readouterr().out
    assert "\x1b" not in said
    assert "\x9b" not in said
    assert "[/red] [bold]Bern[/bold] :warning: \\x1b[31mred" in said
    assert "[/blue]" in said
    assert "123456789.123" in said
    assert "…" not in said
    assert r"[/x]: \x1b[1m a legend." in " ".join(said.split())


def test_tables_are_eighty_wide_where_nobody_says_how_wide(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    table = Table("what", "figure", box=box.SIMPLE_HEAD)
    table.add_row("word " * 60, "1")
    print_table(table, {"figure": "word " * 60})
    assert {len(line) <= 80 for line in capsys.readouterr().out.splitlines()} == {True}


def test_text_and_warnings_are_harmless(capsys: pytest.CaptureFixture[str]) -> None:
    tell(HOSTILE)
    paragraph(HOSTILE)
    warn(f"{HOSTILE}\nsecond line")
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert said.err.startswith("warning: [/red]")
    assert said.err.count("\n") == 1


def test_a_long_message_loses_its_middle_and_nothing_else() -> None:
    line = one_line("file.toml: name = '" + "x" * 50_000_000 + "': expected a name")
    assert len(line) <= LONGEST_LINE
    assert line.startswith("file.toml: name = 'xxx")
    assert line.endswith("xxx': expected a name")
    assert one_line("a\n b\x1b[0m") == r"a b\x1b[0m"


def test_an_error_with_control_characters_is_one_short_line(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> None:
        raise DasError("stop '\x1b[2J\x1b]0;owned\x07'\n" + "y" * 10_000)

    with pytest.raises(SystemExit) as end:
        run_command(main)
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.startswith(r"error: stop '\x1b[2J\x1b]0;owned\x07'\nyyy")
    assert said.count("\n") == 1
    assert len(said) <= LONGEST_LINE + len("error: \n")


@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")])
def test_the_suffix_is_the_kind_of_a_picture_and_bytes_repeat(tmp_path: Path, suffix: str, begins: bytes) -> None:
    pyplot = offscreen_pyplot()
    contents = []
    with pyplot.rc_context({"svg.hashsalt": "test"}):
        for i in range(2):
            figure, axes = pyplot.subplots()
            axes.plot([1, 2])
            save_figure(tmp_path / f"{i}{suffix}", figure)
            pyplot.close(figure)
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

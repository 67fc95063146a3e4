"""Every command of das-precompute: its help, its examples, how it refuses, and that its tables fit 80 columns."""

from __future__ import annotations

import inspect
import json
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest

from das.command_line.application import Entry, with_options
from das.domain.files.load import catalogue, load_route, load_vehicle
from precompute.cli.program import COMMANDS, GONE, NAME
from tests.support.making import REPOSITORY, das_precompute, in_a_process

EVERY = pytest.mark.parametrize("entry", COMMANDS, ids=[entry.name for entry in COMMANDS])


@EVERY
def test_the_table_of_commands_says_what_their_docstrings_say(entry: Entry) -> None:
    doc = inspect.getdoc(entry.function())
    assert doc is not None
    assert doc.splitlines()[0] == entry.summary


@EVERY
def test_every_command_explains_itself_within_80_columns_and_shows_examples(entry: Entry, tmp_path: Path) -> None:
    done = das_precompute(tmp_path, entry.name, "-h")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == das_precompute(tmp_path, entry.name, "--help").stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 80
    assert " ".join(entry.summary.split()) in " ".join(done.stdout.split())
    assert entry.examples
    for example in entry.examples:
        assert f"\n  {example}\n" in f"{done.stdout}\n"


@EVERY
def test_the_examples_have_only_options_that_there_are(entry: Entry) -> None:
    options = {name for parameter in entry.load().params for name in (*parameter.opts, *parameter.secondary_opts)}
    for example in entry.examples:
        words = shlex.split(example)
        assert words[:2] == [NAME, entry.name]
        assert {word for word in words if word.startswith("-")} <= options


@EVERY
def test_every_option_has_a_help_of_a_sentence(entry: Entry) -> None:
    for parameter in entry.load().params:
        text = parameter.help
        assert text, parameter.name
        assert text[0].isupper(), text
        assert text.rstrip().endswith((".", "]", "].")), text


@EVERY
def test_every_command_refuses_a_wrong_option_in_one_line(entry: Entry, tmp_path: Path) -> None:
    done = das_precompute(tmp_path, entry.name, "--no-such-option")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: No such option: --no-such-option")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("name", GONE)
def test_a_command_that_is_gone_says_what_to_run_instead(name: str, tmp_path: Path) -> None:
    for more in ((), ("-h",), ("--check", "-o", "x")):
        done = das_precompute(tmp_path, name, *more)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"error: {name} is no longer a command of this program; run instead: {GONE[name]}\n"
        module = re.search(r"docs\.studies\.\w+", done.stderr)
        assert module is not None
        assert (REPOSITORY / f"{module[0].replace('.', '/')}.py").is_file()
    assert f"  {name} " not in das_precompute(tmp_path, "-h").stdout


@EVERY
def test_an_output_is_called_out_and_a_picture_plot(entry: Entry) -> None:
    spelled = {name for parameter in entry.load().params for name in parameter.opts}
    assert not spelled & {"--output", "--csv", "--png", "--write", "--save"}
    assert ("--out" in spelled) is ("-o" in spelled)


def test_no_option_is_declared_by_two_spellings() -> None:
    """A Python name is one spelling in all commands, and the other way round."""
    by_name: dict[str, set[tuple[str, ...]]] = {}
    for entry in COMMANDS:
        for parameter in entry.load().params:
            if parameter.param_type_name == "option":
                by_name.setdefault(parameter.name or "", set()).add(tuple(sorted(parameter.opts)))
    assert {name: spellings for name, spellings in by_name.items() if len(spellings) > 1} == {}


def test_a_function_of_groups_can_be_called_with_them() -> None:
    """The parameters of every command as typer sees them are the fields of its groups."""
    for entry in COMMANDS:
        function = entry.function()
        assert len(inspect.signature(function).parameters) <= 6, entry.name
        assert len(inspect.signature(with_options(function)).parameters) >= len(inspect.signature(function).parameters)


PRINTED = {
    "catalogue": ("catalogue",),
    "solve": ("solve", "flat-6km", "re460-ic", "--buffer", "7"),
    "rms": ("solve", "flat-6km", "re460-ic", "--buffer", "7", "--strategy", "rms"),
    "front": ("front", "zurich-luzern", "re460-ic", "--to", "Thalwil", "--level", "l2"),
    "exact": ("front", "flat-6km", "re460-ic", "--exact", "--max-buffer", "1"),
    "calm": ("calm", "flat-6km", "re460-ic", "--prices", "0.03"),
    "journey": ("journey", "zurich-luzern", "zurich-luzern", "re460-ic"),
    "sensitivity": ("sensitivity", "flat-6km", "re460-ic", "--buffer", "7", "--vary", "mass=±10%, wind=-20..20"),
    "loss-map": ("loss-map", "re460-ic"),
}
EXPLAINED = {
    "solve": ("λ: ", "gap: ", "fit: "),
    "front": ("λ: ", "gap: ", "saved: "),
    "exact": ("supported: ", "solver: "),
    "calm": ("price: ", "chg: ", "/min: ", "short: ", "more: "),
    "journey": ("λ: ", "buffer: ", "≥, ≤, =: "),
    "sensitivity": ("per step: ", "off plan: ", "on time: ", "saved: "),
    "loss-map": ("mean/in: ", "|cruising|"),
    "catalogue": ("levels: ",),
    "rms": ("fit: ",),
}


@pytest.mark.parametrize("name", PRINTED)
def test_what_is_printed_fits_80_columns_and_explains_its_abbreviations(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    done = das_precompute(tmp_path, *PRINTED[name])
    assert (done.returncode, done.stderr) == (0, "")
    tables = [line for line in done.stdout.splitlines() if ".toml" not in line]  # paths are as long as they are
    assert max(len(line.rstrip()) for line in tables) <= 80
    if name != "catalogue":  # there "…" ends a source that is longer
        assert "…" not in done.stdout.replace(" … ", "")
    for explained in EXPLAINED[name]:
        assert explained in done.stdout


@pytest.mark.processes
def test_the_catalogue_is_what_the_files_say(tmp_path: Path) -> None:
    done = in_a_process("precompute.cli", "catalogue", "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert [one["id"] for one in found["routes"]] == list(catalogue("routes"))
    assert [one["id"] for one in found["vehicles"]] == list(catalogue("vehicles"))
    for one in found["routes"]:
        route = load_route(one["id"])
        assert (one["length_m"], one["name"]) == (route.length_m, route.name)
        assert [(stop["name"], stop["position_m"]) for stop in one["stops"]] == [
            (stop.name, stop.position_m) for stop in route.stops
        ]
    for one in found["vehicles"]:
        vehicle = load_vehicle(one["id"])
        assert (one["mass_kg"], one["max_power_w"]) == (vehicle.mass_kg, vehicle.traction.max_power_w)
        assert one["max_speed_mps"] == vehicle.max_speed_mps
        assert one["levels"] == ["l3", "l0-noreg", "l0-reg", "l1", "l2"]
        written = tomllib.loads(Path(one["file"]).read_text(encoding="utf-8"))["vehicle"]
        assert one["source"] == " ".join(written["source"].split())


REFUSED: dict[str, tuple[tuple[str, ...], str]] = {
    "picture of no kind": (
        ("solve", "flat-6km", "re460-ic", "--buffer", "7", "--plot", "run.gif"),
        "run.gif: expected",
    ),
    "map over its input": (
        ("loss-map", "map.csv", "--out", "map.csv"),
        "map.csv: the file to write is one that is read",
    ),
    "run over its map": (
        ("solve", "flat-6km", "re460-ic", "--buffer", "7", "--loss-map", "map.csv", "-o", "./map.csv"),
        "map.csv: the file to write is one that is read",
    ),
    "rows over the vehicle": (
        ("sensitivity", "flat-6km", "own.toml", "--buffer", "7", "-o", "own.toml"),
        "own.toml: the file to write is one that is read",
    ),
    "front over the vehicle": (
        ("front", "flat-6km", "own.toml", "--exact", "-o", "own.toml"),
        "own.toml: the file to write is one that is read",
    ),
    "plan over the journey": (
        ("journey", "plan.toml", "flat-6km", "own.toml", "-o", "plan.toml"),
        "plan.toml: the file to write is one that is read",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_no_output_replaces_an_input(name: str, tmp_path: Path) -> None:
    for file in ("map.csv", "own.toml", "plan.toml"):
        (tmp_path / file).write_text("mine")
    words, expected = REFUSED[name]
    done: subprocess.CompletedProcess[str] = das_precompute(tmp_path, *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert expected in done.stderr
    assert done.stderr.count("\n") == 1
    assert all((tmp_path / file).read_text() == "mine" for file in ("map.csv", "own.toml", "plan.toml"))


@pytest.mark.parametrize(("suffix", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_tells_the_kind_of_a_picture(suffix: str, begins: bytes, tmp_path: Path) -> None:
    done = das_precompute(tmp_path, "loss-map", "re460-ic", "--plot", f"map.{suffix}", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / f"map.{suffix}").read_bytes().startswith(begins)

"""Every command of das-precompute: its help and examples, what it refuses, and tables that fit 80 columns."""

from __future__ import annotations

import inspect
import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest

from das.command_line.application import Entry, imported
from das.domain.files.load import catalogue, load_route, load_vehicle
from precompute.cli.program import COMMANDS, GONE, NAME
from tests.support.benchmark import TRAIN
from tests.support.crossing import few
from tests.support.making import REPOSITORY, das_precompute, in_a_process, printed

WORDS: dict[str, Entry] = {
    **{entry.name: entry for entry in COMMANDS if entry.where},
    **{f"{entry.name} {one.name}": one for entry in COMMANDS for one in entry.entries},
}
"""Every command by the words that start it."""


def test_every_command_explains_itself_within_80_columns_and_shows_examples(tmp_path: Path) -> None:
    for words, entry in WORDS.items():
        out = printed(tmp_path, *words.split(), "--help")
        assert max(len(line) for line in out.splitlines()) <= 80, words
        assert (inspect.getdoc(imported(entry.where)) or "").splitlines()[0] == entry.summary
        assert " ".join(entry.summary.split()) in " ".join(out.split())
        options = {name for parameter in entry.load().params for name in (*parameter.opts, *parameter.secondary_opts)}
        assert entry.examples, words
        for example in entry.examples:
            assert f"\n  {example}\n" in f"{out}\n"
            typed = shlex.split(example)
            assert f"{' '.join(typed)} ".startswith(f"{NAME} {words} ")
            assert {word for word in typed if word.startswith("-")} <= options, words


def test_options_have_a_help_of_a_sentence_and_one_spelling_in_all_commands() -> None:
    """A Python name is one spelling in all commands, and a command's function takes its options in few groups."""
    spellings: dict[str, set[tuple[str, ...]]] = {}
    for words, entry in WORDS.items():
        for parameter in entry.load().params:
            assert re.match(r"[A-Z].*(\.|\])\s*$", parameter.help or "", re.DOTALL), (words, parameter.name)
            if parameter.param_type_name == "option":
                spellings.setdefault(parameter.name or "", set()).add(tuple(sorted(parameter.opts)))
        assert len(inspect.signature(imported(entry.where)).parameters) <= 6, words
    assert {name: found for name, found in spellings.items() if len(found) > 1} == {}
    assert spellings["out"] == {("--out", "-o")}
    spelled = {name for found in spellings.values() for names in found for name in names}
    assert not spelled & {"--output", "--csv", "--png", "--write", "--save"}


PRINTED = {
    "show": "levels: ",
    "solve flat-6km re460-ic --buffer 7": "gap: ",
    "front zurich-luzern re460-ic --to Thalwil --level l2 --refine off": "saved: ",
    "journey short.toml zurich-luzern re460-ic": "≥, ≤, =: ",
    "show re460-ic --losses": "|cruising|",
    "front flat-6km re460-ic --exact --buffers 0,1": "supported: ",
}
"""An abbreviation that a command explains below its table; the last takes longer."""

SHORT_JOURNEY = """
schema_version = 1
[journey]
id = "short"
name = "Zürich HB – Thalwil, 07:10 (illustrative)"
[[stops]]
stop = "Zürich HB"
departure = "07:10:00"
[[passings]]
name = "In the Zimmerberg tunnel"
position_km = 6.0
earliest = "07:15:45"
[[stops]]
stop = "Thalwil"
arrival = "07:19:30"
"""


@pytest.mark.parametrize("command", few(PRINTED, list(PRINTED)[:-1]))
def test_what_is_printed_fits_80_columns_and_explains_its_abbreviations(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "short.toml").write_text(SHORT_JOURNEY, encoding="utf-8")
    out = printed(tmp_path, *shlex.split(command))
    tables = [line for line in out.splitlines() if ".toml" not in line]  # paths are as long as they are
    assert max(len(line.rstrip()) for line in tables) <= 80
    if command != "show":  # there "…" ends a source that is longer
        assert "…" not in out.replace(" … ", "")
    assert PRINTED[command] in out


def test_the_catalogue_is_what_the_files_say(tmp_path: Path) -> None:
    done = in_a_process("precompute.cli", "show", "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert [one["id"] for one in found["routes"]] == list(catalogue("routes"))
    assert [one["id"] for one in found["vehicles"]] == list(catalogue("vehicles"))
    for one in found["routes"]:
        route = load_route(one["id"])
        assert (one["length_m"], one["name"]) == (route.length_m, route.name)
        stops = [(stop["name"], stop["position_m"]) for stop in one["stops"]]
        assert stops == [(stop.name, stop.position_m) for stop in route.stops]
    for one in found["vehicles"]:
        vehicle = load_vehicle(one["id"])
        assert (one["mass_kg"], one["max_power_w"]) == (vehicle.mass_kg, vehicle.traction.max_power_w)
        assert one["max_speed_mps"] == vehicle.max_speed_mps
        own = ["l3", "l0-noreg", "l0-reg", "l1", "l2"] if "re460" in one["id"] else ["own", "l0-noreg", "l0-reg", "l1"]
        assert one["levels"] == own
        written = tomllib.loads(Path(one["file"]).read_text(encoding="utf-8"))["vehicle"]
        assert one["source"] == " ".join(written["source"].split())


@pytest.mark.parametrize(("suffix", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_tells_the_kind_of_a_picture(suffix: str, begins: bytes, tmp_path: Path) -> None:
    printed(tmp_path, "show", "re460-ic", "--losses", "--plot", f"map.{suffix}", "--json")
    assert (tmp_path / f"map.{suffix}").read_bytes().startswith(begins)


# --- refused in one line ----------------------------------------------------------------------------------------

SOLVE, FRONT = (f"{name} flat-6km re460-ic" for name in ("solve", "front"))
ONE_TIME = "give either --time (s) or --buffer (%)"
READ = "the output file is also an input"
GONE_OPTIONS = [name for name in GONE if name.startswith("-")]
REFUSED = {
    f"{SOLVE}": ONE_TIME,
    f"{SOLVE} --time 220 --buffer 7": ONE_TIME,
    f"{SOLVE} --strategy top-speed": ONE_TIME,
    f"{SOLVE} --strategy top-speed --time 220 --buffer 7": ONE_TIME,
    f"{SOLVE} --strategy fastest --time 220": "--time 220.0: the fastest run has no time to keep",
    f"{FRONT} --exact --refine off": "--refine off: with --exact the solver's runs are not refined",
    f"{SOLVE} --strategy top-speed --buffer 7 --refine off": "--refine off: needs --strategy optimal",
    f"{SOLVE} --strategy slow --buffer 7": "is not one of 'optimal', 'fastest', 'top-speed'",
    f"{SOLVE} --time 0": "time 0.0 s: expected a finite time > 0 s",
    f"{SOLVE} --time nan": "time nan s: expected a finite time > 0 s",
    f"{SOLVE} --time soon": "--time",
    f"{SOLVE} --buffer nan": "buffer nan %: expected a number from 0",
    f"{SOLVE} --buffer -1": "buffer -1.0 %: expected a number from 0",
    f"{SOLVE} --buffer 7 --from Zug": "no stop 'Zug'; it has 1: A, 2: B",
    f"{SOLVE} --buffer 7 --from ²": "no stop '²'; it has 1: A, 2: B",
    f"{SOLVE} --buffer 7 --from B --to A": "'A' does not come after 'B' in this dir",
    f"{SOLVE} --buffer 7 --loss-map small.csv": (
        "small.csv: the state 300.0 kN at 0.0 km/h (0 kW at the wheel) is outside the loss map"
    ),
    f"{SOLVE} --buffer 7 --loss-map no.csv": "no.csv: cannot be read (No such file",
    f"{SOLVE} --buffer 7 --bound tight": (
        "--bound is no longer an option of this command: use docs.studies.tight_bound.tightened in Python"
    ),
    f"{SOLVE} --buffer 7 --refine much": "--refine much: expected off or on",
    f"{SOLVE} --buffer 7 --out no/run.csv": "no/run.csv: no such folder no",
    f"{SOLVE} --buffer 7 --out folder": "folder: is a folder, expected a file to write",
    f"{SOLVE} --buffer 7 --plot small.csv/a.png": "small.csv/a.png: no such folder",
    f"{SOLVE} --buffer 7 --plot run.gif": "run.gif: expected",
    f"{SOLVE} --buffer 7 --loss-map map.csv -o ./map.csv": f"map.csv: {READ}",
    "solve flat-6km nix.json --buffer 7": "nix.json: no such file",
    "solve nix re460-ic --buffer 7": "nix: not a bundled route (flat-6km, zurich-luzern)",
    "solve flat-6km lb.toml --buffer 7": "lb.toml: vehicle.mass_lb = 970000.0: expecte",
    "solve flat-6km train.json --buffer 7 --level l3": (
        "train.json: no data for level l3 (it has l0-noreg, l0-reg, own); give a loss map with --loss-map"
    ),
    f"{FRONT} --buffers 0,x": "--buffers 0,x: expected numbers separated",
    f"{FRONT} --exact --plot a.png": "--plot a.png: draws the solver's front only, and cannot be combined with --exact",
    f"{FRONT} --plot a.gif": "a.gif: expected a file name that ends in .png, .pdf or .svg",
    f"{FRONT} --exact --buffers nan": "buffer nan %: expected a number from 0",
    f"{FRONT} --exact --out no/front.csv": "no/front.csv: no such folder no",
    "front flat-6km own.toml --exact -o own.toml": f"own.toml: {READ}",
    "journey plan.toml flat-6km own.toml -o plan.toml": f"plan.toml: {READ}",
    "build trainless.toml -o tables": "error: trainless.toml: trains is missing: expected at least one [[trains]]\n",
    **{f"{FRONT} {name} 1": f"{name} is no longer an option of this command: {GONE[name]}" for name in GONE_OPTIONS},
    **{
        f"{name} x --y": f"{name} is no longer a command of this program; run instead: {GONE[name]}"
        for name in GONE
        if name not in GONE_OPTIONS
    },
    "show nix": "nix: expected a route, vehicle, journey, loss map or tables, or one of CH_Stadler_FLIRT_TPF",
    "show no.csv": "no.csv: cannot be read",
    "show re460-ic --losses --plot no/where.png": "no/where.png: no such folder",
    "show l2.toml --losses": "l2.toml: no data for level l3",
    "show --plot a.png": "--plot a.png: needs a file",
    "show re460-ic --reverse": "--reverse: re460-ic is a vehicle",
    "show flat-6km --load full": "--load full: flat-6km is a route",
    "show folder --plot a.png": "--plot a.png: folder is tables",
    "show zurich-luzern --vehicle re460-ic": "--vehicle re460-ic: zurich-luzern is a route",
    "show map.png": "map.png: expected a route, vehicle, journey, loss map or tables",
    **{
        f"{group.name} {word}": f"{word} is no longer a command of this program; run instead: {instead}"
        for group in COMMANDS
        for word, instead in group.gone.items()
    },
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the refused commands name: a small loss map, trains, a plan, and files that are nobody's."""
    folder = tmp_path_factory.mktemp("refused")
    small = [f"{v},{f},1000\n" for v in range(0, 201, 20) for f in range(-100_000, 100_001, 10_000)]
    bundled = (REPOSITORY / "das/domain/catalogue/vehicles/re460-ic.toml").read_text(encoding="utf-8")
    head = bundled[: bundled.index("[losses]")]
    files = {
        "small.csv": "speed_kmh,force_n,loss_w\n" + "".join(small),
        "lb.toml": bundled.replace("mass_t = 440.0", "mass_lb = 970000.0"),
        "l2.toml": head + '[losses]\ndefault = "l2"\n[losses.l2]\nmean_efficiency_ratio = 0.9\n',
        "train.json": json.dumps(TRAIN),
        "trainless.toml": 'schema_version = 1\n[[routes]]\nroute = "flat-6km"\n',
        **dict.fromkeys(("map.csv", "own.toml", "plan.toml", "folder/file"), "mine"),
    }
    (folder / "folder").mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_done_is_refused_in_one_line_and_changes_no_file(command: str, folder: Path) -> None:
    def content() -> dict[str, bytes]:
        return {str(path): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}

    before = content()
    done = das_precompute(folder, *shlex.split(command))
    assert (done.returncode, done.stdout) == (2, "")
    assert REFUSED[command] in done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert content() == before

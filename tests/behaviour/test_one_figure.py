"""A figure of a drive is the same in every command, and what one command refuses all refuse in the same words.

Some forty recordings go to every command: the bundled trip, real trips, a day of every scenario, cut files, and trips
with the wrong train. All figures that two commands state under one name are compared.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

import sim
from das.domain.errors import DasError
from das.domain.files.load import catalogue
from sim.cli.trips import bundled_recording
from sim.drive.above_optimum import NO_PART, NOT_WHOLE
from sim.drive.comparison import AlignedDrives, drives_on_track
from sim.drive.comparison import as_dict as comparison_dict
from sim.drive.drive import Drive
from sim.drivers.kinds import Presentation
from sim.recording.course import known
from sim.review.page import as_dict as report_dict
from sim.review.page import subject_of
from sim.world.scenario import bundled_scenarios
from tests.support.benchmark import shared_data, track_path, train_path
from tests.support.flat_days import FLAT
from tests.support.making import REPOSITORY, das_sim, das_sim_json, refusal

REFERENCES: Final = REPOSITORY / "recordings" / "references"
TOLERANCES: Final = {
    **dict.fromkeys(("late_s", "arrived_late_s", "departed_late_s", "arrived_s", "departed_s", "trip_s"), 0.5),
    **dict.fromkeys(("over_limit_s", "stopping_error_m"), 2.0),
    "over_limit_mps": 0.2,
}
"""How far apart figures of one name may be; positions once a second tell times less exactly than the simulator does.
Figures that are not named here are equal but for rounding."""
NOT_FIGURES: Final = {"file", "recording", "label", "train", "first_different_advice"}
"""Names of what says where a figure is from."""
FASTER: Final = "the trip reaches "
"""How the refusal begins for an open trip that is faster than the train, so that it has no part to compare."""
LISTS: Final = {"legs": "section", "sections": "section", "stops": "stop"}
"""Names of lists with figures of their own, and of one entry."""
Figures = Mapping[str, Any]


def run(folder: Path, *args: str) -> dict[str, Any]:
    """What a command prints with --json."""
    return das_sim_json(*args, cwd=folder)


def figures(told: Figures) -> dict[str, Any]:
    """All figures of what a command printed, those of sections and stops by their numbers."""
    named = {name: value for name, value in told.items() if not isinstance(value, dict | list)}
    for name in LISTS.keys() & told.keys():
        for i, one in enumerate(told[name]):
            named |= {f"{LISTS[name]} {i}: {inner}": value for inner, value in figures(one).items()}
    return {name: value for name, value in named.items() if name not in NOT_FIGURES}


def same(name: str, one: Any, other: Any) -> bool:
    if not isinstance(one, float) or not isinstance(other, float | int):
        return bool(one == other)
    return bool(one == pytest.approx(other, abs=TOLERANCES.get(name.rpartition(": ")[2], 1e-6), nan_ok=True))


def check_same(**sources: Figures) -> set[str]:
    """Every figure is the same in all sources that state it; the names of those that more than one states."""
    names = {name for found in sources.values() for name in found}
    told = {name: {source: found[name] for source, found in sources.items() if name in found} for name in names}
    for name, by_source in sorted(told.items()):
        first, *others = by_source.values()
        assert all(same(name, first, other) for other in others), f"{name}: {by_source}"
    return {name for name, by_source in told.items() if len(by_source) > 1}


def of_report(path: Path) -> tuple[Drive, dict[str, Figures]]:
    """A drive, and what a report says of it: on its first page, of its energy, and else."""
    subject = subject_of(path)
    (told,) = report_dict([subject], None, "")["drives"]
    return subject.drive, {
        "report": figures(told),
        "page": figures(told["first_page"]),
        "causes": figures(told["energy"] or {}),
    }


def of_comparison(*drives: Drive) -> Iterator[dict[str, Any]]:
    """What a comparison says of each drive."""
    for one in comparison_dict(AlignedDrives.of(drives_on_track(drives)))["drives"]:
        yield figures(one)


def of_recording(path: Path) -> dict[str, Figures]:
    """What every command says of a recording that needs nothing else: report, energy, comparison."""
    drive, told = of_report(path)
    if drive.energy.above is None or drive.energy.not_comparable.startswith((NOT_WHOLE, FASTER)):
        with pytest.raises(DasError, match=f"{path}: .*{re.escape(drive.energy.not_comparable)}"):
            list(of_comparison(drive, drive))
    else:
        told["comparison"], again = of_comparison(drive, drive)
        assert again["more_energy_kwh"] == 0.0
        assert again["more_energy_equal_arrival_kwh"] in (0.0, None)
        assert (again["equal_arrival_not_comparable"] or "") == drive.energy.not_comparable
    told["library"] = {"not_comparable": drive.energy.not_comparable or None, "late_s": known(drive.late_s)}
    told["library"]["instructions"] = drive.figures.instructions.instructions
    if not drive.energy.not_comparable:
        assert drive.energy.attribution is not None
        told["library"] |= figures(drive.energy.above.as_dict() if drive.energy.above else {})
        assert told["causes"]["energy_kwh"] is not None
    assert check_same(**told) >= {"measured"} if "comparison" in told else {"not_comparable"}
    return told


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated day of four minutes without advice."""
    found = tmp_path_factory.mktemp("figures")
    (found / "flat.toml").write_text(FLAT, encoding="utf-8")
    told = run(found, "run", "flat.toml", "--seed", "1", "--advice", "none", "-o", "none.mcap")
    (found / "none.json").write_text(json.dumps(told), encoding="utf-8")
    return found


def slow_train(folder: Path, max_speed_kmh: int) -> str:
    """The bundled train with another top speed; files of trains that it names are beside it."""
    text = catalogue("vehicles")["re460-ic"].read_text(encoding="utf-8")
    line = next(one for one in text.splitlines() if one.startswith("max_speed_kmh"))
    slow = folder / f"to-{max_speed_kmh}"
    slow.mkdir(exist_ok=True)
    for name, path in catalogue("vehicles").items():
        changed = path.read_text(encoding="utf-8").replace(line, f"max_speed_kmh = {max_speed_kmh}")
        (slow / f"{name}.toml").write_text(changed)
    return str(slow / "re460-ic.toml")


@pytest.mark.slow
def test_a_simulated_day_has_one_set_of_figures(folder: Path) -> None:
    told = json.loads((folder / "none.json").read_text())
    api = sim.run_day(folder / "flat.toml", 1, driver="human", advice="none").outcome
    energy = run(folder, "report", "none.mcap")["drives"][0]["energy"]
    compared = check_same(
        run=figures(told), api=figures(api), energy=figures(energy), **of_recording(folder / "none.mcap")
    )
    assert compared >= {"energy_kwh", "energy_optimum_kwh", "above_optimum_kwh", "late_s", "over_limit_s"}
    assert told["above_optimum_ratio"] == pytest.approx(told["above_optimum_kwh"] / told["energy_optimum_kwh"])


@pytest.mark.slow
def test_what_advice_saved_is_one_figure_at_equal_arrival(folder: Path) -> None:
    """By what-if, comparison, batch and the energies above the optimum."""
    before = json.loads((folder / "none.json").read_text())
    found = run(folder, "what-if", "none.mcap", "--advice", "guide", "-o", "guide.mcap")
    recorded, what_if = (figures(one) for one in found["comparison"]["drives"])
    drives = [Drive.read(folder / name) for name in ("none.mcap", "guide.mcap")]
    first, other = of_comparison(*drives)
    check_same(comparison=first, run={**figures(before), "time_s": first["time_s"]}, recorded=recorded)
    check_same(what_if=what_if, comparison=other)
    saved_kwh = before["above_optimum_kwh"] - other["above_optimum_kwh"]
    assert other["saved_by_advice_kwh"] == pytest.approx(saved_kwh)
    optimum_kwh = 0.5 * (before["energy_optimum_kwh"] + other["energy_optimum_kwh"])
    assert other["saved_by_advice_ratio"] == pytest.approx(saved_kwh / optimum_kwh)
    assert other["more_energy_equal_arrival_ratio"] == pytest.approx(-saved_kwh / optimum_kwh)
    assert what_if["more_energy_kwh"] == pytest.approx(what_if["times_worth_kwh"] - saved_kwh)
    back = list(of_comparison(*reversed(drives)))[1]
    assert back["saved_by_advice_kwh"] == pytest.approx(saved_kwh)
    same = (other["saved_by_advice_ratio"], back["saved_by_advice_ratio"], back["more_energy_equal_arrival_ratio"])
    assert same == pytest.approx((other["saved_by_advice_ratio"],) * 3)


@pytest.mark.nightly
def test_days_say_the_same_as_a_run_and_a_what_if(folder: Path) -> None:
    days = ("experiment", "run", "--scenario", "flat.toml", "--seeds", "1", "--advice", "none,guide")
    told = run(folder, *days, "--out", "days", "--workers", "1")
    run(folder, "what-if", "none.mcap", "--advice", "guide", "-o", "again.mcap")
    drives = [Drive.read(folder / name) for name in ("none.mcap", "again.mcap")]
    *_, other = of_comparison(*drives)
    (saved,) = told["savings"]
    assert saved["saved_kwh"] == pytest.approx(other["saved_by_advice_kwh"], abs=1e-6)
    assert saved["saved_ratio"] == pytest.approx(other["saved_by_advice_ratio"], abs=1e-6)
    with (folder / "days" / "trials.csv").open(newline="") as file:
        (row,) = (one for one in csv.DictReader(file) if one["presentation"] == "none")
    found = json.loads((folder / "none.json").read_text())
    both = [name for name in found if row.get(name) and isinstance(found[name], float)]
    assert len(both) > 15
    assert [float(row[name]) for name in both] == pytest.approx([found[name] for name in both])


@pytest.mark.nightly
@pytest.mark.parametrize("trip", ["bundled", "simulated"])
def test_a_trip_its_replay_and_a_what_if_of_it_have_one_set_of_figures(folder: Path, trip: str) -> None:
    """The what-if of a trip by positions keeps its brakes: motors first, on both sides."""
    source = bundled_recording() if trip == "bundled" else folder / "none.mcap"
    told = run(folder, "replay", str(source), "-o", f"{trip}.mcap")
    looked_at = run(folder, "trip", str(source))
    path, new = folder / f"{trip}.mcap", folder / f"{trip}-guide.mcap"
    compared = check_same(replay=figures(told), trip=figures(looked_at["energy"]), **of_recording(path))
    assert "above_optimum_likely_low_kwh" in compared
    if trip == "bundled":  # the simulator measured the energy of the other
        check_same(replay=figures(told), **of_recording(source))
    found = run(folder, "what-if", path.name, "--advice", "guide", "-o", new.name)["comparison"]["drives"]
    assert found[0]["energy_kwh"] == pytest.approx(told["energy_kwh"])
    two_runs = "this needs two simulated runs with the same disturbances, one of them without advice"
    assert found[1]["saved_by_advice_not_comparable"] == two_runs
    *_, other = of_comparison(Drive.read(path), Drive.read(new))
    check_same(what_if=figures(found[1]), again=other)
    of_recording(new)


@pytest.mark.nightly
@pytest.mark.parametrize("train", ["CH_Stadler_KISS_SBB", "CH_Stadler_FLIRT_TPF", "NL_Intercity_VIRM6"])
@pytest.mark.parametrize("name", ["clean", "dropouts", "cut"])
def test_a_real_trip_has_one_set_of_figures_or_one_refusal(tmp_path: Path, name: str, train: str) -> None:
    """With each of three trains, of which one or the other cannot have driven so, and without its second half."""
    trips = shared_data(module=False) / "trips"
    record = trips / f"kolback_vasteras_{'clean' if name == 'cut' else name}.csv"
    if name == "cut":
        rows = record.read_text(encoding="utf-8").splitlines(keepends=True)
        record = tmp_path / "cut.csv"
        record.write_text("".join(rows[: len(rows) // 2]), encoding="utf-8")
    options = [
        *("--route", str(track_path("SE_Vasteras_Kolback")), "--vehicle", str(train_path(train))),
        *("--reverse", "--posts", str(trips / "kolback_vasteras_kmposts.csv")),
    ]
    told = run(tmp_path, "replay", str(record), *options, "-o", "replayed.mcap")
    looked_at = run(tmp_path, "trip", str(record), *options)
    found = of_recording(tmp_path / "replayed.mcap")
    check_same(replay=figures(told), trip=figures(looked_at["energy"]), **found)
    assert told["compared_part"] == looked_at["compared_part"]
    if name == "cut" and told["compared_part"] is None:
        assert train == "NL_Intercity_VIRM6"  # 140 km/h
        assert told["not_comparable"].startswith(FASTER)
    else:
        assert (told["compared_part"] is not None) == (name == "cut")


@pytest.mark.nightly
@pytest.mark.parametrize("scenario", sorted(bundled_scenarios()))
def test_a_day_of_every_scenario_has_one_set_of_figures(tmp_path: Path, scenario: str) -> None:
    """Each with one of the presentations of the advice, in turn."""
    shown = list(Presentation)[sorted(bundled_scenarios()).index(scenario) % len(Presentation)]
    told = run(tmp_path, "run", scenario, "--seed", "2", "--advice", str(shown), "-o", "day.mcap")
    compared = check_same(run=figures(told), **of_recording(tmp_path / "day.mcap"))
    assert compared >= {"energy_kwh", "energy_optimum_kwh", "above_optimum_kwh", "late_s", "over_limit_s"}


@pytest.mark.nightly
@pytest.mark.parametrize("trip", ["bundled", "simulated"])
def test_the_wrong_train_is_refused_by_every_command_in_the_same_words(folder: Path, trip: str) -> None:
    """A train that is slower than the trip: its top speed is not the limit of the line."""
    source = bundled_recording() if trip == "bundled" else folder / "none.mcap"
    slow, name = slow_train(folder, 90), f"{trip}-slow.mcap"
    told = run(folder, "replay", str(source), "--vehicle", slow, "-o", name)
    path, why = folder / name, told["not_comparable"]
    assert "cannot arrive as early as the trip did" in why
    assert told["above_optimum_kwh"] is told["above_optimum_ratio"] is None
    check_same(replay=figures(told), **of_recording(path))
    assert refusal("report", path.name, "--show", "energy", cwd=folder) == f"error: {path.name}: not comparable: {why}"
    drive = Drive.read(path)
    assert drive.energy.why_no_attribution == f"not comparable: {why}"
    assert drive.limit_known
    kinds = [str(one.kind) for one in drive.events]
    assert "beyond-train" in kinds
    if trip == "simulated":  # the other was above the limit of the line, too
        assert drive.violations.over_limit_s == 0.0
        assert "overspeed" not in kinds
    *_, second = of_comparison(Drive.read(source), drive)
    assert second["equal_arrival_not_comparable"] in (why, "the trains differ")


@pytest.mark.slow
def test_a_cut_recording_is_refused_by_every_command_in_the_same_words(folder: Path) -> None:
    whole = (folder / "none.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert not Drive.read(folder / "cut.mcap").recording.complete
    assert of_recording(folder / "cut.mcap")["report"]["not_comparable"] == NOT_WHOLE
    for command in (("cut.mcap", "--show", "energy"), ("none.mcap", "cut.mcap", "--table", "both.csv")):
        refused = das_sim("report", *command, cwd=folder)
        assert refused.returncode == 2
        assert refused.stderr.endswith(f"cut.mcap: not comparable: {NOT_WHOLE}\n")
    told = run(folder, "replay", "cut.mcap", "-o", "cut-replayed.mcap")
    check_same(replay=figures(told), **of_recording(folder / "cut-replayed.mcap"))
    assert (told["compared_part"] is None) == (told["not_comparable"] is not None)


@pytest.mark.nightly
def test_an_open_trip_is_compared_over_one_part_by_every_command(folder: Path) -> None:
    """The record ends as the train rolls: its longest part between equal speeds; or while it starts: no part."""
    assert das_sim("trip", "none.mcap", "-o", "none.csv", cwd=folder).returncode == 0
    rows = (folder / "none.csv").read_text(encoding="utf-8").splitlines()
    where = ("--route", "flat-6km", "--vehicle", "re460-ic")
    found = []
    for name, part in (("open", 0.8), ("start", 0.2)):
        (folder / f"{name}.csv").write_text("\n".join(rows[: int(part * len(rows))]) + "\n", encoding="utf-8")
        told = run(folder, "replay", f"{name}.csv", *where, "-o", f"{name}.mcap")
        looked_at = run(folder, "trip", f"{name}.csv", *where)
        assert looked_at["compared_part"] == told["compared_part"]
        compared = of_recording(folder / f"{name}.mcap")
        assert "energy_low_kwh" in check_same(replay=figures(told), trip=figures(looked_at["energy"]), **compared)
        found.append(told)
    told = found[0]
    assert told["compared_part"] == Drive.read(folder / "open.mcap").energy.above.part  # type: ignore[union-attr]
    assert told["above_optimum_kwh"] > 0.0
    assert told["energy_low_kwh"] < told["energy_kwh"] < told["energy_high_kwh"]
    smoothing = told["above_optimum_unknowns"][-1]
    assert smoothing["low_kwh"] < smoothing["high_kwh"]
    assert found[1]["not_comparable"] == NO_PART


@pytest.mark.nightly
@pytest.mark.parametrize("path", sorted(REFERENCES.glob("*.mcap")), ids=lambda path: path.stem)
def test_a_reference_has_one_set_of_figures_or_one_refusal(path: Path) -> None:
    found = of_recording(path)
    why = found["report"]["not_comparable"]
    if why is not None:
        assert why in refusal("report", str(path), "--show", "energy", cwd=path.parent)

"""A figure of a drive is the same in every command, and what one command refuses all refuse in the same words."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

import sim
from das.domain.files.load import catalogue
from das.domain.units import kwh
from sim.cli.trips import bundled_recording
from sim.drive.above_optimum import NO_PART, NOT_WHOLE
from sim.drive.comparison import AlignedDrives, drives_on_track
from sim.drive.comparison import as_dict as comparison_dict
from sim.drive.drive import Drive
from sim.review.report.page import as_dict as report_dict
from sim.review.report.page import subject_of
from tests.support.flat_days import FLAT
from tests.support.making import REPOSITORY, das_sim, refusal

REFERENCES: Final = REPOSITORY / "recordings" / "references"
TOLERANCES: Final = {"late_s": 0.5, "time_s": 0.5}
"""How far apart figures of one name may be; positions once a second tell times less exactly than the simulator does.
Figures that are not named here are equal but for rounding."""
NAMES: Final = {
    "energy_driven_kwh": "energy_kwh",
    "driven_kwh": "energy_kwh",
    "energy_hindsight_kwh": "energy_optimum_kwh",
    "optimum_same_times_kwh": "energy_optimum_kwh",
    "driven_late_s": "late_s",
}
"""Names under which commands state the same figure."""
COMPARED: Final = (
    *("energy_kwh", "energy_optimum_kwh", "above_optimum_kwh", "above_optimum_ratio", "not_comparable", "late_s"),
    *("above_optimum_likely_low_kwh", "above_optimum_likely_high_kwh"),
    *("more_energy_kwh", "more_energy_equal_arrival_kwh", "saved_by_advice_kwh", "saved_by_advice_ratio"),
)
Figures = Mapping[str, Any]


def run(folder: Path, *args: str) -> dict[str, Any]:
    """What a command prints with --json."""
    done = das_sim(*args, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def figures(said: Figures) -> dict[str, Any]:
    """The figures that are compared, by the names that they have here."""
    named = {NAMES.get(name, name): value for name, value in said.items()}
    return {name: named[name] for name in COMPARED if name in named}


def of_report(path: Path) -> dict[str, Any]:
    """The data of a report, without its pictures."""
    (told,) = report_dict([subject_of(path)], None, "")["drives"]
    return figures({**(told["energy"] or {}), **told})


def of_drive(path: Path) -> dict[str, Any]:
    """What the library says."""
    drive = Drive.read(path)
    assert drive.above is not None
    return figures({"energy_kwh": kwh(drive.driven_j or 0.0), "late_s": drive.late_s, **drive.above.as_dict()})


def of_comparison(*paths: Path) -> Iterator[dict[str, Any]]:
    aligned = AlignedDrives.of(drives_on_track([Drive.read(path) for path in paths]))
    for told, one in zip(comparison_dict(aligned)["drives"], aligned.drives, strict=True):
        at_end = one.drive.calls[-1].served  # the references end before the last stop
        yield figures({**told, "late_s": told["arrived_late_s"][-1] if at_end else one.drive.late_s})


def check_same(**sources: Figures) -> None:
    """Every figure is the same in all sources that state it, and more than one source states any."""
    for name in COMPARED:
        told = {source: found[name] for source, found in sources.items() if name in found}
        values = list(told.values())
        for value in values[1:]:
            known = isinstance(value, float) and isinstance(values[0], float)
            within = pytest.approx(values[0], abs=TOLERANCES.get(name, 1e-6), nan_ok=True) if known else values[0]
            assert value == within, f"{name}: {told}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated day of four minutes without advice."""
    found = tmp_path_factory.mktemp("figures")
    (found / "flat.toml").write_text(FLAT, encoding="utf-8")
    told = run(found, "run", "flat.toml", "--seed", "1", "--advice", "none", "-o", "none.mcap")
    (found / "none.json").write_text(json.dumps(told), encoding="utf-8")
    return found


@pytest.mark.processes
@pytest.mark.slow
def test_a_simulated_day_has_one_set_of_figures(folder: Path) -> None:
    told, path = json.loads((folder / "none.json").read_text()), folder / "none.mcap"
    library = sim.run_day(folder / "flat.toml", 1, driver="human", advice="none").outcome
    energy = run(folder, "energy", "none.mcap")
    check_same(
        run=figures(told),
        library=figures(library),
        energy=figures(energy),
        report=of_report(path),
        drive=of_drive(path),
    )
    assert told["above_optimum_ratio"] == pytest.approx(told["above_optimum_kwh"] / told["energy_kwh"])


@pytest.mark.processes
@pytest.mark.slow
def test_what_advice_saved_is_one_figure_at_equal_arrival(folder: Path) -> None:
    """By what-if, comparison, batch and the energies above the optimum."""
    before = json.loads((folder / "none.json").read_text())
    found = run(folder, "what-if", "none.mcap", "--advice", "coach", "-o", "coach.mcap")
    what_if = found["comparison"]["drives"][1]
    first, other = of_comparison(folder / "none.mcap", folder / "coach.mcap")
    check_same(comparison=first, run=figures(before))
    check_same(what_if=figures(what_if), comparison=other, drive=of_drive(folder / "coach.mcap"))
    saved_kwh = before["above_optimum_kwh"] - other["above_optimum_kwh"]
    assert other["saved_by_advice_kwh"] == pytest.approx(saved_kwh)
    assert other["saved_by_advice_ratio"] == pytest.approx(saved_kwh / before["energy_kwh"])
    assert what_if["more_energy_kwh"] == pytest.approx(what_if["times_worth_kwh"] - saved_kwh)
    back = list(of_comparison(folder / "coach.mcap", folder / "none.mcap"))[1]
    assert back["saved_by_advice_kwh"] == pytest.approx(saved_kwh)


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_a_batch_says_the_same_as_a_run_and_a_what_if(folder: Path) -> None:
    pytest.importorskip("pyarrow")
    told = run(
        folder, "batch", "flat.toml", "--seeds", "1", "--advice", "none,coach", "--out", "batch", "--workers", "1"
    )
    run(folder, "what-if", "none.mcap", "--advice", "coach", "-o", "again.mcap")
    *_, other = of_comparison(folder / "none.mcap", folder / "again.mcap")
    (saved,) = told["savings"]
    assert saved["saved_kwh"] == pytest.approx(other["saved_by_advice_kwh"], abs=1e-6)
    assert saved["saved_ratio"] == pytest.approx(other["saved_by_advice_ratio"], abs=1e-6)


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize("trip", ["bundled", "simulated"])
def test_a_replay_its_recording_and_a_what_if_of_it_have_one_set_of_figures(folder: Path, trip: str) -> None:
    """The what-if of a trip by positions keeps its brakes: motors first, on both sides."""
    source = bundled_recording() if trip == "bundled" else folder / "none.mcap"
    told = run(folder, "replay", str(source), "-o", f"{trip}.mcap")
    path = folder / f"{trip}.mcap"
    check_same(replay=figures(told), report=of_report(path), drive=of_drive(path))
    found = run(folder, "what-if", path.name, "--advice", "coach", "-o", f"{trip}-coach.mcap")["comparison"]["drives"]
    assert found[0]["energy_kwh"] == pytest.approx(told["energy_driven_kwh"])
    assert found[1]["saved_by_advice_not_comparable"] == "only a simulated driver drives the same day twice"
    check_same(
        what_if=figures(found[1]), comparison=list(of_comparison(path, folder / f"{trip}-coach.mcap"))[1],
        drive=of_drive(folder / f"{trip}-coach.mcap"),
    )  # fmt: skip


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_the_wrong_train_is_refused_by_every_command_in_the_same_words(folder: Path) -> None:
    """A train that is slower than the trip: its top speed is not the limit of the line."""
    text = catalogue("vehicles")["re460-ic"].read_text(encoding="utf-8")
    line = next(one for one in text.splitlines() if one.startswith("max_speed_kmh"))
    slow = folder / "slow"
    slow.mkdir()
    for name, path in catalogue("vehicles").items():
        (slow / f"{name}.toml").write_text(path.read_text(encoding="utf-8").replace(line, "max_speed_kmh = 90"))
    told = run(folder, "replay", "none.mcap", "--vehicle", str(slow / "re460-ic.toml"), "-o", "slow.mcap")
    path, why = folder / "slow.mcap", told["not_comparable"]
    assert "cannot arrive as early as the trip did" in why
    assert told["above_optimum_kwh"] is told["above_optimum_ratio"] is None
    check_same(replay=figures(told), report=of_report(path), drive=of_drive(path))
    assert refusal("energy", path.name, cwd=folder) == f"error: {path.name}: not comparable: {why}"
    drive = Drive.read(path)
    assert drive.why_no_attribution == f"not comparable: {why}"
    assert (drive.violations.over_limit_s, drive.limit_known) == (0.0, True)
    kinds = [str(one.kind) for one in drive.events]
    assert "beyond-train" in kinds
    assert "overspeed" not in kinds
    second = comparison_dict(AlignedDrives.of(drives_on_track([Drive.read(folder / "none.mcap"), drive])))["drives"][1]
    assert second["equal_arrival_not_comparable"] in (why, "the trains differ")


@pytest.mark.processes
@pytest.mark.slow
def test_a_cut_recording_is_refused_by_every_command_in_the_same_words(folder: Path) -> None:
    whole = (folder / "none.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    drive = Drive.read(folder / "cut.mcap")
    assert not drive.recording.complete
    assert drive.not_comparable == of_report(folder / "cut.mcap")["not_comparable"] == NOT_WHOLE
    for command in (("energy", "cut.mcap"), ("compare", "none.mcap", "cut.mcap")):
        refused = das_sim(*command, cwd=folder)
        assert refused.returncode == 2
        assert refused.stderr.endswith(f"error: cut.mcap: not comparable: {NOT_WHOLE}\n")


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_an_open_trip_is_compared_over_one_part_by_every_command(folder: Path) -> None:
    """The record ends as the train rolls: its longest part between equal speeds; or while it starts: no part."""
    assert das_sim("trip", "none.mcap", "-o", "none.csv", cwd=folder).returncode == 0
    rows = (folder / "none.csv").read_text(encoding="utf-8").splitlines()
    where = ("--route", "flat-6km", "--vehicle", "re460-ic")
    found = []
    for name, part in (("open", 0.8), ("start", 0.2)):
        (folder / f"{name}.csv").write_text("\n".join(rows[: int(part * len(rows))]) + "\n", encoding="utf-8")
        found.append(run(folder, "replay", f"{name}.csv", *where, "-o", f"{name}.mcap"))
    told, path = {**found[0], "driven_late_s": math.nan}, folder / "open.mcap"  # it does not arrive
    check_same(replay=figures(told), report=of_report(path), drive=of_drive(path))
    assert told["compared_part"] == Drive.read(path).above.part  # type: ignore[union-attr]
    assert told["above_optimum_kwh"] > 0.0
    assert told["energy_driven_low_kwh"] < told["energy_driven_kwh"] < told["energy_driven_high_kwh"]
    assert found[1]["not_comparable"] == of_report(folder / "start.mcap")["not_comparable"] == NO_PART


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(REFERENCES.glob("*.mcap")), ids=lambda path: path.stem)
def test_a_reference_has_one_set_of_figures_or_one_refusal(path: Path) -> None:
    drive = Drive.read(path)
    if drive.above is None:
        assert of_report(path)["not_comparable"] == drive.not_comparable != ""
        assert drive.not_comparable in refusal("energy", str(path), cwd=path.parent)
        return
    first, second = of_comparison(path, path)
    check_same(drive=of_drive(path), report=of_report(path), first=first)
    assert second["more_energy_kwh"] == second["more_energy_equal_arrival_kwh"] == 0.0

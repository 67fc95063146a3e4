"""Tables: what is written comes back, and what is damaged, foreign or nonsense is refused in one line."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das import table as key
from das.domain.braking import ServiceBraking
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import Stop
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.guide.policies import DEFAULT
from das.solver.section import Section, SectionOptions, build_section
from das.table import METHOD, MOST_BYTES, Table, TableError, key_of, section_facts, table_name
from tests.support.making import das_precompute, make_route
from tests.support.small_tables import BUFFERS, GRADES, LENGTH_M, LIMITS, line, seal_anew, train

Body = dict[str, Any]


@pytest.fixture
def copied(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(made, tmp_path / "table.json"))


def test_the_front_comes_back_as_it_was_solved(made: Path, front: Front) -> None:
    table, least_time_s = Table.read(made), front.fastest().time_s
    assert table.least_time_s == least_time_s
    columns = table.columns()
    np.testing.assert_array_equal(columns["buffer_percent"], [*BUFFERS, np.nan])
    for i, buffer in enumerate([*BUFFERS, 1e9]):
        solved = front.trajectory(least_time_s * (1 + buffer / 100))
        assert (columns["time_s"][i], columns["energy_input_j"][i]) == (solved.time_s, solved.balance.input)
        assert table.front[i]["fit"] == str(solved.fit)


def put(*keys: str | int, value: Any) -> Callable[[Body], None]:
    """Put a value into a table."""

    def change(body: Any) -> None:
        for one in keys[:-1]:
            body = body[one]
        body[keys[-1]] = value

    return change


def drop(*keys: str | int) -> Callable[[Body], None]:
    """Leave a key out of a table."""

    def change(body: Any) -> None:
        for one in keys[:-1]:
            body = body[one]
        del body[keys[-1]]

    return change


PHASE = "expected [kind (one of traction, hold, coast, brake, curve), share of effort from 0 to 1, "
FIRST = ("references", 0, "phases", 0)
BAD: dict[str, tuple[Callable[[Body], Any], str]] = {
    "old schema": (put("schema_version", value=3), "schema_version = 3: expected 4; build the table again"),
    "schema true": (put("schema_version", value=True), "schema_version = True: expected 4"),
    "other method": (put("method", value=0), f"method = 0: expected {METHOD}; build the table again"),
    "no method": (drop("method"), f"method is missing: expected {METHOD}"),
    "no key": (drop("key"), "key is missing: expected a string"),
    "least time 0": (put("least_time_s", value=0), "least_time_s = 0: expected a finite number > 0"),
    "section null": (put("section", value=None), "section = None: expected an object"),
    "start null": (put("section", "start_m", value=None), "section.start_m = None: expected a finite number"),
    "braking a list": (put("section", "braking", value=[]), "section.braking = []: expected an object or null"),
    "refined": (put("settings", value={}), "settings.refine is missing: expected a string"),
    "no points": (put("front", value=[]), "front = []: expected a list that is not empty"),
    "point null": (put("front", 1, value=None), "front[1] = 'NoneType': expected a table of keys"),
    "energy null": (put("front", 0, "energy_input_j", value=None), "front[0].energy_input_j = None: expected a finite"),
    "fit a list": (put("front", 2, "fit", value=["late"]), "front[2].fit = ['late']: expected one of on-time, late"),
    "no references": (put("references", value={}), "references = {}: expected a list that is not empty"),
    "times that fall": (put("references", 1, "time_s", value=1.0), "references[1].time_s = 1.0: expected a time above"),
    "price below 0": (put("references", 0, "lambda_w", value=-1.0), "references[0].lambda_w = -1.0: expected a finite"),
    "number of 400 digits": (put("references", 0, "energy_j", value=10**400), "references[0].energy_j = 1"),
    "no phases": (put("references", 0, "phases", value=[]), "references[0].phases = []: expected a list that is not"),
    "phase null": (put(*FIRST, value=None), f"references[0].phases[0] = None: {PHASE}"),
    "kind": (put(*FIRST, value=["fly", 1.0, 0, 9.0]), PHASE),
    "kind a list": (put(*FIRST, value=[[], 1.0, 0, 9.0]), PHASE),
    "share": (put(*FIRST, value=["traction", 1.5, 0, 9.0]), PHASE),
    "speed": (put(*FIRST, value=["traction", 1.0, 0, float("nan")]), PHASE),
    "fast": (put(*FIRST, value=["traction", 1.0, 0, 200.0]), PHASE),
    "begins late": (put(*FIRST, value=["traction", 1.0, 1, 9.0]), PHASE),
    "begins in part": (put(*FIRST, value=["traction", 1.0, 0.0, 9.0]), PHASE),
    "out of order": (put("references", 0, "phases", 1, value=["hold", 0.0, 0, 9.0]), "references[0].phases[1] = ["),
}


@pytest.mark.parametrize("case", BAD)
def test_nonsense_under_a_right_seal_is_refused_by_its_key(copied: Path, case: str) -> None:
    change, said = BAD[case]
    seal_anew(copied, change)
    with pytest.raises(TableError) as caught:
        Table.read(copied)
    message = str(caught.value)
    assert message.startswith(f"{copied}: ")
    assert said in message
    assert "\n" not in message


def test_a_seal_alone_does_not_hurt(copied: Path, section: Section) -> None:
    """The way the bad tables are made leaves a good one good."""
    seal_anew(copied, lambda body: None)
    assert Table.read(copied).references_for(section, DEFAULT).finished


def retouched(path: Path) -> None:
    path.write_text(path.read_text().replace('"train": "test"', '"train": "best"'))


def as_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def as_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


DAMAGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "retouched": (retouched, "was altered since it was written"),
    "cut": (lambda path: os.truncate(path, path.stat().st_size - 1000), "not valid JSON"),
    "empty": (lambda path: os.truncate(path, 0), "not valid JSON"),
    "a list": (lambda path: path.write_text("[]") and None, "expected a table of keys"),
    "bytes": (lambda path: path.write_bytes(b"\xff\xfe") and None, "not a UTF-8 text file"),
    "deep": (lambda path: path.write_text("[" * 200_000) and None, "not valid JSON"),
    "large": (lambda path: path.write_bytes(b" " * (MOST_BYTES + 1)) and None, "more than 20 MB"),
    "missing": (Path.unlink, "cannot be read"),
    "a pipe": (as_pipe, "not a regular file"),
    "a device": (as_device, "not a regular file"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_table_is_refused(copied: Path, damage: str) -> None:
    damaged, said = DAMAGES[damage]
    damaged(copied)
    with pytest.raises(TableError, match=said) as caught:
        Table.read(copied)
    assert str(caught.value).startswith(f"{copied}: ")


def with_mass(mass_kg: float) -> Vehicle:
    return replace(train(), mass_kg=mass_kg)


LOSS = EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.2, idle_w=31e3)
CHANGED = "line, losses, brakes or settings have changed"
GENTLE = SectionOptions(braking=ServiceBraking(deceleration_mps2=0.3, build_up_s=1.0))
OTHERS: dict[str, tuple[Callable[[], Section], str]] = {
    "a limit": (lambda: build_section(make_route(LENGTH_M, [*LIMITS[:2], (3800.0, 21.0)], GRADES), train()), CHANGED),
    "a gradient": (lambda: build_section(make_route(LENGTH_M, LIMITS, [(0.0, 0.001), *GRADES[1:]]), train()), CHANGED),
    "the mass": (lambda: build_section(line(), with_mass(110e3)), "mass_kg 100000.0, not 110000.0"),
    "the length": (
        lambda: build_section(line(), train(), options=SectionOptions(point_mass=True)),
        "length_m 60.0, n",
    ),
    "the level": (lambda: build_section(line(), train(), level=Level.L1), "level 'own', not 'l1'"),
    "the end": (lambda: build_section(line(), train(), end_m=4900.0), "end_m 5000.0, not 4900.0"),
    "the end speed": (lambda: build_section(line(), train(), options=SectionOptions(end_speed_mps=5.0)), CHANGED),
    "the braking": (lambda: build_section(line(), train(), options=GENTLE), "braking None, not {'deceleration_mps2'"),
    "losses": (lambda: build_section(line(), replace(train(), losses={Level.OWN: LOSS})), CHANGED),
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_table_of_another_section_is_refused(made: Path, other: str) -> None:
    build, said = OTHERS[other]
    section = build()
    with pytest.raises(TableError) as caught:
        Table.read(made).references_for(section, DEFAULT)
    assert f"{made}: not the table of {section.name}: " in str(caught.value)
    assert said in str(caught.value)


def test_a_table_for_other_prices_or_of_another_method_is_refused(
    made: Path, section: Section, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = Table.read(made)
    with pytest.raises(TableError, match=CHANGED):
        table.references_for(section, replace(DEFAULT, change_s=0.2))
    monkeypatch.setattr(key, "METHOD", key.METHOD + 1)
    with pytest.raises(TableError, match=CHANGED):
        table.references_for(section, DEFAULT)


def test_phases_beyond_the_section_are_refused(copied: Path, section: Section) -> None:
    """A table that somebody forged under the key of a section cannot name an interval that the section lacks."""
    seal_anew(copied, lambda body: body["references"][0]["phases"].append(["coast", 0.0, len(section.step_m), 5.0]))
    with pytest.raises(TableError, match="not the table of"):
        Table.read(copied).references_for(section, DEFAULT)


def test_names_and_what_lies_outside_do_not_matter(section: Section) -> None:
    longer = make_route(LENGTH_M + 2000.0, [*LIMITS, (LENGTH_M, 44.0)], [*GRADES, (LENGTH_M + 500.0, 0.02)])
    renamed = replace(
        longer, id="other", name="other", source="other", stops=(Stop(name="X", position_m=0.0), *longer.stops[1:])
    )
    vehicle = replace(train(), id="other", name="other", comfort_power_w=1e5)
    assert key_of(build_section(renamed, vehicle, end_m=LENGTH_M), DEFAULT) == key_of(section, DEFAULT)


def test_rounding_of_another_processor_does_not_matter(section: Section) -> None:
    shifted = replace(section, envelope_mps=section.envelope_mps * (1 + 1e-14))
    assert key_of(shifted, DEFAULT) == key_of(section, DEFAULT)


def test_a_name_tells_what_people_know_and_keeps_the_rest_apart(section: Section) -> None:
    facts = section_facts(section)
    name = table_name(facts)
    assert name.startswith("test_a-b_test_own_")
    assert table_name({**facts, "mass_kg": 1.0}) == name  # a train that weighs more is told so, by the table
    others = [{"end_m": 4900.0}, {"length_m": 0.0}, {"braking": {"reaction_s": 2.0}}, {"level": "l1"}, {"train": "x"}]
    assert len({name, *(table_name({**facts, **other}) for other in others)}) == 6
    assert table_name({**facts, "from": "", "to": "Zürich / HB"}).startswith("test_0-m-zurich-hb_test_own_")


def test_the_commands_say_it_in_one_line(copied: Path, tmp_path: Path) -> None:
    seal_anew(copied, put("method", value=0))
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "manifest.json").write_text(json.dumps({"schema_version": 3}))
    for command in ("verify", "show"):
        done = das_precompute(tmp_path, command, ".")
        assert done.returncode == 1
        assert "old: a table of an earlier release, which is not supported; remove it and build it again" in done.stdout
        assert f"table.json: method = 0: expected {METHOD}; build the table again" in done.stdout
        assert done.stderr == ""

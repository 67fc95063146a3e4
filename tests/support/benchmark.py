"""The public benchmark library TTOBench: its figures in tests/data, and the whole library if ../shared exists."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from das.domain.files.load import locate_vehicle
from docs.studies.results import PEER, Instance, read_rows
from tests.support.making import REPOSITORY
from tests.support.needs import missing

DATA = REPOSITORY / "tests" / "data"
SHARED = REPOSITORY.parent / "shared" / "data"
"""Third-party data next to the checkout; a user's clone has none (the fixture `shared` then skips or fails)."""

TRACKS = [
    *("00_reference", "00_reference_with_tunnels", "00_var_gradient_minus_10", "00_var_gradient_minus_5"),
    *("00_var_gradient_minusplus_6", "00_var_gradient_plus_10", "00_var_gradient_plus_5", "00_var_speed_limit_100"),
    *("00_var_speed_limit_110", "00_var_speed_limit_120", "00_var_speed_limit_wind", "CH_Fribourg_Bern"),
    *("CH_StGallen_Wil", "CH_Stadelhofen_Altstetten", "CN_Songjiazhuang_Yizhuang", "SE_Vasteras_Kolback"),
]
TRAINS = ["CH_Stadler_FLIRT_TPF", "CN_Beijing_Subway", "NL_Intercity_VIRM6", "CH_Stadler_KISS_SBB"]
JOURNEY = "CH_StGallen_Wil_Journey_01"
TRAIN = {
    name: {"unit": unit, "value": value}
    for name, value, unit in (
        ("mass", 100, "t"),
        ("max traction power", 2000, "kW"),
        ("max reg braking power", 2000, "kW"),
        ("max traction force", 100, "kN"),
        ("max reg braking force", 100, "kN"),
        ("max speed", 160, "km/h"),
        ("rolling resistance r0", 2, "kN"),
        ("rolling resistance r1", 0.01, "kN/(km/h)"),
        ("rolling resistance r2", 0.0005, "kN/(km/h)^2"),
        ("efficiency traction", 90, "%"),
        ("efficiency reg brake", 80, "%"),
    )
}
"""A train of this project in the format of the library."""


def shared_data(*, module: bool = True) -> Path:
    """The folder of third-party data next to the checkout; without it, the test fails in CI and is skipped elsewhere.

    With `module` the whole test file is skipped, for files that test only these data.
    """
    if not SHARED.is_dir():
        missing(f"{SHARED} is missing: third-party data next to the checkout, not part of the project", module=module)
    return SHARED


def track_path(track: str) -> Path:
    """The file of a track: this project's own if tests/data has one, else the library's."""
    own = DATA / "routes" / f"{track}.toml"
    return own if own.is_file() else SHARED / "ttobench" / "tracks" / f"{track}.json"


def train_path(train: str) -> Path:
    """The bundled file of a train of the library."""
    return locate_vehicle(train)


def journey_path() -> Path:
    """The file of the library's only journey, in this project's own format."""
    return DATA / "journeys" / f"{JOURNEY}.toml"


def tracks_here() -> list[str]:
    """The names of the available tracks: all of the library, or those of tests/data in a user's clone."""
    return [track for track in TRACKS if track_path(track).is_file()]


class ReferenceResult(NamedTuple):
    """The energy that another optimiser found for a problem of the benchmark at a time."""

    problem: Instance
    time_s: float
    energy_kwh: float

    @property
    def has_map(self) -> bool:
        return self.problem.loss_model.startswith("map ")


def reference_results() -> list[ReferenceResult]:
    """Every published result of ms-eetc."""
    return [ReferenceResult(*key, float(row["energy_kwh"])) for key, row in read_rows(PEER)]


LEAST_TIMES_S = {
    ("CH_Fribourg_Bern", "CH_Stadler_FLIRT_TPF"): 1103.3,
    ("SE_Vasteras_Kolback", "NL_Intercity_VIRM6"): 594.8,
    ("00_var_speed_limit_100", "NL_Intercity_VIRM6"): 1460.0,
    ("CH_StGallen_Wil", "CH_Stadler_KISS_SBB"): 995.1,
}
"""Least times (s) of tracks and trains from an independent calculation in fine steps."""

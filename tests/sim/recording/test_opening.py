"""The files of a recording go to a private folder under their bare names, and nothing that they name is opened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from das.bus.recording import read_recording
from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_route, load_vehicle
from das.domain.levels import Level
from sim.recording.opening import AttachedFiles, vehicle_files
from tests.sim.world.test_drawn import write_map
from tests.support.recordings import with_run, write_recording

COARSE = (3, 7)
"""Steps of the bundled map's 202 speeds and 603 forces that are one step of a written map."""
BUNDLED = catalogue("vehicles")["re460-ic"].read_text(encoding="utf-8")


def attached(tmp_path: Path, *files: tuple[str, bytes]) -> AttachedFiles:
    """The attached files of a recording that brings these along; their private folder is `tmp_path / "private"`."""
    little = write_recording(tmp_path / "little.mcap", seconds=1)
    path = with_run(little, tmp_path / "run.mcap", *files, without=True)
    return AttachedFiles(read_recording(path), tmp_path / "private")


def with_map(name: str) -> bytes:
    """A vehicle of its own name whose loss map is the file of a name."""
    losses = f'[losses.l3]\nsource = "test"\nkind = "csv"\npath = "{name}"\n'
    head = BUNDLED[: BUNDLED.index("[losses")] if "[losses" in BUNDLED else BUNDLED
    return (head.replace('id = "re460-ic"', 'id = "own"') + losses).encode()


@pytest.mark.parametrize("name", ["../../../escaped.toml", "/tmp/das-escaped.toml", "a/../../escaped.toml"])
def test_a_name_does_not_lead_out_of_the_private_folder(name: str, tmp_path: Path) -> None:
    route = catalogue("routes")["flat-6km"].read_bytes().replace(b'id = "flat-6km"', b'id = "own"')
    _, placed, source = attached(tmp_path, (name, route)).find("routes", "own", load_route)
    assert source == "from the recording"
    assert Path(placed).resolve().is_relative_to(tmp_path / "private")
    assert not list(tmp_path.glob("*.toml"))
    assert not Path("/tmp/das-escaped.toml").exists()


@pytest.mark.parametrize("name", ["..toml", "ro\0ute.toml", f"{'long' * 100}.toml", "folder/...toml"])
def test_a_name_that_no_file_can_have_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(DasError, match="its route 'own' is neither attached nor bundled"):
        attached(tmp_path, (name, b"[route]")).find("routes", "own", load_route)


def with_curve(name: str) -> bytes:
    """The vehicle with a loss map, whose effort curve is the file of a name."""
    return with_map("own.csv").replace(
        b"max_force_kn = 300.0\nmax_power_kw = 6100.0\n", f'curve = "{name}"\n'.encode(), 1
    )


@pytest.mark.parametrize("own", [with_map, with_curve])
@pytest.mark.parametrize("name", ["/etc/hostname", "../../../../../../own.csv"])
def test_a_file_outside_the_private_folder_is_not_opened(
    name: str, own: Callable[[str], bytes], tmp_path: Path
) -> None:
    files = attached(tmp_path, ("own.toml", own(name)))
    with pytest.raises(DasError, match=f"its own.toml names {name}, expected a file in the recording"):
        files.find("vehicles", "own", load_vehicle)


@pytest.mark.parametrize("name", ["own.csv", "../maps/own.csv"])
def test_a_loss_map_that_is_brought_along_is_put_where_the_vehicle_says(name: str, tmp_path: Path) -> None:
    own_map = tmp_path / "own.csv"
    write_map(own_map, 1.2, COARSE)
    files = attached(tmp_path, ("own.toml", with_map(name)), ("own.csv", own_map.read_bytes()))
    vehicle, _, _ = files.find("vehicles", "own", load_vehicle)
    at = np.array([1e5]), np.array([20.0])
    planned = load_vehicle("re460-ic").loss_model(Level.L3)
    np.testing.assert_allclose(vehicle.loss_model(Level.L3).loss_w(*at), 1.2 * planned.loss_w(*at), rtol=0.02)


def test_effort_curves_are_brought_along_and_put_where_the_vehicle_says(tmp_path: Path) -> None:
    """Beside a loss map, which is found by its hash and must not take their place."""
    (tmp_path / "effort.csv").write_text("speed_kmh,force_kn\n0,280\n60,280\n200,100\n")
    write_map(tmp_path / "own.csv", 1.0, COARSE)
    (tmp_path / "own.toml").write_bytes(with_curve("effort.csv"))
    brought = vehicle_files(str(tmp_path / "own.toml"))
    assert {kind: path.name for kind, path in brought.items()} == {
        "vehicle": "own.toml",
        "loss_map": "own.csv",
        "effort_curve_1": "effort.csv",
    }
    files = attached(tmp_path, *((path.name, path.read_bytes()) for path in brought.values()))
    vehicle, _, _ = files.find("vehicles", "own", load_vehicle)
    assert vehicle.traction.max_force_n == 280e3


def test_a_path_in_place_of_a_name_is_not_opened(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_bytes(catalogue("routes")["flat-6km"].read_bytes())
    with pytest.raises(DasError, match="is neither attached nor bundled"):
        attached(tmp_path).find("routes", str(own), load_route)

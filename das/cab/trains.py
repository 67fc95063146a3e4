"""The trains that a journey may name: the one the node was started with, others by file, and the bundled ones."""

from __future__ import annotations

from collections.abc import Sequence

from das.domain.errors import DasError
from das.domain.files.load import catalogue, load_vehicle
from das.domain.vehicle import Vehicle


class Trains:
    """Finds a train by its id and load state, and gives the same object each time.

    `started` is the train that the node was started with, `base` the same train without a load state; `others` are
    names or files of further trains. Raises DasError for a file that cannot be used.
    """

    def __init__(self, started: Vehicle, base: Vehicle, others: Sequence[str] = ()) -> None:
        self._found = {(base.id, ""): base, (started.id, ""): started}
        for name in others:
            vehicle = load_vehicle(name)
            self._found.setdefault((vehicle.id, ""), vehicle)

    @property
    def known(self) -> list[Vehicle]:
        """The trains that have been found so far."""
        return list(self._found.values())

    def find(self, vehicle_id: str, load: str = "") -> Vehicle:
        """The train of an id in a load state (empty: that of its file); DasError if there is none."""
        if (vehicle_id, load) not in self._found:
            self._found[vehicle_id, load] = self._read(vehicle_id, load)
        return self._found[vehicle_id, load]

    def _read(self, vehicle_id: str, load: str) -> Vehicle:
        if load:
            return self.find(vehicle_id).loaded(load)
        # The id is never taken as a path, because it comes over the bus.
        if vehicle_id not in catalogue("vehicles"):
            known = sorted({name for name, _ in self._found} | set(catalogue("vehicles")))
            raise DasError(f"it is for vehicle {vehicle_id!r}, this node knows {', '.join(known)}")
        return load_vehicle(vehicle_id)

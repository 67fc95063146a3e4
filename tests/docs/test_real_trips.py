"""The review of the real trips: its parts sum to the whole, and the page says what the command finds."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.units import KM, kwh
from docs.studies import real_trips
from docs.studies.real_trips import PARTS, TRIPS, _lost_j, above_table, place_table, trip_attributions
from tests.support.benchmark import shared_data


@pytest.mark.nightly
def test_a_real_trip_is_accounted_for_and_the_page_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    trip = next(iter(TRIPS))
    monkeypatch.setattr(real_trips, "TRIPS", {trip: TRIPS[trip]})
    monkeypatch.setattr(real_trips, "TRAINS", {name: real_trips.TRAINS[name] for name in ("KISS", "VIRM6")})
    possible, impossible = trip_attributions(shared_data())
    attribution = possible.attribution
    assert possible.possible
    assert not impossible.possible
    assert sum(attribution.by_cause.values()) == pytest.approx(attribution.above.difference_j, rel=1e-3)
    by_part = [_lost_j(possible, start_km * KM, end_km * KM) for _, start_km, end_km in PARTS]
    assert sum(by_part) == pytest.approx(attribution.above.difference_j, rel=1e-3)
    assert 0.0 < possible.entry_j < attribution.above.difference_j  # a forced slow entry explains a part, not all
    assert possible.likely.low_j < attribution.above.difference_j < possible.likely.high_j
    page = real_trips.PAGE.read_text(encoding="utf-8")
    for line in above_table([possible, impossible]):
        assert line in page
    assert len(list(place_table([possible]))) == 2 + len(PARTS)
    assert np.isfinite(kwh(possible.likely.by_friction_j))

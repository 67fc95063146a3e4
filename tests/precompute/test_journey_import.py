"""A trip of a feed as a journey file: where its stops are placed, and what becomes of its times."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files.reading import Fields
from das.domain.journey import Window
from das.domain.route import Route
from das.offline.asked_journey import Call, Journey, journey_of
from precompute.gtfs import FeedTrip, TripChoice, read_trip
from precompute.journey_import import TimesRead, journey_text, notes, placed
from tests.support.feeds import NAMES, ODD, PLACES_M, feed_route, write_feed


@pytest.fixture(scope="module")
def feed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_feed(tmp_path_factory.mktemp("feed") / "feed.zip")


def trip_of(feed: Path, trip: str = "101") -> FeedTrip:
    return read_trip(feed, TripChoice(trip=trip))


def made(trip: FeedTrip, route: Route | None = None, times: TimesRead | None = None) -> Journey:
    """The journey that is read again from the file that is written."""
    text = journey_text(trip, placed(trip, route), times or TimesRead(), route, "test")
    return journey_of(Fields.of(Path("j.toml"), tomllib.loads(text)), route)


@pytest.mark.parametrize("trip", ["101", "102"])
def test_without_a_route_positions_are_distances_along_the_shape_or_straight_lines(feed: Path, trip: str) -> None:
    found = placed(trip_of(feed, trip), None)
    expected = PLACES_M if trip == "101" else [PLACES_M[-1] - x for x in PLACES_M[::-1]]
    # The sphere of the test's line and the ellipsoid of the product differ by 0.3 %.
    assert [one.position_m for one in found.stops] == pytest.approx(expected, rel=5e-3, abs=1.0)
    assert ("along the feed's shape, at most 100 m from it" in found.notes[0]) is (trip == "101")
    assert ("along straight lines" in found.notes[0]) is (trip == "102")


def test_a_shape_that_passes_far_from_a_stop_is_not_the_way(feed: Path) -> None:
    trip = trip_of(feed)
    away = replace(trip, shape_deg=trip.shape_deg + np.array([0.0, 0.1]))
    assert "straight lines" in placed(away, None).notes[0]


def test_stops_are_those_of_the_route_by_their_names(feed: Path) -> None:
    found = placed(trip_of(feed), feed_route())
    assert [(one.route_stop, one.position_m) for one in found.stops] == list(zip(NAMES, PLACES_M, strict=True))
    assert found.notes == ("4 of 4 stops are stops of the route test",)


def test_a_name_is_that_of_the_stop_with_the_most_words_in_common(feed: Path) -> None:
    """ "Neu Altdorf Station" has all words of "Altdorf", but more of "Neu Altdorf"; that also holds backwards."""
    backwards = placed(trip_of(feed, "102"), feed_route().reversed())
    assert [one.route_stop for one in backwards.stops] == list(NAMES[::-1])


def test_a_stop_of_the_route_may_have_more_words_than_that_of_the_feed(feed: Path) -> None:
    longer = tuple(f"{name} Station Nord" for name in NAMES)
    assert [one.route_stop for one in placed(trip_of(feed), feed_route(names=longer)).stops] == list(longer)


def test_stops_with_other_names_are_placed_on_the_geometry_of_the_route(feed: Path) -> None:
    found = placed(trip_of(feed), feed_route(geometry=True, names=("A", "B", "C", "D")))
    assert [one.route_stop for one in found.stops] == ["A", "B", "C", "D"], "within 500 m of the route's stops"
    between = replace(feed_route(geometry=True), stops=tuple(feed_route().stops[i] for i in (0, 3)))
    found = placed(trip_of(feed), between)
    assert [one.route_stop for one in found.stops] == [NAMES[0], "", "", NAMES[3]]
    assert [one.position_m for one in found.stops] == pytest.approx(PLACES_M, abs=2.0)
    assert "the others are placed on its geometry" in found.notes[0]


def test_stops_beyond_the_route_are_left_out(feed: Path) -> None:
    stops = feed_route().stops[1:]
    found = placed(trip_of(feed), replace(feed_route(), stops=stops))
    assert [one.route_stop for one in found.stops] == list(NAMES[1:])
    assert "left out, because they are beyond the route: Altdorf Station" in found.notes


@pytest.mark.parametrize(
    ("trip", "names", "said"),
    [
        ("101", ("Altdorf", "X", "Y", "Zell"), "Bad Über Station is neither a stop of test nor within 500 m of it"),
        ("102", NAMES, "trip 102 runs from the end of test to its start: give --reverse"),
        ("101", ("P", "Q", "R", "S"), "fewer than two stops of trip 101 are on test, which has P, Q, R, S"),
    ],
)
def test_a_trip_that_does_not_fit_the_route_is_refused(
    feed: Path, trip: str, names: tuple[str, ...], said: str
) -> None:
    with pytest.raises(DasError, match=said):
        placed(trip_of(feed, trip), feed_route(names=names))


def test_a_stop_without_coordinates_needs_a_route(feed: Path) -> None:
    trip = trip_of(feed)
    bare = replace(trip, stops=(trip.stops[0], trip.stops[1]._replace(latitude_deg=np.nan), *trip.stops[2:]))
    assert len(placed(bare, feed_route()).stops) == 4
    with pytest.raises(DasError, match=r"Bad Über Station has no coordinates in stops\.txt: expected coordinates, or"):
        placed(bare, None)


def test_times_become_windows_of_what_the_timetable_rounds(feed: Path) -> None:
    journey = made(trip_of(feed), feed_route())
    calls = [point for point in journey.points if isinstance(point, Call)]
    assert [call.departure for call in calls[:-1]] == [
        Window(earliest_s=x, latest_s=x + 59) for x in (16_080, 16_440, 16_860)
    ]
    assert [call.dwell_s for call in calls] == [0, 30, 30, 0]
    assert calls[2].arrival == Window(latest_s=16_800 + 59), "the feed gives an arrival before the departure"
    assert calls[-1].arrival == Window(latest_s=17_160)


def test_dwell_and_rounding_are_the_users_and_are_said(feed: Path) -> None:
    trip, times = trip_of(feed), TimesRead(dwell_s=90.0, rounded_s=0.0)
    journey = made(trip, feed_route(), times)
    assert [call.dwell_s for call in journey.calls] == [0, 90, 60, 0], "never longer than the feed's own dwell"
    assert journey.calls[1].departure == Window(earliest_s=16_440, latest_s=16_440), "0 is a bound, not none"
    said = notes(trip, placed(trip, None), times, None)
    assert "1 of 2 stops on the way have arrival = departure: assumed dwell 90 s" in said
    assert "the train leaves at each departure, no later (--tolerance)" in said
    assert not any("whole minutes" in note for note in said)


def test_times_finer_than_a_minute_are_kept_without_a_tolerance(feed: Path) -> None:
    trip = trip_of(feed)
    fine = replace(trip, stops=tuple(x._replace(departure_s=x.departure_s + 30) for x in trip.stops))
    journey = made(fine, feed_route())
    assert [call.departure for call in journey.calls[:-1]] == [Window.at(x + 30.0) for x in (16_080, 16_440, 16_860)]


def test_a_train_that_runs_for_days_has_times_beyond_100_hours(feed: Path) -> None:
    trip, days_s = trip_of(feed), 4 * 86_400.0
    later = [x._replace(arrival_s=x.arrival_s + days_s, departure_s=x.departure_s + days_s) for x in trip.stops]
    journey = made(replace(trip, stops=tuple(later)), feed_route())
    assert journey.calls[0].departure.earliest_s == 16_080 + days_s
    assert "100:28" in journey.name


@pytest.mark.parametrize("zone", ["UTC", "Europe/Zurich"])
def test_times_of_another_zone_than_the_lines_are_said(feed: Path, zone: str) -> None:
    trip, route = trip_of(feed), replace(feed_route(), time_zone=zone)
    said = [note for note in notes(trip, placed(trip, route), TimesRead(), route) if "time zone" in note]
    assert (len(said), zone) in {(1, "UTC"), (0, "Europe/Zurich")}
    assert all('write time_zone = "Europe/Zurich" into the [route]' in note for note in said)


def test_where_nobody_gets_on_or_off_the_train_passes_and_its_time_is_a_wish(feed: Path) -> None:
    journey = made(trip_of(feed, ODD))
    (passing,) = journey.passings
    assert (passing.wish, passing.tolerance_s, passing.window) == (True, 30.0, Window.at(86_520.0))
    assert journey.id == ODD


def test_the_file_says_where_it_comes_from_and_holds_no_path(feed: Path) -> None:
    trip = trip_of(feed)
    text = journey_text(trip, placed(trip, None), TimesRead(), None, "das-precompute journey import")
    head = tomllib.loads(text)["journey"]
    assert head["source"] == (
        "GTFS feed feed.zip, trip 101, Made Railway; times of Europe/Zurich; the licence of the feed holds"
    )
    assert "route" not in head
    assert str(feed.parent) not in text
    assert "# 1 of 2 stops on the way have arrival = departure: assumed dwell 30 s." in text

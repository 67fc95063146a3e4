"""The section given on a study's command line: a route, a vehicle, and two stops."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from das.domain.conditions import Conditions
from das.domain.files.load import load_route, load_vehicle
from das.domain.route import section_stops
from das.solver.section import Section, build_section


def add_section(parser: ArgumentParser) -> None:
    """Add the arguments that define a section to a study's parser."""
    parser.add_argument("route")
    parser.add_argument("vehicle")
    parser.add_argument("--from", dest="start", metavar="STOP")
    parser.add_argument("--to", dest="end", metavar="STOP")


def section_of(given: Namespace, conditions: Conditions | None = None) -> Section:
    """The requested section, under other conditions if given; DasError for an unusable file."""
    world = conditions or Conditions()
    route = world.line(load_route(given.route))
    start, end = section_stops(route, given.start, given.end)
    train = world.train(load_vehicle(given.vehicle))
    return build_section(route, train, start_m=start.position_m, end_m=end.position_m)

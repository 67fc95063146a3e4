"""The fixtures of the small table."""

from tests.support.small_table_fixtures import front, made, section, whole

__all__ = ["front", "made", "section", "whole"]

"""The fixtures of the small table."""

from tests.support.small_table_fixtures import folder, front, section

__all__ = ["folder", "front", "section"]

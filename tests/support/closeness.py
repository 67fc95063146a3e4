"""Vectorised comparison of large arrays; `pytest.approx` compares element by element, which would take minutes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def assert_close(
    found: npt.NDArray[np.floating], expected: npt.NDArray[np.floating], *, rel: float = 0.0, absolute: float = 0.0
) -> None:
    """Assert that every element differs by at most `rel` times the expected one or `absolute`, whichever is larger."""
    assert found.shape == expected.shape
    allowed = np.maximum(rel * np.abs(expected), absolute)
    near = (found == expected) | (np.abs(found - expected) <= allowed)
    worst = np.flatnonzero(~near.ravel())[:5]
    assert near.all(), f"{(~near).sum()} differ: {found.ravel()[worst]} instead of {expected.ravel()[worst]}"

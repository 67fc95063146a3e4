"""Large arrays compared at once: `pytest.approx` compares one element after the other, which takes minutes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def assert_close(
    found: npt.NDArray[np.floating], expected: npt.NDArray[np.floating], *, rel: float = 0.0, absolute: float = 0.0
) -> None:
    """Every element differs by at most the larger of `rel` times what is expected and `absolute`."""
    assert found.shape == expected.shape
    allowed = np.maximum(rel * np.abs(expected), absolute)
    near = (found == expected) | (np.abs(found - expected) <= allowed)
    worst = np.flatnonzero(~near.ravel())[:5]
    assert near.all(), f"{(~near).sum()} differ: {found.ravel()[worst]} instead of {expected.ravel()[worst]}"

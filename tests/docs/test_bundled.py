"""The tables of the bundled studies, from what `das-sim experiment analyse --json` prints; what --make-all makes."""

from __future__ import annotations

from docs.studies import pictures
from docs.studies.bundled import COLUMNS, PICTURES, conditions_table, differences_table
from docs.studies.made_by import MINUTES
from sim.experiment.design import bundled_studies
from sim.experiment.measures import MEASURES

RESULT = {
    "conditions": [
        {"condition": "none", "measure": "gap_to_optimum_ratio", "mean": 0.2884},
        {"condition": "none", "measure": "speed_rmse_mps", "mean": None},
        {"condition": "vector", "measure": "gap_to_optimum_ratio", "mean": 0.203},
        {"condition": "vector", "measure": "speed_rmse_mps", "mean": 0.654},
    ],
    "differences": [
        {
            "name": "none - vector", "measure": "gap_to_optimum_ratio", "mean": 0.0854, "interval": [0.061, 0.11],
            "p_corrected": 0.0004, "stands_out": True,
        },
        {
            "name": "moves", "measure": "control_movements_per_min", "mean": -0.6, "interval": [-1.3, 0.1],
            "p_corrected": 0.081, "stands_out": False,
        },
    ],
}  # fmt: skip


def test_conditions_have_the_means_of_their_measures() -> None:
    columns = {"gap_to_optimum_ratio": "gap, %", "speed_rmse_mps": "speed error, m/s"}
    assert list(conditions_table(RESULT, columns)) == [
        "| condition | gap, % | speed error, m/s |",
        "|---|---:|---:|",
        "| none | 28.8 |  |",
        "| vector | 20.3 | 0.65 |",
    ]


def test_differences_have_interval_and_decision() -> None:
    assert list(differences_table(RESULT))[2:] == [
        "| none - vector | +8.5 points | +6.1 to +11.0 | < 0.001 | yes |",
        "| moves | -0.6 | -1.3 to +0.1 | 0.081 | no |",
    ]


def made_of(script: str) -> set[str]:
    """The names that --make-all gives to a script."""
    return {one.split()[-1] for one in MINUTES if one.startswith(f"python -m docs.studies.{script} ")}


def test_every_bundled_study_is_made_and_every_column_is_a_measure() -> None:
    assert set(PICTURES) == set(bundled_studies()) == made_of("bundled")
    assert set(pictures.PICTURES) == made_of("pictures")
    assert {name for columns in COLUMNS.values() for name in columns} <= set(MEASURES)

"""The table of a batch's results: Parquet, one row a run (docs/reference/batch-table.md)."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from sim.jobs.batch import STOP_COLUMNS
from sim.world.outcome import SHARES

TEXTS = (
    *("scenario", "driver", "friction_policy", "population", "advice", "level", "error", "happens", "drawn"),
    *("recording", "version"),
    *("code_sha256", "scenario_sha256", "route_sha256", "vehicle_sha256", "loss_map_sha256"),
    *("true_vehicle_sha256", "true_loss_map_sha256", "driver_sha256", "population_sha256", "inputs_sha256"),
)
COUNTS = (
    "participant",
    "advices_given",
    "advices_withdrawn",
    "advices_unheard",
    "advices_above_limit",
    "reversals",
    "signals_passed",
    "simulated_s",
)
TRUTHS = ("advice_restless", "hindsight_faster_than_possible")
FIGURES = (
    *("late_s", "running_time_s"),
    *("energy_kwh", "energy_at_stops_kwh", "energy_planned_kwh", "energy_hindsight_kwh", "above_optimum_ratio"),
    *("energy_blending_kwh", "energy_profile_kwh", "energy_own_braking_kwh"),
    *(f"{name}_kwh" for name in SHARES),
    *(f"{name}_ratio" for name in SHARES),
    *("potential_kwh", "ledger_residual_ratio", "beyond_signal_m", "over_limit_s", "over_limit_kmh"),
    *("advice_changes_per_min", "shortest_mode_s"),
)


def require_pyarrow() -> None:
    """Raise DasError if the package that writes the table is not installed."""
    if importlib.util.find_spec("pyarrow") is None:
        raise DasError("pyarrow is not installed: pip install 'driver-advisory-system[batch]'")


def write_table(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write the rows as Parquet; columns that a failed run does not have are null."""
    import pyarrow as pa
    from pyarrow import parquet

    listed = list(rows)
    table = pa.Table.from_pylist([{name: row.get(name) for name in SCHEMA_NAMES} for row in listed], schema=_schema())
    content = io.BytesIO()
    parquet.write_table(table, content, compression="zstd")
    write_whole(path, content.getvalue())


SCHEMA_NAMES = (
    *("seed", *TEXTS, *COUNTS, *FIGURES, *TRUTHS, "stops"),
    *(f"stop_{name}" for name in STOP_COLUMNS),
    *("decision_time_s", "decision_what", "decision_value"),
)


def _schema() -> Any:
    import pyarrow as pa

    types = {
        "seed": pa.int64(),
        **dict.fromkeys(TEXTS, pa.string()),
        **dict.fromkeys(COUNTS, pa.int64()),
        **dict.fromkeys(FIGURES, pa.float64()),
        **dict.fromkeys(TRUTHS, pa.bool_()),
        "stops": pa.list_(pa.string()),
        **{f"stop_{name}": pa.list_(pa.float64()) for name in STOP_COLUMNS},
        **dict.fromkeys(("decision_time_s", "decision_value"), pa.list_(pa.float64())),
        "decision_what": pa.list_(pa.string()),
    }
    return pa.schema([(name, types[name]) for name in SCHEMA_NAMES])

"""Tables as the bytes of Parquet and CSV files."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import math
from collections.abc import Mapping
from typing import Any

from das.domain.errors import DasError
from sim.drive.export.columns import Column, DataTable


def require_parquet() -> None:
    """Raise DasError if the package that writes Parquet is not installed."""
    if importlib.util.find_spec("pyarrow") is None:
        raise DasError(
            "pyarrow is not installed: pip install 'driver-advisory-system[export]', or write CSV alone (--format csv)"
        )


def as_csv(table: DataTable) -> bytes:
    """A table as CSV (UTF-8): one head line, an empty cell where nothing is known, lists as JSON."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([one.name for one in table.columns])
    writer.writerows(zip(*([_cell(value) for value in one.values] for one in table.columns), strict=True))
    return out.getvalue().encode()


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    return json.dumps([None if math.isnan(x) else x for x in value]) if isinstance(value, list) else value


def as_parquet(table: DataTable, about: Mapping[str, str]) -> bytes:
    """A table as Parquet; each column's unit and meaning are in its metadata, `about` in the table's."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field(one.name, _type(one, pa), metadata=_metadata(one)) for one in table.columns]
    schema = pa.schema(fields, metadata={**about, "table": table.name})
    arrays = [pa.array(one.values, type=entry.type) for one, entry in zip(table.columns, fields, strict=True)]
    out = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), out, compression="zstd")
    return out.getvalue()


def _metadata(column: Column) -> dict[str, str]:
    return {key: text for key, text in (("unit", column.unit), ("meaning", column.meaning)) if text}


def _type(column: Column, pa: Any) -> Any:
    return {
        "int": pa.int64(),
        "float": pa.float64(),
        "bool": pa.bool_(),
        "text": pa.string(),
        "choice": pa.string(),
        "floats": pa.list_(pa.float64()),
    }[column.kind]


def columns_table(tables: list[DataTable]) -> DataTable:
    """A table of all columns: in which table, of which kind, in which unit, and what they mean."""
    listed = [(table.name, one) for table in tables for one in table.columns]
    rows = {
        "table": [name for name, _ in listed],
        "column": [one.name for _, one in listed],
        "kind": [one.kind for _, one in listed],
        "unit": [one.unit for _, one in listed],
        "meaning": [one.meaning for _, one in listed],
    }
    return DataTable(
        name="columns", columns=[Column(name=name, kind="text", values=values) for name, values in rows.items()]
    )

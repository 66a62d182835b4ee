"""Parquet files, of which only the wanted columns are read, in bounded memory.

The footer states how many rows there are; where the pages of a column hold more than that, Arrow runs out of memory.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table


def table_of_parquet(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all that hold no text for None.

    Raises RecordError for a file that is too large, and what Arrow raises for one that is damaged.
    """
    try:
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise RecordError("Parquet needs the package pyarrow; install it, or save as CSV") from error
    with bounded_memory(limits), path.open("rb") as file:
        table = parquet.ParquetFile(file)
        schema = table.schema_arrow
        limits.check_columns(len(schema.names))
        limits.check_samples(table.metadata.num_rows)
        names = [
            field.name
            for field in schema
            if "string" not in str(field.type) and (wanted is None or field.name in wanted)
        ]
        limits.check_numbers(table.metadata.num_rows * len(names))
        found = {
            name: np.asarray(table.read([name], use_threads=False).column(name).to_numpy(), float) for name in names
        }
    return Table(found, schema.names)

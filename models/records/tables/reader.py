"""The table in a file of any format that is known; which format it is follows from the end of the file's name."""

from __future__ import annotations

import stat
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from models.records.tables.binary.hdf5 import table_of_hdf5
from models.records.tables.binary.matlab import table_of_mat
from models.records.tables.binary.mdf4 import table_of_mdf4
from models.records.tables.binary.npz import table_of_npz
from models.records.tables.binary.parquet_table import table_of_parquet
from models.records.tables.binary.rosbag import table_of_rosbag
from models.records.tables.binary.tdms import table_of_tdms
from models.records.tables.formats import LISTED, TEXT
from models.records.tables.sizes import LIMITS, Limits, RecordError
from models.records.tables.table import Table
from models.records.tables.text.delimited import table_of_csv

# A reader takes the path, the limits and the names of the columns that are wanted (None: all), and returns the table.
Reader = Callable[[Path, Limits, Collection[str] | None], Table]

READERS: Final[Mapping[str, Reader]] = {
    **dict.fromkeys(TEXT, table_of_csv),
    ".gz": table_of_csv,
    ".mat": table_of_mat,
    ".parquet": table_of_parquet,
    ".npz": table_of_npz,
    ".h5": table_of_hdf5,
    ".hdf5": table_of_hdf5,
    ".hdf": table_of_hdf5,
    ".tdms": table_of_tdms,
    ".mf4": table_of_mdf4,
    ".mcap": table_of_rosbag,
    ".db3": table_of_rosbag,
}


def read_table(path: Path, wanted: Collection[str] | None = None, limits: Limits = LIMITS) -> Table:
    """The table in a file, its columns (n,) [as the file has them]: the wanted ones, or all for None.

    Columns that do not hold samples (single numbers, matrices) are left out. Raises RecordError for what can't be
    read, or holds more than `limits` says.
    """
    try:
        if path.is_dir():
            raise RecordError("is a folder; give the file that holds the record, of a ROS 2 bag its .mcap or .db3")
        if not stat.S_ISREG(path.stat().st_mode):
            raise RecordError("is not a plain file; give the file that holds the record")
        reader = READERS.get(path.suffix.lower())
        if reader is None:
            raise RecordError(f"ends in {path.suffix or 'nothing'}; give a {LISTED} file")
        table = reader(path, limits, wanted)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error
    except Exception as error:  # the libraries behind the readers raise what they like
        if isinstance(error, OSError) and error.strerror:
            raise RecordError(f"{path}: can't be read ({error.strerror}); give an existing record") from error
        text = " ".join(str(error).split())[:200]
        raise RecordError(f"{path}: can't be read as a {path.suffix} file ({text}); export it again") from error
    samples = {name: column for name, column in table.columns.items() if column.ndim == 1 and column.size > 1}
    return replace(table, columns=samples)

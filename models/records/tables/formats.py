"""Which files can be read, by the ends of their names, for messages and help."""

from typing import Final

TEXT: Final = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")
FORMATS: Final = (
    *TEXT,
    ".csv.gz",
    ".mat",
    ".parquet",
    ".npz",
    ".h5",
    ".hdf5",
    ".hdf",
    ".tdms",
    ".mf4",
    ".mcap",
    ".db3",
)
LISTED: Final = f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"

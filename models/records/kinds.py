"""What a record can show, by the names that `identify` and its command know."""

from typing import Final

# In the order in which they are identified: each uses what those before it gave.
KINDS: Final = ("response", "excitation", "hysteresis", "motion", "dynamics")

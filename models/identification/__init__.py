"""From measured records to the numbers of a machine, each with its uncertainty."""

from typing import Final

MOST_MODES: Final = 8  # Vibration modes that are looked for in a frequency response.

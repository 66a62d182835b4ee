"""What a starter file is made from: the answers, as options with units. Kept light, as `--help` comes through here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Asked:
    """One answer: its name, SI unit, metavar, meaning, and an example as one would type it."""

    name: str
    unit: str
    metavar: str
    meaning: str
    example: str

    @property
    def option(self) -> str:
        """The option as it is typed."""
        return f"--{self.name.replace('_', '-')}"


ANSWERS: Final = (
    Asked("mass", "kg", "MASS", "moving mass", "12 kg"),
    Asked("rated_thrust", "N", "FORCE", "largest thrust of the drive", "200 N"),
    Asked("rated_speed", "m/s", "SPEED", "largest speed of the drive", "1 m/s"),
    Asked("sample_time", "s", "TIME", "sample time of the controller", "250 us"),
    Asked("resolution", "m", "LENGTH", "resolution of the scale", "10 nm"),
    Asked("stroke", "m", "LENGTH", "stroke of the motions that are to settle quickly", "50 um"),
    Asked("tolerance", "m", "LENGTH", "distance (+-) from the target within which a motion has settled", "1 um"),
    Asked("settling_time", "s", "TIME", "time within which a motion has to settle", "20 ms"),
    Asked("friction_force", "N", "FORCE", "friction at a slow steady speed", "10 N"),
    Asked("presliding", "m", "LENGTH", "distance from rest after which friction has its full force", "50 um"),
)
"""What has to be answered."""
OPTIONAL: Final = (
    Asked(
        "offset", "N", "FORCE", "constant force that the drive has to hold, such as gravity; none if not given", "60 N"
    ),
    Asked(
        "travel", "m", "LENGTH", "how far the axis may travel, which experiments keep to; open if not given", "40 mm"
    ),
    Asked("dead_time", "s", "TIME", "dead time from command to thrust; 1.5 sample times if not given", "400 us"),
)
"""What is assumed where it is not answered."""

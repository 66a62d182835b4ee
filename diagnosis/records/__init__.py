"""The records of a diagnosis: what is refused, their motions, and the units in which their machine counts."""

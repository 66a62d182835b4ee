"""The units in which a table or an axis of a figure has numbers that the reader need not count the digits of."""


def force_unit(largest: float) -> tuple[float, str]:
    """How many of a unit are in 1 N, and the unit [-], for an axis of forces up to `largest` [N]."""
    if largest == 0 or largest >= 1e-3:
        return 1.0, "N"
    return (1e6, "µN") if largest >= 1e-6 else (1e9, "nN")


def length_unit(largest: float) -> tuple[float, str]:
    """How many of a unit are in 1 m, and the unit [-], for an axis of lengths up to `largest` [m]: µm, or mm where
    these would take five digits and nm where the first one would stand behind a zero."""
    if 0 < largest < 1e-7:
        return 1e9, "nm"
    return (1e6, "µm") if largest < 0.01 else (1e3, "mm")


def time_unit(largest: float) -> tuple[float, str]:
    """How many of a unit are in 1 s, and the unit [-], for an axis of times up to `largest` [s]."""
    if largest >= 10:
        return 1.0, "s"
    return (1e6, "µs") if 0 < largest < 1e-3 else (1e3, "ms")

"""Units that a foreign recording may be in, and how many of ours one of theirs is."""

import math

from wrenchflow.errors import ConfigError, unknown

_POUND_KG, _INCH_M, _G_M_S2 = 0.45359237, 0.0254, 9.80665
# Our unit: what may be written in its place, and its size in ours.
UNITS: dict[str, dict[str, float]] = {
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": _G_M_S2, "gf": 1e-3 * _G_M_S2, "lbf": _POUND_KG * _G_M_S2},
    "N.m": {
        "N.m": 1.0,
        "mN.m": 1e-3,
        "N.mm": 1e-3,
        "N.cm": 1e-2,
        "kgf.cm": _G_M_S2 * 1e-2,
        "lbf.in": _POUND_KG * _G_M_S2 * _INCH_M,
        "lbf.ft": _POUND_KG * _G_M_S2 * 12.0 * _INCH_M,
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH_M},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "in/s": _INCH_M},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0},
}


def factor_of(unit: str, ours: str, where: str) -> float:
    """How many of our unit one of another is.

    Args:
        unit: The other, such as `lbf`.
        ours: Ours, such as `N`.
        where: Name of the place that says so, for the message.

    Raises:
        ConfigError: If it is not stated, or not a unit of that kind.
    """
    known = UNITS[ours]
    if not unit:
        raise ConfigError(f"{where}: the unit is not stated. Available: {', '.join(sorted(known))}.")
    if unit not in known:
        raise ConfigError(f"{where}: {unknown('unit', unit, known)}")
    return known[unit]

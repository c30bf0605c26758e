"""The way that is wiped, in the goal's axes: an S that goes on along x, so that where one is says where to go next.

Skill and referee share it. Whoever follows it needs to remember nothing: the place along x is all there is to know.
"""

import math

from wrenchflow.compiled import kernel

BEGIN_M = 0.03  # Along x; before it is the run-in, in which the tool lands and the force rises.
END_M = 0.15
_SWING_M = 0.010
_WAVE_M = 0.15  # One whole S, run-in included.


@kernel
def aside(along):
    """Where the way is across, y, at a place along it, x [m]; it goes on beyond its end."""
    return _SWING_M * math.sin(2.0 * math.pi * along / _WAVE_M)


@kernel
def slope(along):
    """How steeply it swings there, dy/dx."""
    return _SWING_M * 2.0 * math.pi / _WAVE_M * math.cos(2.0 * math.pi * along / _WAVE_M)

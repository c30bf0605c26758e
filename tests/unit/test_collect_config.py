"""What a session may be asked for: a value that makes no sense is refused where it is given, with what does."""

import math
from dataclasses import replace

import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.device_config import DeviceConfig
from wrenchflow.collect.devices.twist_map import TwistMap
from wrenchflow.errors import ConfigError

# Kind, its field, the ends of what is allowed, and what lies beyond them.
RANGES = [
    (TwistMap, "linear_max_m_s", (0.001, 3.0), (0.0, 3.1, 1e5)),
    (TwistMap, "angular_max_rad_s", (0.005, 4.0), (0.0, 4.1, math.inf)),
    (TwistMap, "dead_man_s", (0.005, 1.0), (0.0, 2.0, math.nan)),
    (CollectConfig, "disturbance_m", (0.0, 0.01), (-0.001, 5.0)),
    (CollectConfig, "disturbance_s", (0.001, 60.0), (0.0, 1e4)),
    (CollectConfig, "tares", (1, 100), (0, 10**6)),
    (CollectConfig, "tare_wait_s", (0.0, 60.0), (-1.0, 3600.0)),
    (CollectConfig, "device_hz", (10, 1000), (0, 2000)),
    (CollectConfig, "episodes", (1, 100_000), (0, 10**12)),
    (DeviceConfig, "patience_s", (0.01, 60.0), (0.0, 1e4)),
    (DeviceConfig, "tap_s", (0.005, 2.0), (0.0, 30.0)),
    (DeviceConfig, "full_scale", (1e-6, 1e6), (0.0, 1e9)),
    (DeviceConfig, "scale", (0.01, 10.0), (0.0, 1000.0)),
    (DeviceConfig, "gripper_button", (0, 47), (-1, 48)),
    (DeviceConfig, "mark_button", (0, 47), (-1, 48)),
    (DeviceConfig, "full_scale_counts", (1, 10**6), (0, 10**9)),
    (DeviceConfig, "offsets_rad", ((), (-math.pi, math.tau)), ((0.0, 90.0), (-90.0,))),
]


@pytest.mark.parametrize(("kind", "name", "allowed", "beyond"), RANGES)
def test_every_range_has_two_ends(kind, name, allowed, beyond):
    for value in allowed:
        assert getattr(replace(kind(), **{name: value}), name) == value
    for value in beyond:
        with pytest.raises(ConfigError, match=rf"{name} is .*, expected from "):
            replace(kind(), **{name: value})

"""A configuration of control beyond any use is refused where it is made: no safeguard can be set never to act."""

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from wrenchflow.control.config import _RANGES, ControlConfig
from wrenchflow.control.controller import Controller
from wrenchflow.errors import ConfigError
from wrenchflow.rig import load_rig

RIG = load_rig("panda_peg")


def config_with(name: str, value: Any) -> ControlConfig:
    return ControlConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ramp_s", 1e30),
        ("damping_design_hz", 1e-300),
        ("zone_slowing_s", 1e-6),
        ("zone_speed_m_s", 0.25),
        ("arm_speed_share", 1e6),
        ("brake_s", 1e6),
        ("force_max_n", 1e6),
        ("moment_max_nm", 1e6),
        ("stiffness_fall_n_m_s", 1e12),
        ("stiffness_fall_nm_rad_s", 1e12),
        ("slew_inertia_kg", 1e-6),
        ("slew_inertia_kg_m2", 1e-6),
        ("tank_start_j", 1e6),
        ("tank_max_j", 1e6),
        ("tank_fill_w", 1e6),
        ("tank_refill_share", 1.01),
        ("observer_patience_s", 1e6),
        ("observer_damping_nm_s_rad", 1e-9),
        ("hold_max_s", 1e6),
        ("stop_s", 1e6),
        ("brake_nm_s_rad", 1e-9),
        ("retreat_force_n", 1e6),
        ("retreat_moment_nm", 1e6),
        ("retreat_patience_s", 1e6),
        ("retreat_m", 1e-9),
        ("retreat_max_s", 1e6),
        ("impact_force_n", 1e6),
        ("joint_speed_share", 1.01),
        ("joint_margin_rad", 1e-9),
        ("overrun_s", 0.001),
        ("overruns_max", 99999999999999999999),
        ("overrun_max_s", 1e3),
        ("stale_s", 0.0005),
        ("stale_s", 1e6),
        ("frozen_s", 1e6),
        ("torque_share", 1.01),
        ("torque_rate_share", 1.01),
    ],
)
def test_what_would_switch_a_safeguard_off_or_trip_it_always_is_refused(name: str, value: float):
    with pytest.raises(ConfigError, match=rf"^control\.{name} is [\d.e+-]+, expected from [\d.e+-]+ to [\d.e+-]+\.$"):
        config_with(name, value)


def test_every_field_has_a_range_and_its_default_is_well_within():
    assert list(_RANGES) == [field.name for field in fields(ControlConfig)]
    for name, (low, high) in _RANGES.items():
        assert low <= getattr(ControlConfig(), name) < high, name


@pytest.mark.parametrize("name", _RANGES)
def test_a_range_holds_its_ends_and_nothing_beyond(name: str):
    low, high = _RANGES[name]
    for value in (low, high):
        assert getattr(config_with(name, value), name) == value
    whole = isinstance(low, int)
    beyond = (low - 1, high + 1) if whole else (math.nextafter(low, -1.0), math.nextafter(high, math.inf))
    for value in (*beyond, *(() if whole else (-math.inf, math.inf, math.nan))):
        with pytest.raises(ConfigError, match=rf"^control\.{name} is "):
            config_with(name, value)


@pytest.mark.parametrize("name", _RANGES)
def test_what_is_within_its_range_can_be_computed_with_or_is_refused(name: str):
    def not_finite(controller: Controller) -> set[str]:
        ctl = controller.ctl[0]
        return {each for each in ctl.dtype.names if not np.isfinite(ctl[each]).all()}

    for value in _RANGES[name]:
        try:
            controller = Controller(RIG, config_with(name, value))
        except ConfigError:  # Beyond this robot or sensor, or out of order with another limit.
            continue
        assert not_finite(controller) == not_finite(Controller(RIG, ControlConfig()))

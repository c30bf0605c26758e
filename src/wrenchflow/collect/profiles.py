"""People, by name: how fast, how hard and how steady each moves; and a hand of each, a little different every time."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.hand import HAND, MEMORY
from wrenchflow.collect.skills.decide import skill_of
from wrenchflow.config import to_mapping
from wrenchflow.control.config import Impedance
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.sim.attempt import PERSON


@dataclass(frozen=True, kw_only=True)
class Profile:
    """One person.

    Attributes:
        pace: Speeds, over those of a careful person.
        press: Forces, likewise.
        delay_s: From seeing and feeling to moving [s].
        grip_s: In which what is off is put right [s].
        hand_s: Lag of the hand [s].
        crosstalk: Of a deflection, what leaks into each other axis (standard deviation).
        motor_noise: Standard deviation of a deflection over its size.
        tremor: Standard deviation, of full deflection.
        tremor_hz: Its frequency [Hz].
        feel_noise: Standard deviation of a felt force over its size.
        eye_m: Of where the goal seems to be, besides the scene's own error [m].
        stroke_miss: Standard deviation of where a stroke ends over its length.
        stroke_rest_s: Between two strokes [s].
        bow: How far a stroke goes aside, over its length; everybody has a side of their own.
    """

    pace: float = 1.0
    press: float = 1.0
    delay_s: float = 0.12
    grip_s: float = 0.16
    hand_s: float = 0.08
    crosstalk: float = 0.04
    motor_noise: float = 0.12
    tremor: float = 0.006
    tremor_hz: float = 9.5
    feel_noise: float = 0.05
    eye_m: float = 0.0002
    stroke_miss: float = 0.06
    stroke_rest_s: float = 0.12
    bow: float = 0.2


PROFILES: Mapping[str, Profile] = MappingProxyType(
    {
        "steady": Profile(),
        "brisk": Profile(pace=1.7, press=1.15, delay_s=0.08, grip_s=0.12, motor_noise=0.18, stroke_miss=0.10, bow=0.05),
        "gentle": Profile(pace=0.7, press=0.7, delay_s=0.14, tremor=0.004, feel_noise=0.04, bow=1.2),
        "heavy": Profile(pace=1.1, press=1.5, delay_s=0.13, motor_noise=0.16, feel_noise=0.07, bow=0.5),
        "novice": Profile(
            pace=0.85,
            press=1.2,
            delay_s=0.18,
            grip_s=0.2,
            hand_s=0.1,
            crosstalk=0.06,
            motor_noise=0.25,
            tremor=0.010,
            tremor_hz=8.5,
            feel_noise=0.08,
            eye_m=0.0004,
            stroke_miss=0.15,
            stroke_rest_s=0.2,
            bow=1.0,
        ),
    }
)
# Nobody is the same twice: each trait varies by this much from episode to episode (standard deviation of its log).
_VARIES = 0.12
# What a trait of the skill grows with.
_PACED = ("speed_m_s", "landing_m_s", "insert_m_s", "wipe_m_s")
_OF_THE_HAND = (
    *("grip_s", "hand_s", "motor_noise", "tremor", "tremor_hz", "feel_noise", "eye_m"),
    *("stroke_miss", "stroke_rest_s", "bow"),
)


def names_of(config: CollectConfig) -> tuple[str, ...]:
    """The people of a configuration, all there are if it names none.

    Raises:
        ConfigError: If there is nobody of a name.
    """
    for name in config.profiles:
        if name not in PROFILES:
            raise ConfigError(unknown("profile", name, PROFILES))
    return config.profiles or tuple(PROFILES)


def person_of(config: CollectConfig, index: int) -> tuple[str, Profile]:
    """Whose turn it is at an episode, people taking turns, and what that person is like today."""
    names = names_of(config)
    name = names[index % len(names)]
    rng = np.random.default_rng((config.seed, index, PERSON))
    usual = to_mapping(PROFILES[name])
    return name, Profile(**{trait: value * float(np.exp(_VARIES * rng.normal())) for trait, value in usual.items()})


def make_hand(
    person: Profile, config: CollectConfig, rng: np.random.Generator, impedance: Impedance | None = None
) -> np.ndarray:
    """The hand of a person.

    Args:
        person: What that person is like today.
        config: Task, device, and how stiffly the target is followed.
        rng: For what leaks from which axis into which.
        impedance: What holds the tool on the way to the target, if it is not the arm's.

    Returns:
        One `HAND` record. Shape (1,).

    Raises:
        ConfigError: If nobody knows how to do the task.
    """
    hand = np.zeros(1, HAND)
    hand["task"], skill = skill_of(config.task, impedance or config.impedance)
    for trait in _PACED:
        skill[trait] *= person.pace
    skill["press_n"] *= person.press ** skill["press_taste"]
    hand["skill"] = skill[0]
    hand["delay_periods"] = min(round(person.delay_s * config.device_hz), MEMORY - 1)
    for trait in _OF_THE_HAND:
        hand[trait] = getattr(person, trait)
    hand["crosstalk"] = rng.normal(size=(6, 6)) * person.crosstalk * (1.0 - np.eye(6))
    side = np.array([*rng.normal(size=2), abs(rng.normal())])  # Never down, where the goal is.
    hand["bow_way"] = side / np.linalg.norm(side)
    hand["slow_s"], hand["motor_noise_s"], hand["drift_s"] = 0.05, 0.05, 0.5
    hand["stroke_s"], hand["stroke_s_bit"], hand["near_m"] = 0.1, 0.08, 0.003
    hand["disturbance_m"], hand["disturbance_s"] = config.disturbance_m, config.disturbance_s
    return hand

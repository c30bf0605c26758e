"""Any teleoperator of LeRobot as a device: its drivers for phones, pads and leader arms are not written here again."""

import contextlib
import importlib
import pkgutil
import sys
import time
from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.devices.lerobot_actions import (
    FULL_SCALE_COUNTS,
    FollowerState,
    HeldConfig,
    LeaderConfig,
    meaning_of,
)
from wrenchflow.collect.devices.newest import Newest
from wrenchflow.errors import DeviceError, unknown

_FIRST_S, _LOOK_S = 3.0, 0.01  # So long a first answer is waited for.
_SILENT_NS = 500_000_000  # After that it begins anew: nobody knows where the hand went meanwhile.
_MOST_FAILURES = 20  # In a row: a packet of a bus is lost now and then, a cable that was pulled stays pulled.


@runtime_checkable
class SeesFollower(Protocol):
    """A device that has to know where the arm is, to begin from there."""

    def see_follower(self, q_rad: Float[np.ndarray, " n"], pose: Float[np.ndarray, " 7"]) -> None:
        """Hear where the arm is: joint angles [rad], and its target T_base_tcp; before each read."""
        ...


class LeRobotTeleoperator:
    """A `TeleopDevice` of a LeRobot `Teleoperator` that is connected.

    from lerobot.teleoperators.phone import Phone, PhoneConfig
    phone = Phone(PhoneConfig())
    phone.connect()
    device = LeRobotTeleoperator(phone)
    """

    full_scale_counts = FULL_SCALE_COUNTS

    def __init__(
        self,
        teleoperator: Any,
        *,
        held: HeldConfig | None = None,
        leader: LeaderConfig | None = None,
        full_scale: float = 1.0,
    ) -> None:
        """Take a teleoperator.

        Args:
            teleoperator: Connected; it is asked in a thread of its own, for many drivers wait.
            held: How the movement of something held moves the tool.
            leader: What a leader arm is; needed for one.
            full_scale: What an increment is at full deflection.

        Raises:
            DeviceError: If it cannot move an arm, or says its joints in what cannot be known.
        """
        self._teleoperator, self._label = teleoperator, str(teleoperator.name)
        names = _names(self._label, teleoperator)
        if leader is not None:
            leader = replace(leader, units=_units(self._label, teleoperator, leader))
        self._meaning = meaning_of(names, held=held, leader=leader, full_scale=full_scale)
        self._newest: Newest | None = Newest(teleoperator.get_action)
        self._follower: FollowerState | None = None
        self._number, self._reading = 0, Reading(t_ns=0)

    @property
    def name(self) -> str:
        """That of LeRobot, marked as such."""
        return f"lerobot-{self._label}"

    def see_follower(self, q_rad: Float[np.ndarray, " n"], pose: Float[np.ndarray, " 7"]) -> None:
        """Hear where the arm is, to begin from there.

        Args:
            q_rad: Its joint angles.
            pose: Of its target, T_base_tcp. Shape (7,).
        """
        self._follower = FollowerState(q_rad.copy(), pose.copy())

    def require_there(self) -> None:
        """Wait until its driver has answered once; one that waits itself, for whoever holds it, is not waited for.

        Raises:
            DeviceError: If it only fails: some drivers connect to what is not there, and say so when they are asked.
        """
        assert self._newest is not None  # It is not closed yet.
        stop_s = time.monotonic() + _FIRST_S
        while (news := self._newest.news).failures < _MOST_FAILURES and time.monotonic() < stop_s:
            if news.number > news.failures:
                return
            if news.error is not None and not self._teleoperator.is_connected:
                break
            time.sleep(_LOOK_S)
        if news.error is not None:
            raise DeviceError(
                f"the teleoperator '{self._label}' is connected to nothing ({_said(news.error)}): look at its cable, "
                "its port or its app, and whether its driver works on this machine."
            ) from news.error

    def read(self, now_ns: int) -> Reading:
        """What it gave last."""
        if self._newest is None:
            raise DeviceError(f"the teleoperator '{self._label}' was closed, and cannot be read any more.")
        news = self._newest.news
        if news.error is not None and (news.failures >= _MOST_FAILURES or not self._teleoperator.is_connected):
            raise DeviceError(
                f"the teleoperator '{self._label}' has gone ({_said(news.error)}): look at its cable or its app, "
                "connect it again, and start the episode anew."
            ) from news.error
        if news.number == self._number:
            return self._reading
        self._number, last = news.number, self._reading
        if now_ns - last.t_ns > _SILENT_NS:
            self._meaning.let_go()
        if news.error is not None:
            return self._refuse(f"its driver fails: {_said(news.error)}")
        try:
            meant = self._meaning.of(news.values, self._follower)
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            return self._refuse(_said(error))
        self._reading = Reading(
            t_ns=max(last.t_ns, now_ns) if meant.is_new else last.t_ns,
            counts=meant.counts.copy(),
            buttons=meant.buttons,
            pose=meant.pose,
            problem=meant.problem,
        )
        return self._reading

    def _refuse(self, problem: str) -> Reading:
        self._meaning.let_go()
        self._reading = Reading(t_ns=self._reading.t_ns, problem=problem)
        return self._reading

    def feel(self, share: float) -> None:
        """Nothing: LeRobot's teleoperators agree on no way to feel a force."""

    def close(self) -> None:
        """Disconnect it."""
        if self._newest is None:
            return
        self._newest.close()
        self._newest = None
        if self._teleoperator.is_connected:
            self._teleoperator.disconnect()


def connect(
    kind: str,
    settings: Mapping[str, Any],
    *,
    held: HeldConfig | None = None,
    leader: LeaderConfig | None = None,
    full_scale: float = 1.0,
) -> LeRobotTeleoperator:
    """Make a teleoperator of LeRobot by its name, and connect it.

    Args:
        kind: As LeRobot calls it, such as `so101_leader` or `phone`; those of its plug-ins too.
        settings: What LeRobot wants to know of it, such as `port` and `id`.
        held: As of `LeRobotTeleoperator`.
        leader: As of `LeRobotTeleoperator`.
        full_scale: As of `LeRobotTeleoperator`.

    Raises:
        DeviceError: If there is none of that name, if its settings are others, or if it cannot be connected, was
            never calibrated or only fails when it is asked; the message says what to do.
    """
    # Drivers talk to a person on stdout, where results go.
    with contextlib.redirect_stdout(sys.stderr):
        try:
            import draccus
            from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
            from lerobot.utils.import_utils import register_third_party_plugins
        except ImportError as error:
            raise DeviceError(
                f"a '{kind}' is driven by LeRobot, which cannot be loaded ({error}): install lerobot>=0.6,<0.7."
            ) from error
        _load_kinds()
        register_third_party_plugins()
        kinds = TeleoperatorConfig.get_known_choices()
        if kind not in kinds:
            raise DeviceError(unknown("teleoperator", kind, kinds))
        try:
            config = draccus.decode(TeleoperatorConfig, {"type": kind, **settings})
        except Exception as error:  # draccus has a kind of error for each way to be wrong.
            raise DeviceError(_wrong(kind, kinds[kind], settings, error)) from error
        try:
            teleoperator = make_teleoperator_from_config(config)
            _connect(teleoperator)
        except Exception as error:  # Every driver has errors of its own, and all mean that there is no device.
            # What is missing is wrapped by who makes it, or not.
            missing = next((each for each in (error, error.__cause__) if isinstance(each, ImportError)), None)
            if missing is not None:
                said = f"the driver of the teleoperator '{kind}' is not installed: {_said(missing)}."
                raise DeviceError(said) from error
            raise DeviceError(
                f"the teleoperator '{kind}' cannot be connected ({_said(error)}): look at its cable, its port and who "
                "may read it (`lerobot-find-port` helps), and connect it again."
            ) from error
        if not _holds(teleoperator.is_calibrated):
            with contextlib.suppress(Exception):  # It is not used, whatever it says to that.
                teleoperator.disconnect()
            raise DeviceError(
                f"the teleoperator '{kind}' was never calibrated: run lerobot-calibrate --teleop.type={kind} with the "
                "same settings first."
            )
        try:
            device = LeRobotTeleoperator(teleoperator, held=held, leader=leader, full_scale=full_scale)
        except BaseException:
            with contextlib.suppress(Exception):  # Likewise.
                teleoperator.disconnect()
            raise
        try:
            device.require_there()
        except BaseException:
            with contextlib.suppress(Exception):  # Likewise.
                device.close()
            raise
    return device


def _wrong(kind: str, config: type, settings: Mapping[str, Any], error: Exception) -> str:
    """What is wrong with settings, and what they may be."""
    takes = {field.name: field for field in fields(config) if field.init}
    needs = [name for name, of in takes.items() if of.default is MISSING and of.default_factory is MISSING]
    if strange := [name for name in settings if name not in takes]:
        return f"'{kind}': {unknown('setting', strange[0], takes)}"
    lacking = [name for name in needs if name not in settings]
    names = f"Its settings are {', '.join(takes)}, each as --device.settings NAME=VALUE."
    if lacking:
        return f"'{kind}' needs {', '.join(lacking)}. {names}"
    given = ", ".join(f"{name}={value}" for name, value in settings.items())
    return f"'{kind}' does not take {given}: {_said(error)}. {names}"


def _load_kinds() -> None:
    """Let each kind of LeRobot make itself known; one whose packages are missing stays unknown."""
    import lerobot.teleoperators as kinds

    for module in pkgutil.iter_modules(kinds.__path__):
        if module.ispkg:
            with contextlib.suppress(ImportError):
                importlib.import_module(f"{kinds.__name__}.{module.name}")


def _connect(teleoperator: Any) -> None:
    try:
        teleoperator.connect(calibrate=False)  # Nobody is asked for anything in the middle of a session's start.
    except TypeError:
        teleoperator.connect()  # Those without the choice, such as a phone, wait for the person who holds them.


def _names(label: str, teleoperator: Any) -> tuple[str, ...]:
    try:
        features = teleoperator.action_features
    except Exception as error:  # Of LeRobot's own, one fails here.
        raise DeviceError(f"the teleoperator '{label}' does not say what it gives: {_said(error)}") from error
    return tuple(features.get("names", features))


def _units(label: str, teleoperator: Any, leader: LeaderConfig) -> Any:
    """What the joints are said in: as the driver tells, else as the person says; anything else cannot be known."""
    motors = getattr(getattr(teleoperator, "bus", None), "motors", None) or {}
    arm = [motor.norm_mode for name, motor in motors.items() if name != "gripper"]
    told = {str(getattr(mode, "value", mode)) for mode in arm}
    if not told and getattr(getattr(teleoperator, "config", None), "use_degrees", None) is True:
        told = {"degrees"}
    if told - {"degrees"}:
        raise DeviceError(
            f"the teleoperator '{label}' says its joints as {', '.join(sorted(told))}, a share of a range that only "
            "its calibration knows, expected degrees: give it use_degrees=true, or a driver that has them."
        )
    if told and leader.units == "radians":
        raise DeviceError(f"the teleoperator '{label}' says its joints in degrees, and not in radians as was told.")
    if not told and not leader.units:
        raise DeviceError(
            f"the teleoperator '{label}' does not tell whether its joints are in degrees or in radians: say which."
        )
    return leader.units or "degrees"


def _holds(value: Any) -> bool:
    # A property for most, a method for some, and None where nobody thought of it.
    value = value() if callable(value) else value
    return value is None or bool(value)


def _said(error: BaseException) -> str:
    return " ".join(str(error.args[0] if error.args else error).split()) or type(error).__name__

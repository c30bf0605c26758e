"""A teleoperator of LeRobot without hardware: a subclass of its real base class that gives what a test feeds it."""

import queue
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from wrenchflow.collect.devices.lerobot_teleoperator import LeRobotTeleoperator


@dataclass(kw_only=True)
class FedConfig(TeleoperatorConfig):
    """Of a teleoperator that is fed."""

    use_degrees: bool | None = None


class Fed(Teleoperator):
    """Waits for what it is fed, as a driver waits for its bus."""

    config_class = FedConfig
    name = "fed"

    def __init__(self, folder: Path, features: dict[str, Any], *, use_degrees: bool | None = None) -> None:
        self.config = FedConfig(calibration_dir=folder, use_degrees=use_degrees)
        super().__init__(self.config)
        self._features, self._is_connected = features, True
        self._food: queue.Queue[Any] = queue.Queue()
        self._asked = threading.Semaphore(0)

    @property
    def action_features(self) -> dict[str, Any]:
        return self._features

    @property
    def feedback_features(self) -> dict[str, Any]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._is_connected

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        self._is_connected = True

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        raise NotImplementedError

    def get_action(self) -> dict[str, Any]:
        self._asked.release()
        said = self._food.get()
        if isinstance(said, Exception):
            raise said
        return said

    def disconnect(self) -> None:
        self._is_connected = False

    def feed(self, said: Any) -> None:
        """Let it say something, and wait until that was heard: then it is asked again."""
        assert self._asked.acquire(timeout=10.0)
        self._food.put(said)
        assert self._asked.acquire(timeout=10.0)
        self._asked.release()

    def end(self) -> None:
        """Let the thread that asks it come to its end."""
        for _ in range(3):
            self._food.put(ConnectionError("ended"))


DELTAS = {"dtype": "float32", "shape": (4,), "names": {"delta_x": 0, "delta_y": 1, "delta_z": 2, "gripper": 3}}


def increments(folder: Path) -> tuple[Fed, LeRobotTeleoperator]:
    """One as LeRobot's gamepad is."""
    fed = Fed(folder, DELTAS)
    return fed, LeRobotTeleoperator(fed)


def deltas(x: float = 0.0, y: float = 0.0, z: float = 0.0, gripper: int = 1) -> dict[str, Any]:
    return {"delta_x": np.float32(x), "delta_y": np.float32(y), "delta_z": np.float32(z), "gripper": gripper}

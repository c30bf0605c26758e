"""What became of a policy's plans at the arm, for the recording."""

from typing import Any

import numpy as np

from wrenchflow.control.controller import TICK_NS
from wrenchflow.sim.attempt import Attempt

_COLUMNS = ("age_ticks", "kept", "dropped", "seam_jump_m", "seam_jump_rad")


class Receipts:
    """Hands plans to an attempt's controller, and keeps a row of each."""

    def __init__(self, attempt: Attempt) -> None:
        """Begin with none."""
        self._attempt = attempt
        self._rows: list[tuple[int, int, int, float, float]] = []

    def receive(self, packet: np.ndarray) -> None:
        """Let the controller take in a packet, before the next tick."""
        schedule, age_ns = self._attempt.controller.schedule[0], self._attempt.now_ns - int(packet["t_obs_ns"][0])
        dropped = int(schedule["dropped"])
        is_accepted = self._attempt.accept(packet) == "accepted"
        dropped = int(schedule["dropped"]) - dropped
        kept = int(packet["count"][0]) - dropped if is_accepted else 0
        jumps = [round(float(schedule[f"seam_jump_{unit}"]), 6) if is_accepted else 0.0 for unit in ("m", "rad")]
        self._rows.append((age_ns // TICK_NS, kept, dropped, jumps[0], jumps[1]))

    def summary(self) -> dict[str, Any]:
        """Plain figures.

        Returns:
            `received`, how many arrived; `refused`, those that were not sound, by reason; and a list a column, a value
            for each that arrived: its age since its observation [ticks of 1 ms], waypoints kept and dropped, and how
            far the target would have jumped without the blend [m, rad].
        """
        columns = {name: [row[i] for row in self._rows] for i, name in enumerate(_COLUMNS)}
        return {"received": len(self._rows), "refused": self._attempt.controller.refusals, **columns}

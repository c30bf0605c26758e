"""How far a session is: what was kept, what failed, what was discarded, and what all of it covers."""

from dataclasses import dataclass, replace

from wrenchflow.collect.coverage import Coverage
from wrenchflow.collect.demonstration import Demonstration


@dataclass(frozen=True, kw_only=True)
class Tally:
    """A value: what happens gives another one.

    Attributes:
        total: Episodes that there shall be.
        coverage: Of those that are kept.
        kept: Episodes that are there, failed ones too.
        failed: Of these, those without success.
        discarded: Episodes that nobody wants.
        simulated_s: Time in them, of this run.
    """

    total: int
    coverage: Coverage
    kept: int = 0
    failed: int = 0
    discarded: int = 0
    simulated_s: float = 0.0

    def with_(self, shown: Demonstration) -> "Tally":
        """With an episode that is kept."""
        return replace(
            self,
            coverage=self.coverage.with_(shown),
            kept=self.kept + 1,
            failed=self.failed + (not shown.outcome.success),
            simulated_s=self.simulated_s + (0.0 if shown.was_there else shown.samples * 1e-3),
        )

    def without(self, shown: Demonstration) -> "Tally":
        """With an episode that was discarded."""
        return replace(self, discarded=self.discarded + 1, simulated_s=self.simulated_s + shown.samples * 1e-3)


def told(shown: Demonstration) -> str:
    """One episode in one line."""
    outcome = shown.outcome
    end = "success" if outcome.success else f"failed: {outcome.failure}"
    notes = [f"tare refused: {why}" for why in shown.refused]
    notes += [f"{shown.late_ticks} late ticks"] if shown.late_ticks else []
    notes += [f"{shown.lost} rows lost"] if shown.lost else []
    was_there = " (was there)" if shown.was_there else ""
    return "; ".join([f"{shown.id}  {shown.who}  {outcome.duration_s:.1f} s  {end}{was_there}", *notes])

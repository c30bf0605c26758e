"""One small scenario a safeguard: with it everything holds, without it a check fails.

A scenario takes the safeguards that are left out and returns what was found. `SCENARIOS` has one for each of
`SAFEGUARDS`, by its name; they stand in three files, by what the safeguard guards.
"""

from collections.abc import Callable

from safety.findings import Finding
from safety.guards_of_asking import ASKED
from safety.guards_of_energy import ENERGY
from safety.guards_of_stops import STOPS

Scenario = Callable[[tuple[str, ...]], list[Finding]]

SCENARIOS: dict[str, Scenario] = {**ASKED, **ENERGY, **STOPS}


def broken_without(safeguard: str) -> tuple[list[Finding], list[Finding]]:
    """What does not hold in a safeguard's scenario: with nothing left out, and without the safeguard."""
    scenario = SCENARIOS[safeguard]
    return tuple([each for each in scenario(left_out) if not each.holds] for left_out in ((), (safeguard,)))

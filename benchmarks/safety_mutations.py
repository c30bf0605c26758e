"""What each safeguard is worth: with it all checks hold; where it is left out at least one fails, and this says which.

Run it as `python benchmarks/safety_mutations.py`; it returns 1 if a safeguard is not missed, or does not hold.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))

from safety.scenarios import SCENARIOS, broken_without
from wrenchflow.control.safeguards import SAFEGUARDS


def main() -> int:
    """Print a line a safeguard."""
    bad = 0
    for safeguard in SAFEGUARDS:
        whole, without = broken_without(safeguard)
        missed = "; ".join(f"{each.name}: {each.worst:.4g} of {each.limit:.4g}" for each in without) or "NOTHING FAILS"
        print(f"{safeguard:16} {(SCENARIOS[safeguard].__doc__ or '').strip()}")
        print(f"{'':16} without it: {missed}")
        for each in whole:
            print(f"{'':16} FAILS WITH IT: {each}")
        bad += bool(whole) or not without
    print(f"\n{len(SAFEGUARDS) - bad} of {len(SAFEGUARDS)} safeguards hold, and are missed where they are left out.")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

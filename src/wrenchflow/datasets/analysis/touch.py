"""Contact in data sets that say nothing of it: from a force whose bias nobody may have taken out."""

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.process.contact import hysteresis

# From `process`: contact begins at six deviations of the noise above zero, and ends at half of that.
_SIGMAS, _LEAST_N = 6.0, 1.0


def touching(force_n: Float[np.ndarray, "n 3"], resting: int) -> Bool[np.ndarray, " n"] | None:
    """Whether each sample is in contact.

    Args:
        force_n: Measured force. Shape (n, 3).
        resting: The first so many samples are without contact; their median is the bias.

    Returns:
        Shape (n,); None where there are too few samples, or one is not finite.
    """
    if len(force_n) < max(resting, 2) or not np.isfinite(force_n).all():
        return None
    felt = force_n - np.median(force_n[: max(resting, 1)], axis=0)
    # Steps from sample to sample are noise and little else; of them, the median is not moved by contacts.
    noise = np.median(np.abs(np.diff(felt, axis=0)), axis=0) / (0.6745 * np.sqrt(2.0))
    on_n = max(_SIGMAS * float(np.sqrt((noise**2).sum())), _LEAST_N)
    norm = np.linalg.norm(felt, axis=1)
    return hysteresis(norm >= on_n, norm < 0.5 * on_n)

"""Which samples of which columns show what: kept beside the reading, which is not altered."""

from collections.abc import Sequence

import numpy as np

from wrenchflow.episode import Stream
from wrenchflow.process.finding import Finding
from wrenchflow.signals import mask

ANOMALY = "anomaly"

# What a flag of the mask stands for; 0 is nothing. A later one is the worse one where two meet.
CODES = {
    kind: code
    for code, kind in enumerate(
        (
            "uneven",
            "quaternion-flip",
            "vibration",
            "drift",
            "jump",
            "spike",
            "repeated",
            "stuck",
            "constant",
            "duplicate-column",
            "wrong-payload",
            "wrong-frame",
            "wrong-sign",
            "dropout",
            "saturation",
            "implausible",
            "not-finite",
        ),
        start=1,
    )
}


def mask_of(raw: Stream, findings: Sequence[Finding]) -> Stream | None:
    """The mask of a reading, or None where nothing was found that lies in its samples.

    Args:
        raw: `wrench_raw`.
        findings: Of any kinds; those that are not in `CODES` are of no sample.

    Returns:
        A stream at the stamps of `raw`, with a code of `CODES` a sample and column.
    """
    flags = np.zeros(raw.data.shape)
    for finding in findings:
        if finding.kind not in CODES:
            continue
        first, last = np.searchsorted(raw.t, [finding.start_ns, finding.stop_ns])
        columns = [raw.signal.columns.index(name) for name in finding.columns if name in raw.signal.columns]
        inside = flags[first:last, columns] if columns else flags[first:last]
        worse = np.maximum(inside, CODES[finding.kind])
        if columns:
            flags[first:last, columns] = worse
        else:
            flags[first:last] = worse
    return Stream(raw.t, flags, mask(raw.signal.columns), raw.frame) if flags.any() else None

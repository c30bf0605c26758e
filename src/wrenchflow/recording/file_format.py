"""What makes an MCAP file one of ours: the version of its format, and the names in it that writer and reader share."""

FORMAT_VERSION = 1
EVENTS = "events"
CLOCK_SYNC = "clock_sync"
# Metadata records: at the start, at the end, and where a file was recovered.
METADATA = "wrenchflow"
RESULT = "wrenchflow/result"
RECOVERED = "wrenchflow/recovered"
# Keeps the entries of an episode's `meta` apart from ours.
META_PREFIX = "meta."

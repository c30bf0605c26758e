"""Recordings in Rerun."""

import os

# Rerun would log to stderr beside us; what goes wrong is raised, and said once. This is read when it is imported.
os.environ.setdefault("RUST_LOG", "off")

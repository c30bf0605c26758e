"""Recordings of others to ours: tables, MATLAB files, and topics, by a mapping that says what their numbers mean."""

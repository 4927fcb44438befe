"""Recordings: raw link chunks and decoded topics in MCAP."""

"""Trends of a dataset as terminal lines, tables for scripts and an HTML report."""

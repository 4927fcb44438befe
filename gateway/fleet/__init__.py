"""Campaigns over thousands of recordings: their estimation by many processes, and the dataset of their results."""

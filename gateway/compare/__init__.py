"""Comparison of recordings, pages of a drive, and order spectra."""

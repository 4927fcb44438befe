"""The ring: its four numbers from the waveform, the rolling ring, and the fit of its exact equilibrium."""

"""What the mean waveforms leave: unexplained orders, changes from block to block, and single revolutions."""

"""A test day played with faults: pseudo-terminals, TCP, a vehicle bus, a broker and a disk, compressed in time."""

"""Export of measurements: tables of samples, revolutions and estimates in the file formats of other programs."""

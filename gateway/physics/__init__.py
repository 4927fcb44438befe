"""Physical models of the tire: functions of arrays in SI units, each with its source equation."""

"""Pure physics on arrays, SI units, each function with its source equation."""

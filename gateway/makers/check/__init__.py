"""Check of a firmware under development against the specification of the protocol."""

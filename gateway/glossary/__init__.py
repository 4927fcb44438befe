"""Words of this program, explained from the declarations that it works with."""

"""Laws: short equations for what is left where no effect of the catalogue explains it."""

"""Set-up of hubs and of this computer."""

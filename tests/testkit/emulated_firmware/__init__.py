"""The reference collector in the loop: built, emulated, and fed with the samples of simulated tires."""

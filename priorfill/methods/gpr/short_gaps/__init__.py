"""Short gaps that are filled over time, and the choice between that and a regression."""

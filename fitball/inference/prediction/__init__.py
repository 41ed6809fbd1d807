"""What follows: predictive, new impacts, simulation, court pace, engine and lookup fits, error budget."""

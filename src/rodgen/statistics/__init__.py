"""Linear statistics on NumPy arrays: column spaces, tests, and the thresholds that decide an answer."""

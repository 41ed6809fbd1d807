"""Which model: candidates, LOO, cross-validation, criteria, weights."""

"""Where tables meet models: priors, fits, posteriors, verdicts."""

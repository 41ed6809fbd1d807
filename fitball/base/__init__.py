"""Room: what every other room stands on: numbers, units, text, files, errors, priors, columns."""

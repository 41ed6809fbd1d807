"""Best values: least squares (lmfit), maximum of the posterior."""

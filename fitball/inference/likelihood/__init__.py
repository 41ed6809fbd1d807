"""How probable: densities and residuals, as functions of a Problem; derivatives."""

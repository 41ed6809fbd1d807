"""Room: what is judged of a fit: adequacy, profiles, verdicts, assumptions, constants."""

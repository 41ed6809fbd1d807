"""A fitted parameter set in other forms: ports of the model to other languages, tables, engine settings."""

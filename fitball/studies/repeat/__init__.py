"""A run made again and compared."""

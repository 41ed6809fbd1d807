"""The report of `fitball track`."""

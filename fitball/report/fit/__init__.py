"""One fit for a person: rows, terminal, page, CSV, folder."""

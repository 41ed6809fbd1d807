"""The kernel-to-C99/Python translator (1,267 lines: a compiler front end, no report)."""

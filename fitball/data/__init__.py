"""Tables, scenes and model-free balances: what was measured and what is known about it."""

"""What is found: frozen values only."""

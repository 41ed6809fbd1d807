"""What examines the machine and other people's samplers rather than a table; nothing in `fitball` knows of it."""

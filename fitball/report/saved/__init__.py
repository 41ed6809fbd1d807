"""Result files written and read back (candidate for a room of its own, fitball/store/, below report)."""

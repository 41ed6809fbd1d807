"""All of `compare`: rows, words, text, figure, folder."""

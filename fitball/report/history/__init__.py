"""All of `simulate`: rows, text, figure, folder."""

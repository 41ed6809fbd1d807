"""What a person sees of a fit: rounded numbers, figures, pages, exported files."""

"""What all reports are made of: the document and its renderers, numbers and units, parameters as text, colours,
files, folders.

Offers: `Document`, `on_terminal`, `as_page`, `as_markdown`, `parameter_row`, `fixed`, `handy`, `write_text`.
May import: data, models, inference.problem, inference.results.
"""

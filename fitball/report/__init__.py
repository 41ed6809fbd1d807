"""What a person sees: rounded numbers, sentences, figures, pages, and the files of a result folder. Nothing is fitted
here; the rooms within say what is whose.

Offers: one room for each verb (`fit`, `compare`, `predict`, `history`) over `figures`, `saved` and `form`.
May import: inference, models, data.
"""

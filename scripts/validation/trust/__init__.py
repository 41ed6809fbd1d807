"""Is what a fit says of itself true? Tables that the model made and tables that it did not are simulated and fitted;
counted is how often a fit says that it describes them, and how often what it calls identified holds the truth.
"""

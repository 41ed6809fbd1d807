"""What studies have in common: tables simulated from a truth, a posterior by a short chain, replicates that are kept
so that an interrupted run goes on, and rates.
"""

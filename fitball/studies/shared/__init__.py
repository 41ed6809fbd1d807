"""What studies have in common: tables simulated from a truth, a posterior by a short chain, replicates that are kept
so that an interrupted run goes on, and rates.

Offers: `kept_replicates`, `drawn_truth`, `simulated_columns`, `short_chain`, `Rate`.
May import: report.form, inference, models, scheduling.
"""

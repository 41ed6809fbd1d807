"""Does reweighting find a population that is known? Tables of simulated ones are fitted one by one, and counted is
how often intervals of centre and spread hold the truth, on levels too; on ten tables the joint fit is set beside it.
"""

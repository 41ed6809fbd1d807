"""What users write and what lies in result folders, damaged at random: every command must end with exit code 0 or 2.

Offers: `run_target`, `all_targets`.
May import: api, exports, report, inference, models, data.
"""

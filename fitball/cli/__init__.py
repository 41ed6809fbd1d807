"""The command line, a module for each verb: parse, call the rooms below, print, exit code.

Offers: `main`, the program `fitball`.
May import: api, batch, bench, repeat, thesis, exports, report, inference, models, data, scheduling.
"""

"""The report of a checkpoint on held-out surfaces, which `evaluate.py` makes: sections, tables and pictures."""

"""Example programs: `python -m pairmask.examples` lists them."""

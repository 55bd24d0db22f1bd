"""Methods: one module each with ``step(par, mem, sample, h, out)``; traits.py is their table."""

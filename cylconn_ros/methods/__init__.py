"""The methods: one file each, one signature, ``step(par, mem, sample, h, out)``."""

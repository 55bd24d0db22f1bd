"""Whoever solves a scene, one file each and one signature: see ``task``.

Heavy packages are imported when a task is prepared, so that all contestants can be named where only
some are installed.
"""

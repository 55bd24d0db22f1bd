"""Fault injection: behaviour of the node when messages, timing, processes and disks fail.

``run`` injects faults into real processes. ``sweep`` runs every scene of the library in process
over a faulty channel between plant and connector. ``measure`` runs both and ``tables`` prints them.
``soak`` and ``soak_report`` exchange millions of samples with a recording node.
"""

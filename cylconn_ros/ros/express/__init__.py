"""Samples from bytes to bytes in compiled code, for messages that come as nearly all do.

``lane``: four messages that differ from the ones before in stamp and numbers only become a sample.
``letters``: an answer becomes messages that were laid out before. ``tally``: what diagnostics will
say of it. ``straight``: all of it in one call, from the middleware's queues to its publishers.
Whatever is different goes the ordinary way, ros/answering.py, with the same result.
"""

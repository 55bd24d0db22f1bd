"""The map of hard conditions: which method survives what, judged from the bodies' motion alone.

``conditions`` says what is hard, ``contestants`` who tries, ``judge`` what survival is, ``measure``
runs the grid and ``show`` draws it.
"""

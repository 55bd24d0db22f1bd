"""The report of a recorded run: one page that opens anywhere, and its summary in a terminal."""

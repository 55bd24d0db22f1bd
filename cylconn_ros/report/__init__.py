"""Reports of a run: self-contained HTML page, sparklines for the terminal, matplotlib picture."""

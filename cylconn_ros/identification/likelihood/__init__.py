"""Friction law, its likelihood in slip windows, choice of its terms, and tests of its residuals."""

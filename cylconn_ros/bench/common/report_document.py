"""Put results into a page, between the marks of their command."""

from __future__ import annotations

import re

END = "<!-- end -->"


def mark(command: str) -> str:
    """The line above a command's results; `<!-- end -->` stands below them."""
    return f"<!-- {command} -->"


def replaced(page: str, command: str, text: str) -> str:
    """The page with the new results of a command. Raises ValueError where it has no place."""
    begin = mark(command)
    if page.count(begin) != 1 or END not in page.partition(begin)[2]:
        raise ValueError(f"needs one line {begin} and a line {END} below it")
    pattern = re.escape(begin) + r".*?" + re.escape(END)
    new = f"{begin}\n\n{text.strip()}\n\n{END}"
    return re.sub(pattern, lambda _: new, page, count=1, flags=re.DOTALL)

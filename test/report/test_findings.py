"""Pages of findings: text is escaped, plots of many points keep their extremes."""

from __future__ import annotations

import re

import numpy as np

from cylconn_ros.report import findings, page
from cylconn_ros.report.findings import Findings, Plot, Section, Series, Table


def test_many_points_are_drawn_by_their_extremes() -> None:
    rng = np.random.default_rng(1)
    x, y = np.arange(200_000.0), rng.standard_normal(200_000)
    y[123_456] = 40.0
    rows = findings.thinned([x, y])
    assert len(rows) <= 5 * findings.BUCKETS + 1
    assert 123_456 in rows
    assert {0, 199_999, int(y.argmin())} <= set(rows.tolist())
    assert findings.thinned([x[:2000], y[:2000]]).tolist() == list(range(2000))


def test_texts_are_escaped_and_the_parts_are_in_their_order() -> None:
    evil = "</script><img alt=x>%%numbers%%"
    points = Series(evil, "blue", "points", np.zeros(3), np.zeros(3))
    section = Section(
        "one", evil, evil, [evil], Table([evil], [[evil]]), [Plot("p", evil, evil, evil, [points])]
    )
    found = Findings(evil, "bad", [evil], [section])
    text = page.render_findings(evil, found, [page.Fact(evil, evil)], [(evil, evil)], evil)
    assert "<img" not in text
    assert text.count("</script>") == text.count("<script")
    inside = text.replace(page.library(), "")
    places = [inside.index(part) for part in ('id="verdict"', "<table>", 'class="plots"', "<dl>")]
    assert places == sorted(places)
    external = r"""(src|href)=["']?(?!data:)\w|url\(|@import|https?:|\bimport\b.*from|\bfetch\("""
    assert re.search(external, inside) is None
    assert "default-src 'none'" in text

"""Working memory of a step of connectors that share bodies: one array, cut into named parts."""

from cylconn_ros.core import model
from cylconn_ros.core.friction import SIZE, Array
from cylconn_ros.core.group_problem import GroupProblem
from cylconn_ros.core.jit import device_function
from cylconn_ros.methods.coupled.constraints import NPREPARED, Arrays


def working_size(count: int) -> int:
    """Length of the working memory of a group of ``count`` connectors, at least what it takes."""
    return model.NMEM + SIZE + 200 * count * count + 500 * count + 64


@device_function
def parts(work: Array, count: int, par: Array) -> tuple[Arrays, GroupProblem]:
    """The parts of ``work`` (working_size(count),) for connectors with the parameters ``par``."""
    n, q = 2 * count, 4 * count
    at = model.NMEM + SIZE
    sizes = (
        count * NPREPARED, 72 * count, 36 * count * count, q * q, q * q, q * q, q, q,
        (n + 1) * q, n * n, n, n * (2 * n + 1), n, count,
    )  # fmt: skip
    o1 = at + sizes[0]
    o2 = o1 + sizes[1]
    o3 = o2 + sizes[2]
    o4 = o3 + sizes[3]
    o5 = o4 + sizes[4]
    o6 = o5 + sizes[5]
    o7 = o6 + sizes[6]
    o8 = o7 + sizes[7]
    o9 = o8 + sizes[8]
    o10 = o9 + sizes[9]
    o11 = o10 + sizes[10]
    o12 = o11 + sizes[11]
    o13 = o12 + sizes[12]
    a = Arrays(
        work[0 : model.NMEM],
        work[model.NMEM : at],
        work[at : at + count * NPREPARED].reshape((count, NPREPARED)),
        work[o1 : o1 + count * 72].reshape((count, 72)),
        work[o2 : o2 + 6 * count * 6 * count].reshape((6 * count, 6 * count)),
        work[o3 : o3 + q * q].reshape((q, q)),
        work[o4 : o4 + q * q].reshape((q, q)),
        work[o5 : o5 + q * q].reshape((q, q)),
        work[o6 : o6 + q],
        work[o7 : o7 + q],
        work[o8 : o8 + (n + 1) * q].reshape((n + 1, q)),
        work[o9 : o9 + n * n].reshape((n, n)),
        work[o10 : o10 + n],
        work[o11 : o11 + n * (2 * n + 1)].reshape((n, 2 * n + 1)),
        work[o12 : o12 + n],
        work[o13 : o13 + count],
        work[o13 + count : o13 + count + 1],
    )
    s = o13 + count + 1
    by = s + n * n
    m = by + q * n
    v = m + (2 * n + 1) * (2 * n + 2)
    w = v + 16 * n
    u = w + 8 * count
    x = u + 5 * q + 2 + n
    y = x + 3 + 4 * n
    z = y + 4 * n
    g = GroupProblem(
        count, par, work[w : w + count], work[s : s + n * n].reshape((n, n)), work[v : v + n],
        work[z : z + n], work[u : u + q], work[by : by + q * n].reshape((q, n)),
        work[v + n : v + 2 * n],
        work[v + 14 * n : v + 15 * n], work[v + 15 * n : v + 16 * n],
        work[v + 2 * n : v + 3 * n], work[v + 3 * n : v + 4 * n], work[v + 4 * n : v + 5 * n],
        work[v + 5 * n : v + 6 * n], work[v + 8 * n : v + 9 * n],
        work[w + count : w + 2 * count],
        work[w + 2 * count : w + 3 * count], work[w + 3 * count : w + 4 * count],
        work[u + 5 * q : u + 5 * q + 1], work[u + 5 * q + 1 : u + 5 * q + 2],
        work[v + 6 * n : v + 7 * n], work[v + 7 * n : v + 8 * n],
        work[v + 12 * n : v + 14 * n], work[v + 9 * n : v + 10 * n], work[v + 10 * n : v + 11 * n],
        work[v + 11 * n : v + 12 * n], work[w + 4 * count : w + 5 * count],
        work[w + 5 * count : w + 6 * count], work[w + 6 * count : w + 7 * count],
        work[x : x + 1], work[w + 7 * count : w + 8 * count],
        work[u + q : u + 2 * q], work[u + 2 * q : u + 3 * q],
        work[m : m + (2 * n + 1) * (2 * n + 2)].reshape((2 * n + 1, 2 * n + 2)),
        work[u + 3 * q : u + 4 * q], work[u + 4 * q : u + 5 * q],
        work[y : y + 2 * n], work[y + 2 * n : y + 4 * n],
        work[u + 5 * q + 2 : u + 5 * q + 2 + n],
        work[x + 1 : x + 2 + 2 * n], work[x + 2 + 2 * n : x + 3 + 4 * n],
    )  # fmt: skip
    return a, g

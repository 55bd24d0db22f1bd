"""3-vectors, quaternions (x, y, z, w) and symmetric 3x3 tensors (xx, xy, xz, yy, yz, zz) as tuples.

Tuples of floats compile to registers and need no allocation; they are also the fastest form in
plain Python. A rotation matrix is a tuple of its three columns: the axes of the rotated frame.
"""

import math

from cylconn_ros.core.jit import inline_function

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Symmetric = tuple[float, float, float, float, float, float]


@inline_function
def add(a: Vector, b: Vector) -> Vector:
    """Vector algebra: a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inline_function
def sub(a: Vector, b: Vector) -> Vector:
    """Vector algebra: a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inline_function
def scale(s: float, a: Vector) -> Vector:
    """Vector algebra: s a."""
    return (s * a[0], s * a[1], s * a[2])


@inline_function
def add_scaled(a: Vector, s: float, b: Vector) -> Vector:
    """Vector algebra: a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@inline_function
def dot(a: Vector, b: Vector) -> float:
    """Vector algebra: a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline_function
def cross(a: Vector, b: Vector) -> Vector:
    """Vector algebra: a x b."""
    x, y, z = a
    u, v, w = b
    return (y * w - z * v, z * u - x * w, x * v - y * u)


@inline_function
def norm(a: Vector) -> float:
    """|a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@inline_function
def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """The product p q: first the rotation q, then the rotation p."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


@inline_function
def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation."""
    return (-q[0], -q[1], -q[2], q[3])


@inline_function
def normalised(q: Quaternion) -> Quaternion:
    """The unit quaternion q / |q|; the caller ensures that |q| is not zero."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (s * q[0], s * q[1], s * q[2], s * q[3])


@inline_function
def turned(q: Quaternion, r: Vector) -> Quaternion:
    """The orientation q after a further rotation by the rotation vector r (world axes)."""
    squared = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    if squared == 0.0:
        return q
    if squared < 1e-8:  # sin(x/2)/x by its series; the next term is below 1e-20
        half = 0.5 - squared / 48.0 * (1.0 - squared / 80.0)
        w = 1.0 - squared / 8.0 * (1.0 - squared / 48.0)
    else:
        angle = math.sqrt(squared)
        half = math.sin(0.5 * angle) / angle
        w = math.cos(0.5 * angle)
    return normalised(multiply((half * r[0], half * r[1], half * r[2], w), q))


@inline_function
def matrix(q: Quaternion) -> Matrix:
    """The axes of a frame of orientation q, as columns."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@inline_function
def out_of(m: Matrix, a: Vector) -> Vector:
    """Vector m a: components in the rotated frame to components in the outer frame."""
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = m
    x, y, z = a
    return (m00 * x + m10 * y + m20 * z, m01 * x + m11 * y + m21 * z, m02 * x + m12 * y + m22 * z)


@inline_function
def into(m: Matrix, a: Vector) -> Vector:
    """m^T a: components in the outer frame to components in the rotated frame."""
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = m
    x, y, z = a
    return (m00 * x + m01 * y + m02 * z, m10 * x + m11 * y + m12 * z, m20 * x + m21 * y + m22 * z)


@inline_function
def times(i: Symmetric, a: Vector) -> Vector:
    """The symmetric tensor times a vector."""
    xx, xy, xz, yy, yz, zz = i
    x, y, z = a
    return (xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z)


@inline_function
def tensor_in(m: Matrix, i: Symmetric) -> Symmetric:
    """Tensor m i m^T, for i given in the rotated frame, expressed in the outer frame."""
    r0 = (m[0][0], m[1][0], m[2][0])
    r1 = (m[0][1], m[1][1], m[2][1])
    r2 = (m[0][2], m[1][2], m[2][2])
    i0, i1, i2 = times(i, r0), times(i, r1), times(i, r2)
    return (dot(r0, i0), dot(r0, i1), dot(r0, i2), dot(r1, i1), dot(r1, i2), dot(r2, i2))


@inline_function
def product(a: Matrix, b: Matrix) -> Matrix:
    """a^T b: the axes of b in components of a."""
    return (into(a, b[0]), into(a, b[1]), into(a, b[2]))

"""The three machines written down by hand, as one who fits them without rodgen would.

Twice: on whole arrays (3, rows) for NumPy, with few and large operations, and in components of one row for tools that
trace or map a scalar function (JAX, CasADi). ``m`` is then the module that has sin and cos.

A unit vector n tilted by the rotation vector a u + b v, and a rotation matrix of a small vector, are written with the
series of sin(x)/x and cos(x) in x², exact to rounding below x = 0.5: they have derivatives at zero, where a fit starts.
What does not change during a fit (sine and cosine of the commands) is computed once and given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

GRAVITY = (0.0, 0.0, -1.0)


def basis(n: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return u and v that complete an axis of the machine: here all axes are those of coordinates."""
    k = int(np.argmax(np.abs(n)))
    u = np.eye(3)[(k + 1) % 3]
    return u, np.cross(n, u)


AZ, EL, BORESIGHT = (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
P1_AXIS, P2_AXIS, P2_POINT = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (150.0, 0.0, 320.0)
BALLS = ((250.0, 60.0, 400.0), (150.0, 160.0, 400.0), (150.0, 60.0, 500.0))
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ARM = (
    (Z, (0.0, 0.0, 0.0)),
    (Y, (175.0, 0.0, 495.0)),
    (Y, (175.0, 0.0, 1390.0)),
    (X, (175.0, 0.0, 1565.0)),
    (Y, (1135.0, 0.0, 1565.0)),
    (X, (1270.0, 0.0, 1565.0)),
)
REFLECTOR = (1320.0, 90.0, 1565.0)


BASES = {tuple(map(float, n)): basis(n) for n in (X, Y, Z, AZ)}


def series(square: Any) -> tuple[Any, Any, Any]:
    """Return sin(x)/x, cos(x) and (1 - cos x)/x² of a square x²."""
    sine = cosine = versine = 1.0
    for k in range(6, -1, -1):
        sine = 1 - square / ((2 * k + 2) * (2 * k + 3)) * sine
        versine = 1 - square / ((2 * k + 3) * (2 * k + 4)) * versine
        cosine = 1 - square / ((2 * k + 1) * (2 * k + 2)) * cosine
    return sine, cosine, versine / 2


# whole arrays ----------------------------------------------------------------------------------------------


def _tilted(n: Any, a: float, b: float) -> np.ndarray:
    u, v = BASES[tuple(n)]
    angle = math.hypot(a, b)
    sine = math.sin(angle) / angle if angle else 1.0
    return math.cos(angle) * np.asarray(n) + sine * (b * u - a * v)


def _skew(n: np.ndarray) -> np.ndarray:
    x, y, z = n.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _turned(n: np.ndarray, sine: np.ndarray, cosine: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Turn (3, rows) about one axis by the angle of each row."""
    along = (n[:, None] * n) @ x
    return along + cosine * (x - along) + sine * (_skew(n) @ x)


def _rotation(w: np.ndarray) -> np.ndarray:
    sine, _, versine = series(float(w @ w))
    k = _skew(w)
    return np.eye(3) + sine * k + versine * (k @ k)


def mount_arrays(theta: np.ndarray, d: Mapping[str, np.ndarray], frame: Any = None) -> np.ndarray:
    """Return the residuals, (2 rows,)."""
    theta = theta.tolist()
    az, el, target = _tilted(AZ, *theta[:2]), _tilted(EL, *theta[2:4]), _tilted(BORESIGHT, *theta[4:6])
    (sine_az, sine_el), (cosine_az, cosine_el), q_el = d["sine"], d["cosine"], d["q"][1]
    down = _turned(az, -sine_az, cosine_az, np.array(GRAVITY)[:, None])
    here = _turned(el, sine_el, cosine_el, target[:, None])
    moment = ((_skew(el) @ here) * down).sum(0)  # n . (c x g) = (n x c) . g
    q_el = q_el + theta[6] * moment
    x = _turned(el, np.sin(q_el), np.cos(q_el), target[:, None])
    x = _turned(az, sine_az, cosine_az, x)
    z = x[2]
    across = np.sqrt(1 - z * z)
    lift = theta[7] * across / z
    sine, cosine = np.sin(lift), np.cos(lift)
    x = x * (cosine - sine * z / across)
    x[2] = z * cosine + across * sine
    factor = -2 / (1 + (d["reading"] * x).sum(0))
    return np.concatenate([factor * (d["e1"] * x).sum(0), factor * (d["e2"] * x).sum(0)])


def positioner_arrays(theta: np.ndarray, d: Mapping[str, np.ndarray], frame: Any = None) -> np.ndarray:
    """Return the residuals, (3 rows,)."""
    axis = _tilted(P2_AXIS, theta[0], theta[1])
    u, v = BASES[P2_AXIS]
    point = (np.array(P2_POINT) + theta[2] * u + theta[3] * v)[:, None]
    balls = np.array(BALLS) + theta[4:13].reshape(3, 3)
    sine, cosine = d["sine"], d["cosine"]
    x = point + _turned(axis, sine[1], cosine[1], balls.T[:, d["target"]] - point)
    x = _turned(np.array(P1_AXIS), sine[0], cosine[0], x)
    rotation = frame.rotation @ _rotation(theta[16:19])
    return (d["reading"] - rotation @ x - (frame.position + theta[13:16])[:, None]).ravel()


def arm_arrays(theta: np.ndarray, d: Mapping[str, np.ndarray], frame: Any = None) -> np.ndarray:
    """Return the residuals, (3 rows,)."""
    sine, cosine = d["sine"].copy(), d["cosine"].copy()
    q0 = d["q"][0] - theta[27] / 2 * d["s"]
    q1 = d["q"][1] + theta[28] * cosine[1] + theta[29] * sine[1]
    np.sin(q0, out=sine[0]), np.cos(q0, out=cosine[0])
    np.sin(q1, out=sine[1]), np.cos(q1, out=cosine[1])
    x = (np.array(REFLECTOR) + theta[24:27])[:, None]
    for j in reversed(range(6)):
        n, p = ARM[j]
        a, b, along_u, along_v = theta[4 * j : 4 * j + 4].tolist()
        u, v = BASES[tuple(n)]
        point = (np.array(p) + along_u * u + along_v * v)[:, None]
        x = point + _turned(_tilted(n, a, b), sine[j], cosine[j], x - point)
    return (d["reading"] - x).ravel()


# one row, in components ------------------------------------------------------------------------------------

Three = Sequence[Any]
Link = Callable[[Three], Three]


def plain(x: Three) -> Three:
    """Do nothing with a link of the chain; a tool may want to know where one ends."""
    return x


def _dot(a: Three, b: Three) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Three, b: Three) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _turn(n: Three, sine: Any, cosine: Any, x: Three) -> list[Any]:
    along, across = (1 - cosine) * _dot(n, x), _cross(n, x)
    return [cosine * x[i] + sine * across[i] + along * n[i] for i in range(3)]


def _tilt(n: Sequence[float], a: Any, b: Any) -> list[Any]:
    u, v = BASES[tuple(n)]
    sine, cosine, _ = series(a * a + b * b)
    return [cosine * float(n[i]) + sine * (b * float(u[i]) - a * float(v[i])) for i in range(3)]


def _moved(p: Sequence[float], n: Sequence[float], a: Any, b: Any) -> list[Any]:
    u, v = BASES[tuple(n)]
    return [float(p[i]) + a * float(u[i]) + b * float(v[i]) for i in range(3)]


def _carry(n: Three, p: Three, sine: Any, cosine: Any, x: Three) -> Three:
    turned = _turn(n, sine, cosine, [x[i] - p[i] for i in range(3)])
    return [p[i] + turned[i] for i in range(3)]


def mount_geometry(theta: Any, frame: Any) -> list[Any]:
    """Return what all rows share: axes, target and effects."""
    return [
        *_tilt(AZ, theta[0], theta[1]),
        *_tilt(EL, theta[2], theta[3]),
        *_tilt(BORESIGHT, theta[4], theta[5]),
        theta[6],
        theta[7],
    ]


def mount_row(m: Any, g: Any, row: Any, link: Link = plain) -> list[Any]:
    """Return the two residuals of a row: sine (2), cosine (2), q (2), reading, e1 and e2 (3 each)."""
    az, el, target = g[0:3], g[3:6], g[6:9]
    down = link(_turn(az, -row[0], row[2], GRAVITY))
    here = link(_turn(el, row[1], row[3], target))
    q = row[5] + g[9] * _dot(_cross(el, here), down)
    x = link(_turn(el, m.sin(q), m.cos(q), target))
    x = link(_turn(az, row[0], row[2], x))
    across = m.sqrt(1 - x[2] * x[2])
    lift = g[10] * across / x[2]
    sine, cosine = m.sin(lift), m.cos(lift)
    shrunk = cosine - sine * x[2] / across
    x = [x[0] * shrunk, x[1] * shrunk, x[2] * cosine + across * sine]
    factor = -2 / (1 + _dot(row[6:9], x))
    return [factor * _dot(row[9:12], x), factor * _dot(row[12:15], x)]


def positioner_geometry(theta: Any, frame: Any) -> list[Any]:
    """Return axis, point, balls, and the frame's rotation and position."""
    w = theta[16], theta[17], theta[18]
    sine, _, versine = series(_dot(w, w))
    columns = []
    for i in range(3):
        e = [float(i == k) for k in range(3)]
        once = _cross(w, e)
        twice = _cross(w, once)
        columns.append([e[k] + sine * once[k] + versine * twice[k] for k in range(3)])
    r0 = frame.rotation.tolist()
    rotation = [_dot(r0[k], columns[i]) for k in range(3) for i in range(3)]
    return [
        *_tilt(P2_AXIS, theta[0], theta[1]),
        *_moved(P2_POINT, P2_AXIS, theta[2], theta[3]),
        *(BALLS[k][i] + theta[4 + 3 * k + i] for k in range(3) for i in range(3)),
        *rotation,
        *(float(frame.position[i]) + theta[13 + i] for i in range(3)),
    ]


def positioner_row(m: Any, g: Any, row: Any, link: Link = plain) -> list[Any]:
    """Return the three residuals of a row: sine (2), cosine (2), reading (3), which ball (3: 1 or 0)."""
    x = [row[7] * g[6 + i] + row[8] * g[9 + i] + row[9] * g[12 + i] for i in range(3)]
    x = link(_carry(g[0:3], g[3:6], row[1], row[3], x))
    x = link(_turn(P1_AXIS, row[0], row[2], x))
    return [row[4 + k] - _dot(g[15 + 3 * k : 18 + 3 * k], x) - g[24 + k] for k in range(3)]


def arm_geometry(theta: Any, frame: Any) -> list[Any]:
    """Return axes, points, reflector, effects."""
    g: list[Any] = []
    for j, (n, p) in enumerate(ARM):
        g += _tilt(n, theta[4 * j], theta[4 * j + 1])
        g += _moved(p, n, theta[4 * j + 2], theta[4 * j + 3])
    g += [REFLECTOR[i] + theta[24 + i] for i in range(3)]
    return [*g, theta[27], theta[28], theta[29]]


def arm_row(m: Any, g: Any, row: Any, link: Link = plain) -> list[Any]:
    """Return the three residuals of a row: sine (6), cosine (6), q (6), reading (3), s."""
    sine, cosine = [row[j] for j in range(6)], [row[6 + j] for j in range(6)]
    first = row[12] - g[39] / 2 * row[21]
    second = row[13] + g[40] * cosine[1] + g[41] * sine[1]
    sine[:2], cosine[:2] = [m.sin(first), m.sin(second)], [m.cos(first), m.cos(second)]
    x = g[36:39]
    for j in reversed(range(6)):
        x = link(_carry(g[6 * j : 6 * j + 3], g[6 * j + 3 : 6 * j + 6], sine[j], cosine[j], x))
    return [row[18 + i] - x[i] for i in range(3)]


ARRAYS = {"mount": mount_arrays, "positioner": positioner_arrays, "arm": arm_arrays}
GEOMETRY = {"mount": mount_geometry, "positioner": positioner_geometry, "arm": arm_geometry}
ROW = {"mount": mount_row, "positioner": positioner_row, "arm": arm_row}
ROW_COLUMNS = {
    "mount": ("sine", "cosine", "q", "reading", "e1", "e2"),
    "positioner": ("sine", "cosine", "reading", "one_hot"),
    "arm": ("sine", "cosine", "q", "reading", "s"),
}

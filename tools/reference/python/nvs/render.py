"""The portable render: docs/format/render.md. All arrays are f32; numpy rounds each operation by itself."""

import numpy as np

from .bits import exp

F32, U32 = np.float32, np.uint32
np.seterr(all="ignore")


def bits(x):
    return np.asarray(x, F32).view(U32)


def floats(u):
    return np.asarray(u, U32).view(F32)


def largest(a, b):
    return np.where(a > b, a, b)


def least(a, b):
    return np.where(a < b, a, b)


def clamp(x, low, high):
    return least(largest(x, low), high)


def reciprocal(x):
    y = floats(U32(0x7EF311C7) - bits(x))
    for _ in range(3):
        y = y * (F32(2) - x * y)
    return y + y * (F32(1) - x * y)


def inverse_sqrt(x):
    y = floats(U32(0x5F375A86) - (bits(x) >> U32(1)))
    half = F32(0.5) * x
    for _ in range(3):
        y = y * (F32(1.5) - half * y * y)
    return y


def sqrt(x):
    return np.where(x >= F32(2.3509887e-38), x * inverse_sqrt(x), F32(0))


LOG = [F32(c) for c in (-1.151461e-1, 1.1676999e-1, -1.2420141e-1, 1.4249323e-1, -1.6668057e-1, 2.0000715e-1,
                        -2.4999994e-1, 3.333333e-1)]


def log2(x):
    e = (bits(x) - U32(0x3F3504F3)).view(np.int32) >> 23
    t = floats(bits(x) - (e << 23).view(U32)) - F32(1)
    p = F32(7.0376836e-2)
    for c in LOG:
        p = p * t + c
    s = t * t
    ln = t + (p * t * s - F32(0.5) * s)
    return e.astype(F32) + ln * F32(1.442695)


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def times(m, v):
    return [dot(row, v) for row in m]


def matrix(q):
    w, x, y, z = q
    one, two = F32(1), F32(2)
    return [[one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)]]


def normalised(q):
    w, x, y, z = (np.asarray(v, F32) for v in q)
    s = inverse_sqrt(w * w + x * x + y * y + z * z)
    return [w * s, x * s, y * s, z * s]


def placed(pose, prior):
    """Rotation (w, x, y, z) and translation of a packet's pose, relative to the prior's centre."""
    step = F32(1) / (F32(131071) * F32(1.4142135))
    small = [F32(k) * step for k in pose.small]
    rest = F32(1) - dot(small, small)
    small.insert(pose.largest, sqrt(rest))
    q = normalised(small)
    centre = [F32(c) * F32(prior.unit / 131072) for c in pose.centre]
    return q, [-v for v in times(matrix(q), centre)]


class Scene:
    """Splats as they are drawn: "Splats"."""

    def __init__(self, prior):
        self.prior = prior
        opacity = opacities(prior.logits)
        kept = np.flatnonzero(opacity >= F32(1 / 255))
        kept = kept if len(kept) else np.array([0])
        self.clamped = bool((opacity[kept] > prior.alpha_max * (F32(1) - F32(1e-5))).any())
        self.opacity = opacity[kept]
        arrays = [a[kept] for a in (prior.positions, prior.log_scales, prior.rotations, prior.sh)]
        positions, log_scales, rotations, self.sh = arrays
        self.positions = [c.astype(F32) for c in (positions.astype(np.float64) - prior.centre.astype(np.float64)).T]
        self.axes = scaled_axes(rotations, log_scales)


def opacities(logits):
    return np.array([1 / (1 + exp(-float(v))) for v in logits], F32)


def scaled_axes(rotations, log_scales):
    """axes[i][k]: component k of axis i of each splat."""
    w, x, y, z = rotations.astype(np.float64).T
    length = np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = ((v / length).astype(F32).astype(np.float64) for v in (w, x, y, z))
    by = 1 / np.sqrt(x * x + y * y + z * z + w * w)
    w, x, y, z = w * by, x * by, y * by, z * by
    x2, y2, z2 = x + x, y + y, z + z
    xx, xy, xz, yy, yz, zz = x * x2, x * y2, x * z2, y * y2, y * z2, z * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    columns = [[1 - (yy + zz), xy + wz, xz - wy], [xy - wz, 1 - (xx + zz), yz + wx], [xz + wy, yz - wx, 1 - (xx + yy)]]
    scales = [np.array([exp(float(s)) for s in column]) for column in log_scales.T]
    return [[(v * scale).astype(F32) for v in column] for column, scale in zip(columns, scales)]


def harmonics(d):
    x, y, z = d
    xx, yy, zz = x * x, y * y, z * z
    c = F32
    return [
        np.full_like(x, 0.2820948), c(-0.48860252) * y, c(0.48860252) * z, c(-0.48860252) * x,
        c(1.0925485) * x * y, c(-1.0925485) * y * z, c(0.31539157) * (c(2) * zz - xx - yy), c(-1.0925485) * x * z,
        c(0.54627424) * (xx - yy), c(-0.5900436) * y * (c(3) * xx - yy), c(2.8906114) * x * y * z,
        c(-0.4570458) * y * (c(4) * zz - xx - yy), c(0.37317634) * z * (c(2) * zz - c(3) * xx - c(3) * yy),
        c(-0.4570458) * x * (c(4) * zz - xx - yy), c(1.4453057) * z * (xx - yy), c(-0.5900436) * x * (xx - c(3) * yy),
    ]


def colours(scene, eye):
    v = [p - e for p, e in zip(scene.positions, eye)]
    far = largest(np.abs(v[0]), largest(np.abs(v[1]), np.abs(v[2])))
    by = np.where(far < F32(1e18), F32(1), F32(1e-20))
    v = [c * by for c in v]
    inverse = inverse_sqrt(largest(dot(v, v), F32(1e-36)))
    d = [c * inverse for c in v]
    d = [np.where(np.abs(c) > F32(1e-12), c, F32(0)) for c in d]
    rgb = [np.full(len(by), 0.5, F32) for _ in range(3)]
    for k, weight in enumerate(harmonics(d)[:scene.sh.shape[1]]):
        for c in range(3):
            rgb[c] = rgb[c] + weight * scene.sh[:, k, c]
    most = np.finfo(F32).max
    return [np.where(c > F32(1e-20), least(c, most), F32(0)) for c in rgb]


def frustum(side, focal, principal):
    side, focal, principal = float(side), float(F32(focal)), float(F32(principal))
    margin = float(F32(0.3)) * 0.5 * side / focal
    return F32(-principal / focal - margin), F32((side - principal) / focal + margin)


def low_pass(prior, fx):
    """Low-pass of a picture, and the part of it that opacity does not compensate, pixels²."""
    if prior.antialiased:
        return F32(0.3), F32(0)
    if prior.trained_focal is None:
        return F32(0.3), F32(0.3)
    pixels = min(fx / prior.trained_focal, F32(64))
    kept = F32(0.3) * (pixels * pixels)
    return max(F32(0.3), kept), kept


def project(scene, camera, rotation, translation):
    """Records of splats, and which are seen."""
    prior = scene.prior
    width, height, fx, fy, cx, cy = camera
    fx, fy, cx, cy = F32(fx), F32(fy), F32(cx), F32(cy)
    r = matrix(rotation)
    p = [v + t for v, t in zip(times(r, scene.positions), translation)]
    axes = [times(r, axis) for axis in scene.axes]
    z = p[2]
    seen = (z > prior.near) & (z > F32(1e-18)) & (z < F32(1e30))
    iz = reciprocal(z)
    ray = [clamp(p[0] * iz, *frustum(width, fx, cx)), clamp(p[1] * iz, *frustum(height, fy, cy))]
    m0 = [(fx * iz) * (v[0] - ray[0] * v[2]) for v in axes]
    m1 = [(fy * iz) * (v[1] - ray[1] * v[2]) for v in axes]
    of = lambda m: largest(np.abs(m[0]), largest(np.abs(m[1]), np.abs(m[2])))
    longest = largest(of(m0), of(m1))
    seen &= longest < F32(1e30)
    s = np.where(longest > F32(1e6), reciprocal(longest), F32(1))
    m0, m1 = [v * s for v in m0], [v * s for v in m1]
    a0, b, c0 = dot(m0, m0), dot(m0, m1), dot(m1, m1)
    dilation, dilation_kept = low_pass(prior, fx)
    low = dilation * s * s
    a, c = a0 + low, c0 + low
    n = cross(m0, m1)
    det0, tr = dot(n, n), a0 + c0
    det = det0 + low * tr + low * low
    seen &= det > F32(1e-30)
    alpha = scene.opacity
    if dilation_kept < dilation:
        part = dilation_kept * s * s
        kept = det0 + part * tr + part * part
        alpha = alpha * sqrt(largest(kept * reciprocal(det), F32(2.5e-5)))
    mean = [fx * p[0] * iz + cx, fy * p[1] * iz + cy]
    seen &= (alpha >= F32(1 / 255)) & (np.abs(mean[0]) < F32(1e15)) & (np.abs(mean[1]) < F32(1e15))
    l22 = inverse_sqrt(c)
    l11 = c * l22 * inverse_sqrt(det)
    conic = [l11 * s, -l11 * b * l22 * l22 * s, l22 * s]
    g = reciprocal(s)
    sigma = [sqrt(a) * g, sqrt(c) * g]
    log = log2(alpha)
    k = sqrt(F32(1.3862944) * (log + F32(7.9943534))) * F32(1.00001)
    for axis, side in enumerate((width, height)):
        tiles = F32((side + 7) // 8)
        e = k * sigma[axis] + F32(0.51) + F32(1e-6) * np.abs(mean[axis])
        first = clamp(np.floor((mean[axis] - e) * F32(0.125)), F32(0), tiles)
        end = clamp(np.floor((mean[axis] + e) * F32(0.125)) + F32(1), F32(0), tiles)
        seen &= first < end
    return seen, mean, conic, log, z


def reach(mean, sigma, cut, side):
    """Pixels [first, end) of an axis whose tiles a splat may show in."""
    tiles = (side + 7) // 8
    half = 1.05 * np.sqrt(cut) * sigma + 2 + 1e-5 * abs(mean)
    tile = lambda v: int(min(max(np.floor(v / 8), 0), tiles))
    first, end = tile(mean - half), min(tile(mean + half) + 1, tiles)
    return 8 * first, min(8 * end, side)


def render(scene, camera, pose):
    """RGB bytes and depths at a packet's pose, and the placement."""
    rotation, translation = placed(pose, scene.prior)
    width, height = camera[:2]
    seen, mean, conic, log, z = project(scene, camera, rotation, translation)
    columns = list(zip(*matrix(rotation)))
    eye = [-dot(column, translation) for column in columns]
    rgb = colours(scene, eye)
    order = np.flatnonzero(seen)
    order = order[np.argsort(bits(z[order]), kind="stable")]
    image = np.zeros((5, height, width), F32)
    image[4] = 1
    place = [np.arange(side) for side in (width, height)]
    middle = [(p // 8 * 8 + 4).astype(F32) for p in place]
    local = [(p % 8).astype(F32) - F32(3.5) for p in place]
    limit = F32(0.7220327) + F32(0.01499177) * F32(-7.9943534)
    for i in order:
        wide = [float(v[i]) for v in conic]
        cut = max(2 * np.log(2) * float(log[i] + F32(7.9943534)) + 0.1, 0)
        x0, x1 = reach(float(mean[0][i]), np.sqrt(1 + (wide[1] / wide[2]) ** 2) / wide[0], cut, width)
        y0, y1 = reach(float(mean[1][i]), 1 / wide[2], cut, height)
        if x0 >= x1 or y0 >= y1:
            continue
        l11, l21, l22 = (v[i] * F32(0.10399171) for v in conic)
        dx = mean[0][i] - middle[0][None, x0:x1]
        dy = mean[1][i] - middle[1][y0:y1, None]
        x, y = local[0][None, x0:x1], local[1][y0:y1, None]
        w = l22 * dy
        u = (l11 * dx + l21 * dy) - l11 * x
        level = F32(0.7220327) + F32(0.01499177) * log[i] - w * w
        curve = l21 * l21 + l22 * l22
        arg = level - u * u + y * (((l21 + l21) * u + (l22 + l22) * w) - y * curve)
        power = arg * arg + F32(0.47866673)
        for _ in range(5):
            power = power * power
        if scene.clamped:
            power = least(power, scene.prior.alpha_max)
        part = image[:, y0:y1, x0:x1]
        alpha = np.where((arg >= limit) & (part[4] > F32(1e-4)), power, F32(0))
        weight = alpha * part[4]
        for c in range(3):
            part[c] += weight * rgb[c][i]
        part[3] += weight * z[i]
        part[4] -= weight
    shown = [image[c] + image[4] * F32(scene.prior.background[c]) for c in range(3)]
    low = [np.where(v > 0, v, F32(0)) for v in shown]
    bytes_ = [(np.where(v < 1, v, F32(1)) * F32(255) + F32(0.5)).astype(np.uint8) for v in low]
    depths = image[3] / largest(F32(1) - image[4], F32(1e-3))
    return np.stack(bytes_, 2), depths, (rotation, translation)

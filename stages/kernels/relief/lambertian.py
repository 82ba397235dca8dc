"""Normals of pixels that were photographed under several lights."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

_PASSES = 8
_SMALL = 3.0  # deviations of brightness
_UNLIKE = 0.015  # 1 less the cosine of 10 degrees
_OUTLIER = 2.5  # deviations at which a photograph counts half


@inner
def _median(values, count):
    """Of the first values, which are sorted."""
    for i in range(1, count):
        one, j = values[i], i
        while j > 0 and values[j - 1] > one:
            values[j] = values[j - 1]
            j -= 1
        values[j] = one
    return values[count // 2]


@compiled
def fit_lambertian(brightness, lights, triples, inverses, floor, around, normals, weights, first, last):
    """Fill rows ``first`` to ``last`` of ``normals`` and ``weights``: brightness is normal times light, or 0.

    Of the normals that three of the lights give, the start is that with the least sum of errors e / (e + e0), which
    grows ever less with an error, so that the best fit goes through three values. It is refined by least squares
    with weights that fall with the error.

    Parameters
    ----------
    brightness : (h, w, n) float32
    lights : (n, 3) float64
    triples : (m, 3) int64, lights that are not near one plane
    inverses : (m, 3, 3) float64 of the lights of each
    floor : deviation of brightness, relative to a pixel's albedo, that is no error
    around : (h, w, 3) float32, unit vectors near which normals are likely, which count as one more photograph; or 0
    normals : (h, w, 3) float32, output, times the albedo; 0 where all is dark
    weights : (h, w, n) float32, output, 0..1; of lights that reach the surface
    """
    _, width, count = brightness.shape
    error, best = np.empty(count), np.zeros(3)
    for y in range(first, last):
        for x in range(width):
            seen = brightness[y, x]
            for k in range(count):
                error[k] = seen[k]
            usual = max(_SMALL * floor * _median(error, count), 1e-12)
            least = np.inf
            best[:] = 0
            for m in range(len(triples)):
                a, b, c = seen[triples[m, 0]], seen[triples[m, 1]], seen[triples[m, 2]]
                p = inverses[m, 0, 0] * a + inverses[m, 0, 1] * b + inverses[m, 0, 2] * c
                q = inverses[m, 1, 0] * a + inverses[m, 1, 1] * b + inverses[m, 1, 2] * c
                r = inverses[m, 2, 0] * a + inverses[m, 2, 1] * b + inverses[m, 2, 2] * c
                if r <= 0:  # turned away from the camera
                    continue
                size = np.sqrt(p * p + q * q + r * r)
                unlike = max(0.0, 1 - (p * around[y, x, 0] + q * around[y, x, 1] + r * around[y, x, 2]) / size)
                total = unlike / (unlike + _UNLIKE)
                for k in range(count):
                    off = abs(max(0.0, p * lights[k, 0] + q * lights[k, 1] + r * lights[k, 2]) - seen[k])
                    total += off / (off + usual)
                    if total >= least:
                        break
                if total < least:
                    least, best[0], best[1], best[2] = total, p, q, r
            for _ in range(_PASSES):
                size = np.sqrt(best[0] * best[0] + best[1] * best[1] + best[2] * best[2])
                lit = 0
                for k in range(count):
                    made = best[0] * lights[k, 0] + best[1] * lights[k, 1] + best[2] * lights[k, 2]
                    weights[y, x, k] = 1 if made > 0 else 0
                    if made > 0:
                        error[lit] = abs(made - seen[k])
                        lit += 1
                if lit < 3:
                    break
                deviation = _OUTLIER * max(1.4826 * _median(error, lit), floor * size)
                if deviation <= 0:
                    break
                xx = xy = xz = yy = yz = zz = u = v = w = 0.0
                for k in range(count):
                    if weights[y, x, k] > 0:
                        i, j, h = lights[k, 0], lights[k, 1], lights[k, 2]
                        off = (best[0] * i + best[1] * j + best[2] * h - seen[k]) / deviation
                        weight = 1 / (1 + off * off)
                        weight *= weight
                        weights[y, x, k] = weight
                        xx, xy, xz = xx + weight * i * i, xy + weight * i * j, xz + weight * i * h
                        yy, yz, zz = yy + weight * j * j, yz + weight * j * h, zz + weight * h * h
                        u, v, w = u + weight * i * seen[k], v + weight * j * seen[k], w + weight * h * seen[k]
                a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
                whole = xx * a + xy * b + xz * c
                if whole <= 1e-9:
                    break
                best[0] = (a * u + b * v + c * w) / whole
                best[1] = (b * u + (xx * zz - xz * xz) * v + (xy * xz - xx * yz) * w) / whole
                best[2] = (c * u + (xy * xz - xx * yz) * v + (xx * yy - xy * xy) * w) / whole
            for k in range(3):
                normals[y, x, k] = best[k]

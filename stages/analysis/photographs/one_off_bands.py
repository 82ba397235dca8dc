"""Bands across a whole surface that do not repeat: cornices, sills, a course of another stone."""

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.analysis.photographs.evenness import without_drift
from texloom.stages.analysis.photographs.reduced_surface import reduced_surface, without_rim
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.numerics.filters import gradients
from texloom.stages.vocabulary.arrays import Image, Mask

_SIDE = 192  # px of the longer side, at which they are searched
_SECTIONS = 4  # along a band, in which it is told
_AGREE = 0.75  # share of the sections in which a row must stand out: a band runs across the whole surface
_OUT = 3.0  # times the median distance of rows from the median row
_NOTICED = 1.5  # CIELAB, added to that
_STEEP = 2.0  # weight of mean gradients, CIELAB for a px, against colours
_LEAST_SHOWN = 0.3  # of a row of a section, that has to be shown for it to tell
_GAP = 0.06  # of the surface: rows between two parts of one band, such as profiles of a cornice
_EDGE = 0.1  # of the surface, between a band and its border: too little to tell, and left out with it
_MOST_BANDS, _MOST = 2, 0.25  # number of bands, and share of the rows; more is how the surface is


def one_off_bands(image: Image, usable: Mask) -> Mask:
    """The rows and columns that stand out across the whole surface, at most twice along each side.

    A row stands out where its mean colour and mean gradients, in sections along it, are far from those of the
    median row. What stands out more often, or over more than a quarter, is how the surface is, such as joints.

    Parameters
    ----------
    image : the surface from the front.
    usable : where it counts.

    References
    ----------
    Ours.
    """
    lab, shown = reduced_surface(image, usable, _SIDE)
    if not shown.any():
        return np.zeros(usable.shape, np.bool_)
    lab = without_drift(lab, shown)
    found = _rows(lab, shown)[:, None] | _rows(lab.transpose(1, 0, 2), shown.T)[None]
    height, width = usable.shape
    wide = resize(found.astype(np.float32)[..., None], height, width, bilinear=True)[..., 0]
    return np.asarray((wide > 0) & usable)


def _rows(lab: Float32[np.ndarray, "h w 3"], shown: Mask) -> Bool[np.ndarray, "h"]:  # type: ignore[name-defined]
    """The rows that are in bands."""
    lightness = np.where(shown, lab[..., 0], lab[shown][:, 0].mean())
    steep = [np.abs(slope) * np.float32(_STEEP / 32) for slope in gradients(np.asarray(lightness, np.float32))]
    inner = without_rim(shown, 1)
    planes = np.concatenate([lab, np.stack(steep, axis=2)], axis=2) * inner[..., None]
    out, told = np.zeros(len(shown)), np.zeros(len(shown))
    for columns in np.array_split(np.arange(shown.shape[1]), _SECTIONS):
        count = inner[:, columns].sum(axis=1)
        tells = count >= _LEAST_SHOWN * len(columns)
        if np.count_nonzero(tells) < 8:
            continue
        mean = planes[tells][:, columns].sum(axis=1, dtype=np.float64) / count[tells][:, None]
        away = np.sqrt(np.square(mean - np.median(mean, axis=0)).sum(axis=1))
        told[tells] += 1
        out[tells] += away > _OUT * np.median(away) + _NOTICED
    known = told >= 2
    odd = known & (out >= _AGREE * told)
    return _bands(odd, np.flatnonzero(shown.any(axis=1)))


def _bands(odd: Bool[np.ndarray, "h"], places: np.ndarray) -> Bool[np.ndarray, "h"]:  # type: ignore[name-defined]
    """Rows that stand out with the gaps between them; none where these are many."""
    found = np.zeros(len(odd), np.bool_)
    rows = np.flatnonzero(odd)
    if not len(rows):
        return found
    first, last = int(places[0]), int(places[-1]) + 1
    size = last - first
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > max(1, _GAP * size)) + 1)
    for part in parts:
        top, bottom = int(part[0]) - 1, int(part[-1]) + 2  # borders are soft
        top = first if top - first < _EDGE * size else top
        bottom = last if last - bottom < _EDGE * size else bottom
        found[max(0, top) : bottom] = True
    few = len(parts) <= _MOST_BANDS and np.count_nonzero(found) <= _MOST * size
    return found if few else np.zeros(len(odd), np.bool_)

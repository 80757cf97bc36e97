"""What astronomers ask of a fitted mount: TPOINT's terms, and the pointing error on the sky."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.words import three_digits
from rodgen.data.units import ARCSEC
from rodgen.errors import RodgenError
from rodgen.machines.emit.pointing_terms import pointing_terms
from rodgen.machines.mounts import GEOMETRY, Mount, mount_of
from rodgen.statistics.decompositions import lstsq
from rodgen.views import Result, plain

ITERATIONS = 8
"""Of two zeros: from a radian off each one squares the error."""
ON_SKY = math.sqrt(2)
"""Of an error of each of the two components of a direction."""
STEP = 1e-5
"""Of derivatives by differences, rad: their error is 1e-10 of themselves."""


@dataclass(frozen=True)
class Pointing(Result):
    """The pointing of a mount, arcsec.

    Attributes
    ----------
    records, poses : int
        Rows, and how many differ: a star that is logged again while the mount tracks it is one pose.
    zeros : tuple of str, length 2
        TPOINT's names of the zeros of both axes.
    after_zeros : float
        Root mean square of the angle on the sky between what is seen and what the axes say, without their zeros alone.
    after_model : float
        That of the fit.
    terms : mapping of str to Estimate
        Terms of TPOINT. Effects that are no terms are not in it.
    """

    records: int
    poses: int
    zeros: tuple[str, str]
    after_zeros: float
    after_model: float
    terms: dict[str, Estimate]

    def sentence(self, before: float | None = None) -> str:
        """Return the pointing error on the sky, also that before effects were added, an rms of readings."""
        sizes = [f"{three_digits(self.after_zeros)} arcsec rms without {' and '.join(self.zeros)} alone"]
        if before is not None:
            sizes.append(f"{three_digits(before * ON_SKY)} with the model of the file")
        sizes.append(f"{three_digits(self.after_model)} with this model")
        again = f" ({self.records} records, {self.poses} poses)" if self.poses < self.records else ""
        return f"Pointing error on the sky{again}: {', '.join(sizes)}."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        terms = {term: {"value": e.value, "std": e.std} for term, e in self.terms.items()}
        return plain(self, "records poses zeros after_zeros after_model") | {"unit": "arcsec", "terms": terms}


def pointing(fit: Fit) -> Pointing | None:
    """Return the pointing of a fitted mount in its own axes; None of other machines."""
    mount = mount_of(fit.machine)
    if mount is None or fit.machine.measured.frame == "free" or fit.observations.blocks is not None:
        return None
    try:
        keys = [p.key for p in fit.parameters]
        terms = pointing_terms(fit.machine, (keys, fit.covariance), others=True)
    except RodgenError:  # terms are of first order in small angles
        return None
    known = bool(np.isfinite(fit.covariance).all())
    estimates = {
        term: Estimate(term, "arcsec", value, std or None, held=known and not std, determined=bool(std))
        for term, (value, std) in terms.items()
    }
    geometry = [term for term in GEOMETRY[mount.name] if term in estimates]
    estimates = {term: estimates[term] for term in dict.fromkeys([*geometry, *estimates])}
    first, second = GEOMETRY[mount.name][:2]
    poses = fit.observations.pose[~fit.outliers]
    return Pointing(
        len(poses),
        len(np.unique(poses)),
        (first, second),
        _after_zeros(fit, mount),
        fit.rms * ON_SKY,
        estimates,
    )


def _after_zeros(fit: Fit, mount: Mount) -> float:
    """Return the error on the sky without the zeros of both axes, arcsec: least squares of two angles."""
    seen, q = fit.observations.reading[~fit.outliers], fit.observations.q[~fit.outliers]
    zeros = np.zeros(2)
    for _ in range(ITERATIONS):
        at = q + zeros
        off = seen - mount.direction(*at.T)
        moves = [
            mount.direction(*(at + step).T) - mount.direction(*(at - step).T) for step in STEP * np.eye(2)
        ]
        columns = np.stack(moves, axis=-1).reshape(-1, 2) / (2 * STEP)
        zeros += lstsq(columns, off.ravel(), relative=1e-9)
    size = np.linalg.norm(seen - mount.direction(*(q + zeros).T), axis=1)
    return float(np.sqrt(np.mean((2 * np.arcsin(size / 2)) ** 2)) / ARCSEC)

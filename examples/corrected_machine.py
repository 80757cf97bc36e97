# %% [markdown]
# # From a CSV to a corrected machine
#
# A telescope observes eighty stars. The model of its mount, two perpendicular axes and a tube, predicts their
# directions with an error of 2.7 arc seconds. Which physical effect is missing, and how large is the error with it?
#
# This notebook shows every step by hand: a machine file, a measurement file, a fit, the residuals, two effects, and the
# corrected model as C for the mount's controller. With gravity and refraction added the error is 0.66 arc seconds.
# (`rodgen diagnose` looks for the effects by itself; the notebook `off_by_20_um` shows it.) The data are real: a
# pointing run of the 6.5 m MMT telescope (`machines/mount/SOURCE.txt`).

# %%
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

import rodgen

folder = Path("machines/mount")
output = Path("../build/corrected_machine")
output.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The machine and its measurements
#
# A machine is a chain of joints, described with all joints at zero. Azimuth (AZ) turns about the downward vertical,
# elevation (EL) about the axis that points east, and the tube points north. A fit without further effects adjusts the
# directions of the two axes and of the tube. Each row of the measurements has the readings of both encoders and the
# direction of a star, a unit vector `ux, uy, uz`.

# %%
machine = rodgen.Machine.load(folder / "machine.toml")
data = rodgen.Measurements.load(folder / "mmt_2021.csv")
print(machine.describe())
print(data)

# %% [markdown]
# ## Fit
#
# Each parameter is a small angle, with its standard deviation (`std`): `AZ.axis.a` and `AZ.axis.b` are the tilts of the
# azimuth axis in two directions, `target.boresight` is the tube.

# %%
fit = machine.fit(data)
print(fit.summary())

# %% [markdown]
# The axes are off by a few arc seconds, the encoders by some arc minutes: that is normal for such a mount. The
# residuals are 2.7 arc seconds per reading, and the reading of a star is good to a few tenths. So something is
# missing.
#
# ## Compare
#
# What do the residuals depend on? Each covariate is held against them, in three directions: horizontal, towards the
# zenith, and along the motion of each joint.

# %%
comparison = fit.compare()
print(comparison)

# %%
elevation = np.degrees(fit.observations.q[:, 1])
figure = go.Figure(layout={"xaxis_title": "elevation [deg]", "yaxis_title": "measured - predicted [arcsec]"})
figure.add_scatter(x=elevation, y=fit.residuals[:, 1], mode="markers", name="towards the zenith")
figure.add_scatter(
    x=elevation, y=fit.residuals[:, 0], mode="markers", name="horizontal", marker_symbol="circle-open"
)
figure.show()

# %% [markdown]
# The error is in elevation, and depends on it. At low elevation the weight of the tube bends it and winds up the
# drive, in proportion to the cosine of the elevation. In the catalogue that is `gravity_windup` at EL. Its second
# parameter, for a centre of mass off the axis, has the same effect here as an offset of the encoder, so it is held at
# zero.
#
# ## Add an effect

# %%
sagging = machine.add("gravity_windup", joint="EL", hold={"k2": 0})
fit_sagging = sagging.fit(data)
print(f"error before {fit.rms:.3f} arcsec, after {fit_sagging.rms:.3f} arcsec\n")
print(fit_sagging.compare())

# %% [markdown]
# The remaining error is largest near the horizon. There the air lifts the stars most: refraction lifts them by more
# than the coordinates of the stars allowed for.
#
# ## Add refraction

# %%
complete = sagging.add("refraction")
fit_complete = complete.fit(data)
print(fit_complete.summary())

# %% [markdown]
# The two coefficients agree with those that TPOINT, a program of astronomers for this purpose, found in these data:
# 21.41 and 2.72 arc seconds. `rodgen diagnose` finds the same model, with `tube_flexure` as the name of the sagging,
# and says that these data cannot distinguish it from others, such as a wrong ratio of the elevation drive (`scale` at
# EL), which telescopes have less often.
#
# ## Are the effects real?
#
# Or does a model with more parameters simply fit the noise? The held-out error decides: each pose is predicted by a fit
# without it.

# %%
rows = [("base", fit), ("+ gravity_windup at EL", fit_sagging), ("+ refraction", fit_complete)]
for name, each in rows:
    held_out = each.held_out()
    print(f"{name:24} fitted {each.rms:.3f}   held out {getattr(held_out, 'rms', held_out):.3f} arcsec")

# %% [markdown]
# ## The corrected model for the controller
#
# `emit` writes the fitted model as standalone C: the forward function, its Jacobian, and the compensation, which
# returns the joint commands that point the tube in a wanted direction. The folder includes a test.

# %%
print("written:", *fit_complete.machine.emit("c", output / "c"), sep="\n  ")

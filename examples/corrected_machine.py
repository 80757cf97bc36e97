# %% [markdown]
# # From a CSV to a corrected machine
#
# A telescope looks at eighty stars. The model of its mount, two perpendicular axes and a tube, puts them 2.7 arc
# seconds beside where they were seen. Which physical effect is missing, and what does the error become with it? This
# notebook goes the whole way: a machine file, a measurement file, a fit, the residuals, two effects, and the
# corrected model as C for the mount's controller. The data are real: a pointing run of the 6.5 m MMT telescope
# (`machines/mount/SOURCE.txt`). At the end the same is done to a machine of your own invention, whose truth is
# sealed.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import rodgen

folder = Path("machines/mount")
output = Path("../build/corrected_machine")
output.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The machine, and what was measured
#
# A machine is a chain of joints, given with all joints at zero. Azimuth turns about the downward vertical, elevation
# about the axis that points east, and the tube looks north. A base fit adjusts the two axes and the direction of the
# tube.

# %%
machine = rodgen.Machine.load(folder / "machine.toml")
data = rodgen.Measurements.load(folder / "mmt_2021.csv")
print(machine.describe())
print(data)

# %% [markdown]
# ## Fit

# %%
fit = machine.fit(data)
print(fit.summary())

# %% [markdown]
# The axes are a few seconds off, the encoders some minutes: that is how such a mount is. What is left is 2.7 arc
# seconds a reading, and the reading of a star is good to a few tenths. So something is missing. What does the rest
# depend on?
#
# ## Compare

# %%
comparison = fit.compare()
print(comparison)

# %%
elevation = np.degrees(fit.observations.q[:, 1])
plt.figure(figsize=(7, 3.2))
plt.plot(elevation, fit.residuals[:, 1], "k.", label="towards the zenith")
plt.plot(elevation, fit.residuals[:, 0], "o", mfc="none", color="0.5", label="horizontal")
plt.axhline(0, color="0.7", lw=0.8)
plt.xlabel("elevation [deg]")
plt.ylabel("measured - predicted [arcsec]")
plt.legend()
plt.tight_layout()
plt.show()

# %% [markdown]
# The error lies in elevation, and follows it. Low down the tube hangs: its own weight bends it and winds up the
# drive, as the cosine of the elevation. In the catalogue that is `gravity_windup` at EL; its second parameter, for a
# weight beside the axis, is the same here as an offset of the encoder, so it is held at zero.
#
# ## Add an effect

# %%
sagging = machine.add("gravity_windup", joint="EL", hold={"k2": 0})
fit_sagging = sagging.fit(data)
print(f"{fit.rms:.3f} -> {fit_sagging.rms:.3f} arcsec")
print(fit_sagging.compare())

# %% [markdown]
# What remains is strongest near the horizon: the air lifts the stars by more than the coordinates allowed for.

# %%
complete = sagging.add("refraction")
fit_complete = complete.fit(data)
print(fit_complete.summary())

# %% [markdown]
# The two coefficients agree with those that TPOINT found in these data, 21.41 and 2.72 arc seconds. Are the effects
# real, or does a model with more parameters just bend further? The held-out error tells: each pose is predicted by a
# fit that has not seen it.

# %%
rows = [("base", fit), ("+ gravity_windup at EL", fit_sagging), ("+ refraction", fit_complete)]
for name, each in rows:
    held_out = each.held_out()
    print(f"{name:24} fitted {each.rms:.3f}   held out {getattr(held_out, 'rms', held_out):.3f} arcsec")

# %% [markdown]
# ## The corrected model for the controller
#
# `emit` writes the fitted model as standalone C: forward, its Jacobian, and the compensation, which gives the joint
# commands that bring the tube to a wanted direction. The folder brings its own test.

# %%
for path in fit_complete.machine.emit("c", output / "c"):
    print(path)

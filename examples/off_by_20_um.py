# %% [markdown]
# # My machine is off by 20 µm. What is it?
#
# A slide is commanded to 800 mm, and a laser tracker reads 800.020. This notebook finds out why, from readings that
# were taken while the slide warmed up. The answer comes out below: the screw of the X axis expands with its
# temperature, by 1.05 · 10⁻⁵ per kelvin, the coefficient of steel. Six steps lead there, and from there to a
# corrected machine:
#
# 1. *fit* the model to the readings: is anything wrong?
# 2. *compare* readings and model: where is it wrong?
# 3. *diagnose*: which physical effect does it?
# 4. *plan*: what should be measured next?
# 5. *add* the effect, and write the corrected model as C code;
# 6. *report*: a page for the workshop.
#
# `docs/start/first_diagnosis.md` shows the same steps on the command line. The machine is simulated, so the true answer
# is known and can be compared with what is found.
#
# ## The machine
#
# It has two linear axes, X and Y, and a ball whose place is measured. What a fit adjusts before any effect is added
# is the place of the ball.

# %%
from pathlib import Path

import plotly.graph_objects as go

import rodgen
from rodgen.calibration.plan import plan

folder = Path("off_by_20_um")
output = Path("../build/off_by_20_um")
output.mkdir(parents=True, exist_ok=True)
machine = rodgen.Machine.load(folder / "machine.toml")
print(machine.describe())

# %% [markdown]
# ## Measurements
#
# Three passes along X, one reading per minute, each with the temperature of the screw's nut (`T_X`), and readings of a
# second day for a test. The simulation has one hidden effect, a steel screw that expands with its temperature; nothing
# below uses it.

# %%
design = rodgen.Measurements.load(folder / "design.csv")
hidden = "thermal_expansion@X:alpha=1.1e-5"
data = rodgen.simulate(machine, design, [hidden], seed=20).data
another_day = rodgen.simulate(
    machine, rodgen.Measurements.load(folder / "design_2.csv"), [hidden], seed=21
).data
print(data)

# %% [markdown]
# ## Fit: is anything wrong?

# %%
fit = machine.fit(data)
print(fit.summary())

# %% [markdown]
# Yes. The tracker is good to a micrometre (`noise`), but the readings are off by three (`rms`, the root of the mean
# square of the residuals). `p` is the probability of such residuals if the model were right.
#
# ## Compare: where is it wrong?
#
# Each covariate is held against the residuals: how much of their variance does it explain, and with what probability
# would chance do the same?

# %%
print(fit.compare())

# %%
x, warmth = fit.observations.q[:, 0], fit.observations.temperature["X"]
figure = go.Figure(layout={"xaxis_title": "X [mm]", "yaxis_title": "measured - predicted, x [µm]"})
marker = {"color": warmth, "colorscale": "Cividis", "colorbar_title": "X above<br>20 °C [K]"}
figure.add_scatter(x=x, y=1e3 * fit.residuals[:, 0], mode="markers", marker=marker)
figure.show()

# %% [markdown]
# The figure shows the residuals along X: they grow with the distance, and more so when the screw is warm. But the slide
# warmed up during the measurement, so they vary with time as well. Looking at one covariate at a time cannot decide
# between them.
#
# ## Diagnose: what is it?
#
# Every effect of the catalogue is tried at every joint. The most probable set of effects is named, each with what these
# data cannot distinguish from it. The second day takes no part in the search; it is only
# predicted.

# %%
found = fit.diagnose(test=another_day)
print(found)

# %% [markdown]
# The error falls to the noise of the tracker, on the second day as well. How clear is the decision? The five best
# candidates, with the odds of the model with each alone, as a power of ten, and the share of the variance that it
# explains:

# %%
print("effect                             odds   explains")
for candidate in found.ranking[:5]:
    print(f"{candidate.effect.title:28}   10^{candidate.log10_odds:<8.1f} {candidate.explains:5.0%}")

# %% [markdown]
# Neither the distance alone (`scale`) nor the temperature alone (`thermal_offset`) explains the error: their product
# does. That is a scale that expands with temperature, and its coefficient is that of steel.
#
# ## Plan: what to measure next
#
# Six more readings are allowed. Which would make the coefficient most certain?

# %%
more = plan(found, 6, wanted=["X.thermal_expansion.alpha"])
print(more)

# %% [markdown]
# ## Add: the corrected machine
#
# The machine file gets the effect, with its coefficient from a new fit. The corrected model is written as C for the
# controller, with a test.

# %%
better = machine.add(found.steps[0]).fit(data)
print(f"error before {fit.rms:.5f} mm, after {better.rms:.5f} mm")
print("written:", *better.machine.emit("c", output / "c"), sep="\n  ")

# %% [markdown]
# ## Report: the page for the workshop
#
# One HTML page holds the fit, the diagnosis and the plan, with figures.

# %%
print("written:", *rodgen.write_report(found, output / "report.html", more), sep="\n  ")

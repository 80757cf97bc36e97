# %% [markdown]
# # My machine is off by 20 µm. What is it?
#
# A slide is commanded to 800 mm, and a laser tracker reads 800.020. This notebook finds out why, from readings that
# were taken while the slide warmed up: fit, compare, diagnose, plan, add, report. `docs/diagnose.md` shows the same
# steps on the command line.
#
# The machine is simulated, so the answer is known. First the machine file, with two linear axes and a ball:

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
# Three passes along X, one reading per minute, each with the temperature of the screw's nut. The hidden effect, a steel
# screw that expands with its temperature, is not used from here on.

# %%
design = rodgen.Measurements.load(folder / "design.csv")
hidden = "thermal_expansion@X:alpha=1.1e-5"
data = rodgen.simulate(machine, design, [hidden], seed=20).data
another_day = rodgen.simulate(
    machine, rodgen.Measurements.load(folder / "design_2.csv"), [hidden], seed=21
).data
print(data)

# %% [markdown]
# ## Is anything wrong?

# %%
fit = machine.fit(data)
print(fit.summary())

# %% [markdown]
# The tracker is good to a micrometre, the model to three. Where is it wrong?

# %%
print(fit.compare())

# %%
x, warmth = fit.observations.q[:, 0], fit.observations.temperature["X"]
figure = go.Figure(layout={"xaxis_title": "X [mm]", "yaxis_title": "measured - predicted, x [µm]"})
marker = {"color": warmth, "colorscale": "Cividis", "colorbar_title": "X above<br>20 °C [K]"}
figure.add_scatter(x=x, y=1e3 * fit.residuals[:, 0], mode="markers", marker=marker)
figure.show()

# %% [markdown]
# The residuals vary with temperature, and with time as well: the slide warmed up during the measurement. Looking at one
# covariate at a time cannot decide between them.
#
# ## What is it?
#
# Every effect of the catalogue is tried at every joint. The effects that the data support are added, each with a list
# of the others that would change these readings in the same way. The second day is only predicted.

# %%
found = fit.diagnose(test=another_day)
print(found)

# %%
for candidate in found.ranking[:5]:
    print(f"{candidate.effect.title:28} log10 p {candidate.log10_p:8.1f}   explains {candidate.explains:.0%}")

# %% [markdown]
# Neither the distance nor the temperature alone explains the error: their product does. That is a scale that expands
# with temperature, and its coefficient is that of steel.
#
# ## What to measure next

# %%
more = plan(found, 6, wanted=["X.thermal_expansion.alpha"])
print(more)

# %% [markdown]
# ## The corrected machine, and the page for the workshop

# %%
better = machine.add(found.steps[0]).fit(data)
print(f"{fit.rms:.5f} -> {better.rms:.5f} mm")
print(*better.machine.emit("c", output / "c"), sep="\n")

# %%
print(*rodgen.write_report(found, output / "report.html", more), sep="\n")

#!/usr/bin/python3
"""The display of LinuxCNC in tests: homes the joints, runs path.ngc, and writes what is sampled into path.txt.

LinuxCNC runs it with the Python of the system, where its own modules are.
"""

import subprocess
import sys
import time

import linuxcnc

LONGEST = 60.0
"""Seconds of a step, on a slow machine."""

command, status, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()


def until(done, what):
    """Wait until something is so; an error message of LinuxCNC ends the run."""
    end = time.monotonic() + LONGEST
    while True:
        status.poll()
        said = errors.poll()
        if said and said[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            sys.exit(f"rodgen: {what}: {said[1]}")
        if done():
            return
        if time.monotonic() > end:
            sys.exit(f"rodgen: {what}: not within {LONGEST:.0f} s")
        time.sleep(0.01)


for state in (linuxcnc.STATE_ESTOP_RESET, linuxcnc.STATE_ON):
    command.state(state)
    until(lambda state=state: status.task_state == state, "switching on")
command.mode(linuxcnc.MODE_MANUAL)
command.wait_complete()
command.teleop_enable(0)
command.wait_complete()
command.home(-1)
until(lambda: all(status.homed[: status.joints]), "homing")
with open("path.txt", "w") as file, subprocess.Popen(["halsampler"], stdout=file) as sampler:
    command.mode(linuxcnc.MODE_AUTO)
    command.wait_complete()
    command.program_open("path.ngc")
    command.wait_complete()
    command.auto(linuxcnc.AUTO_RUN, 0)
    until(lambda: status.interp_state != linuxcnc.INTERP_IDLE, "starting")
    until(lambda: status.interp_state == linuxcnc.INTERP_IDLE and status.inpos, "running")
    time.sleep(0.1)  # until the last rows are written
    sampler.terminate()

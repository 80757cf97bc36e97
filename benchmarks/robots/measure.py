"""Random poses of each robot; rodgen's kernels, ssik's compiled solvers and EAIK on them, in turn."""

from __future__ import annotations

import os
import time

import clock
import environments
import numpy as np

from rodgen.kinematics import spatial

N = 20_000
"""Poses of one call of rodgen: their results stay in the second cache or the third."""
FEW = 500
"""Poses of the peers, which take them one by one."""
ROBOTS = {"Puma 560": spatial.PUMA_560, "GE P60": spatial.GE_P60, "T3-776": spatial.T3_776}
OWN_REVERSE, OWN_FORWARD = "rodgen: reverse", "rodgen: forward"
FORWARD = (OWN_FORWARD, "ssik: fk, in Python", "EAIK: fwdkin")
AGREE = 1e-6
"""Largest difference of an angle: the peers lose digits near poses where solutions meet."""


def measure(*, quick: bool = False) -> dict:
    """Time everything in alternating rounds; check that all answers agree."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    environments.ensure(environments.PEERS, environments.HERE / "requirements-peers.txt")
    environments.append_to_path(environments.PEERS)
    from robots.peers import Peers

    robots, share, rounds = {}, 1.0, 0
    for name, mechanism in ROBOTS.items():
        rng = np.random.default_rng(1)
        q = rng.uniform(-np.pi, np.pi, (N, 6))
        T = spatial.forward(mechanism, q)
        few, few_q = T[:FEW], list(q[:FEW])
        peers = Peers(mechanism)
        worst, counts = peers.disagreement(few, spatial.reverse(mechanism, few))
        if worst > AGREE or counts > FEW // 100:
            raise AssertionError(f"{name}: angles differ by {worst:.1e} rad, {counts} counts differ")
        as_ssik, as_eaik = peers.poses(few)
        entries = {
            OWN_REVERSE: clock.Entry(lambda m=mechanism, T=T: spatial.reverse(m, T), N),
            "ssik: its C++ solver": clock.Entry(lambda p=peers, T=as_ssik: p.reverse(T), FEW),
            "EAIK": clock.Entry(lambda p=peers, T=as_eaik: p.reverse_eaik(T), FEW),
            "EAIK: a list of poses": clock.Entry(
                # its worker is another thread
                lambda p=peers, T=as_eaik: p.reverse_eaik_list(T),
                FEW,
                processor=time.process_time_ns,
            ),
            "rodgen: reverse, one pose a call": clock.Entry(
                lambda m=mechanism, T=few: [spatial.reverse(m, one) for one in T], FEW
            ),
            OWN_FORWARD: clock.Entry(lambda m=mechanism, q=q: spatial.forward(m, q), N),
            "ssik: fk, in Python": clock.Entry(lambda p=peers, q=few_q: p.forward_ssik(q), FEW),
            "EAIK: fwdkin": clock.Entry(lambda p=peers, q=few_q: p.forward_eaik(q), FEW),
        }
        for entry in entries.values():
            clock.calibrate(entry, 0.02 if quick else 0.05)
        share = min(share, clock.alternate(entries, 3 if quick else 9, budget_s=40))
        rounds = len(entries[OWN_REVERSE].samples)
        rows = []
        for what, entry in entries.items():
            forward = what in FORWARD
            rows.append(
                {
                    "name": what,
                    "kind": "forward" if forward else "reverse",
                    "ns": round(entry.median, 1),
                    "spread": round(entry.spread, 3),
                    "ratio": round(clock.ratio(entry, entries[OWN_FORWARD if forward else OWN_REVERSE]), 2),
                }
            )
        robots[name] = {"rows": rows, "family": peers.family, "apart": worst, "counts": counts}
    return {"robots": robots, "rounds": rounds, "share": round(share, 3), "n": N, "few": FEW}

"""The robots as ssik and EAIK know them, called pose by pose: neither takes an array of poses.

Both get all lengths divided by the reach, as their tolerances are for lengths near 1. Of ssik the prepared C++ solver
is called itself: its Python functions around that cost fifty times as much. EAIK is called through its extension as
well, with the poses in a list beforehand, one by one and as a list for its own loop over poses (one thread).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rodgen.kinematics import spatial

RAW = (0, False, np.zeros(0), "wrap_linf", False, 0.0, -1, False, 15, False)
"""ssik: no limits, no seed, all solutions, no rescue, no further turns."""


class Peers:
    """One robot in both libraries."""

    def __init__(self, mechanism: spatial.Mechanism) -> None:
        import ssik
        import ssik._native
        from eaik.IK_HP import HPRobot

        self.reach = float(np.abs(mechanism.a).sum() + np.abs(mechanism.offset).sum())
        a, alpha = np.append(0, mechanism.a) / self.reach, np.append(0, mechanism.alpha)
        links = spatial.link_transform(a, alpha, mechanism.offset / self.reach, 0.0)
        arm = ssik.Manipulator.from_transforms([*links, np.eye(4)])
        self.family = arm.solver_name
        self.fk = arm.fk
        self.ssik = ssik._native._solver(ssik._native._load_ext(), arm.kinbody, self.family)
        axes, steps, frame, before = [], [], np.eye(4), np.zeros(3)
        for link in links:
            frame = frame @ link
            axes.append(frame[:3, 2])
            steps.append(frame[:3, 3] - before)
            before = frame[:3, 3]
        self.turn = frame[:3, :3].T
        self.eaik = HPRobot(np.array(axes), np.array([*steps, np.zeros(3)]))

    def poses(self, T: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Poses as ssik and as EAIK take them."""
        one = T.copy()
        one[:, :3, 3] /= self.reach
        other = one.copy()
        other[:, :3, :3] = one[:, :3, :3] @ self.turn
        return one, list(other)

    def reverse(self, poses: np.ndarray) -> list[np.ndarray]:
        solve = self.ssik.solve
        return [solve(pose, *RAW)[0] for pose in poses]

    def reverse_eaik(self, poses: list[np.ndarray]) -> list[np.ndarray]:
        solve = self.eaik._robot.calculate_IK
        return [solve(pose) for pose in poses]

    def reverse_eaik_list(self, poses: list[np.ndarray]) -> list:
        return self.eaik._robot.calculate_IK_batched(poses, 1)

    def forward_eaik(self, q: list[np.ndarray]) -> list[np.ndarray]:
        forward = self.eaik._robot.fwdkin
        return [forward(one) for one in q]

    def forward_ssik(self, q: list[np.ndarray]) -> list[np.ndarray]:
        return [self.fk(one) for one in q]

    def disagreement(self, T: np.ndarray, found: spatial.Reverse) -> tuple[float, int]:
        """Tell how far the nearest of each solution of the peers is off (rad), and how many counts differ."""
        ours, theirs = self.poses(T)
        worst, counts = 0.0, 0
        answers: tuple[tuple[Callable, object], ...] = ((self.reverse, ours), (self.reverse_eaik, theirs))
        for solve, poses in answers:
            for status, angles, answer in zip(found.status, found.solutions, solve(poses), strict=True):
                there = angles[status <= spatial.ReverseStatus.FAMILY]
                q = np.array(answer) if solve == self.reverse else np.array(answer.Q)[~np.array(answer.is_LS)]
                counts += len(q) != len(there)
                if len(q) and len(there):
                    apart = np.abs(np.remainder(q[:, None] - there + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
                    worst = max(worst, float(apart.min(axis=1).max()))
        return worst, counts

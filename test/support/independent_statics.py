# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The energy and the tendons of an arm, written anew from its description alone.

Nothing of the solver is imported: the arm is built body by body in the world frame (z up), in
joint angles, so that a slip in the solver's load coefficients, absolute angles or mounting
rotation shows.  Derivatives are complex steps, hence exact to rounding.
"""

import numpy as np
from scipy.optimize import minimize


class IndependentArm:
    """Potential energy, tendon lengths and their derivatives over all joint angles, SI units."""

    def __init__(self, arm):
        """Read the description of ``arm``."""
        self.arm = arm
        n = arm.bodies_per_segment
        self.joints = len(arm.segments) * (n + 1)
        self.springs = np.concatenate(
            [np.full(n + 1, (n + 1) * s.stiffness_y / s.length) for s in arm.segments])

    def walk(self, q):
        """Return (energy, right length, left length, world points of body ends) at angles q."""
        arm, n = self.arm, self.arm.bodies_per_segment
        angle, gravity = arm.mounting_angle + 0.0 * q[..., 0], np.linalg.norm(arm.gravity)
        x = arm.discs[0].height * np.sin(angle)
        z = arm.discs[0].height * np.cos(angle)
        energy = 0.5 * (self.springs * q * q).sum(axis=-1)
        lengths = [0.0, 0.0]
        ends = [(x, z)]
        joint = 0
        for s, (segment, disc) in enumerate(zip(arm.segments, arm.discs[1:], strict=True)):
            lower = self._guides(x, z, angle, arm.tendons[0].offset_at(s, 0.0))
            for _ in range(n):
                angle = angle + q[..., joint]
                joint += 1
                dx = segment.length / n * np.sin(angle)
                dz = segment.length / n * np.cos(angle)
                energy = energy + segment.mass / n * gravity * (z + dz / 2)
                x, z = x + dx, z + dz
                ends.append((x, z))
            angle = angle + q[..., joint]
            joint += 1
            upper = self._guides(x, z, angle, arm.tendons[0].offset_at(s, 1.0))
            for side in (0, 1):
                run = [b - a for a, b in zip(lower[side], upper[side], strict=True)]
                lengths[side] = lengths[side] + np.sqrt(run[0]**2 + run[1]**2)
            dx, dz = disc.height * np.sin(angle), disc.height * np.cos(angle)
            energy = energy + disc.mass * gravity * (z + dz / 2)
            x, z = x + dx, z + dz
            ends.append((x, z))
        return energy, lengths[0], lengths[1], ends

    @staticmethod
    def _guides(x, z, angle, offset):
        right = (x + offset * np.cos(angle), z - offset * np.sin(angle))
        left = (x - offset * np.cos(angle), z + offset * np.sin(angle))
        return right, left

    def values(self, q):
        """Return (energy J, right length m, left length m)."""
        return np.array(self.walk(np.asarray(q, dtype=float))[:3])

    def gradients(self, q):
        """Return d(energy, right length, left length)/dq, shape (3, joints)."""
        stepped = np.asarray(q) + 1e-30j * np.eye(self.joints)
        return np.array([v.imag / 1e-30 for v in self.walk(stepped)[:3]])

    def hessians(self, q, step=1e-5):
        """Return the second derivatives, shape (3, joints, joints)."""
        q = np.asarray(q, dtype=float)
        rows = [(self.gradients(q + e) - self.gradients(q - e)) / (2 * step)
                for e in step * np.eye(self.joints)]
        both = np.array(rows).transpose(1, 0, 2)
        return 0.5 * (both + both.transpose(0, 2, 1))

    @property
    def straight_lengths(self):
        """Length of each tendon in the straight arm, m."""
        return self.values(np.zeros(self.joints))[1:]

    def free_joints(self, soft):
        """Return which joints belong to a soft segment."""
        return np.repeat(np.asarray(soft, dtype=bool), self.arm.bodies_per_segment + 1)

    def minimise(self, start, pulls, soft):
        """Return the joint angles that SLSQP finds from ``start``, and whether it succeeded."""
        free = self.free_joints(soft)
        start = np.array(start, dtype=float)
        scale = 1.0 / self.springs.mean()
        carrying = [t for t in (0, 1) if np.isfinite(pulls[t])]
        limit = self.straight_lengths - np.where(np.isfinite(pulls), pulls, 0.0)

        def whole(part):
            q = start.copy()
            q[free] = part
            return q

        found = minimize(
            lambda p: self.values(whole(p))[0] * scale, start[free], method='SLSQP',
            jac=lambda p: self.gradients(whole(p))[0][free] * scale,
            constraints=[{
                'type': 'ineq',
                'fun': lambda p, t=t: (limit[t] - self.values(whole(p))[1 + t]) * 10.0,
                'jac': lambda p, t=t: -self.gradients(whole(p))[1 + t][free] * 10.0,
            } for t in carrying],
            options={'ftol': 1e-16, 'maxiter': 1000})
        q = whole(found.x)
        feasible = all(self.values(q)[1 + t] <= limit[t] + 1e-8 for t in carrying)
        return q, feasible and (found.success or found.status == 8)

    def unbalanced(self, q, tensions, soft):
        """Return the largest moment (N m) about a soft joint that the tensions leave over."""
        energy, right, left = self.gradients(q)
        moment = energy + tensions[0] * right + tensions[1] * left
        free = self.free_joints(soft)
        return float(np.abs(moment[free]).max()) if free.any() else 0.0

    def lowest_curvature(self, q, tensions, soft, tight=1e-9):
        """
        Return the smallest curvature of the energy over directions that the taut tendons leave.

        Relative to the springs' own, N m/rad.  A tendon holds a direction only while it carries
        tension; one that is just long enough without tension lets the arm shorten its path.
        """
        free = self.free_joints(soft)
        first = self.gradients(q)[:, free]
        second = self.hessians(q)[:, free][:, :, free]
        hessian = second[0] + tensions[0] * second[1] + tensions[1] * second[2]
        hold = first[1:][np.asarray(tensions) > tight]
        basis = np.eye(free.sum())
        if len(hold):
            _, singular, vectors = np.linalg.svd(hold)
            rank = int((singular > 1e-9 * singular[0]).sum())
            basis = vectors[rank:].T
        if basis.shape[1] == 0:
            return np.inf
        springs = np.diag(self.springs[free])
        root = np.linalg.cholesky(basis.T @ springs @ basis)
        inner = np.linalg.solve(root, np.linalg.solve(root, basis.T @ hessian @ basis).T)
        return float(np.linalg.eigvalsh(inner)[0])

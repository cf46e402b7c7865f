# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The energy of an arm with every kind of spring, jam, tendon and load, from its description alone.

Nothing of the solver is imported.  Derivatives are complex steps, hence exact to rounding; the
second ones are differences of these.
"""

import numpy as np
from scipy.optimize import minimize

STEP = 1e-30


def density(law, curvature):
    """Return the integral of the moment from 0 to a curvature, J/m; complex-safe."""
    size = np.where(np.real(curvature) < 0.0, -1.0, 1.0) * curvature
    k, m = np.array(law.curvatures), np.array(law.moments)
    slopes = np.diff(m) / np.diff(k)
    areas = np.concatenate([[0.0], np.cumsum(0.5 * (m[1:] + m[:-1]) * np.diff(k))])
    row = np.clip(np.searchsorted(k, np.real(size)) - 1, 0, len(slopes) - 1)
    beyond = size - k[row]
    return areas[row] + m[row] * beyond + 0.5 * slopes[row] * beyond**2


class Reference:
    """
    Energy, tendon spans and equilibrium of an arm over its joint angles, SI units.

    stiff: one flag per segment.  held: (joints,) rad, the shape that the jams hold.  vacuum: one
    number from 0 to 1 per segment.
    """

    def __init__(self, arm, stiff=None, held=None, vacuum=None):
        """Read the description of ``arm``."""
        self.arm = arm
        self.segments, self.bodies = len(arm.segments), arm.bodies_per_segment
        self.joints = self.segments * (self.bodies + 1)
        self.stiff = (False,) * self.segments if stiff is None else tuple(stiff)
        self.held = np.zeros(self.joints) if held is None else np.asarray(held)
        self.vacuum = (1.0,) * self.segments if vacuum is None else tuple(vacuum)
        self.free = np.repeat([not (s and g.jam.ratio == np.inf and g.jam.law is None)
                               for s, g in zip(self.stiff, arm.segments, strict=True)],
                              self.bodies + 1)

    def rows(self, segment):
        """Return the joints of a segment."""
        return slice(segment * (self.bodies + 1), (segment + 1) * (self.bodies + 1))

    def parts(self, segment):
        """Return the length of spring, m, in each joint of a segment."""
        length, n = self.arm.segments[segment].length, self.bodies
        if self.arm.discretisation == 'paper':
            return np.full(n + 1, length / (n + 1))
        parts = np.full(n + 1, length / n)
        parts[[0, -1]] /= 2.0
        return parts

    def soft_density(self, segment, curvature):
        """Return the energy of the leaf spring per length, J/m."""
        if segment.soft_law is not None:
            return density(segment.soft_law, curvature)
        return 0.5 * segment.stiffness_y * curvature**2

    def springs(self, q):
        """Return the elastic energy in every joint, soft and jammed, (2, ..., joints), J."""
        soft, jammed = 0.0 * q, 0.0 * q
        for s, segment in enumerate(self.arm.segments):
            rows, parts = self.rows(s), self.parts(s)
            soft[..., rows] = parts * self.soft_density(segment, q[..., rows] / parts)
            if not (self.stiff[s] and self.free[rows].all()):
                continue
            away = (q - self.held)[..., rows] / parts
            if segment.jam.law is not None:
                extra = density(segment.jam.law, away) - self.soft_density(segment, away)
            else:
                extra = (segment.jam.ratio - 1.0) * self.soft_density(segment, away)
            part = self.vacuum[s]**segment.jam.stiffness_exponent
            jammed[..., rows] = part * parts * extra
        return soft, jammed

    def jam_moments(self, q):
        """Return the moment of every jam about its held shape, N m (as if none yields)."""
        return self.springs(np.asarray(q) + 1j * STEP)[1].imag / STEP

    def walk(self, q):
        """Return the energy of the loads, J, and the tendons' spans (..., 2, segments), m."""
        arm = self.arm
        theta = np.cumsum(q, axis=-1)
        down_x, _, down_z = arm.gravity
        x = z = angle = 0.0 * q[..., 0]
        z = z + arm.discs[0].height
        energy, spans = 0.0, []
        body = 0
        for s, segment in enumerate(arm.segments):
            lower = self.guides(x, z, angle, arm.tendons[0].offset_at(s, 0.0))
            for _ in range(self.bodies):
                angle = theta[..., body]
                dx = segment.length / self.bodies * np.sin(angle)
                dz = segment.length / self.bodies * np.cos(angle)
                fallen = down_x * (x + dx / 2) + down_z * (z + dz / 2)
                energy = energy - segment.mass / self.bodies * fallen
                x, z, body = x + dx, z + dz, body + 1
            angle = theta[..., body]
            body += 1
            upper = self.guides(x, z, angle, arm.tendons[0].offset_at(s, 1.0))
            spans.append([np.sqrt((b[0] - a[0])**2 + (b[1] - a[1])**2)
                          for a, b in zip(lower, upper, strict=True)])
            dx = arm.discs[s + 1].height * np.sin(angle)
            dz = arm.discs[s + 1].height * np.cos(angle)
            middle = x + dx / 2, z + dz / 2
            fallen = down_x * middle[0] + down_z * middle[1]
            energy = energy - arm.discs[s + 1].mass * fallen
            for wrench in arm.wrenches:
                if wrench.disc == s + 1:
                    energy = energy - wrench.force[0] * middle[0] - wrench.force[2] * middle[1]
            x, z = x + dx, z + dz
        energy = energy - arm.payload * (down_x * x + down_z * z)
        return energy, np.moveaxis(np.array(spans), (0, 1), (-1, -2))

    @staticmethod
    def guides(x, z, angle, offset):
        """Return the right and the left guide of a disc end."""
        across_x, across_z = offset * np.cos(angle), -offset * np.sin(angle)
        return (x + across_x, z + across_z), (x - across_x, z - across_z)

    def energy(self, q):
        """Return the energy of springs, jams and loads, J."""
        q = np.asarray(q)
        soft, jammed = self.springs(q)
        return (soft + jammed).sum(axis=-1) + self.walk(q)[0]

    def spans(self, q):
        """Return the tendons' spans (..., 2, segments), m."""
        return self.walk(np.asarray(q))[1]

    def pulls(self, q):
        """Return by how much both tendons are shorter than in the straight arm, (2,), m."""
        return (self.spans(np.zeros(self.joints)) - self.spans(q)).sum(axis=-1)

    def gradient(self, q):
        """Return the derivative of the energy, (joints,), N m."""
        return self.energy(np.asarray(q) + 1j * STEP * np.eye(self.joints)).imag / STEP

    def span_gradients(self, q):
        """Return the derivatives of the spans, (joints, 2, segments), m."""
        return self.spans(np.asarray(q) + 1j * STEP * np.eye(self.joints)).imag / STEP

    def moments(self, q, tensions, ratios=None):
        """Return the moment that springs, loads and tendons leave over in every joint, N m."""
        shares = np.ones((2, self.segments)) if ratios is None else ratios
        along = (self.span_gradients(q) * shares).sum(axis=2)
        return self.gradient(q) + along @ np.asarray(tensions)

    def unbalanced(self, q, tensions, ratios=None):
        """Return the largest moment that is left over in a joint that can move, N m."""
        left = self.moments(q, tensions, ratios)[self.free]
        return float(np.abs(left).max()) if left.size else 0.0

    def hessian(self, q, tensions, ratios=None, step=1e-6):
        """Return the second derivative at constant tensions, (joints, joints), N m."""
        steps = step * np.eye(self.joints)
        return np.array([(self.moments(q + e, tensions, ratios)
                          - self.moments(q - e, tensions, ratios)) / (2 * step) for e in steps])

    def stable(self, q, tensions):
        """Whether a state is a strict minimum along all that the taut tendons leave free."""
        hessian = self.hessian(q, tensions)[self.free][:, self.free]
        rows = self.span_gradients(q).sum(axis=2)[self.free][:, np.asarray(tensions) > 1e-9]
        basis = np.eye(len(hessian))
        if rows.size:
            left, sizes, _ = np.linalg.svd(rows)
            basis = left[:, int((sizes > 1e-9 * sizes[0]).sum()):]
        inner = basis.T @ (hessian + hessian.T) @ basis
        return inner.size == 0 or np.linalg.eigvalsh(inner)[0] > 0.0

    def rest(self, start, tensions=(0.0, 0.0), stretch=None):
        """
        Return the joint angles of least energy near ``start``, by scipy's BFGS.

        tensions: given, N.  stretch: (pulls, compliance) of tendons that are springs instead, in
        m and m/N.
        """
        start = np.array(start, dtype=float)
        straight = self.spans(np.zeros(self.joints)).sum(axis=-1)
        scale = max(s.stiffness_y / s.length for s in self.arm.segments)

        def whole(part):
            q = start.astype(part.dtype) + np.zeros((*part.shape[:-1], 1))
            q[..., self.free] = part
            return q

        def energy(part):
            q = whole(part)
            lengths = self.spans(q).sum(axis=-1)
            total = self.energy(q) + lengths @ np.asarray(tensions, dtype=float)
            if stretch is not None:
                over = lengths - (straight - np.asarray(stretch[0]))
                taut = np.real(over) > 0.0
                total = total + (np.where(taut, over, 0.0)**2).sum(axis=-1) / (2 * stretch[1])
            return total / scale

        def slope(part):
            return energy(part + 1j * STEP * np.eye(part.size)).imag / STEP

        found = minimize(lambda p: float(energy(p)), start[self.free], jac=slope, method='BFGS',
                         options={'gtol': 1e-11, 'maxiter': 2000})
        return whole(found.x)

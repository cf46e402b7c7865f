/*
 * Copyright 2026 The soft_continuum authors
 * SPDX-License-Identifier: Apache-2.0
 *
 * What the solver is measured against: the same Newton method written by hand for one case only.
 *
 * A weightless chain of SEGMENTS soft segments with JOINTS joints each, from its absolute angles;
 * one tendon on the right of given length.  In absolute angles the springs give a tridiagonal
 * Hessian, the tendon a diagonal and one rank-one term per span, and its length a border.
 * SEGMENTS and JOINTS are set on the compiler's command line.
 */
#include <math.h>
#include <string.h>
#include <time.h>

#define COUNT (SEGMENTS * JOINTS)
#define WIDTH (2 + SEGMENTS) /* right-hand sides: moments, the border, one span each */
#define SMALL (1 + SEGMENTS)

enum { STABLE, UNSTABLE, FAILED };

static const double MOMENT_TOLERANCE = 1e-11, LENGTH_TOLERANCE = 1e-13, STEP_LIMIT = 0.7;

typedef struct {
    double length[COUNT];    /* of every body, m */
    double stiffness[COUNT]; /* of the joint below it, N m/rad */
    double lower[SEGMENTS], upper[SEGMENTS]; /* offsets of the guides, m */
} chain;

/* Eliminates a small symmetric system without pivoting; returns its negative pivots. */
static int small_solve(double m[SMALL][SMALL], double b[SMALL]) {
    int negatives = 0;
    for (int k = 0; k < SMALL; k++) {
        negatives += m[k][k] < 0.0;
        for (int r = k + 1; r < SMALL; r++) {
            double factor = m[r][k] / m[k][k];
            for (int c = k + 1; c < SMALL; c++) m[r][c] -= factor * m[k][c];
            b[r] -= factor * b[k];
        }
    }
    for (int k = SMALL - 1; k >= 0; k--) {
        for (int c = k + 1; c < SMALL; c++) b[k] -= m[k][c] * b[c];
        b[k] /= m[k][k];
    }
    return negatives;
}

/*
 * Finds the equilibrium near theta (rad) and tension (N), in place, at a length of the tendon (m).
 * Fills the iterations and the largest unbalanced moment (N m); returns how it ended.
 */
int solve(const chain *arm, double target, double *theta, double *tension, int *iterations,
          double *residual) {
    double gradient[COUNT], diagonal[COUNT], off[COUNT], x[COUNT][WIDTH];
    double border[COUNT], across[SEGMENTS][JOINTS + 1], sine[COUNT], cosine[COUNT];
    double largest = 1.0;
    int negatives = 0;
    for (int iteration = 0; iteration < 40; iteration++) {
        const double f = *tension;
        double gap = -target;
        for (int i = 0; i < COUNT; i++) {
            sine[i] = sin(theta[i]);
            cosine[i] = cos(theta[i]);
            border[i] = 0.0;
        }
        for (int i = 0; i < COUNT; i++) {
            double up = i + 1 < COUNT ? arm->stiffness[i + 1] : 0.0;
            double below = i > 0 ? theta[i - 1] : 0.0;
            gradient[i] = arm->stiffness[i] * (theta[i] - below);
            if (i + 1 < COUNT) gradient[i] -= up * (theta[i + 1] - theta[i]);
            diagonal[i] = arm->stiffness[i] + up;
            off[i] = -up;
        }
        memset(x, 0, sizeof x);
        for (int s = 0; s < SEGMENTS; s++) {
            const int first = s * JOINTS, disc = first + JOINTS - 1;
            const double a = arm->lower[s], b = arm->upper[s];
            const double low_sine = s ? sine[first - 1] : 0.0, low_cosine = s ? cosine[first - 1] : 1.0;
            double span_x = b * cosine[disc] - a * low_cosine;
            double span_z = a * low_sine - b * sine[disc];
            for (int i = first; i < disc; i++) {
                span_x += arm->length[i] * sine[i];
                span_z += arm->length[i] * cosine[i];
            }
            const double span = sqrt(span_x * span_x + span_z * span_z);
            const double ux = span_x / span, uz = span_z / span, scale = sqrt(f / span);
            gap += span;
            for (int i = s ? first - 1 : first; i <= disc; i++) {
                const double sn = sine[i], cs = cosine[i];
                double along, turned; /* the span's change by this angle: along u, across it */
                if (i < first) {
                    along = a * (ux * sn + uz * cs);
                    turned = a * (ux * cs - uz * sn);
                    diagonal[i] += f * turned;
                } else if (i == disc) {
                    along = -b * (ux * sn + uz * cs);
                    turned = -b * (ux * cs - uz * sn);
                    diagonal[i] += f * turned;
                } else {
                    along = arm->length[i] * (ux * cs - uz * sn);
                    turned = -arm->length[i] * (ux * sn + uz * cs);
                    diagonal[i] += f * turned;
                }
                border[i] += along;
                across[s][i - first + 1] = x[i][2 + s] = scale * turned;
            }
        }
        double worst = 0.0;
        for (int i = 0; i < COUNT; i++) {
            gradient[i] += f * border[i];
            worst = fmax(worst, fabs(gradient[i]));
            x[i][0] = -gradient[i];
            x[i][1] = border[i];
        }
        *iterations = iteration;
        *residual = worst;
        if (!(worst < 1e30)) return FAILED;
        if (worst <= MOMENT_TOLERANCE && fabs(gap) <= LENGTH_TOLERANCE && iteration > 0 &&
            largest < 1e-4)
            return negatives ? UNSTABLE : STABLE;

        int pivots = diagonal[0] < 0.0;
        for (int i = 1; i < COUNT; i++) {
            const double factor = off[i - 1] / diagonal[i - 1];
            diagonal[i] -= factor * off[i - 1];
            pivots += diagonal[i] < 0.0;
            for (int c = 0; c < WIDTH; c++) x[i][c] -= factor * x[i - 1][c];
        }
        for (int c = 0; c < WIDTH; c++) x[COUNT - 1][c] /= diagonal[COUNT - 1];
        for (int i = COUNT - 2; i >= 0; i--) {
            const double inverse = 1.0 / diagonal[i];
            for (int c = 0; c < WIDTH; c++)
                x[i][c] = (x[i][c] - off[i] * x[i + 1][c]) * inverse;
        }

        double m[SMALL][SMALL] = {{0}}, step[SMALL] = {0};
        for (int s = 0; s < SEGMENTS; s++) {
            const int first = s * JOINTS;
            for (int i = s ? first - 1 : first; i < first + JOINTS; i++) {
                const double value = across[s][i - first + 1];
                for (int c = 0; c < SEGMENTS; c++) m[s][c] += value * x[i][2 + c];
                m[s][SEGMENTS] += value * x[i][1];
                step[s] += value * x[i][0];
            }
            m[s][s] += 1.0;
        }
        for (int i = 0; i < COUNT; i++) {
            for (int c = 0; c < SEGMENTS; c++) m[SEGMENTS][c] += border[i] * x[i][2 + c];
            m[SEGMENTS][SEGMENTS] += border[i] * x[i][1];
            step[SEGMENTS] += border[i] * x[i][0];
        }
        step[SEGMENTS] += gap;
        /* Haynsworth: a minimum has as many negative pivots here as in the tridiagonal part. */
        negatives = small_solve(m, step) - pivots;

        largest = 0.0;
        for (int i = 0; i < COUNT; i++) {
            double change = x[i][0] - x[i][1] * step[SEGMENTS];
            for (int c = 0; c < SEGMENTS; c++) change -= x[i][2 + c] * step[c];
            x[i][0] = change;
            largest = fmax(largest, fabs(change));
        }
        const double fraction = largest <= STEP_LIMIT ? 1.0 : STEP_LIMIT / largest;
        for (int i = 0; i < COUNT; i++) theta[i] += fraction * x[i][0];
        *tension += fraction * step[SEGMENTS];
    }
    return FAILED;
}

/* Returns the processor time in s of one of `repeats` solves from theta and tension. */
double time_solve(const chain *arm, double target, const double *theta, double tension,
                  int repeats) {
    struct timespec begin, end;
    double shape[COUNT], force, residual;
    volatile int ended;
    int iterations;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    for (int r = 0; r < repeats; r++) {
        memcpy(shape, theta, sizeof shape);
        force = tension;
        ended = solve(arm, target, shape, &force, &iterations, &residual);
    }
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    (void)ended;
    return ((end.tv_sec - begin.tv_sec) + 1e-9 * (end.tv_nsec - begin.tv_nsec)) / repeats;
}

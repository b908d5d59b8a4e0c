/* Coefficients: Dormand & Prince, "A family of embedded Runge-Kutta formulae", J. Comput. Appl. Math. 6 (1980).
   Step size: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, II.4. */
#include "integrator.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "plant_table.h"

double number_of_steps(double start, double end, double size)
{
    double slack = 1e-6 + 2 * DBL_EPSILON * fabs(start) / size;
    return fmax(1, ceil((end - start) / size - slack));
}

int arrive(const ode *problem, integration_point *at, double t, const double x[N_STATES],
           const double xdot[N_STATES], double *end)
{
    int changed = 0;
    at->t = t;
    memcpy(at->x, x, sizeof at->x);
    memcpy(at->xdot, xdot, sizeof at->xdot);
    if (!problem->accept(problem->owner, at->t, at->x, at->xdot, end, &changed))
        return 0;
    if (changed)
        problem->derivatives(problem->owner, at->t, at->x, at->xdot);
    return 1;
}

integration integrate_fixed(const ode *problem, integration_point *at, double end, double size)
{
    double start = at->t, n = number_of_steps(start, end, size), span = end - start, planned = end;
    long done = 0;
    if (n > MOST_FIXED_STEPS)
        return TOO_MANY_STEPS;
    while (at->t < end) {
        if (end != planned) { /* the observer has reduced it; no more steps than were left */
            start = at->t;
            n = number_of_steps(start, end, size);
            span = end - start;
            planned = end;
            done = 0;
        }
        done++;
        double t = (double)done < n ? start + span * ((double)done / n) : end, x[N_STATES], xdot[N_STATES];
        if (!(t > at->t))
            return STEP_TOO_SMALL;
        integration how = fixed_step(problem, at, t, span / n, x, xdot);
        if (how != REACHED_END)
            return how;
        if (!arrive(problem, at, t, x, xdot, &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}

#if !HAS_BRISTLES
#define STAGES 7

/* the last row is the solution of order 5, so stage 7 is the first stage of the next step */
static const double A[STAGES][STAGES - 1] = {
    {0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
};
static const double C[STAGES] = {0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
/* order 5 less order 4 */
static const double E[STAGES] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                 -17253.0 / 339200, 22.0 / 525, -1.0 / 40};

static const double SAFETY = 0.9, SMALLEST_FACTOR = 0.2, LARGEST_FACTOR = 10;

/* fmax as one instruction; it need not handle NaN, since a NaN in x makes the norm NaN anyway */
static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* Root mean square of v in units of the tolerance at x. */
static double scaled_norm(const double v[], const double x[], const double y[], double tolerance)
{
    double sum = 0;
    for (int i = 0; i < N_STATES; i++) {
        double r = v[i] / (tolerance + tolerance * larger(fabs(x[i]), fabs(y[i])));
        sum += r * r;
    }
    return sqrt(sum / N_STATES);
}

/* First step size, from the magnitudes of x, f and a difference quotient of f. */
static double first_step(const ode *problem, const integration_point *at, double span, double tolerance)
{
    double x1[N_STATES], f1[N_STATES];
    double d0 = scaled_norm(at->x, at->x, at->x, tolerance), d1 = scaled_norm(at->xdot, at->x, at->x, tolerance);
    double h0 = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1;
    h0 = fmin(h0, span);
    for (int i = 0; i < N_STATES; i++)
        x1[i] = at->x[i] + h0 * at->xdot[i];
    problem->derivatives(problem->owner, at->t + h0, x1, f1);
    for (int i = 0; i < N_STATES; i++)
        f1[i] -= at->xdot[i];
    double d2 = scaled_norm(f1, at->x, at->x, tolerance) / h0, d = fmax(d1, d2);
    double h1 = d <= 1e-15 ? fmax(1e-6, 1e-3 * h0) : pow(0.01 / d, 1.0 / 5);
    /* not finite if the trial step reached a pole: then use the small step */
    return h1 < 100 * h0 ? h1 : isfinite(h1) ? 100 * h0 : h0;
}

static void add_multiple(double v[N_STATES], double factor, const double of[N_STATES])
{
    for (int i = 0; i < N_STATES; i++)
        v[i] += factor * of[i];
}

/* One trial step from `at` to x after h, with all stages; returns the error in units of the tolerance. */
static double attempt(const ode *problem, const integration_point *at, double t, double h, double tolerance,
                      double k[STAGES][N_STATES], double x[N_STATES])
{
    double error[N_STATES] = {0};
    memcpy(k[0], at->xdot, sizeof k[0]);
    for (int s = 1; s < STAGES; s++) {
        memcpy(x, at->x, sizeof at->x);
        for (int r = 0; r < s; r++)
            add_multiple(x, h * A[s][r], k[r]);
        problem->derivatives(problem->owner, s == STAGES - 1 ? t : at->t + C[s] * h, x, k[s]);
    }
    for (int s = 0; s < STAGES; s++)
        add_multiple(error, h * E[s], k[s]);
    return scaled_norm(error, at->x, x, tolerance);
}

integration integrate_controlled(const ode *problem, integration_point *at, double end, double tolerance)
{
    double k[STAGES][N_STATES], x[N_STATES];
    double proposal = at->step > 0 ? at->step : first_step(problem, at, end - at->t, tolerance);
    int rejected = 0;
    for (long steps = 0; at->t < end; steps++) {
        if (steps == MOST_INTERNAL_STEPS)
            return TOO_MANY_STEPS;
        /* avoid a very short last step */
        int last = at->t + 1.01 * proposal >= end;
        double h = last ? end - at->t : proposal, t = last ? end : at->t + h;
        if (!(h > 0) || !(t > at->t) || (!last && h < 16 * DBL_EPSILON * fabs(at->t))) {
            at->step = h;
            return STEP_TOO_SMALL;
        }
        double error = attempt(problem, at, t, h, tolerance, k, x);
        if (!(error < 1)) { /* also for NaN */
            rejected = 1;
            double factor = isfinite(error) ? fmax(SMALLEST_FACTOR, SAFETY * pow(error, -1.0 / 5)) : SMALLEST_FACTOR;
            proposal = h * factor;
            at->step = proposal;
            if (proposal < DBL_MIN)
                return STEP_TOO_SMALL;
            continue;
        }
        double factor = error == 0 ? LARGEST_FACTOR : fmin(LARGEST_FACTOR, SAFETY * pow(error, -1.0 / 5));
        if (rejected)
            factor = fmin(factor, 1);
        rejected = 0;
        factor = fmax(factor, SMALLEST_FACTOR);
        /* a step shortened to end on time is no estimate for the next one */
        proposal = last && h < proposal ? fmax(proposal, h * factor) : h * factor;

        at->step = proposal;
        if (!arrive(problem, at, t, x, k[STAGES - 1], &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}

/* Classical RK4. */
integration fixed_step(const ode *problem, integration_point *at, double t, double h, double x[N_STATES],
                       double xdot[N_STATES])
{
    double k2[N_STATES], k3[N_STATES], k4[N_STATES];
    memcpy(x, at->x, sizeof at->x);
    add_multiple(x, h / 2, at->xdot);
    problem->derivatives(problem->owner, at->t + h / 2, x, k2);
    memcpy(x, at->x, sizeof at->x);
    add_multiple(x, h / 2, k2);
    problem->derivatives(problem->owner, at->t + h / 2, x, k3);
    memcpy(x, at->x, sizeof at->x);
    add_multiple(x, h, k3);
    problem->derivatives(problem->owner, t, x, k4);
    for (int i = 0; i < N_STATES; i++)
        x[i] = at->x[i] + h / 6 * (at->xdot[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    problem->derivatives(problem->owner, t, x, xdot);
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(x[i]) || !isfinite(xdot[i]))
            return NOT_FINITE;
    return REACHED_END;
}
#endif

/* Steps of a plant with bristles by exponential_step.h: under error control, from halved steps; or fixed, with
   w = nu + gain (z - z0) in place of the velocities nu that friction brakes, divided where they do not resolve a bristle. */
#include "integrator.h"

#if HAS_BRISTLES
#include <float.h>
#include <math.h>
#include <string.h>

#define WIDTH 1
#include "exponential_step.h"

/* ---- error control -------------------------------------------------------------------------------------------- */

/* A step from t over h: for the rates in its stages. */
typedef struct {
    const ode *problem;
    double t, h;
} span;

static void rates_in_stage(void *owner, double share, const double x[N_STATES], double rate[N_STATES])
{
    const span *s = owner;
    s->problem->derivatives(s->problem->owner, s->t + share * s->h, x, rate);
}

/* From (t, x) with the derivatives there to `end` after h. */
static void step_from(const ode *problem, const coefficients *c, double t, double h, const double x[N_STATES],
                      const double rate[N_STATES], double end[N_STATES])
{
    span of_step = {problem, t, h};
    double rates[4][N_STATES];
    bristle_stages bristles;
    memcpy(rates[0], rate, sizeof rates[0]);
    exponential_step(c, h, x, rates, rates_in_stage, &of_step, &bristles, end);
}

/* The largest |a - b| in units of the tolerance at x and a, relative, and absolute in SI units times the nominal of a
   state over that of the pose. */
static double distance(const double a[N_STATES], const double b[N_STATES], const double x[N_STATES], double tolerance)
{
    double largest = 0;
    for (int i = 0; i < N_STATES; i++) {
        double size = NOMINAL_STATES[i] / NOMINAL_STATES[0];
        double r = fabs(a[i] - b[i]) / (tolerance * (size + fmax(fabs(x[i]), fabs(a[i]))));
        if (!(r <= largest))
            largest = r; /* also NaN */
        if (isnan(largest))
            break;
    }
    return largest;
}

/* By which the next step is longer, from 0.2 to 4; 0.1 if the error is not finite. */
static double factor_of(double error)
{
    if (!isfinite(error))
        return 0.1;
    return error > 0 ? fmin(4, fmax(0.2, 0.9 * pow(error, -0.2))) : 4;
}

integration integrate_controlled(const ode *problem, integration_point *at, double end, double tolerance)
{
    double h = at->step > 0 ? at->step : end - at->t;
    for (long steps = 0; at->t < end; steps++) {
        if (steps == MOST_INTERNAL_STEPS)
            return TOO_MANY_STEPS;
        int last = at->t + h >= end;
        double size = last ? end - at->t : h, t = last ? end : at->t + size;
        if (!(t > at->t) || (!last && h < 16 * DBL_EPSILON * fabs(end))) {
            at->step = size;
            return STEP_TOO_SMALL;
        }
        double decay[N_LEGS], coarse[N_STATES], middle[N_STATES], fine[N_STATES], rate[N_STATES];
        coefficients whole, half;
        problem->decays(problem->owner, at->x, decay);
        find_coefficients(decay, size, &whole);
        find_coefficients(decay, size / 2, &half);
        step_from(problem, &whole, at->t, size, at->x, at->xdot, coarse);
        step_from(problem, &half, at->t, size / 2, at->x, at->xdot, middle);
        /* the same rate in both halves: any is right, the nearest is the most exact */
        problem->derivatives(problem->owner, at->t + size / 2, middle, rate);
        step_from(problem, &half, at->t + size / 2, size / 2, middle, rate, fine);
        double error = distance(fine, coarse, at->x, tolerance) / 15, factor = factor_of(error);
        if (!(error <= 1)) {
            at->step = h = size * factor;
            if (h < DBL_MIN)
                return STEP_TOO_SMALL;
            continue;
        }
        /* a step shortened to end on time is no estimate for the next one */
        at->step = h = last && size < h ? fmax(h, size * factor) : size * factor;
        problem->derivatives(problem->owner, t, fine, rate);
        if (!arrive(problem, at, t, fine, rate, &end))
            return GIVEN_UP;
    }
    return REACHED_END;
}

/* ---- fixed steps ------------------------------------------------------------------------------------------------

   Friction has the part sigma1 dz/dt, which falls within 1/d, a hundredth of a step of 1 ms at speed. Its sum over the
   stages of a step would be wrong by a factor of up to h d; its integral is sigma1 times a difference of z. So in place of
   the velocities nu that friction brakes a step has w = nu + gain (z - z0), with the gain at its begin: dw/dt has nothing
   of sigma1 dz/dt but what the gain changes within the step. Likewise the weights of RK4 give a wrong integral of z where
   z falls within a step. ETDRK4 has it exactly, as of a state that -z drives, and its difference from the sum of RK4 is
   taken from the velocities at the end. Without decay that is 0, and all is RK4.

   The error of the bristles costs next to nothing: with the rate at the end instead of that of the fourth stage the scheme
   has order 3, and their distance is that of these rates times the stage's coefficient. That is blind to a kink between
   the stages: where a leg reverses, the error of Simpson's rule over the kink is added. Where v crosses 0, the slope of
   d z jumps by the slope of v times |d z/v|; the rule's error for max(0, a (t - tau)) is a h^2 (theta^2/2 - theta/6),
   theta = tau/h or 1 - tau/h below 1/2: about a h^2 theta (1 - theta)/6, at most 0.042 a h^2. A step that is off by more
   than RESOLUTION of a bristle's reach is divided. Of the accelerations dw/dt there is the same distance, in units of what
   Coulomb friction would give: modes of elastic legs, which RK4 damps, are resolved while a jump of the force lets them
   ring. */

/* of the motors if legs are elastic, else of the platform */
#if HAS_SPRINGS
enum { X_BRAKED = X_MOTOR_VELOCITY };
#else
enum { X_BRAKED = X_VELOCITY };
#endif

static const double LARGEST_FACTOR = 4, SMALLEST_FACTOR = 0.1, SAFETY = 0.8;

/* The same equations with w for nu, over a step from t. */
typedef struct {
    span of_step;
    grip of_legs;
    double start[N_LEGS]; /* z0 */
} momentum;

/* v += sign gain b */
static void add_gain(const momentum *m, double sign, const double b[N_LEGS], double v[N_LEGS])
{
    for (int k = 0; k < N_LEGS; k++)
        for (int i = 0; i < N_LEGS; i++)
            v[i] += sign * m->of_legs.gain[N_LEGS * k + i] * b[k];
}

/* The state of y. */
static void leave_momentum(const momentum *m, const double y[N_STATES], double x[N_STATES])
{
    double bent[N_LEGS];
    for (int i = 0; i < N_LEGS; i++)
        bent[i] = y[X_LEG_BRISTLE + i] - m->start[i];
    memcpy(x, y, sizeof(double) * N_STATES);
    add_gain(m, -1, bent, x + X_BRAKED);
}

static void rates_in_momentum(void *owner, double share, const double y[N_STATES], double rate[N_STATES])
{
    momentum *m = owner;
    double x[N_STATES];
    leave_momentum(m, y, x);
    rates_in_stage(&m->of_step, share, x, rate);
    add_gain(m, 1, rate + X_LEG_BRISTLE, rate + X_BRAKED);
}

/* The integral of z over a step of ETDRK4 less the sum of RK4: phi_2, phi_3, phi_4 in place of phi_1, phi_2, phi_3. */
static double missed_integral(double decay, double h, const bristle_stages *bristles, int k)
{
    double phi[5];
    const double z[] = {bristles->z[0][k], bristles->z[1][k], bristles->z[2][k], bristles->z[3][k]};
    const double n[] = {bristles->n[0][k], bristles->n[1][k], bristles->n[2][k], bristles->n[3][k]};
    phi_functions(-h * decay, phi);
    double exact = phi[1] * z[0] + h * ((phi[2] - 3 * phi[3] + 4 * phi[4]) * n[0] +
                                        (2 * phi[3] - 4 * phi[4]) * (n[1] + n[2]) + (4 * phi[4] - phi[3]) * n[3]);
    return h * (exact - (z[0] + 2 * (z[1] + z[2]) + z[3]) / 6);
}

/* Adds the errors of bristles whose leg turns within the step from x to `end`. */
static void add_reversals(const momentum *m, double h, const double x[N_STATES], const double end[N_STATES],
                          double error[N_LEGS])
{
    const ode *problem = m->of_step.problem;
    double after[N_LEGS], decay[N_LEGS];
    int known = 0;
    problem->sliding(problem->owner, end, after);
    for (int k = 0; k < N_LEGS; k++) {
        double before = m->of_legs.sliding[k];
        if (!(before * after[k] < 0))
            continue;
        if (!known)
            problem->decays(problem->owner, end, decay);
        known = 1;
        double kink = fabs(m->of_legs.decay[k] * x[X_LEG_BRISTLE + k] / before) +
                      fabs(decay[k] * end[X_LEG_BRISTLE + k] / after[k]);
        error[k] += kink * h / 6 * fabs(before * after[k] / (after[k] - before));
    }
}

/* The largest error of dw/dt over a step, the distance from its rates in the last stage, those of a scheme of order 3, to
   the rate at the end, in units of what Coulomb friction of all legs would give. */
static double share_of_friction(const momentum *m, const double last_rate[N_STATES], const double end_rate[N_STATES])
{
    double end[N_LEGS], friction[N_LEGS] = {0}, largest = 0;
    memcpy(end, end_rate + X_BRAKED, sizeof end);
    add_gain(m, 1, end_rate + X_LEG_BRISTLE, end);
    for (int k = 0; k < N_LEGS; k++)
        for (int i = 0; i < N_LEGS; i++)
            friction[i] += fabs(m->of_legs.gain[N_LEGS * k + i]) * m->of_legs.ratio[k] * m->of_legs.reach[k];
    for (int i = 0; i < N_LEGS; i++)
        largest = fmax(largest, fabs(end[i] - last_rate[X_BRAKED + i]) / (10 * friction[i]));
    return largest;
}

/* One undivided step from (t, x) with the rate there to `end` with its rate; the largest error of bristles and
   accelerations in units of their RESOLUTION, infinite for a step that has diverged. */
static double momentum_step(const ode *problem, double t, double h, const double x[N_STATES],
                            const double rate[N_STATES], double end[N_STATES], double end_rate[N_STATES])
{
    momentum m = {.of_step = {problem, t, h}};
    double rates[4][N_STATES], last[N_STATES], missed[N_LEGS], error[N_LEGS], largest = 0;
    coefficients c;
    bristle_stages bristles;
    problem->find_grip(problem->owner, x, &m.of_legs);
    find_coefficients(m.of_legs.decay, h, &c);
    memcpy(m.start, x + X_LEG_BRISTLE, sizeof m.start);
    memcpy(rates[0], rate, sizeof rates[0]);
    add_gain(&m, 1, rates[0] + X_LEG_BRISTLE, rates[0] + X_BRAKED);
    exponential_step(&c, h, x, rates, rates_in_momentum, &m, &bristles, last);
    leave_momentum(&m, last, end);
    for (int k = 0; k < N_LEGS; k++)
        missed[k] = m.of_legs.ratio[k] * (c.decay[k] > 0 ? missed_integral(c.decay[k], h, &bristles, k) : 0);
    add_gain(&m, -1, missed, end + X_BRAKED);
    problem->derivatives(problem->owner, t + h, end, end_rate);
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(end[i]) || !isfinite(end_rate[i]))
            return INFINITY;
    for (int k = 0; k < N_LEGS; k++) {
        int i = X_LEG_BRISTLE + k;
        error[k] = fabs(c.last[k] * (end_rate[i] + c.decay[k] * end[i] - bristles.n[3][k]));
    }
    add_reversals(&m, h, x, end, error);
    for (int k = 0; k < N_LEGS; k++)
        largest = fmax(largest, error[k] / (RESOLUTION * m.of_legs.reach[k]));
    return fmax(largest, share_of_friction(&m, rates[3], end_rate) / FORCE_RESOLUTION);
}

/* A step from (t, x) to `end`, divided where needed; else the time that MOST_SUBSTEPS reach, or the next one would. */
static double divided_step(const ode *problem, double t, double end, double x[N_STATES], double rate[N_STATES])
{
    double start = t, size = end - t, next[N_STATES], next_rate[N_STATES];
    for (int tried = 0; tried < MOST_SUBSTEPS; tried++) {
        double parts = ceil((end - t) / size - 1e-9), h = (end - t) / parts;
        double error = momentum_step(problem, t, h, x, rate, next, next_rate);
        double factor = error > 0 ? SAFETY * pow(error, -0.25) : LARGEST_FACTOR;
        size = h * fmin(LARGEST_FACTOR, fmax(SMALLEST_FACTOR, factor));
        if (!(error <= 1))
            continue;
        memcpy(x, next, sizeof next);
        memcpy(rate, next_rate, sizeof next_rate);
        if (parts == 1)
            return end;
        t += h;
    }
    return t > start ? t : start + size;
}

integration fixed_step(const ode *problem, integration_point *at, double t, double h, double x[N_STATES],
                       double xdot[N_STATES])
{
    (void)h; /* it lands on t */
    memcpy(x, at->x, sizeof at->x);
    memcpy(xdot, at->xdot, sizeof at->xdot);
    double reached = divided_step(problem, at->t, t, x, xdot);
    if (!(reached < t))
        return REACHED_END;
    at->step = reached - at->t;
    return TOO_FAST;
}
#else
/* A file without declarations is not C. */
typedef int no_bristles;
#endif

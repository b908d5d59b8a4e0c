/* Fixed steps of legs that stick: by steps.h, with w = nu + gain (z - z0) in place of the velocities nu that friction
   brakes, divided where they do not resolve a bristle.

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

#include "step.h"

#if HAS_BRISTLES
#include <math.h>

#include "kernel.h"

/* of the motors if legs are elastic, else of the platform */
#if HAS_SPRINGS
enum { X_BRAKED = X_MOTOR_VELOCITY };
#else
enum { X_BRAKED = X_VELOCITY };
#endif

static const double LARGEST_FACTOR = 4, SMALLEST_FACTOR = 0.1, SAFETY = 0.8;

/* What friction does within a step, see kernel_grip. */
typedef struct {
    double decay[N_LEGS], gain[N_LEGS * N_LEGS], ratio[N_LEGS], reach[N_LEGS], sliding[N_LEGS];
} grip;

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

static void rates_in_momentum(const void *owner, double share, const double y[N_STATES], double rate[N_STATES])
{
    const momentum *m = owner;
    double x[N_STATES];
    leave_momentum(m, y, x);
    find_stage_rates(&m->of_step, share, x, rate);
    add_gain(m, 1, rate + X_LEG_BRISTLE, rate + X_BRAKED);
}

/* The integral of z over a step of ETDRK4 less the sum of RK4: phi_2, phi_3, phi_4 in place of phi_1, phi_2, phi_3. */
static double missed_integral(const bristle *b, double h)
{
    const double *phi = b->phi, *z = b->z, *n = b->n;
    if (b->decay == 0)
        return 0;
    double exact = phi[1] * z[0] + h * ((phi[2] - 3 * phi[3] + 4 * phi[4]) * n[0] +
                                        (2 * phi[3] - 4 * phi[4]) * (n[1] + n[2]) + (4 * phi[4] - phi[3]) * n[3]);
    return h * (exact - (z[0] + 2 * (z[1] + z[2]) + z[3]) / 6);
}

/* Adds the errors of bristles whose leg turns within the step from x to `end`. */
static void add_reversals(const momentum *m, const double x[N_STATES], const double end[N_STATES], double error[N_LEGS])
{
    const double *p = m->of_step.step->c->s.p;
    double after[N_LEGS], decay[N_LEGS];
    int known = 0;
    kernel_sliding(end, p, after);
    for (int k = 0; k < N_LEGS; k++) {
        double before = m->of_legs.sliding[k];
        if (!(before * after[k] < 0))
            continue;
        if (!known)
            kernel_decays(end, p, decay);
        known = 1;
        double kink = fabs(m->of_legs.decay[k] * x[X_LEG_BRISTLE + k] / before) +
                      fabs(decay[k] * end[X_LEG_BRISTLE + k] / after[k]);
        error[k] += kink * m->of_step.h / 6 * fabs(before * after[k] / (after[k] - before));
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
static double momentum_step(const communication_step *step, double t, double h, const double x[N_STATES],
                            const double rate[N_STATES], double end[N_STATES], double end_rate[N_STATES])
{
    momentum m = {.of_step = {step, t, h}};
    double last[N_STATES], missed[N_LEGS], error[N_LEGS], largest = 0;
    stages s;
    grip *g = &m.of_legs;
    kernel_grip(x, step->c->s.p, g->decay, g->gain, g->ratio, g->reach, g->sliding);
    for (int k = 0; k < N_LEGS; k++)
        s.bristles[k].decay = g->decay[k];
    memcpy(m.start, x + X_LEG_BRISTLE, sizeof m.start);
    memcpy(s.rate[0], rate, sizeof s.rate[0]);
    add_gain(&m, 1, s.rate[0] + X_LEG_BRISTLE, s.rate[0] + X_BRAKED);
    take_step(&s, h, x, rates_in_momentum, &m, last);
    leave_momentum(&m, last, end);
    for (int k = 0; k < N_LEGS; k++)
        missed[k] = g->ratio[k] * missed_integral(&s.bristles[k], h);
    add_gain(&m, -1, missed, end + X_BRAKED);
    find_rates(step, t + h, end, end_rate);
    if (!all_finite(end, N_STATES) || !all_finite(end_rate, N_STATES))
        return INFINITY;
    for (int k = 0; k < N_LEGS; k++) {
        const bristle *b = &s.bristles[k];
        int i = X_LEG_BRISTLE + k;
        error[k] = fabs(b->last * (end_rate[i] + b->decay * end[i] - b->n[3]));
    }
    add_reversals(&m, x, end, error);
    for (int k = 0; k < N_LEGS; k++)
        largest = fmax(largest, error[k] / (RESOLUTION * g->reach[k]));
    return fmax(largest, share_of_friction(&m, s.rate[3], end_rate) / FORCE_RESOLUTION);
}

/* Divided where needed. */
integration sticking_step(communication_step *step, double end, double x[N_STATES], double rate[N_STATES])
{
    const component *c = step->c;
    double start = c->s.time, t = start, size = end - t, next[N_STATES], next_rate[N_STATES];
    memcpy(x, c->s.x, sizeof c->s.x);
    memcpy(rate, c->xdot, sizeof c->xdot);
    for (int tried = 0; tried < MOST_SUBSTEPS; tried++) {
        double parts = ceil((end - t) / size - 1e-9), h = (end - t) / parts;
        double error = momentum_step(step, t, h, x, rate, next, next_rate);
        double factor = error > 0 ? SAFETY * pow(error, -0.25) : LARGEST_FACTOR;
        size = h * fmin(LARGEST_FACTOR, fmax(SMALLEST_FACTOR, factor));
        if (!(error <= 1))
            continue;
        memcpy(x, next, sizeof next);
        memcpy(rate, next_rate, sizeof next_rate);
        if (parts == 1)
            return REACHED_END;
        t += h;
    }
    step->size = t > start ? t - start : size;
    return TOO_FAST;
}
#else
/* A file without declarations is not C. */
typedef int no_bristles;
#endif

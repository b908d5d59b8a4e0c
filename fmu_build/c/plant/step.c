/* A communication step of the plant: internal steps under error control or of equal size, with steps.h. */
#define WIDTH 1
#include "plant.h"
#include "steps.h"

#include <float.h>
#include <math.h>

#include "kernel.h"

/* The current communication step. Internal steps, each from t over h, move the component's time, states and derivatives. */
typedef struct {
    component *c;
    const step_observer *observer;
    int interpolates;
    double since; /* time at which the inputs had the values of `from` */
    double from[N_INPUTS];
    double size; /* of the next internal step; of the last one if it was too small, or the largest that is possible */
    double t, h;
} communication_step;

#define LIKELY_CAUSE "forces too large, leg_friction_velocity too small, or pose nearly singular"

static void inputs_at(const communication_step *step, double t, double u[N_INPUTS])
{
    for (int i = 0; i < N_INPUTS; i++)
        u[i] = step->from[i] + step->c->s.input_rates[i] * (t - step->since);
}

/* f(t, x) */
static void find_rates(const communication_step *step, double t, const double x[N_STATES], double rate[N_STATES])
{
    double u[N_INPUTS];
    if (step->interpolates)
        inputs_at(step, t, u);
    kernel_derivatives(x, step->interpolates ? u : step->c->s.inputs, step->c->s.p, rate);
}

/* Implements `find_stage`. */
static void find_stage_rates(const void *owner, double share, const double x[N_STATES], double rate[N_STATES])
{
    const communication_step *step = owner;
    find_rates(step, step->t + share * step->h, x, rate);
}

/* ---- legs with stiction --------------------------------------------------------------------------------------------- */

#if HAS_BRISTLES
/* Fixed steps of legs with stiction: by steps.h, with w = nu + gain (z - z0) in place of the velocities nu that friction
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

/* of the motors if legs are elastic, else of the platform */
#if HAS_SPRINGS
enum { X_BRAKED = X_MOTOR_VELOCITY };
#else
enum { X_BRAKED = X_VELOCITY };
#endif

static const double LARGEST_FACTOR = 4, SMALLEST_FACTOR = 0.1, SAFETY = 0.8;

/* The same equations with w for nu over an internal step: what friction does there, see kernel_grip, and z0. */
typedef struct {
    const communication_step *step;
    double decay[N_LEGS], gain[N_LEGS * N_LEGS], ratio[N_LEGS], reach[N_LEGS], sliding[N_LEGS];
    double start[N_LEGS];
} momentum;

/* v += sign gain b */
static void add_gain(const momentum *m, double sign, const double b[N_LEGS], double v[N_LEGS])
{
    for (int k = 0; k < N_LEGS; k++)
        for (int i = 0; i < N_LEGS; i++)
            v[i] += sign * m->gain[N_LEGS * k + i] * b[k];
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
    find_stage_rates(m->step, share, x, rate);
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
    const double *p = m->step->c->s.p;
    double after[N_LEGS], decay[N_LEGS];
    int known = 0;
    kernel_sliding(end, p, after);
    for (int k = 0; k < N_LEGS; k++) {
        double before = m->sliding[k];
        if (!(before * after[k] < 0))
            continue;
        if (!known)
            kernel_decays(end, p, decay);
        known = 1;
        double kink = fabs(m->decay[k] * x[X_LEG_BRISTLE + k] / before) +
                      fabs(decay[k] * end[X_LEG_BRISTLE + k] / after[k]);
        error[k] += kink * m->step->h / 6 * fabs(before * after[k] / (after[k] - before));
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
            friction[i] += fabs(m->gain[N_LEGS * k + i]) * m->ratio[k] * m->reach[k];
    for (int i = 0; i < N_LEGS; i++)
        largest = fmax(largest, fabs(end[i] - last_rate[X_BRAKED + i]) / (10 * friction[i]));
    return largest;
}

/* One undivided internal step from x with the rate there to `end` with its rate; the largest error of bristles and
   accelerations in units of their RESOLUTION, infinite for a step that has diverged. */
static double momentum_step(const communication_step *step, const double x[N_STATES], const double rate[N_STATES],
                            double end[N_STATES], double end_rate[N_STATES])
{
    momentum m = {.step = step};
    double last[N_STATES], missed[N_LEGS], error[N_LEGS], largest = 0, h = step->h;
    stages s;
    kernel_grip(x, step->c->s.p, m.decay, m.gain, m.ratio, m.reach, m.sliding);
    for (int k = 0; k < N_LEGS; k++)
        s.bristles[k].decay = m.decay[k];
    memcpy(m.start, x + X_LEG_BRISTLE, sizeof m.start);
    memcpy(s.rate[0], rate, sizeof s.rate[0]);
    add_gain(&m, 1, s.rate[0] + X_LEG_BRISTLE, s.rate[0] + X_BRAKED);
    take_step(&s, h, x, rates_in_momentum, &m, last);
    leave_momentum(&m, last, end);
    for (int k = 0; k < N_LEGS; k++)
        missed[k] = m.ratio[k] * missed_integral(&s.bristles[k], h);
    add_gain(&m, -1, missed, end + X_BRAKED);
    find_rates(step, step->t + h, end, end_rate);
    if (!all_finite(end, N_STATES) || !all_finite(end_rate, N_STATES))
        return INFINITY;
    for (int k = 0; k < N_LEGS; k++) {
        const bristle *b = &s.bristles[k];
        int i = X_LEG_BRISTLE + k;
        error[k] = fabs(b->last * (end_rate[i] + b->decay * end[i] - b->n[3]));
    }
    add_reversals(&m, x, end, error);
    for (int k = 0; k < N_LEGS; k++)
        largest = fmax(largest, error[k] / (RESOLUTION * m.reach[k]));
    return fmax(largest, share_of_friction(&m, s.rate[3], end_rate) / FORCE_RESOLUTION);
}

/* A fixed step to `end`, divided where needed: the state there and its derivatives. 1, or 0 if no division resolves it. */
static int sticking_step(communication_step *step, double end, double x[N_STATES], double rate[N_STATES])
{
    const component *c = step->c;
    double start = c->s.time, size = end - start, next[N_STATES], next_rate[N_STATES];
    step->t = start;
    memcpy(x, c->s.x, sizeof c->s.x);
    memcpy(rate, c->xdot, sizeof c->xdot);
    for (int tried = 0; tried < MOST_SUBSTEPS; tried++) {
        double parts = ceil((end - step->t) / size - 1e-9);
        step->h = (end - step->t) / parts;
        double error = momentum_step(step, x, rate, next, next_rate);
        double factor = error > 0 ? SAFETY * pow(error, -0.25) : LARGEST_FACTOR;
        size = step->h * fmin(LARGEST_FACTOR, fmax(SMALLEST_FACTOR, factor));
        if (!(error <= 1))
            continue;
        memcpy(x, next, sizeof next);
        memcpy(rate, next_rate, sizeof next_rate);
        if (parts == 1)
            return 1;
        step->t += step->h;
    }
    step->size = step->t > start ? step->t - start : size;
    return 0;
}
#endif

/* Moves the component to the end of an internal step, if it can be there: time, states, inputs and derivatives. The
   observer may reduce the end of the communication step, and set inputs. */
static outcome arrive(communication_step *step, double t, const double x[N_STATES], const double rate[N_STATES], double *end)
{
    component *c = step->c;
    c->s.time = t;
    memcpy(c->s.x, x, sizeof c->s.x);
    memcpy(c->xdot, rate, sizeof c->xdot);
    c->has_xdot = 1;
    c->has_results = c->has_legs = 0;
    if (step->interpolates)
        inputs_at(step, t, c->s.inputs);
    outcome checked = component_check_state(c);
    if (checked != DONE || !step->observer)
        return checked;
    step->observer->notice(step->observer->context, t, end);
    step->since = t;
    memcpy(step->from, c->s.inputs, sizeof step->from);
    if (!c->has_xdot)
        find_rates(step, t, c->s.x, c->xdot);
    c->has_xdot = 1;
    return DONE;
}

/* ---- error control ----------------------------------------------------------------------------------------------- */

static outcome integrate_controlled(communication_step *step, double end, double tolerance)
{
    component *c = step->c;
    const double planned = end;
    double proposed = step->size > 0 ? step->size : end - c->s.time, x[N_STATES];
    stages s;
    for (long steps = 0; c->s.time < end; steps++) {
        if (steps == MOST_INTERNAL_STEPS)
            return refuse_step(c, "internal steps", MOST_INTERNAL_STEPS, "", "too many internal steps for one step to time "
                               "%.12g s at tolerance %g; " LIKELY_CAUSE, planned, tolerance);
        double left = end - c->s.time, size = step->size = size_of(proposed, left);
        double t = size < left ? c->s.time + size : end;
        if (!(t > c->s.time) || (size < left && size < 16 * DBL_EPSILON * fabs(end)))
            return refuse_step(c, "internal step size", size, " s", "the tolerance %g cannot be met; " LIKELY_CAUSE,
                               tolerance);
        step->t = c->s.time;
        step->h = size;
#if HAS_BRISTLES
        double decay[N_LEGS];
        kernel_decays(c->s.x, c->s.p, decay);
        for (int k = 0; k < N_LEGS; k++)
            s.bristles[k].decay = decay[k];
#endif
        memcpy(s.rate[0], c->xdot, sizeof c->xdot);
        take_step(&s, size, c->s.x, find_stage_rates, step, x);
        find_rates(step, t, x, s.rate[STAGES]);
        double ratio = error_of_step(&s, size, c->s.x, x) / tolerance;
        proposed = step->size = proposal_after(proposed, size, ratio);
        if (ratio <= 1 && arrive(step, t, x, s.rate[STAGES], &end) != DONE)
            return NOT_POSSIBLE;
    }
    return DONE;
}

/* ---- fixed steps ------------------------------------------------------------------------------------------------- */

/* Number of equal steps of at most `size`, within the rounding of times of this magnitude. */
static double number_of_steps(double start, double end, double size)
{
    double slack = 1e-6 + 2 * DBL_EPSILON * fabs(start) / size;
    return fmax(1, ceil((end - start) / size - slack));
}

/* Equal steps, the largest not above `size`. */
static outcome integrate_fixed(communication_step *step, double end, double size)
{
    component *c = step->c;
    const double whole = end;
    double start = c->s.time, n = number_of_steps(start, end, size), span = end - start, planned = end;
    double x[N_STATES], rate[N_STATES];
    long done = 0;
    while (c->s.time < end) {
        if (end != planned) { /* the observer has reduced it; no more steps than were left */
            start = c->s.time;
            n = number_of_steps(start, end, size);
            span = end - start;
            planned = end;
            done = 0;
        }
        done++;
        double t = (double)done < n ? start + span * ((double)done / n) : end;
        if (n > MOST_FIXED_STEPS || !(t > c->s.time))
            return refuse_step(c, "fixed_step_size", size, " s", "too small for one step to time %.12g s; expected at most "
                               "%d steps, each large enough to advance the time", whole, MOST_FIXED_STEPS);
#if HAS_BRISTLES
        if (!sticking_step(step, t, x, rate))
            return refuse_step(c, "fixed_step_size", size, " s", "no division resolves legs with stiction in such a step; "
                               "expected at most %.2g s, or 0 for error control", step->size);
#else
        double rates[4][N_STATES];
        step->t = c->s.time;
        step->h = t - c->s.time;
        memcpy(rates[0], c->xdot, sizeof c->xdot);
        rk4_step(step->h, c->s.x, rates, find_stage_rates, step, x);
        find_rates(step, t, x, rate);
        if (!all_finite(x, N_STATES) || !all_finite(rate, N_STATES))
            return refuse_step(c, "fixed_step_size", size, " s", "the motion is not finite; the step is too large, or "
                               LIKELY_CAUSE);
#endif
        if (arrive(step, t, x, rate, &end) != DONE)
            return NOT_POSSIBLE;
    }
    return DONE;
}

/* ---- the largest fixed step -------------------------------------------------------------------------------------- */

#if HAS_BRISTLES || HAS_SPRINGS
/* |A^1024|^(1/1024) is within 2 % of the spectral radius for norms that differ by 10^9. */
enum { SQUARINGS = 10 };

static double spectral_radius(double a[N_STATES][N_STATES])
{
    double logarithm = 0, power = 1;
    for (int squared = 0;; squared++) {
        double size = 0, product[N_STATES][N_STATES];
        for (int i = 0; i < N_STATES; i++)
            for (int j = 0; j < N_STATES; j++)
                size = fmax(size, fabs(a[i][j]));
        if (!(size > 0))
            return 0;
        logarithm += log(size) / power;
        if (squared == SQUARINGS)
            return exp(logarithm);
        for (int i = 0; i < N_STATES; i++)
            for (int j = 0; j < N_STATES; j++)
                a[i][j] /= size;
        memset(product, 0, sizeof product);
        for (int i = 0; i < N_STATES; i++)
            for (int k = 0; k < N_STATES; k++)
                for (int j = 0; j < N_STATES; j++)
                    product[i][j] += a[i][k] * a[k][j];
        memcpy(a, product, sizeof product);
        power *= 2;
    }
}

/* LARGEST_PRODUCT over the largest |eigenvalue| of the plant at rest in this pose, all legs sticking. */
static double stable_step(const double x[N_STATES], const double u[N_INPUTS], const double p[N_PARAMETERS])
{
    static const double no_input[N_INPUTS] = {0}, no_parameter[N_PARAMETERS] = {0};
    double rest[N_STATES] = {0}, direction[N_STATES] = {0}, change[N_STATES], results[N_RESULTS], a[N_STATES][N_STATES];
    memcpy(rest, x, sizeof(double) * X_VELOCITY);
#if HAS_SPRINGS
    memcpy(rest + X_MOTOR_POSITION, x + X_MOTOR_POSITION, sizeof(double) * N_LEGS);
#endif
    for (int k = 0; k < N_STATES; k++) {
        direction[k] = 1;
        kernel_forward(rest, u, p, direction, no_input, no_parameter, change, results);
        direction[k] = 0;
        for (int i = 0; i < N_STATES; i++)
            a[i][k] = change[i];
    }
    double largest = LARGEST_PRODUCT / spectral_radius(a);
#if HAS_BRISTLES
    largest = fmin(largest, LARGEST_FIXED_STEP);
#endif
    return largest;
}
#endif

/* ---- the communication step -------------------------------------------------------------------------------------- */

/* A step in which the modes of sticking or elastic legs would grow, or rest where they should not, is refused. */
static outcome check_fixed_step(component *c, double time, double step)
{
#if HAS_BRISTLES || HAS_SPRINGS
    if (!(c->s.fixed_step_size > 0))
        return DONE;
    double h = step / number_of_steps(time, time + step, c->s.fixed_step_size);
    double largest = c->s.largest_step > 0 ? c->s.largest_step : stable_step(c->s.x, c->s.inputs, c->s.p);
    /* the difference of two rounded times may be larger than the size that was set */
    if (!(h <= largest * (1 + 1e-9)))
        return refuse_step(c, "fixed_step_size", h, " s", "steps of %g s are too large for legs with stiction or compliance "
                           "like these; expected at most %.3g s, or 0 for error control", h, largest);
    c->s.largest_step = isfinite(largest) ? largest : 0; /* a saved state is finite */
#endif
    (void)c, (void)time, (void)step;
    return DONE;
}

outcome component_step(component *c, double time, double step, const step_observer *observer, double *reached)
{
    *reached = c->s.time;
    outcome checked = check_step(c->s.time, c->s.stop_time, time, step, c->message);
    if (checked == DONE)
        checked = component_check_parameters(c);
    if (checked != DONE)
        return checked;
    plant_state before = c->s;
    checked = check_fixed_step(c, c->s.time, step);
    if (checked != DONE)
        return checked;
    /* some masters do not propagate start values and begin with zeros; if the actuator forces are connected, zeros mean
       that the controller has no output yet */
    int is_unset = ZEROS_ARE_UNSET_AT_START && c->s.time == c->s.start_time;
    for (int leg = 0; leg < N_LEGS; leg++)
        is_unset = is_unset && c->s.inputs[leg] == 0;
    for (int leg = 0; is_unset && leg < N_LEGS; leg++)
        component_put(c, FIRST_INPUT + leg, START_INPUTS[leg]);
    communication_step run = {.c = c, .observer = observer, .since = before.time, .size = c->s.internal_step};
    memcpy(run.from, c->s.inputs, sizeof run.from);
    for (int i = 0; i < N_INPUTS; i++)
        run.interpolates |= before.input_rates[i] != 0;
    double end = time + step, rate[N_STATES];
    checked = component_derivatives(c, rate);
    if (checked == DONE)
        checked = before.fixed_step_size > 0 ? integrate_fixed(&run, end, before.fixed_step_size)
                                             : integrate_controlled(&run, end, before.tolerance);
    if (checked == DONE) {
        c->s.internal_step = run.size;
        *reached = c->s.time;
    } else {
        c->s = before;
        component_forget(c);
    }
    return checked;
}

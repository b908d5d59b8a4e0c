#include "machine.h"

#include <math.h>

#include "machine_fields.h"
#include "turning.h"

#ifdef __clang__
#pragma clang fp contract(off) reciprocal(off)
#endif

/* generated: motions by kind, and what follows from a motion; the gains and times that act, the matrices of laws,
   coefficients of sensors */
#include "design.h"
#include "plan.h"

#define N_REFERENCE 30
#define FIRST_OF_LENGTHS 12 /* of all signals */

/* What a machine follows, computed at each row: the reference, and forces along it. */
typedef struct {
    int64_t kind;               /* of motion, see harness/export/machine_equations.py; 0: the caller gives it */
    const double *coefficients; /* the values of its keys */
    int64_t n_pieces;           /* of a table: when each begins [s], and its polynomials (6, 6), highest power first */
    const double *begins, *pieces;
    double end;             /* of the last piece [s] */
    double last;            /* forces look no further: the end of a table [s] */
    const double *platform; /* (N_PARAMETERS), the nominal model */
    int64_t feedforward;    /* 0 none, 1 gravity, 2 computed torque */
    double ahead;           /* [s] */
    double *given;          /* (18) pose, rates and accelerations that the caller writes, and their time [s] */
    double *given_at;
    /* where a hand wants the platform: pose and angles (6), followed by a filter with limits */
    double *target;
    const double *smoothing;
    double *smoothed; /* (18) values, rates and accelerations */
    int64_t *samples; /* (1) that the filter has done; -1: what is given is not filtered */
    double *reference, *forces, *jacobians, *inverses; /* for the rows of a call; no feedforward leaves its forces 0 */
} planned;

/* What is made of a block's fields when it is opened; it stands before them. */
typedef struct {
    batch members; /* one */
    loop loop;
    planned plan; /* kind -1: the loop has tables of all its rows */
    turning turned;
    int64_t kept; /* rows that there is room for */
    /* rows from which on other parameters, inputs and faults hold, and the next of them */
    int64_t n_changes, next_change;
    const int64_t *change_rows;
    const double *change_parameters, *change_inputs, *change_faults;
    int64_t forever; /* it has no end: samples beyond the table's are regular, and nothing is injected there */
    int64_t n_samples;
    const int64_t *sample_rows;
    const double *injected;
    int64_t *clock; /* rows of the samples of a call, and what is injected there */
    double *injections;
} machine;

typedef char a_block_has_room[sizeof(machine) <= MACHINE_ROOM * sizeof(int64_t) ? 1 : -1];

static machine *machine_of(const int64_t *block) { return (machine *)(void *)(block + MACHINE_HEAD); }
static void *place(int64_t *block, int64_t at) { return at ? block + at : 0; }

/* generated: each field from its word */
#define WHOLE(k) fields[k]
#define NUMBER(k) number(fields[k])
#define PLACE(k) place(block, fields[k])

int64_t machine_open(int64_t *block, int64_t words)
{
    if (words < MACHINE_FIELDS || block[0] != MACHINE_VERSION || block[1] != words || block[2])
        return 1;
    machine *m = machine_of(block);
    const int64_t *fields = block + MACHINE_FIELDS;
    MACHINE_READ
    block[2] = 1;
    return 0;
}

/* ---- motions --------------------------------------------------------------------------------------------------------- */

enum { GIVEN, PIECES };

/* The motion of the piece at a time, which may be the first one's or the last one's; at rest beyond. */
static void piece_at(const planned *p, double time, double motion[])
{
    double first = p->begins[0], moves = time >= first && time <= p->end + MOTION_ROUNDING;
    int64_t low = 0;
    time = larger_of(first, smaller_of(p->end, time));
    for (int64_t high = p->n_pieces; high - low > 1;) {
        int64_t middle = (low + high) / 2, is_later = p->begins[middle] <= time;
        low = is_later ? middle : low;
        high = is_later ? high : middle;
    }
    double since = time - p->begins[low];
    plan_piece(p->pieces + 36 * low, &since, &moves, motion);
}

static void motion_at(const planned *p, double time, double motion[])
{
    double ahead = time - p->given_at[0];
    if (p->kind == GIVEN)
        plan_extrapolated(p->given, &ahead, motion);
    else if (p->kind == PIECES)
        piece_at(p, time, motion);
    else
        MOTIONS[p->kind](p->coefficients, &time, motion);
}

/* What the hand's filter gives at a sample, once. */
static void smooth(const planned *p, int64_t sample, double time)
{
    double after[N_MOTION];
    if (p->kind != GIVEN || !p->target || p->samples[0] < 0 || sample < p->samples[0])
        return;
    component_smoothing(p->smoothing, p->smoothed, p->target, after);
    memcpy(p->smoothed, after, sizeof after);
    plan_motion_of_pose(p->smoothed, p->smoothed + 6, p->smoothed + 12, p->given);
    p->given_at[0] = time;
    p->samples[0] = sample + 1;
}

void machine_take(int64_t *block)
{
    machine *m = machine_of(block);
    planned *p = &m->plan;
    int64_t every = m->loop.every, sample = (m->loop.at_row[0] + every - 1) / every;
    if (!block[2] || p->kind < 0)
        return;
    /* at the next sample it has the motion of then, from which it goes on */
    p->samples[0] = sample + 1;
    if (p->kind == GIVEN || !p->target)
        return;
    double time = (double)(sample * every) * m->loop.plant_step, motion[N_MOTION];
    motion_at(p, time, motion);
    plan_coordinates(motion, p->smoothed);
    memcpy(p->target, p->smoothed, 6 * sizeof(double));
    memcpy(p->given, motion, sizeof motion);
    p->given_at[0] = time;
    p->kind = GIVEN;
}

/* ---- runs ------------------------------------------------------------------------------------------------------------ */

/* New parameters, inputs and faults from a row on. */
static void change(machine *m)
{
    int64_t k = m->next_change++;
    memcpy((double *)m->members.parameters, m->change_parameters + k * N_PARAMETERS, N_PARAMETERS * sizeof(double));
    memcpy((double *)m->members.inputs, m->change_inputs + k * N_INPUTS, N_INPUTS * sizeof(double));
    if (m->loop.cut && m->change_faults) {
        const double *failed = m->change_faults + k * (N_LEGS + N_SIGNALS);
        memcpy(m->loop.cut, failed, N_LEGS * sizeof *failed);
        memcpy(m->loop.frozen, failed + N_LEGS, N_SIGNALS * sizeof *failed);
    }
}

/* A table whose first row is that of an index. */
static const double *beginning(const double *at, int64_t index, int64_t row)
{
    return at ? (const double *)((uintptr_t)at - (uintptr_t)(index * row) * sizeof(double)) : 0;
}

/* Computes the reference of rows and what their samples need. */
static void plan_rows(machine *m, int64_t row, int64_t to)
{
    planned *p = &m->plan;
    loop *l = &m->loop;
    double motion[N_MOTION];
    int64_t first = row / l->every, last = (to - 1) / l->every;
    for (int64_t k = first; k <= last; k++) {
        double time = (double)(k * l->every) * l->plant_step, later = time + p->ahead;
        smooth(p, k, time);
        for (int64_t at = k * l->every; at < to && at < (k + 1) * l->every; at++) {
            motion_at(p, (double)at * l->plant_step, motion);
            plan_signals(motion, p->platform, p->reference + (at - first * l->every) * N_REFERENCE);
        }
        if (p->feedforward) {
            motion_at(p, later < p->last || p->kind == GIVEN ? later : p->last, motion);
            FEEDFORWARD[p->feedforward](motion, p->platform, p->forces + (k - first) * N_LEGS);
        }
        if (p->jacobians) {
            motion_at(p, time, motion);
            plan_maps(motion, p->platform, p->jacobians + (k - first) * 36, p->inverses + (k - first) * 36);
        }
    }
    l->reference.at = beginning(p->reference, first * l->every, N_REFERENCE);
    l->feedforward.at = beginning(p->forces, first, N_LEGS);
    l->jacobian.at = beginning(p->jacobians, first, 36);
    l->inverse.at = beginning(p->inverses, first, 36);
}

/* Samples and injections of rows that may be beyond the tables. */
static void sample_rows(machine *m, int64_t row, int64_t to)
{
    loop *l = &m->loop;
    int64_t first = row / l->every, last = (to - 1) / l->every;
    for (int64_t k = first; k <= last; k++) {
        m->clock[k - first] = k < m->n_samples ? m->sample_rows[k] : k * l->every;
        for (int i = 0; m->injected && i < N_LEGS; i++)
            m->injections[(k - first) * N_LEGS + i] = k < m->n_samples ? m->injected[k * N_LEGS + i] : 0;
    }
    l->sampled.at = (const int64_t *)((uintptr_t)m->clock - (uintptr_t)first * sizeof(int64_t));
    l->injection.at = beginning(m->injections, first, N_LEGS);
}

int64_t machine_run(int64_t *block, int64_t to)
{
    machine *m = machine_of(block);
    int64_t row = m->loop.at_row[0], most = row + m->kept;
    if (!block[2])
        return row;
    m->loop.first_row = row;
    most = most < m->loop.last + 1 ? most : m->loop.last + 1;
    to = to < most ? to : most;
    if (m->forever && row < to)
        sample_rows(m, row, to);
    if (m->plan.kind >= 0 && row < to)
        plan_rows(m, row, to);
    while (row < to) {
        if (m->next_change < m->n_changes && m->change_rows[m->next_change] == row)
            change(m);
        row = m->next_change < m->n_changes && m->change_rows[m->next_change] < to ? m->change_rows[m->next_change] : to;
        while (!loop_run(&m->members, &m->loop, 0, 1, row, INT64_MAX))
            ;
    }
    return row;
}

int64_t machine_ended(const int64_t *block) { return machine_of(block)->loop.ended[0]; }
int64_t machine_failure(const int64_t *block) { return machine_of(block)->members.failure[0]; }

/* ---- settings -------------------------------------------------------------------------------------------------------- */

/* Above 0, or from 0 on. */
static int bounded(const turning *t, const loop *l, int which, double value)
{
    switch (which) {
    case DELAY: return value >= 0 && value <= (double)l->most_delay && value == floor(value);
    case FORCE_LIMIT: return value > 0;
    case BANDWIDTH: case FILTER_TIME: case NOISE: case QUANTISATION: return value >= 0 && value < INFINITY;
    default: return value > 0 && value < INFINITY;
    case INTEGRAL_TIME: /* at 1/(2 zeta w) or below, the loop with the gains of a bandwidth is unstable */
        return t->variant < 0 || t->wanted[BANDWIDTH] == 0 || !t->gains[12] || (value < INFINITY &&
               value > 1 / (2 * t->wanted[DAMPING_RATIO] * 2 * 3.141592653589793 * t->wanted[BANDWIDTH]));
    }
}

/* Tustin's rule makes a filter ring that is faster than half a sample; limits are felt a sample late. */
static int64_t refused(const turning *t, const double used[])
{
    if (TUSTIN[t->variant] && used[USED_FILTER] < t->sample_time / 2)
        return 1 + FILTER_TIME;
    for (int i = 0; t->gains[12] > 0 && i < N_LEGS; i++)
        if (used[USED_TRACKING + i] < t->sample_time)
            return 1 + INTEGRAL_TIME;
    for (int i = 0; i < USED_FILTER; i++)
        if (!(used[i] < INFINITY))
            return 1 + BANDWIDTH;
    return 0;
}

/* Of a channel with such gains: its [C D; A B], then R of its rest x = R u. */
static void channel_of(const turning *t, const double used[], int channel, double matrices[])
{
    const double *own = used + channel;
    const double values[] = {own[0], own[N_LEGS], own[2 * N_LEGS], used[USED_FILTER], own[USED_TRACKING]};
    LAWS[t->variant](values, t->notch, &t->sample_time, matrices);
}

/* Other gains. Before the first sample the law begins at rest. Later each filter of a derivative gives the force that it
   gave, since what it holds of a length is far more than what it holds of a velocity: about its rest r, c x is kept, as
   x = r' + c/c' (x - r). The states of all channels' controllers come first, then those of their notches. */
static void turn_law(const turning *t, loop *l, const double used[])
{
    int64_t first = STATES[t->variant][0], second = STATES[t->variant][1], n = first + second;
    double old[MOST_ELEMENTS_OF_CHANNEL], channels[N_LEGS][MOST_ELEMENTS_OF_CHANNEL];
    const double *u = l->memory + l->n_states;
    for (int i = 0; i < N_LEGS; i++) {
        channel_of(t, t->used, i, old);
        channel_of(t, used, i, channels[i]);
        for (int64_t state = 0; state < (l->at_row[0] ? 1 : n); state++) {
            double *x = l->memory + (state < first ? i * first : (N_LEGS - 1) * first + i * second) + state;
            double rest = 0, old_rest = 0;
            for (int64_t k = 0; k < l->kinds; k++) {
                int64_t R = (1 + n) * (n + l->kinds) + state * l->kinds + k;
                rest += channels[i][R] * u[k * N_LEGS + i];
                old_rest += old[R] * u[k * N_LEGS + i];
            }
            *x = rest + (l->at_row[0] ? old[0] / channels[i][0] * (*x - old_rest) : 0);
        }
    }
    for (int64_t k = 0; k < l->entries; k++)
        ((double *)l->values.at)[k] = channels[t->channels[2 * k]][t->channels[2 * k + 1]];
}

int64_t machine_turn(int64_t *block)
{
    machine *m = machine_of(block);
    turning *t = &m->turned;
    loop *l = &m->loop;
    const double *wanted = t->wanted;
    double used[N_USED];
    if (!block[2] || !wanted)
        return 0;
    for (int k = 0; k < N_WANTED; k++)
        if (!bounded(t, l, k, wanted[k]))
            return 1 + k;
    if (t->variant >= 0) {
        design_used(t->masses, t->gains, wanted, &t->filter_time, &t->tracking_time, used);
        int64_t fault = refused(t, used);
        if (fault)
            return fault;
    }
    *(double *)l->delay.at = wanted[DELAY];
    m->plan.ahead = (wanted[DELAY] + 0.5) * t->sample_time;
    for (int k = 0; l->limits.at && k < 2 * N_LEGS; k++) /* of all legs the lowest, then the highest */
        ((double *)l->limits.at)[k] = k < N_LEGS ? -wanted[FORCE_LIMIT] : wanted[FORCE_LIMIT];
    for (int64_t k = 0; l->sensors.at && k < l->n_noisy; k++) {
        double c[SENSOR_COEFFICIENTS], *lengths = (double *)l->sensors.at + FIRST_OF_LENGTHS * SENSOR_COEFFICIENTS;
        if (l->noisy[2 * k] != FIRST_OF_LENGTHS)
            continue;
        ((double *)l->deviations.at)[k] = wanted[NOISE];
        design_sensor(wanted + QUANTISATION, c);
        for (int i = 0; i < N_LEGS * SENSOR_COEFFICIENTS; i++)
            lengths[i] = c[i % SENSOR_COEFFICIENTS];
    }
    if (!l->at_row[0] && l->kinds) {
        if (m->plan.kind >= 0)
            plan_rows(m, 0, 1);
        loop_begin(&m->members, l);
    }
    if (t->variant >= 0) {
        turn_law(t, l, used);
        memcpy(t->used, used, sizeof used);
    }
    return 0;
}

int64_t machine_margins(int64_t *block)
{
    machine *m = machine_of(block);
    return block[2] ? turn_margins(&m->turned, &m->loop) : 1;
}

void *machine_field(int64_t *block, int64_t field)
{
    return field < 0 || field >= MACHINE_N_FIELDS ? 0 : place(block, block[MACHINE_FIELDS + field]);
}

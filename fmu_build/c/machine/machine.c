#include "machine.h"

#include "lanes_table.h"
#include "loop.h"
#include "machine_fields.h"
#include "planning.h"
#include "turning.h"
#include "vectors.h"

#ifdef MACHINE_HAS_LAW
#include "law.h"
#endif

/* What is made of a block's fields when it is opened; it stands before them. */
typedef struct {
    batch of;
    loop with;
    int64_t n_changes, kept;
    const int64_t *change_rows;
    const double *change_parameters, *change_inputs, *change_faults;
    planned plan; /* kind -1: it has tables */
    turning turned;
    int64_t forever; /* it has no end: samples beyond the table's are regular, and nothing is injected there */
    int64_t n_samples;
    const int64_t *sample_rows;
    const double *injected;
    int64_t *clock; /* for the samples of a call */
    double *injections;
    int64_t next_change;
} own;

typedef char own_has_room[sizeof(own) <= MACHINE_ROOM * sizeof(int64_t) ? 1 : -1];

static own *own_of(int64_t *block)
{
    return (own *)(void *)(block + MACHINE_HEAD);
}

static void *place(int64_t *block, int64_t at)
{
    return at ? block + at : 0;
}

/* generated: each field from its word */
#define WHOLE(k) fields[k]
#define NUMBER(k) number(fields[k])
#define PLACE(k) place(block, fields[k])

static void read_fields(own *o, int64_t *block, const int64_t *fields)
{
    MACHINE_READ
}

int64_t machine_open(int64_t *block, int64_t words)
{
    if (words < MACHINE_FIELDS || block[0] != MACHINE_VERSION || block[1] != words || block[2])
        return MACHINE_OTHER;
    own *o = own_of(block);
    read_fields(o, block, block + MACHINE_FIELDS);
    if (block[MACHINE_FIELDS + MACHINE_LAW_FIELD]) {
#ifdef MACHINE_HAS_LAW
        o->with.law = law_step;
#else
        return MACHINE_NO_LAW;
#endif
    }
    o->next_change = 0;
    block[2] = 1;
    return MACHINE_OPEN;
}

/* New parameters, inputs and faults from a row on. */
static void change(own *o)
{
    const double *p = o->change_parameters + o->next_change * N_PARAMETERS;
    const double *u = o->change_inputs + o->next_change * N_INPUTS;
    memcpy((double *)o->of.parameters, p, N_PARAMETERS * sizeof *p);
    memcpy((double *)o->of.inputs, u, N_INPUTS * sizeof *u);
    if (o->with.cut && o->change_faults) {
        const double *failed = o->change_faults + o->next_change * (N_LEGS + N_SIGNALS);
        memcpy(o->with.cut, failed, N_LEGS * sizeof *failed);
        memcpy(o->with.frozen, failed + N_LEGS, N_SIGNALS * sizeof *failed);
    }
    o->next_change++;
}

/* A table whose first row is that of an index. */
static const double *beginning(const double *at, int64_t index, int64_t row)
{
    return (const double *)((uintptr_t)at - (uintptr_t)(index * row) * sizeof(double));
}

/* Computes the reference of rows and what their samples need. */
static void plan(own *o, int64_t row, int64_t to)
{
    planned *p = &o->plan;
    loop *w = &o->with;
    int64_t first = row / w->every, last = (to - 1) / w->every;
    for (int64_t k = first; k <= last; k++) {
        double time = (double)(k * w->every) * w->plant_step;
        plan_by_hand(p, k, time);
        for (int64_t at = k * w->every; at < to && at < (k + 1) * w->every; at++)
            plan_reference(p, (double)at * w->plant_step, p->reference + (at - first * w->every) * N_REFERENCE);
        plan_forces(p, time, p->forces + (k - first) * N_LEGS);
        if (p->jacobians)
            plan_maps_at(p, time, p->jacobians + (k - first) * 36, p->inverses + (k - first) * 36);
    }
    w->reference.at = beginning(p->reference, first * w->every, N_REFERENCE);
    w->feedforward.at = beginning(p->forces, first, N_LEGS);
    if (p->jacobians) {
        w->jacobian.at = beginning(p->jacobians, first, 36);
        w->inverse.at = beginning(p->inverses, first, 36);
    }
}

/* Samples and injections of rows that may be beyond the tables. */
static void go_on(own *o, int64_t row, int64_t to)
{
    loop *w = &o->with;
    int64_t first = row / w->every, last = (to - 1) / w->every;
    for (int64_t k = first; k <= last; k++) {
        o->clock[k - first] = k < o->n_samples ? o->sample_rows[k] : k * w->every;
        for (int i = 0; o->injected && i < N_LEGS; i++)
            o->injections[(k - first) * N_LEGS + i] = k < o->n_samples ? o->injected[k * N_LEGS + i] : 0;
    }
    w->sampled.at = (const int64_t *)((uintptr_t)o->clock - (uintptr_t)first * sizeof(int64_t));
    if (o->injected)
        w->injection.at = beginning(o->injections, first, N_LEGS);
}

int64_t machine_run(int64_t *block, int64_t to)
{
    own *o = own_of(block);
    int64_t row = o->with.at_row[0], most = row + o->kept;
    if (!block[2])
        return row;
    o->with.first_row = row;
    to = to < most ? to : most;
    to = to < o->with.last + 1 ? to : o->with.last + 1;
    if (o->forever && row < to)
        go_on(o, row, to);
    if (o->plan.kind >= 0 && row < to)
        plan(o, row, to);
    while (row < to) {
        int64_t stop = to;
        if (o->next_change < o->n_changes && o->change_rows[o->next_change] == row)
            change(o);
        if (o->next_change < o->n_changes && o->change_rows[o->next_change] < to)
            stop = o->change_rows[o->next_change];
        while (!loop_run(&o->of, &o->with, 0, 1, stop, INT64_MAX))
            ;
        row = stop;
    }
    return row;
}

void machine_take(int64_t *block)
{
    own *o = own_of(block);
    int64_t every = o->with.every, sample = (o->with.at_row[0] + every - 1) / every;
    if (!block[2] || o->plan.kind < 0)
        return;
    /* at the next sample it has the motion of then, from which it goes on */
    o->plan.samples[0] = sample + 1;
    plan_take(&o->plan, (double)(sample * every) * o->with.plant_step);
}

int64_t machine_ended(const int64_t *block)
{
    return own_of((int64_t *)block)->with.ended[0];
}

int64_t machine_failure(const int64_t *block)
{
    return own_of((int64_t *)block)->of.failure[0];
}

int64_t machine_turn(int64_t *block)
{
    own *o = own_of(block);
    return block[2] ? turn_all(&o->turned, &o->with, &o->plan) : 0;
}

int64_t machine_margins(int64_t *block)
{
    own *o = own_of(block);
    return block[2] ? turn_margins(&o->turned, &o->with) : 1;
}

void *machine_field(int64_t *block, int64_t field)
{
    return field < 0 || field >= MACHINE_N_FIELDS ? 0 : place(block, block[MACHINE_FIELDS + field]);
}

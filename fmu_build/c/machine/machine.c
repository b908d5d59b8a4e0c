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
        return MACHINE_OTHER;
    machine *m = machine_of(block);
    const int64_t *fields = block + MACHINE_FIELDS;
    MACHINE_READ
    if (fields[MACHINE_LAW_FIELD]) {
#ifdef MACHINE_HAS_LAW
        m->loop.law = law_step;
#else
        return MACHINE_NO_LAW;
#endif
    }
    m->next_change = 0;
    block[2] = 1;
    return MACHINE_OPEN;
}

/* New parameters, inputs and faults from a row on. */
static void change(machine *m)
{
    const double *p = m->change_parameters + m->next_change * N_PARAMETERS;
    const double *u = m->change_inputs + m->next_change * N_INPUTS;
    memcpy((double *)m->members.parameters, p, N_PARAMETERS * sizeof *p);
    memcpy((double *)m->members.inputs, u, N_INPUTS * sizeof *u);
    if (m->loop.cut && m->change_faults) {
        const double *failed = m->change_faults + m->next_change * (N_LEGS + N_SIGNALS);
        memcpy(m->loop.cut, failed, N_LEGS * sizeof *failed);
        memcpy(m->loop.frozen, failed + N_LEGS, N_SIGNALS * sizeof *failed);
    }
    m->next_change++;
}

/* A table whose first row is that of an index. */
static const double *beginning(const double *at, int64_t index, int64_t row)
{
    return (const double *)((uintptr_t)at - (uintptr_t)(index * row) * sizeof(double));
}

/* Computes the reference of rows and what their samples need. */
static void plan_rows(machine *m, int64_t row, int64_t to)
{
    planned *p = &m->plan;
    loop *l = &m->loop;
    int64_t first = row / l->every, last = (to - 1) / l->every;
    for (int64_t k = first; k <= last; k++) {
        double time = (double)(k * l->every) * l->plant_step;
        plan_by_hand(p, k, time);
        for (int64_t at = k * l->every; at < to && at < (k + 1) * l->every; at++)
            plan_reference(p, (double)at * l->plant_step, p->reference + (at - first * l->every) * N_REFERENCE);
        plan_forces(p, time, p->forces + (k - first) * N_LEGS);
        if (p->jacobians)
            plan_maps_at(p, time, p->jacobians + (k - first) * 36, p->inverses + (k - first) * 36);
    }
    l->reference.at = beginning(p->reference, first * l->every, N_REFERENCE);
    l->feedforward.at = beginning(p->forces, first, N_LEGS);
    if (p->jacobians) {
        l->jacobian.at = beginning(p->jacobians, first, 36);
        l->inverse.at = beginning(p->inverses, first, 36);
    }
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
    if (m->injected)
        l->injection.at = beginning(m->injections, first, N_LEGS);
}

int64_t machine_run(int64_t *block, int64_t to)
{
    machine *m = machine_of(block);
    int64_t row = m->loop.at_row[0], most = row + m->kept;
    if (!block[2])
        return row;
    m->loop.first_row = row;
    to = to < most ? to : most;
    to = to < m->loop.last + 1 ? to : m->loop.last + 1;
    if (m->forever && row < to)
        sample_rows(m, row, to);
    if (m->plan.kind >= 0 && row < to)
        plan_rows(m, row, to);
    while (row < to) {
        int64_t stop = to;
        if (m->next_change < m->n_changes && m->change_rows[m->next_change] == row)
            change(m);
        if (m->next_change < m->n_changes && m->change_rows[m->next_change] < to)
            stop = m->change_rows[m->next_change];
        while (!loop_run(&m->members, &m->loop, 0, 1, stop, INT64_MAX))
            ;
        row = stop;
    }
    return row;
}

void machine_take(int64_t *block)
{
    machine *m = machine_of(block);
    int64_t every = m->loop.every, sample = (m->loop.at_row[0] + every - 1) / every;
    if (!block[2] || m->plan.kind < 0)
        return;
    /* at the next sample it has the motion of then, from which it goes on */
    m->plan.samples[0] = sample + 1;
    plan_take(&m->plan, (double)(sample * every) * m->loop.plant_step);
}

int64_t machine_ended(const int64_t *block) { return machine_of(block)->loop.ended[0]; }
int64_t machine_failure(const int64_t *block) { return machine_of(block)->members.failure[0]; }

int64_t machine_turn(int64_t *block)
{
    machine *m = machine_of(block);
    return block[2] ? turn_all(&m->turned, &m->loop, &m->plan) : 0;
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

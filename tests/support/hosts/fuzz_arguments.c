/* Arguments: right ones mostly, wrong ones of every kind now and then. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

/* ---- memory --------------------------------------------------------------------------------------------------- */

static void *lent[64];
static size_t n_lent;

void *exactly(size_t bytes)
{
    if (n_lent == sizeof lent / sizeof lent[0])
        abort();
    void *memory = calloc(1, bytes ? bytes : 1);
    if (!memory)
        abort();
    return lent[n_lent++] = memory;
}

void perform(action action, host *h)
{
    size_t mark = n_lent; /* a callback performs actions within an action */
    action(h);
    while (n_lent > mark)
        free(lent[--n_lent]);
}

void *due(void *pointer)
{
    return chance(0.02) ? NULL : pointer;
}

/* ---- values --------------------------------------------------------------------------------------------------- */

/* A time that decides how much a communication step has to compute. */
static int is_pace(int slot)
{
    return strcmp(variable_of(slot)->name, "fixed_step_size") == 0 || strcmp(variable_of(slot)->name, "sample_time") == 0;
}

static double mild_value_for(int slot)
{
    if (slot < FIRST_INPUT + N_INPUTS)
        return slot < 6 ? between(-50, 150) : between(-10, 10);
    if (slot >= FIRST_RESULT && slot < FIRST_RESULT + N_STATES)
        return START_STATES[slot - FIRST_RESULT] + between(-0.2, 0.2);
    if (parameter_at(slot) >= 0)
        return START_PARAMETERS[parameter_at(slot)] * (chance(0.1) ? between(0.9, 1.1) : 1);
    if (is_pace(slot))
        return (const double[]){0, 0, 1e-3, 0.01}[below(4)];
    return between(-1, 1);
}

double value_for(int slot)
{
    if (chance(0.03))
        return hostile_number();
    if (!chance(0.03))
        return mild_value_for(slot);
    double any = number_of_any_size();
    /* a step of a microsecond is slow, not wrong */
    return is_pace(slot) && fabs(any) < 1e-4 ? 1e-4 : any;
}

double step_size(void)
{
    double kind = fraction();
    if (kind < 0.75)
        return between(1e-4, 5e-3);
    if (kind < 0.93)
        return between(5e-3, 0.05);
    if (kind < 0.96)
        return (const double[]){-1e-3, -0.0, 1e-12, 1e-300}[below(4)];
    return kind < 0.99 ? hostile_number() : between(0.05, 3);
}

double communication_point(const host *h)
{
    double kind = fraction();
    if (kind < 0.9)
        return h->time;
    if (kind < 0.95)
        return h->time * (1 + DBL_EPSILON);
    return kind < 0.97 ? h->time + between(-0.01, 0.01) : hostile_number();
}

/* ---- references ----------------------------------------------------------------------------------------------- */

enum { LONGEST = 6 };

static int random_row(unsigned roles)
{
    if (chance(0.03))
        roles = ANY_ROLE;
    for (;;) {
        size_t row = below(N_VARIABLES);
        if (roles & ROLE(VARIABLES[row].role))
            return (int)row;
    }
}

choice choose(const host *h, unsigned roles)
{
    choice c = {.n = below(LONGEST + 1)};
    int slots[LONGEST * 18] = {0};
    c.references = exactly(c.n * sizeof *c.references);
    c.orders = exactly(c.n * sizeof *c.orders);
    for (size_t k = 0; k < c.n; k++) {
        const variable *v = &VARIABLES[random_row(roles)];
        c.orders[k] = chance(0.03) ? (const int32_t[]){0, 2, -1, INT32_MAX, INT32_MIN}[below(5)] : 1;
        if (h->version == 3) {
            c.references[k] = (uint32_t)(v - VARIABLES);
            for (int s = 0; s < v->size; s++)
                slots[c.n_values++] = v->first + s;
        } else {
            c.references[k] = (uint32_t)(v->first + (int)below((size_t)v->size));
            slots[c.n_values++] = (int)c.references[k];
        }
        if (chance(0.01))
            c.references[k] = (const uint32_t[]){N_VARIABLES, N_SLOTS, INT32_MAX, UINT32_MAX}[below(4)];
    }
    size_t n_slots = c.n_values;
    if (h->version == 3 && chance(0.03))
        c.n_values = below(LONGEST * 18);
    c.values = exactly(c.n_values * sizeof *c.values);
    for (size_t k = 0; k < c.n_values; k++)
        c.values[k] = value_for(k < n_slots ? slots[k] : 0);
    c.references = due(c.references);
    c.values = due(c.values);
    c.orders = due(c.orders);
    return c;
}

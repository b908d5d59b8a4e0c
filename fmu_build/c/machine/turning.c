#include "turning.h"

#include <math.h>
#include <string.h>

#include "elementary.h"

#ifdef __clang__
#pragma clang fp contract(off) reciprocal(off)
#endif

/* generated: gains of a bandwidth, times that follow from gains, the matrices of laws, coefficients of limits and sensors */
#include "design.h"

enum { FIRST_OF_LENGTHS = 12, OF_ENCODERS = 6 };

/* Above 0, or from 0 on. */
static int bounded(const turning *t, const loop *l, int which, double value)
{
    switch (which) {
    case BANDWIDTH:
    case FILTER_TIME:
    case NOISE:
    case QUANTISATION:
        return value >= 0 && value < INFINITY;
    case DELAY:
        return value >= 0 && value <= (double)l->most_delay && value == floor(value);
    case FORCE_LIMIT:
        return value > 0;
    case INTEGRAL_TIME:
        /* below, the loop with these gains is unstable: 1/(2 zeta w) */
        return t->wanted[BANDWIDTH] == 0 || !t->gains[12] ||
               (value > 1 / (2 * t->wanted[DAMPING_RATIO] * 2 * 3.141592653589793 * t->wanted[BANDWIDTH]) &&
                value < INFINITY);
    default:
        return value > 0 && value < INFINITY;
    }
}

static void turn_gains(const turning *t, double used[])
{
    const double *wanted = t->wanted;
    double filter = wanted[FILTER_TIME], tracking = t->tracking_time, times[7];
    memcpy(used, t->gains, N_USED * sizeof *used);
    if (wanted[BANDWIDTH] > 0) {
        double integral_time = t->gains[12] > 0 ? wanted[INTEGRAL_TIME] : INFINITY;
        design_gains(t->masses, wanted + BANDWIDTH, wanted + DAMPING_RATIO, &integral_time, used);
    }
    for (int kind = 0; kind < 3; kind++)
        for (int i = 0; i < N_LEGS; i++)
            used[kind * N_LEGS + i] *= wanted[FACTORS + kind];
    if (filter == 0)
        filter = t->filter_time;
    design_times(used, used + N_LEGS, used + 2 * N_LEGS, times);
    used[USED_FILTER] = filter > 0 ? filter : times[0];
    for (int i = 0; i < N_LEGS; i++)
        used[USED_TRACKING + i] = tracking > 0 ? tracking : times[1 + i];
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

/* The channel of a state, and which of its own it is: those of all controllers come first, then those of notches. */
static int64_t channel_of(int64_t state, int controllers, int notches, int64_t *own)
{
    int64_t first = (int64_t)N_LEGS * controllers, beyond = state - first;
    *own = beyond < 0 ? state % controllers : controllers + beyond % notches;
    return beyond < 0 ? state / controllers : beyond / notches;
}

/* The law's entries, from the matrices [C D; A B] of each channel. */
static void turn_law(const turning *t, const loop *l, const double used[])
{
    int controllers = STATES[t->variant][0], notches = STATES[t->variant][1], states = controllers + notches;
    double channels[N_LEGS][MOST_ELEMENTS_OF_CHANNEL];
    for (int i = 0; i < N_LEGS; i++) {
        const double values[] = {used[i], used[N_LEGS + i], used[2 * N_LEGS + i], used[USED_FILTER], used[USED_TRACKING + i]};
        LAWS[t->variant](values, t->notch, &t->sample_time, channels[i]);
    }
    for (int64_t k = 0; k < l->entries; k++) {
        int64_t row = l->entry_row[k], column = l->entry_column[k], own_row = 0, own_column = 0, channel = row;
        if (row >= N_LEGS) {
            channel = channel_of(row - N_LEGS, controllers, notches, &own_row);
            own_row++;
        }
        if (column < l->n_states)
            channel_of(column, controllers, notches, &own_column);
        else
            own_column = states + (column - l->n_states) / N_LEGS;
        ((double *)l->values.at)[k * l->values.element] = channels[channel][own_row * (states + l->kinds) + own_column];
    }
}

int64_t turn_all(turning *t, loop *l, planned *plan)
{
    const double *wanted = t->wanted;
    double used[N_USED];
    if (!t->wanted)
        return 0;
    for (int k = 0; k < N_WANTED; k++)
        if (!bounded(t, l, k, wanted[k]))
            return 1 + k;
    if (t->variant >= 0) {
        turn_gains(t, used);
        int64_t fault = refused(t, used);
        if (fault)
            return fault;
        turn_law(t, l, used);
        memcpy(t->used, used, sizeof used);
    }
    *(double *)l->delay.at = wanted[DELAY];
    plan->ahead = (wanted[DELAY] + 0.5) * t->sample_time;
    if (l->limits.at) {
        double c[LIMIT_COEFFICIENTS];
        double rate = l->limits.at[2 * l->limits.element] / t->sample_time;
        design_limits(wanted + FORCE_LIMIT, &rate, &t->sample_time, c);
        /* the rate stays as it was, to the last bit */
        for (int k = 0; k < 2; k++)
            ((double *)l->limits.at)[k * l->limits.element] = c[k];
    }
    if (l->n_noisy && l->sensors.at) {
        double c[SENSOR_COEFFICIENTS];
        *(double *)l->deviations.at = wanted[NOISE];
        design_sensor(wanted + QUANTISATION, &t->sample_time, c);
        for (int i = 0; i < OF_ENCODERS; i++)
            for (int k = 0; k < SENSOR_COEFFICIENTS; k++)
                ((double *)l->sensors.at)[((FIRST_OF_LENGTHS + i) * SENSOR_COEFFICIENTS + k) * l->sensors.element] = c[k];
    }
    return 0;
}

#include "planning.h"

#include <string.h>

#include "elementary.h"
#include "lanes_table.h"
#include "machine_fields.h"

#ifdef __clang__
#pragma clang fp contract(off) reciprocal(off)
#endif

/* generated: motions by kind, and what follows from a motion */
#include "plan.h"

enum { GIVEN, PIECES };

/* The motion of the piece at a time, which may be the first one's or the last one's; at rest beyond. */
static void piece_at(const planned *p, double time, double motion[])
{
    double first = p->begins[0], pose[6], rate[6], acceleration[6];
    int moves = time >= first && time <= p->end + MOTION_ROUNDING;
    int64_t low = 0, high = p->n_pieces;
    time = time > p->end ? p->end : time;
    time = time < first ? first : time;
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (p->begins[middle] <= time)
            low = middle;
        else
            high = middle;
    }
    double since = time - p->begins[low];
    for (int i = 0; i < 6; i++) {
        const double *c = p->pieces + 36 * low + 6 * i;
        double value = 0, slope = 0, half = 0;
        for (int k = 0; k < 6; k++) {
            half = half * since + slope;
            slope = slope * since + value;
            value = value * since + c[k];
        }
        pose[i] = value;
        rate[i] = moves ? slope : 0;
        acceleration[i] = moves ? 2 * half : 0;
    }
    plan_motion_of_pose(pose, rate, acceleration, motion);
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

void plan_reference(const planned *p, double time, double reference[])
{
    double motion[N_MOTION];
    motion_at(p, time, motion);
    plan_signals(motion, p->platform, reference);
}

void plan_maps_at(const planned *p, double time, double jacobian[], double inverse[])
{
    double motion[N_MOTION];
    motion_at(p, time, motion);
    plan_maps(motion, p->platform, jacobian, inverse);
}

void plan_take(planned *p, double time)
{
    double motion[N_MOTION];
    if (p->kind == GIVEN || !p->target)
        return;
    motion_at(p, time, motion);
    plan_coordinates(motion, p->smoothed);
    memcpy(p->target, p->smoothed, 6 * sizeof(double));
    memcpy(p->given, motion, sizeof motion);
    p->given_at[0] = time;
    p->kind = GIVEN;
}

void plan_by_hand(const planned *p, int64_t sample, double time)
{
    if (p->kind != GIVEN || !p->target || p->samples[0] < 0 || sample < p->samples[0])
        return;
    for (int group = 0; group < 6; group += 3) {
        double before[9], after[9];
        for (int k = 0; k < 9; k++)
            before[k] = p->smoothed[k / 3 * 6 + group + k % 3];
        component_smoothing(p->smoothing + group / 3 * N_SMOOTHING, before, p->target + group, after);
        for (int k = 0; k < 9; k++)
            p->smoothed[k / 3 * 6 + group + k % 3] = after[k];
    }
    plan_motion_of_pose(p->smoothed, p->smoothed + 6, p->smoothed + 12, p->given);
    p->given_at[0] = time;
    p->samples[0] = sample + 1;
}

void plan_forces(const planned *p, double time, double force[])
{
    double motion[N_MOTION], later = time + p->ahead;
    motion_at(p, later < p->end || p->kind == GIVEN ? later : p->end, motion);
    if (p->feedforward == 1)
        plan_gravity(motion, p->platform, force);
    else if (p->feedforward == 2)
        plan_computed_torque(motion, p->platform, force);
    else
        for (int i = 0; i < N_LEGS; i++)
            force[i] = 0;
}

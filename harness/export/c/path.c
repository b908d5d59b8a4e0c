/* A path by its splines of positions and rotation vectors, highest power first; and its time law.
@if single
   Positions are relative to home.
@end
   */
#define TABLE_END @END@
#define TABLE_ROUNDING @ROUNDING@
#define LAW_DURATION @DURATION@
@if single
#define TABLE_END_LOW @END_LOW@
#define PATH_START pair_of(@START@, @START_LOW@)
@else
#define PATH_START @START@
@end
enum { N_SPLINES = @N_SPLINES@, N_POWERS = @N_POWERS@ };
static const double SPLINE_AT[N_SPLINES] = {@SPLINE_AT@};
static const double SPLINES[N_SPLINES][6][N_POWERS] = {
@SPLINES@
};
@if stepwise
/* At the knots of the law: time since the start; path parameter since the spline's piece began, in a unit that resolves
   more than a float of the same size; its rate and acceleration. And the first knot in each piece. */
#include <stdint.h>
#define LAW_UNIT @UNIT@
enum { N_KNOTS = @N_KNOTS@ };
static const int FIRST_KNOT[N_SPLINES] = {@FIRST_KNOTS@};
static const double LAW_TIME[N_KNOTS] = {@TIMES@};
@if single
static const double LAW_TIME_LOW[N_KNOTS] = {@TIMES_LOW@};
@end
static const int32_t LAW_VALUE[N_KNOTS] = {@VALUES@};
static const float LAW_RATE[N_KNOTS] = {@RATES@};
static const float LAW_CHANGE[N_KNOTS] = {@CHANGES@};
@end

/* The last of n ascending values that is not above `at`, or the first; `step` is the largest power of 2 below n. */
static int last_below(const double *values, int n, int step, double at)
{
    int found = 0;
    for (; step > 0; step /= 2)
        if (found + step < n && values[found + step] <= at) found += step;
    return found;
}

/* x, y, z, roll, pitch, yaw and their first and second derivatives, by the path itself. */
@if single
static void table_at(pair time, double pose[6], double rate[6], double acceleration[6])
{
    const pair end = pair_of(TABLE_END, TABLE_END_LOW);
    const int is_before = pair_less(time, PATH_START), is_over = pair_less(pair_sum(end, pair_of(TABLE_ROUNDING, 0)), time);
    pair at = pair_less(end, time) ? end : time;
@else
static void table_at(double time, double pose[6], double rate[6], double acceleration[6])
{
    const int is_before = time < PATH_START, is_over = time > TABLE_END + TABLE_ROUNDING;
    const double at = is_before ? 0 : (time > TABLE_END ? TABLE_END : time) - PATH_START;
@end
    double spline[6], slope[6], bend[6], speed, change, since;
    int k, j, piece = 0;
@if single
    at = is_before ? pair_of(0, 0) : pair_sum(at, pair_minus(PATH_START));
@end
@if stepwise
    {
@if single
        const int knot = last_below(LAW_TIME, N_KNOTS - 1, @STEP@, at.high);
        const double after = pair_value(pair_sum(at, pair_minus(pair_of(LAW_TIME[knot], LAW_TIME_LOW[knot]))));
        const double length = (LAW_TIME[knot + 1] - LAW_TIME[knot]) + (LAW_TIME_LOW[knot + 1] - LAW_TIME_LOW[knot]);
@else
        const int knot = last_below(LAW_TIME, N_KNOTS - 1, @STEP@, at);
        const double after = at - LAW_TIME[knot], length = LAW_TIME[knot + 1] - LAW_TIME[knot];
@end
        const double first_rate = (double)LAW_RATE[knot], first_change = (double)LAW_CHANGE[knot];
@if averaged
        const double jerk = length > 0 ? ((double)LAW_CHANGE[knot + 1] - first_change) / length : 0;
@else
        const double jerk = 0;
        (void)length;
@end
        while (piece + 1 < N_SPLINES && FIRST_KNOT[piece + 1] <= knot)
            ++piece;
        since = (double)LAW_VALUE[knot] * LAW_UNIT + after * (first_rate + after * (first_change / 2 + after * jerk / 6));
        speed = first_rate + after * (first_change + after * jerk / 2);
        change = first_change + after * jerk;
        if (piece + 1 < N_SPLINES && since >= SPLINE_AT[piece + 1] - SPLINE_AT[piece]) {
            since -= SPLINE_AT[piece + 1] - SPLINE_AT[piece];
            ++piece;
        }
    }
@else
    {
@if single
        const double t = pair_value(at) / LAW_DURATION;
@else
        const double t = at / LAW_DURATION;
@end
        since = t * t * t * (10 + t * (6 * t - 15));
        speed = 30 * t * t * (1 - t) * (1 - t) / LAW_DURATION;
        change = 60 * t * (1 - t) * (1 - 2 * t) / LAW_DURATION / LAW_DURATION;
        piece = last_below(SPLINE_AT, N_SPLINES, @STEP@, since);
        since -= SPLINE_AT[piece];
    }
@end
    if (is_before || is_over) speed = change = 0;
    for (k = 0; k < 6; ++k) {
        double half = 0;
        spline[k] = slope[k] = 0;
        for (j = 0; j < N_POWERS; ++j) {
            half = half * since + slope[k];
            slope[k] = slope[k] * since + spline[k];
            spline[k] = spline[k] * since + SPLINES[piece][k][j];
        }
        bend[k] = 2 * half;
    }
    motion_of_path(spline, slope, bend, &speed, &change, pose, rate, acceleration);
}

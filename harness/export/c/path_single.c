/* A path by its splines of positions, relative to home, and rotation vectors, highest power first; and its time law. */
#define TABLE_END @END@
#define TABLE_END_LOW @END_LOW@
#define TABLE_ROUNDING @ROUNDING@
#define PATH_START pair_of(@START_HIGH@, @START_LOW@)
#define LAW_DURATION @DURATION@
enum { N_SPLINES = @N_SPLINES@, N_POWERS = @N_POWERS@ };
@if stepwise
@else
static const double SPLINE_AT[N_SPLINES] = {@SPLINE_AT@};
@end
static const double SPLINES[N_SPLINES][6][N_POWERS] = {
@SPLINES@
};
@if stepwise
/* At the knots of the law: time since the start as the sum of two; path parameter since the spline's piece began, rate
   and acceleration. And the first knot in each piece. */
enum { N_KNOTS = @N_KNOTS@ };
static const int FIRST_KNOT[N_SPLINES] = {@FIRST_KNOTS@};
static const double LAW_TIME[N_KNOTS] = {@TIMES@};
static const double LAW_TIME_LOW[N_KNOTS] = {@TIMES_LOW@};
static const double LAW_VALUE[N_KNOTS] = {@VALUES@};
static const double LAW_RATE[N_KNOTS] = {@RATES@};
static const double LAW_CHANGE[N_KNOTS] = {@CHANGES@};
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
static void table_at(pair time, double pose[6], double rate[6], double acceleration[6])
{
    const pair end = pair_of(TABLE_END, TABLE_END_LOW);
    const int is_before = pair_less(time, PATH_START), is_over = pair_less(pair_sum(end, pair_of(TABLE_ROUNDING, 0)), time);
    double spline[6], slope[6], bend[6], speed, change, value, since;
    int k, j, piece = 0;
    pair at = pair_less(end, time) ? end : time;
    at = is_before ? pair_of(0, 0) : pair_sum(at, pair_minus(PATH_START));
@if stepwise
    {
        const int knot = last_below(LAW_TIME, N_KNOTS - 1, @STEP@, at.high);
        const double length = (LAW_TIME[knot + 1] - LAW_TIME[knot]) + (LAW_TIME_LOW[knot + 1] - LAW_TIME_LOW[knot]);
@if averaged
        const double jerk = length > 0 ? (LAW_CHANGE[knot + 1] - LAW_CHANGE[knot]) / length : 0;
@else
        const double jerk = 0;
        (void)length;
@end
        while (piece + 1 < N_SPLINES && FIRST_KNOT[piece + 1] <= knot)
            ++piece;
        since = pair_value(pair_sum(at, pair_minus(pair_of(LAW_TIME[knot], LAW_TIME_LOW[knot]))));
        value = LAW_VALUE[knot] + since * (LAW_RATE[knot] + since * (LAW_CHANGE[knot] / 2 + since * jerk / 6));
        speed = LAW_RATE[knot] + since * (LAW_CHANGE[knot] + since * jerk / 2);
        change = LAW_CHANGE[knot] + since * jerk;
    }
@else
    {
        const double t = pair_value(at) / LAW_DURATION;
        value = t * t * t * (10 + t * (6 * t - 15));
        speed = 30 * t * t * (1 - t) * (1 - t) / LAW_DURATION;
        change = 60 * t * (1 - t) * (1 - 2 * t) / LAW_DURATION / LAW_DURATION;
    }
@end
    if (is_before || is_over) speed = change = 0;
@if stepwise
    since = value;
@else
    piece = last_below(SPLINE_AT, N_SPLINES, @SPLINE_STEP@, value);
    since = value - SPLINE_AT[piece];
@end
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

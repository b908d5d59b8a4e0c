/* A path by its splines of positions and rotation vectors, six per piece, highest power first; and its time law. */
#define TABLE_END @END@
#define TABLE_ROUNDING @ROUNDING@
#define PATH_START @START@
#define LAW_STRETCH @STRETCH@
#define LAW_DURATION @DURATION@
#define LONGEST_PIECE @LONGEST@
#define SHORT_PIECE @SHORT@
#define SHORTEST_PIECE @SHORTEST@
enum { N_SPLINES = @N_SPLINES@, N_POWERS = @N_POWERS@, N_KNOTS = @N_KNOTS@ };
static const double SPLINE_AT[N_SPLINES] = {@SPLINE_AT@};
static const double SPLINES[N_SPLINES][6][N_POWERS] = {
@SPLINES@
};
@if stepwise
/* At the knots of the law: time, path parameter and its rate. */
static const double LAW_TIME[N_KNOTS] = {@TIMES@};
static const double LAW_VALUE[N_KNOTS] = {@VALUES@};
static const double LAW_RATE[N_KNOTS] = {@RATES@};
@end
@if averaged
/* The integral of the path parameter; the law is its mean over a window. */
#define LAW_WINDOW @WINDOW@
static const double LAW_AREA[N_KNOTS] = {@AREAS@};
@end

/* The last of n ascending values that is not above `at`, or the first; `step` is the largest power of 2 below n. */
static int last_below(const double *values, int n, int step, double at)
{
    int found = 0;
    for (; step > 0; step /= 2)
        if (found + step < n && values[found + step] <= at) found += step;
    return found;
}

@if stepwise
/* Path parameter, rate, acceleration and integral after a knot; before the first, which is -1, at rest at 0. */
static void law_after(int knot, double time, double at[4])
{
    double since, rate, change;
    memset(at, 0, 4 * sizeof at[0]);
    if (knot < 0) return;
    since = time - LAW_TIME[knot];
    rate = LAW_RATE[knot];
    change = knot + 1 < N_KNOTS ? (LAW_RATE[knot + 1] - rate) / (LAW_TIME[knot + 1] - LAW_TIME[knot]) : 0;
    at[0] = LAW_VALUE[knot] + since * (rate + since * change / 2);
    at[1] = rate + since * change;
    at[2] = change;
@if averaged
    at[3] = LAW_AREA[knot] + since * (LAW_VALUE[knot] + since * (rate / 2 + since * change / 6));
@end
}

@end
/* Pose, rate and acceleration at a time of the law, by its values after the knots `own` and, a window ago, `before`. */
static void path_at(int own, int before, double time, double pose[6], double rate[6], double acceleration[6])
{
    double spline[6], slope[6], bend[6], speed, change, value, since;
    int k, j, piece;
@if stepwise
    double now[4];
@if averaged
    double then[4];
    law_after(own, time, now);
    law_after(before, time - LAW_WINDOW, then);
    value = (now[3] - then[3]) / LAW_WINDOW;
    speed = (now[0] - then[0]) / LAW_WINDOW;
    change = (now[1] - then[1]) / LAW_WINDOW;
@else
    (void)before;
    law_after(own, time, now);
    value = now[0];
    speed = now[1];
    change = now[2];
@end
@else
    const double t = time / LAW_DURATION;
    (void)own;
    (void)before;
    value = t * t * t * (10 + t * (6 * t - 15));
    speed = 30 * t * t * (1 - t) * (1 - t) / LAW_DURATION;
    change = 60 * t * (1 - t) * (1 - 2 * t) / LAW_DURATION / LAW_DURATION;
@end
    piece = last_below(SPLINE_AT, N_SPLINES, @SPLINE_STEP@, value);
    since = value - SPLINE_AT[piece];
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

/* x, y, z, roll, pitch, yaw and their first and second derivatives: between the knots of the law a quintic. */
static void table_at(double time, double pose[6], double rate[6], double acceleration[6])
{
    double ends[2][3][6], left, right, h, t, parts;
    const double moves = time >= PATH_START && time <= TABLE_END + TABLE_ROUNDING ? 1 : 0;
    const double at = between(0, (time - PATH_START) / LAW_STRETCH, LAW_DURATION);
    int k, own = 0, before = -1;
@if stepwise
    own = last_below(LAW_TIME, N_KNOTS, @STEP@, at);
@if averaged
    if (at >= LAW_WINDOW) before = last_below(LAW_TIME, N_KNOTS, @STEP@, at - LAW_WINDOW);
    if (before == N_KNOTS - 1) before = N_KNOTS - 2;
    left = LAW_TIME[own];
    right = own + 1 < N_KNOTS ? LAW_TIME[own + 1] : LAW_DURATION;
    if (before >= 0 && LAW_TIME[before] + LAW_WINDOW > left) left = LAW_TIME[before] + LAW_WINDOW;
    if (LAW_TIME[before + 1] + LAW_WINDOW < right) right = LAW_TIME[before + 1] + LAW_WINDOW;
@else
    if (own == N_KNOTS - 1) own = N_KNOTS - 2;
    left = LAW_TIME[own];
    right = LAW_TIME[own + 1];
@end
@else
    left = 0;
    right = LAW_DURATION;
@end
    /* long pieces are divided */
    parts = ceil((1 - 1e-9) * (right - left) / LONGEST_PIECE);
    if (parts > 1) {
        h = (right - left) / parts;
        left += h * between(0, floor((at - left) / h), parts - 1);
        right = left + h;
    }
    h = right - left;
    t = h > 0 ? (at - left) / h : 0;
    path_at(own, before, left, ends[0][0], ends[0][1], ends[0][2]);
    path_at(own, before, right, ends[1][0], ends[1][1], ends[1][2]);
    for (k = 0; k < 6; ++k) {
        const double v0 = ends[0][1][k] * h, v1 = ends[1][1][k] * h;
        const double a0 = ends[0][2][k] * h * h / 2, a1 = ends[1][2][k] * h * h / 2;
        const double p0 = ends[0][0][k], way = ends[1][0][k] - p0;
        double c3 = 10 * way - 6 * v0 - 4 * v1 - 3 * a0 + a1;
        double c4 = -15 * way + 8 * v0 + 7 * v1 + 3 * a0 - 2 * a1;
        double c5 = 6 * way - 3 * v0 - 3 * v1 - a0 + a1;
        if (h < SHORT_PIECE) { /* the way is mostly rounding; and in the shortest pieces the change of the rate */
            const double faster = v1 - v0;
            c3 = h < SHORTEST_PIECE ? (a1 - a0) / 3 : faster - 2 * (2 * a0 + a1) / 3;
            c4 = h < SHORTEST_PIECE ? 0 : (a0 + a1 - faster) / 2;
            c5 = 0;
        }
        pose[k] = p0 + t * (v0 + t * (a0 + t * (c3 + t * (c4 + t * c5))));
        rate[k] = v0 + t * (2 * a0 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)));
        acceleration[k] = 2 * a0 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5));
        rate[k] = h > 0 ? moves * rate[k] / (h * LAW_STRETCH) : 0;
        acceleration[k] = h > 0 ? moves * acceleration[k] / (h * h * LAW_STRETCH * LAW_STRETCH) : 0;
    }
}

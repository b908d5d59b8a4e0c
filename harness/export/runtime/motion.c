/* Motions that are no formula; constant terms of coordinates are relative to home in single precision. */
#if HAS_TABLE && !HAS_PATH
/* x, y, z, roll, pitch, yaw and their first and second derivatives, by the polynomials between the rows of a table. */
static void table_at(moment time, real pose[6], real rate[6], real acceleration[6])
{
    const int is_over = moment_less(moment_sum(TABLE_END, moment_of(TABLE_ROUNDING, 0)), time);
    int piece = 0, step, k, j;
    real since;
    if (moment_less(TABLE_END, time)) time = TABLE_END;
    if (moment_less(time, BEGINS[0])) time = BEGINS[0];
    for (step = FIRST_STEP; step > 0; step /= 2)
        if (piece + step < N_PIECES && HIGH(BEGINS[piece + step]) <= HIGH(time)) piece += step;
    since = moment_since(time, BEGINS[piece]);
    for (k = 0; k < 6; ++k) {
        real value = 0, slope = 0, half = 0;
        for (j = 0; j < 6; ++j) {
            half = half * since + slope;
            slope = slope * since + value;
            value = value * since + PIECES[piece][k][j];
        }
        pose[k] = value;
        rate[k] = is_over ? 0 : slope;
        acceleration[k] = is_over ? 0 : 2 * half;
    }
}
#endif

#if HAS_PATH
/* x, y, z, roll, pitch, yaw and their first and second derivatives, by a path's splines of positions and rotation
   vectors and its time law. */
static void table_at(moment time, real pose[6], real rate[6], real acceleration[6])
{
    const int is_before = moment_less(time, PATH_START);
    const int is_over = moment_less(moment_sum(TABLE_END, moment_of(TABLE_ROUNDING, 0)), time);
    real spline[6], slope[6], bend[6], speed, change, since;
    int k, j, piece = 0;
    if (moment_less(TABLE_END, time)) time = TABLE_END;
    if (is_before) time = PATH_START;
    time = moment_sum(time, moment_minus(PATH_START));
#if N_KNOTS > 0
    {
        int knot = 0, step;
        real after, length, rate_there, change_there, jerk;
        for (step = FIRST_STEP; step > 0; step /= 2)
            if (knot + step < N_KNOTS - 1 && HIGH(KNOTS[knot + step]) <= HIGH(time)) knot += step;
        after = moment_since(time, KNOTS[knot]);
        length = moment_since(KNOTS[knot + 1], KNOTS[knot]);
        rate_there = (real)LAW_RATE[knot];
        change_there = (real)LAW_CHANGE[knot];
        jerk = IS_AVERAGED && length > 0 ? ((real)LAW_CHANGE[knot + 1] - change_there) / length : 0;
        while (piece + 1 < N_SPLINES && FIRST_KNOT[piece + 1] <= knot)
            ++piece;
        since = (real)LAW_VALUE[knot] * LAW_UNIT + after * (rate_there + after * (change_there / 2 + after * jerk / 6));
        speed = rate_there + after * (change_there + after * jerk / 2);
        change = change_there + after * jerk;
        if (piece + 1 < N_SPLINES && since >= SPLINE_AT[piece + 1] - SPLINE_AT[piece]) {
            since -= SPLINE_AT[piece + 1] - SPLINE_AT[piece];
            ++piece;
        }
    }
#else
    {
        const real t = moment_value(time) / LAW_DURATION;
        since = t * t * t * (10 + t * (6 * t - 15));
        speed = 30 * t * t * (1 - t) * (1 - t) / LAW_DURATION;
        change = 60 * t * (1 - t) * (1 - 2 * t) / LAW_DURATION / LAW_DURATION;
        while (piece + 1 < N_SPLINES && SPLINE_AT[piece + 1] <= since)
            ++piece;
        since -= SPLINE_AT[piece];
    }
#endif
    if (is_before || is_over) speed = change = 0;
    for (k = 0; k < 6; ++k) {
        real half = 0;
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
#endif

#if HAS_TABLE
/* After its end the platform is at rest. */
static void motion(moment time, real motion[18])
{
    real pose[6], rate[6], acceleration[6];
    table_at(time, pose, rate, acceleration);
    motion_of_table(pose, rate, acceleration, motion);
}
#endif

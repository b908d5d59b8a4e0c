/* Polynomials between the rows of a table: six coordinates per piece, highest power first. */
#define TABLE_END @END@
#define TABLE_ROUNDING @ROUNDING@
enum { N_PIECES = @N@ };
static const double BEGINS[N_PIECES] = {@BEGINS@};
@if single
#define TABLE_END_LOW @END_LOW@
static const double BEGINS_LOW[N_PIECES] = {@BEGINS_LOW@};
@end
static const double PIECES[N_PIECES][6][6] = {
@PIECES@
};

/* x, y, z, roll, pitch, yaw and their first and second derivatives. */
@if single
static void table_at(pair time, double pose[6], double rate[6], double acceleration[6])
@else
static void table_at(double time, double pose[6], double rate[6], double acceleration[6])
@end
{
    int piece = 0, step, k, j;
    double s;
@if single
    const pair begin = pair_of(BEGINS[0], BEGINS_LOW[0]), end = pair_of(TABLE_END, TABLE_END_LOW);
    const double moves = pair_less(pair_sum(end, pair_of(TABLE_ROUNDING, 0)), time) ? 0 : 1;
    if (pair_less(end, time)) time = end;
    if (pair_less(time, begin)) time = begin;
    for (step = @STEP@; step > 0; step /= 2)
        if (piece + step < N_PIECES && BEGINS[piece + step] <= time.high) piece += step;
    s = pair_value(pair_sum(time, pair_minus(pair_of(BEGINS[piece], BEGINS_LOW[piece]))));
@else
    const double moves = time <= TABLE_END + TABLE_ROUNDING ? 1 : 0;
    if (time > TABLE_END) time = TABLE_END;
    if (time < BEGINS[0]) time = BEGINS[0];
    for (step = @STEP@; step > 0; step /= 2)
        if (piece + step < N_PIECES && BEGINS[piece + step] <= time) piece += step;
    s = time - BEGINS[piece];
@end
    for (k = 0; k < 6; ++k) {
        double value = 0, slope = 0, half = 0;
        for (j = 0; j < 6; ++j) {
            half = half * s + slope;
            slope = slope * s + value;
            value = value * s + PIECES[piece][k][j];
        }
        pose[k] = value;
        rate[k] = moves * slope;
        acceleration[k] = moves * 2 * half;
    }
}

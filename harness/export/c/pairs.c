/* Time in single precision: numbers of 48 bits as the sum of two of 24. After hours a time still resolves less than a
   nanosecond, and the phase of a motion is what it is. Do not compile this with -ffast-math. */
#ifdef __FAST_MATH__
#error "sums of two numbers need exact rounding: compile without -ffast-math"
#endif

typedef struct {
    double high, low;
} pair;

static pair pair_of(double high, double low)
{
    pair found;
    found.high = high + low;
    found.low = low - (found.high - high);
    return found;
}

static pair pair_sum(pair a, pair b)
{
    const double s = a.high + b.high, v = s - a.high;
    return pair_of(s, (a.high - (s - v)) + (b.high - v) + (a.low + b.low));
}

static pair pair_minus(pair a)
{
    pair found;
    found.high = -a.high;
    found.low = -a.low;
    return found;
}

static pair pair_product(pair a, pair b)
{
    const double p = a.high * b.high;
    return pair_of(p, fma(a.high, b.high, -p) + (a.high * b.low + a.low * b.high));
}

static pair pair_quotient(pair a, pair b)
{
    const double q = a.high / b.high;
    const pair rest = pair_sum(a, pair_minus(pair_product(pair_of(q, 0), b)));
    return pair_of(q, rest.high / b.high);
}

static int pair_less(pair a, pair b)
{
    const pair difference = pair_sum(a, pair_minus(b));
    return difference.high < 0;
}

static double pair_value(pair a)
{
    return a.high + a.low;
}

/* An angle less its whole turns [rad]. */
static double pair_angle(pair a)
{
    const double turns = floor(a.high * 0.15915494309189535 + 0.5);
    const pair whole = pair_product(pair_of(turns, 0), pair_of(@TURN_HIGH@, @TURN_LOW@));
    return pair_value(pair_sum(pair_sum(a, pair_minus(whole)), pair_of(-turns * @TURN_LOWEST@, 0)));
}

/* The time of a sample, or of a part of one after it. */
static pair time_of(unsigned long long sample, double part, pair sample_time)
{
    const double low = (double)(unsigned)(sample & 0xFFFFFF), high = (double)(unsigned)((sample >> 24) & 0xFFFFFF);
    return pair_product(pair_sum(pair_sum(pair_of(high * 16777216, 0), pair_of(low, 0)), pair_of(part, 0)), sample_time);
}

/* Time. A float resolves 0.06 ms at 1000 s, in which a platform moves 0.06 mm, and it has no digit of a phase after a
   million samples. So in single precision a moment is the sum of two floats, 48 bits. */
#if CONTROLLER_SINGLE
#ifdef __FAST_MATH__
#error "sums of two numbers need exact rounding: compile without -ffast-math"
#endif

typedef struct {
    real high, low;
} moment;
/* A constant, split by the compiler. */
#define MOMENT(x) {(real)(x), (real)((x) - (double)(real)(x))}
#define FROM_HOME(x, home) ((real)((x) - (home)))
/* The part that tells the rows of a table apart. */
#define HIGH(a) ((a).high)
#define CONSTANT(x) moment_of((real)(x), (real)((x) - (double)(real)(x)))

MAYBE_UNUSED static moment moment_of(real high, real low)
{
    moment sum;
    sum.high = high + low;
    sum.low = low - (sum.high - high);
    return sum;
}

MAYBE_UNUSED static moment moment_sum(moment a, moment b)
{
    const real s = a.high + b.high, v = s - a.high;
    return moment_of(s, (a.high - (s - v)) + (b.high - v) + (a.low + b.low));
}

MAYBE_UNUSED static moment moment_minus(moment a)
{
    moment negative;
    negative.high = -a.high;
    negative.low = -a.low;
    return negative;
}

MAYBE_UNUSED static moment moment_product(moment a, moment b)
{
    const real p = a.high * b.high;
    return moment_of(p, REAL(fma)(a.high, b.high, -p) + (a.high * b.low + a.low * b.high));
}

MAYBE_UNUSED static moment moment_quotient(moment a, moment b)
{
    const real q = a.high / b.high;
    const moment rest = moment_sum(a, moment_minus(moment_product(moment_of(q, 0), b)));
    return moment_of(q, rest.high / b.high);
}

MAYBE_UNUSED static real moment_value(moment a)
{
    return a.high + a.low;
}

MAYBE_UNUSED static real moment_since(moment a, moment b)
{
    return moment_value(moment_sum(a, moment_minus(b)));
}

/* An angle less its whole turns [rad]. */
MAYBE_UNUSED static real moment_angle(moment a)
{
    const real turns = REAL(floor)(a.high * (real)(1 / 6.283185307179586476925) + 1 / (real)2);
    const moment whole = moment_product(moment_of(turns, 0), CONSTANT(6.283185307179586476925));
    return moment_value(moment_sum(a, moment_minus(whole)));
}

#else
typedef real moment;
#define MOMENT(x) x
#define FROM_HOME(x, home) (x)
#define HIGH(a) (a)
#define CONSTANT(x) x
#define moment_of(high, low) ((high) + (low))
#define moment_sum(a, b) ((a) + (b))
#define moment_minus(a) (-(a))
#define moment_value(a) (a)
#define moment_since(a, b) ((a) - (b))
#endif

MAYBE_UNUSED static int moment_less(moment a, moment b)
{
    return moment_since(a, b) < 0;
}

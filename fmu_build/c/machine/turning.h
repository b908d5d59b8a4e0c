/* What is turned while a machine runs, gains, delay, the force limit, noise and quantisation of the encoders, and what the
   linear loop says of it. Equations are generated from those of Python (design.h). */
#ifndef TURNING_H
#define TURNING_H

#include "loop.h"

enum { /* positions in `wanted` */
    BANDWIDTH,     /* [Hz] gives all gains, with the modal masses; 0: the experiment's gains */
    DAMPING_RATIO, /* with a bandwidth */
    INTEGRAL_TIME, /* [s], with a bandwidth, of a PID */
    FILTER_TIME,   /* [s] of the derivative; 0: the experiment's, or 1/20 of the fastest channel's kd/kp */
    FACTORS,       /* on kp, kd, ki */
    DELAY = FACTORS + 3, /* [samples] */
    FORCE_LIMIT,         /* [N]; infinite: none */
    NOISE,               /* [m] of leg lengths */
    QUANTISATION,        /* [m] of leg lengths; 0: none */
    N_WANTED
};
/* positions in `used`: kp, kd and ki (6 each), the filter's time, and the times of back-calculation (6) */
enum { USED_FILTER = 18, USED_TRACKING = 19, N_USED = 25 };
enum { /* positions in `results` */
    RADIUS,      /* largest |z| of the closed loop */
    N_POLES,
    PEAK_S,      /* max sigma(S), NaN of an unstable loop, as all margins */
    PEAK_T,
    LEG_MARGINS, /* by leg: largest and smallest factor on its gain, phase [rad], delay [s], crossover [Hz] */
    N_MODES = LEG_MARGINS + 5 * N_LEGS,
    POLES /* real and imaginary parts (most_states, 2), then frequencies [Hz] and damping ratios (most_states, 2) */
};

typedef struct {
    int64_t variant;         /* of the laws of design.h; -1: a law without gains */
    const int64_t *channels; /* by entry of the law: its channel, and its place in that one's [C D; A B] */
    double sample_time;      /* [s] */
    const double *masses;    /* (6) modal masses [kg, kg m2] of kp = m w^2, kd = 2 zeta m w */
    const double *gains;     /* (25) those of the experiment, as `used` */
    double filter_time, tracking_time; /* [s] that the experiment states, or 0 */
    const double *notch;               /* values of its keys */
    double *wanted, *used;
    /* the plant from forces to the readings of the law, in its space, small signals at the sample time: x+ = A x + B u,
       y = C x (n_plant states); and from the law's output to forces */
    int64_t n_plant;
    const double *A, *B, *C, *to_force;
    double *work, *results; /* room for the analysis of at most `most_states` of the closed loop */
    int64_t most_states;
} turning;

/* Poles, modes and margins of the linear loop with the present gains and delay. Returns 0, or 1 if there are too many
   states, or no controller. */
int64_t turn_margins(turning *t, const loop *l);

#endif

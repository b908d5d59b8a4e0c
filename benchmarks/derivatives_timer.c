/* Times the generated function `derivatives` (x, u, p) -> xdot.
 * Usage: derivatives_timer CALLS < numbers; reads x (12), u (12), p (N_PARAMETERS), prints xdot, then ns per call:
 * the smallest of 15 rounds. The state changes a little from call to call, so that no call can be skipped. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

int derivatives(const double **arg, double **res, long long *iw, double *w, int mem);
int derivatives_work(long long *sz_arg, long long *sz_res, long long *sz_iw, long long *sz_w);

static double seconds(void) {
    struct timespec t;
    timespec_get(&t, TIME_UTC);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int argc, char **argv) {
    double x[12], u[12], p[N_PARAMETERS], xdot[12], best = 1e300;
    long long n_arg, n_res, n_iw, n_w;
    long calls = argc > 1 ? atol(argv[1]) : 0;
    if (calls <= 0) return 2;
    for (int i = 0; i < 12; i++) if (scanf("%lf", x + i) != 1) return 2;
    for (int i = 0; i < 12; i++) if (scanf("%lf", u + i) != 1) return 2;
    for (int i = 0; i < N_PARAMETERS; i++) if (scanf("%lf", p + i) != 1) return 2;
    if (derivatives_work(&n_arg, &n_res, &n_iw, &n_w)) return 1;
    const double **arg = calloc((size_t)n_arg, sizeof *arg);
    double **res = calloc((size_t)n_res, sizeof *res);
    long long *iw = calloc((size_t)n_iw + 1, sizeof *iw);
    double *w = calloc((size_t)n_w + 1, sizeof *w);
    if (!arg || !res || !iw || !w) return 1;
    arg[0] = x, arg[1] = u, arg[2] = p, res[0] = xdot;
    derivatives(arg, res, iw, w, 0);
    for (int i = 0; i < 12; i++) printf("%.17g\n", xdot[i]);
    for (int round = 0; round < 15; round++) {
        double start = seconds();
        for (long k = 0; k < calls; k++) {
            derivatives(arg, res, iw, w, 0);
            x[5] += 1e-9 * xdot[5];
        }
        double each = (seconds() - start) / (double)calls;
        if (each < best) best = each;
    }
    printf("%.6f\n", 1e9 * best);
    free(arg), free(res), free(iw), free(w);
    return 0;
}

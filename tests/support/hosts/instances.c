/* Many instances of the FMI 2.0 unit in one process: stepped in turn, then by threads, then one after the other. The
   inputs of instance k are those of k mod 10. Whatever the order, every variable has to have the same bits.

   Usage: instances NUMBER THREADS. Prints JSON: memory of an instance, and how many variables were compared. */
#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "model.h"

enum { STEPS = 10, KINDS_OF_INPUT = 10, MOST_THREADS = 64 };
static const double STEP = 0.01;
static const char *const GUID = "host";

static long n;
static fmi2Component *units;
static double *results; /* N_SLOTS of every instance */
static fmi2ValueReference references[N_SLOTS];

static void expect(fmi2Status status, const char *what)
{
    if (status == fmi2OK)
        return;
    fprintf(stderr, "%s returned %d\n", what, (int)status);
    exit(1);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    fprintf(stderr, "%s, status %d, %s: %s\n", name, (int)status, category, message);
}

static void make_all(void)
{
    static const fmi2CallbackFunctions callbacks = {.logger = logger};
    for (long k = 0; k < n; k++) {
        units[k] = fmi2Instantiate("plant", fmi2CoSimulation, GUID, NULL, &callbacks, fmi2False, fmi2True);
        if (!units[k]) {
            fprintf(stderr, "no instance %ld\n", k);
            exit(1);
        }
        expect(fmi2SetupExperiment(units[k], fmi2True, 1e-8, 0, fmi2False, 0), "fmi2SetupExperiment");
        expect(fmi2EnterInitializationMode(units[k]), "fmi2EnterInitializationMode");
        expect(fmi2ExitInitializationMode(units[k]), "fmi2ExitInitializationMode");
    }
}

static void free_all(void)
{
    for (long k = 0; k < n; k++)
        fmi2FreeInstance(units[k]);
}

static void step(long k, int s)
{
    double forces[6];
    for (int leg = 0; leg < 6; leg++)
        forces[leg] = 50 + 5 * sin((double)(k % KINDS_OF_INPUT) + leg + 0.3 * s);
    expect(fmi2SetReal(units[k], references + FIRST_INPUT, 6, forces), "fmi2SetReal");
    expect(fmi2DoStep(units[k], s * STEP, STEP, fmi2True), "fmi2DoStep");
}

static void read_all(double *into)
{
    for (long k = 0; k < n; k++)
        expect(fmi2GetReal(units[k], references, N_SLOTS, into + k * N_SLOTS), "fmi2GetReal");
}

static void run_in_turn(void)
{
    for (int s = 0; s < STEPS; s++)
        for (long k = 0; k < n; k++)
            step(k, s);
}

static void run_one_by_one(void)
{
    for (long k = 0; k < n; k++)
        for (int s = 0; s < STEPS; s++)
            step(k, s);
}

/* Neighbours in memory go to different threads. */
typedef struct {
    pthread_t thread;
    long first, stride;
} share;

static void *run_share(void *given)
{
    const share *own = given;
    for (int s = 0; s < STEPS; s++)
        for (long k = own->first; k < n; k += own->stride)
            step(k, s);
    return NULL;
}

static void run_in_threads(int n_threads)
{
    share shares[MOST_THREADS];
    for (int t = 0; t < n_threads; t++) {
        shares[t].first = t;
        shares[t].stride = n_threads;
        if (pthread_create(&shares[t].thread, NULL, run_share, &shares[t]) != 0) {
            fprintf(stderr, "no thread %d\n", t);
            exit(1);
        }
    }
    for (int t = 0; t < n_threads; t++)
        pthread_join(shares[t].thread, NULL);
}

static void compare(const double *found, const char *how)
{
    if (memcmp(found, results, (size_t)n * N_SLOTS * sizeof *found) == 0)
        return;
    fprintf(stderr, "%s: not the same bits as in turn\n", how);
    exit(1);
}

int main(int argc, char **argv)
{
    int n_threads = argc > 2 ? atoi(argv[2]) : 0;
    n = argc > 1 ? atol(argv[1]) : 0;
    if (n < KINDS_OF_INPUT || n_threads < 1 || n_threads > MOST_THREADS) {
        fprintf(stderr, "usage: instances NUMBER THREADS\n");
        return 2;
    }
    units = calloc((size_t)n, sizeof *units);
    results = calloc((size_t)n * N_SLOTS, sizeof *results);
    double *others = calloc((size_t)n * N_SLOTS, sizeof *others);
    if (!units || !results || !others)
        return 2;
    for (fmi2ValueReference slot = 0; slot < N_SLOTS; slot++)
        references[slot] = slot;

    struct mallinfo2 before = mallinfo2();
    make_all();
    run_in_turn();
    struct mallinfo2 after = mallinfo2();
    double bytes = (double)(after.uordblks + after.hblkhd - before.uordblks - before.hblkhd) / (double)n;
    read_all(results);
    free_all();

    make_all();
    run_in_threads(n_threads);
    read_all(others);
    free_all();
    compare(others, "in threads");

    make_all();
    run_one_by_one();
    read_all(others);
    free_all();
    compare(others, "one by one");

    /* otherwise nothing was compared: other inputs have to lead elsewhere, the same to the same */
    for (int k = 1; k < KINDS_OF_INPUT; k++)
        if (memcmp(results, results + k * N_SLOTS, N_SLOTS * sizeof *results) == 0) {
            fprintf(stderr, "instances 0 and %d did the same under different inputs\n", k);
            return 1;
        }
    for (long k = KINDS_OF_INPUT; k < n; k++)
        if (memcmp(results + k * N_SLOTS, results + k % KINDS_OF_INPUT * N_SLOTS, N_SLOTS * sizeof *results) != 0) {
            fprintf(stderr, "instances %ld and %ld did not do the same\n", k, k % KINDS_OF_INPUT);
            return 1;
        }
    printf("{\"instances\": %ld, \"threads\": %d, \"variables\": %ld, \"bytes_per_instance\": %.1f}\n", n, n_threads,
           n * N_SLOTS, bytes);
    free(units), free(results), free(others);
    return 0;
}

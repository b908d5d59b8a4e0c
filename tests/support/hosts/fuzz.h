/* What the parts of the fuzzer share: importers of one instance each, the calls they make, what must hold after
   every call (fuzz_contract.c), and the actions they choose from. */
#ifndef FUZZ_H
#define FUZZ_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"
#include "model.h"
#include "modes.h"

#define RIGHT_TOKEN "host"
#define FIRST_PARAMETER_ROW VARIABLE_OF_SLOT[FIRST_PARAMETER]

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { MOST_BYTES = 4000 }; /* of a serialised state */

/* An importer of one instance. */
typedef struct {
    int version; /* 2 or 3 */
    fmi_kind kind;
    fmi_mode mode; /* what the standard says after the calls that returned OK */
    void *unit;
    double time;
    enum { SILENT, SOME_CATEGORIES, ALL_CATEGORIES } logging;
    int has_logger;
    const char *name;
    int messages; /* since the call began */
    int last_message_status;
    int is_peeking; /* checks of the fuzzer itself run, which do not count */
} host;

typedef void (*action)(host *h);
typedef struct {
    action action;
    unsigned modes; /* where it makes sense: it is tried there more often */
} entry;

/* ---- reproducible random numbers, mild and hostile (Marsaglia, "Xorshift RNGs", 2003; scrambled by a product) ------ */

extern uint64_t random_state; /* never 0 */

static inline uint64_t random_bits(void)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return random_state * UINT64_C(2685821657736338717);
}

static inline void seed_random(uint64_t seed, uint64_t sequence)
{
    random_state = (seed * UINT64_C(0x9E3779B97F4A7C15)) ^ (sequence * UINT64_C(0xD1B54A32D192ED03)) ^ 1;
    if (random_state == 0)
        random_state = 1;
    for (int k = 0; k < 8; k++) /* neighbours have nothing in common */
        random_bits();
}

/* 0 to n - 1 */
static inline size_t below(size_t n)
{
    return (size_t)((random_bits() >> 11) % n);
}

/* 0 to 1 */
static inline double fraction(void)
{
    return (double)(random_bits() >> 11) * 0x1p-53;
}

static inline int chance(double probability)
{
    return fraction() < probability;
}

static inline double between(double a, double b)
{
    return a + (b - a) * fraction();
}

static inline double hostile_number(void)
{
    static const double numbers[] = {NAN,     INFINITY, -INFINITY, 1e308,  -1e308,   DBL_MAX, 1e30,    -1e30,  1.1e30,
                                     1e-300,  -0.0,     0.0,       5e-324, -5e-324,  1e-308,  DBL_MIN, 1e15,   -1e15};
    return numbers[below(sizeof numbers / sizeof numbers[0])];
}

/* Any size that a machine, or a mistake in units, might have. */
static inline double number_of_any_size(void)
{
    return (chance(0.5) ? -1 : 1) * pow(10, between(-12, 12));
}

/* ---- fuzz_contract.c ------------------------------------------------------------------------------------------ */

extern int traces;           /* print every call */
extern long violations;
extern host *others[];       /* all that are alive; NULL ends the list */
extern const char *sequence; /* how to run it again, for messages */

/* A call with all checks around it; its status. Arguments are evaluated after the first check. */
#define CALL(h, function, ...) (call_begins(h, #function), call_ends((int)function(__VA_ARGS__)))
/* The same call in both versions. */
#define CALL_EITHER(h, two, three, ...)                                                                                \
    ((h)->version == 2 ? CALL(h, two, __VA_ARGS__) : CALL(h, three, __VA_ARGS__))

void call_begins(host *h, const char *function);
int call_ends(int status);
/* The instance; rarely a null pointer, which the checks then know of. */
void *unit(host *h);
void require(int holds, const char *what);
/* For functions without a status. */
void count_call(const char *function, int status);
void print_tallies(long sequences);
double time_of(host *h);

void logger_of_fmi2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String message, ...);
void logger_of_fmi3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message);

/* ---- fuzz_arguments.c ----------------------------------------------------------------------------------------- */

/* Memory of exactly this size, so that sanitizers see a step beyond; lives until the action is over. */
void *exactly(size_t bytes);
void perform(action action, host *h);
/* The pointer; rarely none. */
void *due(void *pointer);

typedef struct {
    uint32_t *references;
    size_t n;
    double *values; /* one for each slot that is meant, or as many as `n_values` says */
    size_t n_values;
    int32_t *orders;
} choice;

#define ROLE(role) (1u << (role))
#define ANY_ROLE (~0u)
/* References mostly of these roles. `n_values` is rarely wrong in FMI 3.0, where the unit is told of it. */
choice choose(const host *h, unsigned roles);

double value_for(int slot);
double step_size(void);
/* Mostly now. */
double communication_point(const host *h);

/* ---- actions -------------------------------------------------------------------------------------------------- */

extern const entry COMMON_ACTIONS[], FMI2_ACTIONS[], FMI3_ACTIONS[]; /* up to a row without action */
extern const action SAVED_STATE_ACTIONS[];                         /* up to NULL */

void *instantiate_fmi2(host *h);
void *instantiate_fmi3(host *h);
/* In the intermediate update: what an importer may do there, and what not. */
void act_in_callback(host *h);
/* Of the sequence that ends. */
void forget_saved_states(host *h);

#endif

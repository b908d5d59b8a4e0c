/* What must hold after every call, by the standards and by fmu_build/c/unit/instance.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

uint64_t random_state = 1;
int traces;
long violations;
host *others[8];
const char *sequence = "";

enum { MOST_VIOLATIONS = 20, MOST_FUNCTIONS = 160, DEEPEST = 3 };

/* ---- tallies -------------------------------------------------------------------------------------------------- */

static struct {
    const char *function;
    long by_status[5];
} tallies[MOST_FUNCTIONS];

void count_call(const char *function, int status)
{
    int k = 0;
    while (tallies[k].function && strcmp(tallies[k].function, function) != 0)
        if (++k == MOST_FUNCTIONS)
            abort();
    tallies[k].function = function;
    tallies[k].by_status[status]++;
}

void print_tallies(long sequences)
{
    printf("{\"sequences\": %ld, \"violations\": %ld, \"calls\": {", sequences, violations);
    for (int k = 0; k < MOST_FUNCTIONS && tallies[k].function; k++) {
        const long *n = tallies[k].by_status;
        printf("%s\n  \"%s\": {\"ok\": %ld, \"warning\": %ld, \"discard\": %ld, \"error\": %ld, \"fatal\": %ld}",
               k ? "," : "", tallies[k].function, n[OK], n[WARNING], n[DISCARD], n[ERROR], n[FATAL]);
    }
    printf("\n}}\n");
}

/* ---- calls under way ------------------------------------------------------------------------------------------ */

typedef struct {
    int status[N_SLOTS];
    double value[N_SLOTS];
} reading;

/* A call; the callback of a step makes calls within a call. */
typedef struct {
    host *h;
    const char *function;
    int goes_to_null;
    double time;
    int is_compared;
    reading before, other_before;
    host *other;
} frame;

static frame frames[DEEPEST];
static int depth;
static const char *last_function;

void require(int holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "violated: %s\n  %s %s; again with: fuzz %s\n", what, depth ? "in" : "after",
            last_function ? last_function : "the beginning", sequence);
    if (++violations == MOST_VIOLATIONS)
        exit(1);
}

void *unit(host *h)
{
    if (!chance(0.005))
        return h->unit;
    frames[depth - 1].goes_to_null = 1;
    return NULL;
}

/* ---- reading behind the back of the sequence ------------------------------------------------------------------ */

static int get(host *h, uint32_t reference, double *values, size_t n)
{
    h->is_peeking++;
    int status = h->version == 2 ? (int)fmi2GetReal(h->unit, &reference, 1, values)
                                 : (int)fmi3GetFloat64(h->unit, &reference, 1, values, n);
    h->is_peeking--;
    return status;
}

double time_of(host *h)
{
    double time = NAN;
    int status = get(h, h->version == 2 ? TIME : VARIABLE_OF_SLOT[TIME], &time, 1);
    require(status == OK && isfinite(time), "the time can always be read");
    return time;
}

static void read_everything(host *h, reading *r)
{
    memset(r, 0, sizeof *r);
    for (uint32_t row = 0; row < N_VARIABLES; row++) {
        const variable *v = &VARIABLES[row];
        if (h->version == 3)
            r->status[v->first] = get(h, row, r->value + v->first, (size_t)v->size);
        else
            for (int slot = v->first; slot < v->first + v->size; slot++)
                r->status[slot] = get(h, (uint32_t)slot, r->value + slot, 1);
    }
}

/* The status of every variable is the same, and where it is OK the bits are. */
static int are_equal(const host *h, const reading *a, const reading *b)
{
    if (memcmp(a->status, b->status, sizeof a->status) != 0)
        return 0;
    for (int row = 0; row < N_VARIABLES; row++) {
        const variable *v = &VARIABLES[row];
        for (int slot = v->first; slot < v->first + v->size; slot++) {
            int status = a->status[h->version == 3 ? v->first : slot];
            if (status == OK && memcmp(&a->value[slot], &b->value[slot], sizeof(double)) != 0) {
                if (traces)
                    fprintf(stderr, "  slot %d: %.17g, now %.17g\n", slot, a->value[slot], b->value[slot]);
                return 0;
            }
        }
    }
    return 1;
}

/* ---- what the standards say of a function --------------------------------------------------------------------- */

/* A call that succeeds elsewhere than in these modes is a violation. `next` is the mode afterwards, 0 the same. */
static const struct {
    const char *name; /* behind fmi2 or fmi3 */
    int modes;
    int next;
} RULES[] = {
    {"EnterInitializationMode", INSTANTIATED, INITIALIZATION},
    {"ExitInitializationMode", INITIALIZATION, EVENT | STEP}, /* by kind */
    {"EnterEventMode", CONTINUOUS, EVENT},
    {"EnterContinuousTimeMode", EVENT, CONTINUOUS},
    {"Terminate", EVENT | CONTINUOUS | STEP, TERMINATED},
    {"Reset", BETWEEN_CALLS, INSTANTIATED},
    {"SetupExperiment", INSTANTIATED, 0},
    {"NewDiscreteStates", EVENT, 0},
    {"UpdateDiscreteStates", EVENT, 0},
    {"EvaluateDiscreteStates", INITIALIZATION | EVENT, 0},
    {"CompletedIntegratorStep", CONTINUOUS, 0},
    {"SetTime", EVENT | CONTINUOUS, 0},
    {"SetContinuousStates", CONTINUOUS, 0},
    {"DoStep", STEP, 0},
    {"SetReal", ANY_MODE & ~TERMINATED, 0},
    {"SetFloat64", ANY_MODE & ~TERMINATED, 0},
    {"SetRealInputDerivatives", BEFORE_START | STEP, 0},
    {"GetRealOutputDerivatives", STEP | TERMINATED, 0},
    {"GetOutputDerivatives", STEP | INTERMEDIATE | TERMINATED, 0},
    {"GetFMUstate", BETWEEN_CALLS, 0},
    {"GetFMUState", BETWEEN_CALLS, 0},
    {"SetFMUstate", BETWEEN_CALLS, 0}, /* the action sets the mode */
    {"SetFMUState", BETWEEN_CALLS, 0},
    {"SetDebugLogging", BETWEEN_CALLS, 0},
    /* what the unit has not */
    {"CancelStep", NEVER, 0},
    {"EnterStepMode", NEVER, 0},
    {"EnterConfigurationMode", NEVER, 0},
    {"ExitConfigurationMode", NEVER, 0},
    {"ActivateModelPartition", NEVER, 0},
};

static void follow_mode(host *h, const char *name)
{
    for (size_t k = 0; k < sizeof RULES / sizeof RULES[0]; k++)
        if (strcmp(RULES[k].name, name) == 0) {
            require(RULES[k].modes & (int)h->mode, "a call succeeds only where the standard allows it");
            if (RULES[k].next == (EVENT | STEP))
                h->mode = h->kind == MODEL_EXCHANGE ? EVENT : STEP;
            else if (RULES[k].next)
                h->mode = (fmi_mode)RULES[k].next;
        }
}

/* Where FMI 2.0 has Discard (2.1.3). */
static const struct {
    const char *name;
    int kinds;
} DISCARDS_OF_FMI2[] = {
    {"SetReal", BOTH},
    {"SetContinuousStates", MODEL_EXCHANGE},
    {"GetReal", MODEL_EXCHANGE},
    {"GetDerivatives", MODEL_EXCHANGE},
    {"GetContinuousStates", MODEL_EXCHANGE},
    {"DoStep", CO_SIMULATION},
    {"GetStatus", CO_SIMULATION},
    {"GetRealStatus", CO_SIMULATION},
    {"GetIntegerStatus", CO_SIMULATION},
    {"GetBooleanStatus", CO_SIMULATION},
    {"GetStringStatus", CO_SIMULATION},
};

static int may_discard(const host *h, const char *name)
{
    for (size_t k = 0; k < sizeof DISCARDS_OF_FMI2 / sizeof DISCARDS_OF_FMI2[0]; k++)
        if (strcmp(DISCARDS_OF_FMI2[k].name, name) == 0)
            return DISCARDS_OF_FMI2[k].kinds & (int)h->kind;
    return 0;
}

static int is_one_of(const char *name, const char *const names[])
{
    while (*names && strcmp(*names, name) != 0)
        names++;
    return *names != NULL;
}

static int only_reads(const char *name)
{
    static const char *const starts[] = {"Get", "Serialize", "DeSerialize", "Deserialize", "Free"};
    for (size_t k = 0; k < sizeof starts / sizeof starts[0]; k++)
        if (strncmp(name, starts[k], strlen(starts[k])) == 0)
            return 1;
    return 0;
}

/* ---- before and after ----------------------------------------------------------------------------------------- */

void call_begins(host *h, const char *function)
{
    if (depth == DEEPEST)
        abort();
    frame *f = &frames[depth];
    f->h = h;
    f->function = last_function = function;
    f->goes_to_null = 0;
    f->time = time_of(h);
    f->is_compared = chance(0.2);
    f->other = NULL;
    if (f->is_compared) {
        read_everything(h, &f->before);
        size_t alive = 0;
        while (others[alive])
            alive++;
        f->other = others[below(alive)];
        if (f->other == h || depth > 0) /* one in whose step this is called has left the point of its last reading */
            f->other = NULL;
        else
            read_everything(f->other, &f->other_before);
    }
    h->messages = 0;
    depth++;
    if (traces)
        fprintf(stderr, "%s%*s%s (%s, mode %d, time %.17g)", depth > 1 ? "\n" : "", 2 * depth, "", function, h->name,
                (int)h->mode, f->time);
}

static void check_messages(const frame *f, int status, const char *name)
{
    const host *h = f->h;
    if (f->goes_to_null || h->messages == 0) {
        require(f->goes_to_null || !h->has_logger || status != ERROR, "an error is logged, whatever is switched on");
        require(f->goes_to_null || h->logging != ALL_CATEGORIES || status == OK,
                "a call that fails says why, if all categories are on");
    } else if (strcmp(name, "DoStep") != 0) { /* whose callback has made calls of its own */
        require(status != OK || strcmp(name, "CompletedIntegratorStep") == 0,
                "a call that succeeds says nothing, unless it asks for the end");
        require(h->last_message_status == status, "the message has the status of the call");
    }
}

static void check_time(const frame *f, int status, const char *name)
{
    static const char *const movers[] = {"SetTime",     "SetupExperiment", "EnterInitializationMode", "Reset",
                                         "SetFMUstate", "SetFMUState",     "DoStep",                  NULL};
    double now = time_of(f->h);
    if (status == OK && !f->goes_to_null && is_one_of(name, movers)) {
        if (strcmp(name, "DoStep") == 0)
            require(now > f->time, "a step moves the time on");
    } else {
        require(now == f->time, "time goes on in steps, and else is only set, reset or restored");
    }
    f->h->time = now;
}

int call_ends(int status)
{
    frame *f = &frames[depth - 1];
    host *h = f->h;
    const char *name = f->function + strlen("fmi2");
    if (traces)
        fprintf(stderr, " -> %d\n", status);
    require(status >= OK && status <= FATAL, "the status is one of the enumeration, and no step is pending");
    require(status != FATAL, "nothing here is fatal");
    require(status != DISCARD || h->version == 3 || may_discard(h, name), "FMI 2.0 has Discard for this function");
    count_call(f->function, status >= OK && status <= FATAL ? status : FATAL);
    require(!f->goes_to_null || status == ERROR, "no call succeeds on a null pointer for an instance");
    check_messages(f, status, name);
    check_time(f, status, name);
    if (status == OK && !f->goes_to_null)
        follow_mode(h, name);
    if (f->is_compared) {
        reading now;
        if (status != OK || only_reads(name)) {
            read_everything(h, &now);
            require(are_equal(h, &f->before, &now), only_reads(name) ? "a call that reads changes no variable"
                                                                     : "a call that fails changes no variable");
        }
        if (f->other) {
            read_everything(f->other, &now);
            require(are_equal(f->other, &f->other_before, &now), "a call changes no other instance");
        }
    }
    last_function = f->function;
    depth--;
    return status;
}

/* ---- messages ------------------------------------------------------------------------------------------------- */

static void check_message(host *h, int status, const char *category, const char *message)
{
    static const char *const categories[] = {"logStatusWarning", "logStatusDiscard", "logStatusError", NULL};
    require(h != NULL, "the logger gets the importer's environment");
    require(status >= OK && status <= ERROR, "the message has a status");
    require(category && is_one_of(category, categories), "the category is one of the description");
    require(message && message[0], "the message is not empty");
    require(message && !strchr(message, '%'), "the message is no format");
    if (traces && message && !h->is_peeking)
        fprintf(stderr, " '%s'", message);
    if (h->is_peeking)
        return;
    require(h->logging != SILENT || status == ERROR, "nothing but errors is logged when logging is off");
    h->messages++;
    h->last_message_status = status;
}

void logger_of_fmi2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String message, ...)
{
    host *h = environment;
    require(name && strcmp(name, h->name) == 0, "the logger gets the instance's name");
    check_message(h, (int)status, category, message);
}

void logger_of_fmi3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    check_message(environment, (int)status, category, message);
}

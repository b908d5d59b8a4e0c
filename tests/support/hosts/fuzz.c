/* Random sequences of calls, legal and illegal, of all functions of FMI 2.0 and 3.0 on several instances at once.

   Usage: fuzz SEED SEQUENCES [FIRST]. Prints how often every function returned what, as JSON, and ends with 1 if
   something that has to hold did not. With FIRST, begins at that sequence and prints every call. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

enum { MOST_HOSTS = 3, SHORTEST_SEQUENCE = 10, LONGEST_SEQUENCE = 70 };

static size_t length_of(const entry actions[])
{
    size_t n = 0;
    while (actions[n].action)
        n++;
    return n;
}

/* One of the version's or of the common actions; mostly one that makes sense now. */
static action any_action(const host *h)
{
    const entry *own = h->version == 2 ? FMI2_ACTIONS : FMI3_ACTIONS;
    size_t n_own = length_of(own), n = n_own + length_of(COMMON_ACTIONS);
    int sensible = chance(0.85);
    for (;;) {
        size_t k = below(n);
        const entry *e = k < n_own ? &own[k] : &COMMON_ACTIONS[k - n_own];
        if (!sensible || (e->modes & (unsigned)h->mode))
            return e->action;
    }
}

static action any_saved_state_action(void)
{
    size_t n = 0;
    while (SAVED_STATE_ACTIONS[n])
        n++;
    return SAVED_STATE_ACTIONS[below(n)];
}

/* Also what is illegal there: steps, resets, saved states. An instance is never freed there, which only the
   importer can prevent. */
void act_in_callback(host *h)
{
    perform(chance(0.1) ? any_saved_state_action() : any_action(h), h);
}

static void begin(host *h)
{
    *h = (host){.version = chance(0.5) ? 2 : 3,
                .kind = chance(N_STATES > 0 ? 0.3 : 0.02) ? MODEL_EXCHANGE : CO_SIMULATION, .name = ""};
    h->mode = INSTANTIATED;
}

static void instantiate(host *h)
{
    h->unit = h->version == 2 ? instantiate_fmi2(h) : instantiate_fmi3(h);
    if (h->unit && h->name[0] != '1')
        h->name = "plant"; /* not what lay in memory of the action */
}

static void end(host *h)
{
    if (h->version == 2)
        fmi2FreeInstance(h->unit);
    else
        fmi3FreeInstance(h->unit);
    count_call(h->version == 2 ? "fmi2FreeInstance" : "fmi3FreeInstance", OK);
}

static void run_sequence(void)
{
    host hosts[MOST_HOSTS];
    size_t n = 0, wanted = 1 + below(MOST_HOSTS);
    while (n < wanted) {
        begin(&hosts[n]);
        perform(instantiate, &hosts[n]);
        if (hosts[n].unit) {
            others[n] = &hosts[n];
            n++;
        } else {
            end(&hosts[n]); /* of a null pointer: nothing */
        }
    }
    others[n] = NULL;
    for (size_t calls = SHORTEST_SEQUENCE + below(LONGEST_SEQUENCE - SHORTEST_SEQUENCE); calls > 0; calls--) {
        host *h = &hosts[below(n)];
        perform(chance(0.15) ? any_saved_state_action() : any_action(h), h);
    }
    forget_saved_states(&hosts[0]);
    for (size_t k = 0; k < n; k++)
        end(&hosts[k]);
    others[0] = NULL;
}

int main(int argc, char **argv)
{
    if (argc < 3) {
        fprintf(stderr, "usage: fuzz SEED SEQUENCES [FIRST]\n");
        return 2;
    }
    uint64_t seed = strtoull(argv[1], NULL, 10);
    long n = atol(argv[2]), first = argc > 3 ? atol(argv[3]) : 0;
    traces = argc > 3;
    for (long k = first; k < first + n; k++) {
        char again[80];
        snprintf(again, sizeof again, "%s 1 %ld", argv[1], k);
        sequence = again;
        seed_random(seed, (uint64_t)k);
        run_sequence();
    }
    print_tallies(n);
    return violations != 0;
}

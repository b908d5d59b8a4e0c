/* A sampled controller as a component: shared declarations. The controller itself is generated plain C,
   controller.h and controller.c; controller_table.h has the slots of its variables.

   The controller is called at start_time + k sample_time / STEPS_A_SAMPLE; a step is a sample, unless it carries drives
   or sensors of its machine, with shorter steps. The inputs of a step determine the forces from output_delay samples
   later on, independent of the communication steps: output_delay is at least 1, so outputs have no direct feedthrough.
   A step at a communication point belongs to the communication step that begins there, after the importer has set the
   inputs.

   sampled_step.c is a unit that takes these steps by itself, within communication steps; clocked.c is one whose steps are
   ticks of a clock, where output_delay may be 0. */
#ifndef SAMPLED_H
#define SAMPLED_H

#include "component.h"
#include "controller.h"
#include "controller_table.h"
#include "internal.h"
#include "message.h"
#include "model.h"

#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)
/* The outputs that wait in the delay line: actuator_force, force_limited, and rate_limited if there is one. */
#define N_DELAYED (HAS_RATE_LIMITED ? 18 : 12)
/* Without delay, the outputs of a step act before those of the oldest are read. */
#define N_PLANNED (MOST_OUTPUT_DELAY * STEPS_A_SAMPLE + (LEAST_OUTPUT_DELAY == 0))

/* The complete state. It has doubles only, since a saved state is a copy of them in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double inputs[AT_LEAST_ONE(N_INPUTS)];
    double input_rates[AT_LEAST_ONE(N_INPUTS)]; /* du/dt from the current time on */
    double output_delay;                        /* samples from the inputs to the outputs */
    double acting[N_DELAYED];                   /* the outputs since the last step */
    double planned[N_PLANNED][N_DELAYED];       /* the outputs of step k at k modulo N_PLANNED */
#if HAS_CLOCK
    double is_ticking;
#endif
    double input_status;                        /* of the last step but the one that is due, like the forces */
    double input_bad_time;
    controller_memory memory;                   /* with the number of steps taken, `samples` */
    controller_parameters p;
} controller_state;

_Static_assert(sizeof(controller_parameters) == N_PARAMETERS * sizeof(double), "the table has the controller's parameters");
_Static_assert(sizeof(controller_memory) % sizeof(double) == 0, "the memory is a vector of doubles");

struct component {
    controller_state s;
    /* derived from the parameters */
    int is_prepared;
    controller_coefficients coefficients;
#if HAS_CLOCK
    /* results of a tick, until something changes that they depend on */
    int is_evaluated;
    double tick[N_DELAYED];
    controller_memory after_tick;
#endif
    char message[MESSAGE_SIZE];
};

#if HAS_CLOCK
#define FORGET_TICK(c) ((c)->is_evaluated = 0)
#define IS_POSSIBLE_TICK(s) ((s).is_ticking == 0 || (s).is_ticking == 1)
#else
#define FORGET_TICK(c) ((void)(c))
#define IS_POSSIBLE_TICK(s) 1
#endif

INTERNAL_BEGIN
/* Time from step to step of the controller. */
double step_period(const component *c);
/* Time of its next step. */
double next_step(const component *c);
/* Tolerance for the accumulated rounding of an importer's clock. */
double clock_slack(const component *c, double time);
/* Whether the steps can be resolved up to this time. */
outcome check_resolution(component *c, double end);
/* One step with the present inputs: its outputs, and the memory after it, which is undefined after a failure. */
outcome take_step(component *c, controller_memory *memory, double outputs[N_DELAYED]);
/* The outputs that a step determines; steps count from 0. */
double *planned_at(component *c, double step);
/* An output while the clock is active. */
outcome get_at_tick(component *c, int slot, double *value);
INTERNAL_END

#endif

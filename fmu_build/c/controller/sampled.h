/* A sampled controller as a component: shared declarations. The controller itself is generated plain C,
   controller.h and controller.c; controller_table.h has the slots of its variables.

   The controller is called at start_time + k sample_time / STEPS_A_SAMPLE; a step is a sample, unless it carries drives
   or sensors of its machine, with shorter steps. The inputs of a step determine the forces from output_delay samples
   later on, independent of the communication steps: output_delay is at least 1, so outputs have no direct feedthrough.
   A step at a communication point belongs to the communication step that begins there, after the importer has set the
   inputs. */
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
#define MOST_STEPS_LATE (MOST_OUTPUT_DELAY * STEPS_A_SAMPLE)

/* The complete state. It has doubles only, since a saved state is a copy of them in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double inputs[AT_LEAST_ONE(N_INPUTS)];
    double input_rates[AT_LEAST_ONE(N_INPUTS)]; /* du/dt from the current time on */
    double output_delay;                        /* samples from the inputs to the outputs, 1 to MOST_OUTPUT_DELAY */
    double acting[N_DELAYED];                   /* the outputs since the last step */
    double planned[MOST_STEPS_LATE][N_DELAYED]; /* the outputs of step k at k modulo MOST_STEPS_LATE */
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
    char message[MESSAGE_SIZE];
};

#endif

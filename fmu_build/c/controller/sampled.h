/* A sampled controller as a component: what the files of this room share. The controller itself is generated plain C,
   controller.h and controller.c; controller_table.h says where its variables are.

   Samples are due at start_time + k sample_time. What is read there decides the forces from sample k + 1 on, whatever
   the communication steps are: no output depends on the inputs of its time. A sample at a communication point belongs
   to the step that begins there, when the importer has set the inputs. */
#ifndef SAMPLED_H
#define SAMPLED_H

#include "component.h"
#include "controller.h"
#include "controller_table.h"
#include "internal.h"
#include "message.h"
#include "model.h"

#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)

/* All that the future depends on. Doubles only: a saved state is these, in this order. */
typedef struct {
    double time;
    double start_time;
    double stop_time; /* infinite if there is none */
    double inputs[AT_LEAST_ONE(N_INPUTS)];
    double input_rates[AT_LEAST_ONE(N_INPUTS)]; /* du/dt from the present time on */
    double acting[N_RESULTS];                   /* the outputs from the last sample on */
    double planned[N_RESULTS];                  /* those from the next one on */
    controller_memory memory;                   /* with the number of samples taken */
    controller_parameters p;
} controller_state;

_Static_assert(sizeof(controller_parameters) == N_PARAMETERS * sizeof(double), "the table has the controller's parameters");
_Static_assert(sizeof(controller_memory) % sizeof(double) == 0, "the memory is a vector of doubles");

struct component {
    controller_state s;
    /* what follows from the parameters */
    int is_prepared;
    controller_coefficients coefficients;
    char message[MESSAGE_SIZE];
};

#endif

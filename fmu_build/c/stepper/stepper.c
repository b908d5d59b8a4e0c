/* The plant as a stepper in a host's process: communication steps of the unit, on memory that the host owns.

   A component is plain data, so the host makes it, reads it and changes it in place: time, inputs, states and parameters
   where `stepper_layout` says. One component may be stepped by one thread at a time. */
#define WIDTH 1
#include "kernel.h"
#include "plant.h"
#include "vectors.h"

/* Bytes of a component, then the offsets in bytes of what a host reads and writes, in the order of
   gough_stewart.model.stepping. */
OFFERED void stepper_layout(size_t layout[])
{
    const size_t places[] = {
        sizeof(component),
        offsetof(component, s.time),
        offsetof(component, s.internal_step),
        offsetof(component, s.handedness),
        offsetof(component, s.largest_step),
        offsetof(component, s.inputs),
        offsetof(component, s.x),
        offsetof(component, s.p),
        offsetof(component, results),
        offsetof(component, failure.time),
        offsetof(component, failure.value),
        offsetof(component, failure.quantity),
        offsetof(component, failure.reason),
    };
    memcpy(layout, places, sizeof places);
}

/* A component at time 0 with zeros for inputs, states and parameters. */
OFFERED void stepper_reset(component *c, double tolerance, double fixed_step_size)
{
    component_reset(c);
    c->s.tolerance = tolerance;
    c->s.fixed_step_size = fixed_step_size;
}

/* To be called after parameters, states or the time have been written; handedness 0 asks for a check of the pose. */
OFFERED void stepper_forget(component *c)
{
    component_forget(c);
    c->s.handedness = 0;
}

/* A communication step from the component's time, also after inputs have been written. 1, or 0 and the failure, which
   leaves the component as it was. */
OFFERED int stepper_step(component *c, double time, double step)
{
    double reached;
    c->has_xdot = c->has_results = c->has_legs = 0;
    c->failure.quantity[0] = 0;
    if ((c->s.handedness != 0 || check_pose(c, &c->s.handedness) == DONE) &&
        component_step(c, time, step, NULL, &reached) == DONE)
        return 1;
    if (!c->failure.quantity[0]) /* of a check that the host was expected to have made */
        refuse_step(c, "step", step, " s", "%s", c->message);
    return 0;
}

/* Outputs and locals under the component's inputs, in the order of a unit. */
OFFERED void stepper_results(component *c)
{
    kernel_outputs(c->s.x, c->s.inputs, c->s.p, c->results);
}

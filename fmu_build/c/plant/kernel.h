/* The equations, generated from the Python source of the physics (kernel.c). Vectors are in the order of model.h:
   states x, inputs u, parameters p and results y, whose first N_STATES elements are the states. */
#ifndef KERNEL_H
#define KERNEL_H

#include "internal.h"
#include "model.h"
#include "plant_table.h"

INTERNAL_BEGIN
/* dx/dt */
void kernel_derivatives(const double x[], const double u[], const double p[], double xdot[]);
/* outputs and locals */
void kernel_outputs(const double x[], const double u[], const double p[], double y[]);
/* change of (xdot, y) when (x, u, p) change by (dx, du, dp) */
void kernel_forward(const double x[], const double u[], const double p[], const double dx[], const double du[],
                    const double dp[], double dxdot[], double dy[]);
/* gradient of wxdot.xdot + wy.y with respect to (x, u, p) */
void kernel_reverse(const double x[], const double u[], const double p[], const double wxdot[], const double wy[],
                    double gx[], double gu[], double gp[]);
/* leg lengths and rates, Jacobian with angles scaled by rho (6 rows of 6), rho */
void kernel_legs(const double x[], const double p[], double length[], double length_rate[], double jacobian[],
                 double rho[]);
#if HAS_BRISTLES
/* rates d [1/s] at which the bristles forget: dz/dt = v - d z */
void kernel_decays(const double x[], const double p[], double decay[]);
/* the same rates d; the gain [1/s], column by column: gain dz/dt is taken from the accelerations, of motors if legs yield,
   else of the platform; so is gain (ratio z), with the ratio [1/s] of stiffness and damping; z in fast sliding [m]; v */
void kernel_grip(const double x[], const double p[], double decay[], double gain[], double ratio[], double reach[],
                 double sliding[]);
/* the velocities v [m/s] at which friction acts */
void kernel_sliding(const double x[], const double p[], double sliding[]);
#endif
INTERNAL_END

#endif

#include "variable.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model.h"

#define TEXT(x) #x
#define TEXT_OF(macro) TEXT(macro)

const variable *variable_of(int slot) { return &VARIABLES[VARIABLE_OF_SLOT[slot]]; }

void write_slot_name(int slot, char name[NAME_SIZE])
{
    const variable *v = variable_of(slot);
    int k = slot - v->first;
    if (v->columns)
        snprintf(name, NAME_SIZE, "%s[%d,%d]", v->name, k / v->columns + 1, k % v->columns + 1);
    else if (v->role == DERIVATIVE) /* der(state[k]) */
        snprintf(name, NAME_SIZE, "%.*s[%d])", (int)strlen(v->name) - 1, v->name, k + 1);
    else if (v->size > 1)
        snprintf(name, NAME_SIZE, "%s[%d]", v->name, k + 1);
    else
        snprintf(name, NAME_SIZE, "%s", v->name);
}

const char *expected_of_slot(int slot, double value)
{
    variable_range range = variable_of(slot)->range;
    if (!isfinite(value))
        return "a finite number";
    if (fabs(value) > LARGEST_NUMBER)
        return "a number below " TEXT_OF(LARGEST_NUMBER) " in SI units";
    if (range == POSITIVE && !(value > 0))
        return "a value > 0";
    if (range == NOT_NEGATIVE && !(value >= 0))
        return "a value >= 0";
    return NULL;
}

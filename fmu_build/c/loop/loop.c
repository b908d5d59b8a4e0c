#include "loop.h"

/* no fused operations, so that the loop has the bits of NumPy's */
#ifdef __clang__
#pragma clang fp contract(off) reciprocal(off)
#endif

#include "components.h"
#include "noise.h"

/* Rows that folds get at once: they stay in the cache. */
#define CHUNK 8

/* The members of one vector. */
typedef struct {
    group plant;
    const loop *loop;
    int64_t first, stride;        /* its place among the members, and theirs in memory */
    int live;                     /* members in it */
    lanes (*chunk)[ROW_ELEMENTS]; /* the row before the chunk, then those of it */
    int64_t taken;                /* rows of the chunk so far */
} vector;

static lanes value_at(const vector *v, const table *t, int64_t row, int64_t element)
{
    const double *from = t->at + row * t->row + element * t->element;
    if (!t->member)
        return (lanes)*from;
    if (v->live == WIDTH)
        return get(from + v->first);
    lanes x = (lanes)from[v->first];
    for (int lane = 1; lane < v->live; lane++)
        LANE(x, lane) = from[v->first + lane];
    return x;
}

/* Some elements of a row. */
static void read_row(const vector *v, const table *t, int64_t row, int64_t first, int n, lanes x[])
{
    for (int k = 0; k < n; k++)
        x[k] = value_at(v, t, row, first + k);
}

static lanes remembered(const vector *v, const double *memory, int64_t element)
{
    return get(memory + element * v->stride + v->first);
}

static void remember(const vector *v, double *memory, int64_t element, lanes x)
{
    put(memory + element * v->stride + v->first, x);
}

static void recall(const vector *v, const double *memory, int n, lanes x[])
{
    for (int i = 0; i < n; i++)
        x[i] = remembered(v, memory, i);
}

/* Where a mask holds. */
static void keep(const vector *v, double *memory, int n, const lanes x[], mask where)
{
    for (int i = 0; i < n; i++)
        remember(v, memory, i, choose(where, x[i], remembered(v, memory, i)));
}

static mask everyone_of(const vector *v) { return v->plant.running | ~v->plant.running; }

/* An element of a row of members, if there is a place for it. */
static void write_number(const vector *v, const rows_out *to, int64_t row, int64_t element, lanes x, mask where)
{
    if (!to->at)
        return;
    double *place = (double *)to->at + row * to->row + element * to->element + v->first;
    if (v->live == WIDTH && !any(~where))
        put(place, x);
    else
        for (int lane = 0; lane < v->live; lane++)
            if (HOLDS(where, lane))
                place[lane] = LANE(x, lane);
}

static void write_numbers(const vector *v, const rows_out *to, int64_t row, int n, const lanes x[], mask where)
{
    for (int i = 0; i < n; i++)
        write_number(v, to, row, i, x[i], where);
}

static void write_flags(const vector *v, const rows_out *to, int64_t row, int n, const lanes x[], mask where)
{
    for (int i = 0; to->at && i < n; i++) {
        uint8_t *place = (uint8_t *)to->at + row * to->row + i * to->element + v->first;
        mask is_set = x[i] != 0;
        for (int lane = 0; lane < v->live; lane++)
            if (HOLDS(where, lane))
                place[lane] = HOLDS(is_set, lane) & 1;
    }
}

/* Ends members at a row: it is their last one. */
static void end(vector *v, mask which, int64_t failure, int64_t row)
{
    if (!any(which))
        return;
    for (int lane = 0; lane < v->live; lane++)
        if (HOLDS(which, lane) && HOLDS(v->plant.running, lane)) {
            v->plant.members->failure[v->first + lane] = failure;
            v->loop->ended[v->first + lane] = row;
            LANE(v->plant.running, lane) = 0;
        }
}

/* The noise (24) of a reading, where there is one. */
static void draw_noise(const vector *v, int64_t reading, lanes noise[])
{
    const loop *l = v->loop;
    words stream[4];
    for (int i = 0; l->n_noisy && i < 4; i++)
        stream[i] = (words)*(const mask_anywhere *)(l->streams + i * v->stride + v->first);
    for (int64_t k = 0; k < l->n_noisy; k++) {
        lanes deviation = value_at(v, &l->deviations, 0, k);
        int64_t first = l->noisy[2 * k], n = l->noisy[2 * k + 1];
        normals(stream, reading, first, n, noise + first);
        for (int64_t i = first; i < first + n; i++)
            noise[i] = noise[i] * deviation;
    }
}

enum { SENSES = 1, AT_MOTOR = 2 };

/* Readings of the members whose sample it is; those of frozen sensors stay. */
static void read_sensors(const vector *v, int64_t reading, int64_t n, const int64_t *used, mask whose)
{
    const loop *l = v->loop;
    lanes noise[N_SIGNALS] = {(lanes)0.0};
    draw_noise(v, reading, noise);
    for (int64_t i = 0; i < n; i++) {
        int64_t element = used[i];
        lanes now = remembered(v, l->signals, element);
#if HAS_SPRINGS
        if (l->senses[element] & AT_MOTOR)
            now = v->plant.x[X_MOTOR_POSITION + element - FIRST_LENGTH]; /* the velocities follow */
#endif
        if (l->senses[element] & SENSES) {
            lanes c[SENSOR_COEFFICIENTS];
            read_row(v, &l->sensors, 0, element * SENSOR_COEFFICIENTS, SENSOR_COEFFICIENTS, c);
            component_sensor(c, &now, &noise[element], &now);
        }
        if (l->frozen) {
            lanes last = remembered(v, l->held, element), frozen = remembered(v, l->frozen, element), reading;
            component_freeze(&now, &last, &frozen, &reading);
            keep(v, l->held + element * v->stride, 1, &reading, whose);
            now = reading;
        }
        remember(v, l->measured, element, now);
    }
}

/* y = M x of a matrix (6, 6) by rows, or of its transpose. */
static void times(const vector *v, const table *matrix, int64_t sample, int transposed, const lanes x[], lanes y[])
{
    for (int i = 0; i < N_LEGS; i++) {
        y[i] = (lanes)0.0;
        for (int j = 0; j < N_LEGS; j++)
            y[i] += value_at(v, matrix, sample, transposed ? N_LEGS * j + i : N_LEGS * i + j) * x[j];
    }
}

/* Those of some members whose controller is off. */
static mask those_off(const vector *v, mask due)
{
    return v->loop->off ? due & (remembered(v, v->loop->off, 0) > 0) : due & 0;
}

/* The parts of u, in task space of displacements, which begin anew while it is off: see harness/control/laws_of_members.py. */
static void feed(vector *v, int64_t sample, mask due, mask off)
{
    const loop *l = v->loop;
    lanes beyond[N_LEGS], excess[N_LEGS], step[N_LEGS], now[N_LEGS], ahead[N_LEGS], length[N_LEGS];
    recall(v, l->excess, N_LEGS, beyond);
    memcpy(excess, beyond, sizeof excess);
    int in_task_space = l->inverse.at != 0;
    if (in_task_space) {
        for (int i = 0; i < N_LEGS; i++) {
            length[i] = remembered(v, l->measured, l->used[i]);
            step[i] = length[i] - choose(off, length[i], remembered(v, l->lengths, i));
        }
        times(v, &l->inverse, sample, 0, step, now);
        for (int i = 0; i < N_LEGS; i++) {
            now[i] += choose(off, (lanes)0.0, remembered(v, l->pose, i));
            step[i] = value_at(v, &l->reference, sample * l->every, l->used[i]) - length[i];
        }
        times(v, &l->inverse, sample, 0, step, ahead);
        if (l->kinds == 3)
            times(v, &l->jacobian, sample, 1, beyond, excess);
        keep(v, l->pose, N_LEGS, now, due);
        keep(v, l->lengths, N_LEGS, length, due);
    }
    for (int64_t i = 0; i < l->size; i++) {
        lanes r = in_task_space ? now[i] + ahead[i] : value_at(v, &l->reference, sample * l->every, l->used[i]);
        lanes y = in_task_space ? now[i] : remembered(v, l->measured, l->used[i]);
        if (!in_task_space && !l->law && l->used[i] >= FIRST_ANGLE && l->used[i] < N_POSE)
            component_nearest_angle(&y, &r, &y); /* in the turns of its reference */
        remember(v, l->memory, l->n_states + i, l->kinds == 1 ? r - y : r);
        if (l->kinds > 1)
            remember(v, l->memory, l->n_states + l->size + i, y);
    }
    for (int i = 0; l->kinds == 3 && i < N_LEGS; i++)
        remember(v, l->memory, l->n_states + 2 * l->size + i, excess[i]);
}

/* The first rows of y = M (x, u), element by element. */
static void multiply(const vector *v, int64_t rows, int64_t entries, const int64_t *row, const int64_t *column,
                     const table *values)
{
    const loop *l = v->loop;
    for (int64_t i = 0; i < rows; i++)
        remember(v, l->next, i, (lanes)0.0);
    for (int64_t k = 0; k < entries; k++) {
        lanes term = value_at(v, values, 0, k) * remembered(v, l->memory, column[k]);
        remember(v, l->next, row[k], remembered(v, l->next, row[k]) + term);
    }
}

/* The controller's forces; x goes on where a sample is due and it is on. */
static void control(vector *v, int64_t sample, mask due, lanes force[])
{
    const loop *l = v->loop;
    mask off = those_off(v, due);
    lanes output[N_LEGS];
    if (l->kinds == ASKED) {
        recall(v, l->next, N_LEGS, force);
        return;
    }
    feed(v, sample, due, off);
    for (int64_t i = 0; i < l->n_states; i++)
        write_number(v, &l->sample_state, sample, i, remembered(v, l->memory, i), due);
    if (l->law) { /* it gets the time of the sample and the reference's accelerations besides references and readings */
        int64_t row = sample * l->every, next = l->n_states + 2 * l->size;
        remember(v, l->memory, next, (lanes)((double)row * l->plant_step));
        for (int i = 0; i < N_ACCELERATIONS; i++)
            remember(v, l->memory, next + 1 + i, value_at(v, &l->reference, row, N_SIGNALS + i));
        l->law(l->memory + v->first, l->next + v->first, v->stride);
    } else {
        if (any(off)) { /* x = R u */
            multiply(v, l->n_states, l->rest_entries, l->rest_row, l->rest_column, &l->rests);
            for (int64_t i = 0; i < l->n_states; i++)
                remember(v, l->memory, i, choose(off, remembered(v, l->next, i), remembered(v, l->memory, i)));
        }
        multiply(v, N_LEGS + l->n_states, l->entries, l->entry_row, l->entry_column, &l->values);
    }
    for (int64_t i = 0; i < l->n_states; i++) {
        lanes next = remembered(v, l->next, N_LEGS + i);
        remember(v, l->memory, i, choose(due & ~off, next, remembered(v, l->memory, i)));
    }
    recall(v, l->next, N_LEGS, output);
    memcpy(force, output, sizeof output);
    if (l->inverse.at)
        times(v, &l->inverse, sample, 1, output, force);
}

/* The forces that reach the drives at a sample: those allowed some samples ago, each member's number of them. */
static void hold(const vector *v, int64_t sample, const lanes allowed[], mask due)
{
    const loop *l = v->loop;
    int64_t slots = l->most_delay + 1;
    lanes late = value_at(v, &l->delay, 0, 0);
    keep(v, l->delayed + sample % slots * N_LEGS * v->stride, N_LEGS, allowed, due);
    for (int64_t d = 0; d < slots; d++) {
        mask which = due & (late == (double)d);
        lanes ready[N_LEGS];
        if (!any(which))
            continue;
        recall(v, l->delayed + (sample + slots - d) % slots * N_LEGS * v->stride, N_LEGS, ready);
        keep(v, l->target, N_LEGS, ready, which);
    }
}

static void sample_at(vector *v, int64_t row, int64_t sample, mask due)
{
    const loop *l = v->loop;
    lanes command[N_LEGS], allowed[N_LEGS], is_cut[N_LEGS], excess[N_LEGS], measured[N_SIGNALS], force[N_LEGS];
    lanes most = (lanes)0.0, nothing = (lanes)0.0;
    if (l->kinds)
        control(v, sample, due, force);
    for (int i = 0; i < N_LEGS; i++) {
        command[i] = value_at(v, &l->feedforward, sample, i);
        if (l->injection.at)
            command[i] += value_at(v, &l->injection, sample, i);
        if (l->kinds)
            command[i] += force[i];
    }
    if (l->off) {
        lanes c[TAKEOVER_COEFFICIENTS], before[TAKEOVER_STATES], after[TAKEOVER_STATES], by_hand[N_LEGS], off[N_LEGS];
        lanes wanted[N_LEGS];
        memcpy(wanted, command, sizeof wanted);
        read_row(v, &l->takeover, 0, 0, TAKEOVER_COEFFICIENTS, c);
        recall(v, l->transfer, TAKEOVER_STATES, before);
        recall(v, l->manual_force, N_LEGS, by_hand);
        recall(v, l->off, N_LEGS, off);
        component_takeover(c, before, wanted, by_hand, off, after, command);
        keep(v, l->transfer, TAKEOVER_STATES, after, due);
    }
    for (int i = 0; i < N_LEGS; i++) {
        most = larger_of(most, magnitude(command[i]));
        nothing += command[i] * 0;
    }
    keep(v, l->command, N_LEGS, command, due);
    end(v, due & ~((most <= LARGEST_COMMAND) & (nothing == 0)), FAILURE_COMMAND, row);
    if (l->limits.at) {
        lanes c[LIMIT_COEFFICIENTS], before[LIMIT_STATES], after[LIMIT_STATES];
        mask goes_on = due & v->plant.running;
        read_row(v, &l->limits, 0, 0, LIMIT_COEFFICIENTS, c);
        recall(v, l->planned, LIMIT_STATES, before);
        component_limits(c, before, command, after, allowed, is_cut, excess);
        for (int i = 0; i < N_LEGS; i++)
            excess[i] = choose(those_off(v, due), (lanes)0.0, excess[i]);
        keep(v, l->planned, LIMIT_STATES, after, goes_on);
        keep(v, l->excess, N_LEGS, excess, goes_on);
        keep(v, l->limited, N_LEGS, is_cut, goes_on);
        hold(v, sample, allowed, goes_on);
    } else
        hold(v, sample, command, due & v->plant.running);
    recall(v, l->limited, N_LEGS, is_cut);
    recall(v, l->measured, N_SIGNALS, measured);
    write_numbers(v, &l->sample_command, sample, N_LEGS, command, due);
    write_flags(v, &l->sample_limited, sample, N_LEGS, is_cut, due);
    write_numbers(v, &l->sample_measured, sample, N_SIGNALS, measured, due);
}

/* Mean forces until the next row, and which of them a rate limit affects. */
static void drive(vector *v, lanes is_behind[])
{
    const loop *l = v->loop;
    lanes target[N_LEGS], mean[N_LEGS];
    recall(v, l->target, N_LEGS, target);
    memcpy(mean, target, sizeof mean);
    if (l->drives.at) {
        lanes c[DRIVE_COEFFICIENTS], before[DRIVE_STATES], after[DRIVE_STATES];
        read_row(v, &l->drives, 0, 0, DRIVE_COEFFICIENTS, c);
        recall(v, l->driven, DRIVE_STATES, before);
        component_drive(c, before, target, after, mean, is_behind);
        keep(v, l->driven, DRIVE_STATES, after, v->plant.running);
    }
    keep(v, l->acting, N_LEGS, mean, v->plant.running);
}

static void keep_row(vector *v, int64_t row, const lanes is_behind[])
{
    const loop *l = v->loop;
    mask everyone = everyone_of(v);
    row -= l->first_row;
    if (l->row_results.at) {
        lanes y[N_RESULTS];
        find_results(&v->plant, y);
        write_numbers(v, &l->row_results, row, N_RESULTS, y, everyone);
        write_numbers(v, &l->row_forces, row, N_INPUTS, v->plant.u, everyone);
    } else {
        lanes signals[N_SIGNALS], acting[N_LEGS], limited[N_LEGS];
        recall(v, l->signals, N_SIGNALS, signals);
        recall(v, l->acting, N_LEGS, acting);
        recall(v, l->limited, N_LEGS, limited);
        write_numbers(v, &l->row_signals, row, N_SIGNALS, signals, everyone);
        write_numbers(v, &l->row_forces, row, N_LEGS, acting, everyone);
        write_flags(v, &l->row_force_limited, row, N_LEGS, limited, everyone);
#if HAS_SPRINGS
        write_numbers(v, &l->row_motors, row, 2 * N_LEGS, v->plant.x + X_MOTOR_POSITION, everyone);
#endif
    }
    write_flags(v, &l->row_rate_limited, row, N_LEGS, is_behind, everyone);
}

/* The elements of a row for folds, and what is kept of it. */
static void take_row(vector *v, int64_t row, const lanes is_behind[])
{
    const loop *l = v->loop;
    lanes *into = v->chunk[++v->taken];
    recall(v, l->signals, N_SIGNALS, into);
    recall(v, l->acting, N_LEGS, into + ROW_FORCES);
    for (int i = 0; i < ROW_FLAGS - ROW_ERRORS; i++) {
        int signal = i < N_POSE ? i : FIRST_LENGTH + i - N_POSE;
        into[ROW_ERRORS + i] = l->reference.at ? value_at(v, &l->reference, row, signal) - into[signal] : (lanes)NAN;
    }
    if (l->reference.at) {
        lanes wanted[N_POSE - FIRST_ANGLE];
        read_row(v, &l->reference, row, FIRST_ANGLE, N_POSE - FIRST_ANGLE, wanted);
        component_rotation_between(into + FIRST_ANGLE, wanted, into + ROW_ERRORS + FIRST_ANGLE);
    }
    for (int i = 0; i < N_LEGS; i++) {
        into[ROW_FLAGS + i] = remembered(v, l->limited, i);
        into[ROW_FLAGS + N_LEGS + i] = is_behind[i];
    }
    for (int i = 0; i < 2 * N_LEGS; i++)
#if HAS_SPRINGS
        into[ROW_MOTORS + i] = v->plant.x[X_MOTOR_POSITION + i];
#else
        into[ROW_MOTORS + i] = into[FIRST_LENGTH + i]; /* rigid legs have one side */
#endif
    for (const kept_rows *k = l->takes->kept; k < l->takes->kept + l->takes->n_kept; k++)
        for (int64_t i = 0; k->place[row] >= 0 && i < k->size; i++)
            write_number(v, &k->to, k->place[row], i, into[k->elements[i]], everyone_of(v));
}

/* Gives the chunk of rows before `row` to the folds. */
static void fold_rows(vector *v, int64_t row)
{
    const loop *l = v->loop;
    int64_t ends[WIDTH], rows = v->taken;
    for (int lane = 0; lane < WIDTH; lane++) {
        int64_t end = l->ended[v->first + lane];
        ends[lane] = end < 0 ? rows + 1 : end < row - rows ? 0 : end - (row - rows) + 1;
    }
    if (rows && l->takes->fold)
        l->takes->fold(l->takes->folding, v->first / WIDTH, row - rows, rows, ROW_ELEMENTS, ends,
                       (const double *)v->chunk);
    for (int i = 0; i < ROW_ELEMENTS; i++)
        v->chunk[0][i] = v->chunk[rows][i];
    v->taken = 0;
}

static void check_limits(vector *v, int64_t row)
{
    const loop *l = v->loop;
    if (l->shortest.at) {
        mask beyond = v->plant.running & 0;
        for (int i = 0; i < N_LEGS; i++) {
            lanes length = remembered(v, l->signals, FIRST_LENGTH + i);
            lanes low = value_at(v, &l->shortest, 0, i), high = value_at(v, &l->longest, 0, i);
            beyond |= (length < low) | (length > high);
        }
        end(v, beyond, FAILURE_STROKE, row);
    }
    if (l->farthest.at) {
        lanes sum = (lanes)0.0;
        for (int i = 0; i < 3; i++)
            sum += sq(value_at(v, &l->reference, row, i) - remembered(v, l->signals, i));
        end(v, ~(square_root(sum) <= value_at(v, &l->farthest, 0, 0)), FAILURE_AWAY, row); /* also for NaN */
    }
}

/* A step of the plant: its own failures end members at this row. Returns the internal steps. */
static int64_t step_plant(vector *v, int64_t row)
{
    const loop *l = v->loop;
    const batch *members = v->plant.members;
    int64_t work = 1;
    end(v, *(const mask_anywhere *)(members->failure + v->first) != 0, FAILURE_NOT_STARTED, row);
    mask ran = v->plant.running;
    if (!any(ran))
        return work;
    if (l->substeps) {
        step_fixed(&v->plant, l->plant_step / (double)l->substeps, l->substeps);
        work = 2 * l->substeps; /* each is compared with a step of order 5 */
    } else {
        lanes before = get(members->internal_steps + v->first);
        step_controlled(&v->plant, l->plant_step, l->tolerance);
        lanes taken = get(members->internal_steps + v->first) - before;
        for (int lane = 0; lane < WIDTH; lane++)
            work = LANE(taken, lane) > (double)work ? (int64_t)LANE(taken, lane) : work;
    }
    for (int lane = 0; lane < v->live; lane++)
        if (HOLDS(ran, lane) && !HOLDS(v->plant.running, lane)) {
            l->ended[v->first + lane] = row;
            work = MOST_LANE_STEPS;
        }
    for (int i = 0; i < N_SIGNALS; i++)
        remember(v, l->signals, i, v->plant.at_x.signals[i]);
    return work;
}

/* The members whose sample is at a row before the end. */
static mask due_at(const vector *v, int64_t row)
{
    const loop *l = v->loop;
    mask due = v->plant.running;
    const int64_t *rows = l->sampled.at + row / l->every * l->sampled.row;
    for (int lane = 0; lane < v->live; lane++)
        if (rows[l->sampled.member ? v->first + lane : 0] != row)
            LANE(due, lane) = 0;
    return due;
}

static void read_at(const vector *v, int64_t row, mask due)
{
    const loop *l = v->loop;
    if (l->reading_every && row % l->reading_every == 0)
        read_sensors(v, row / l->reading_every, l->size, l->used, v->plant.running);
    else if (!l->reading_every && any(due))
        read_sensors(v, row / l->every, l->size, l->used, due);
}

/* Command, drives and faults: what acts from a row on. The row is kept, and its limits are checked. */
static void act_at(vector *v, int64_t row, mask due)
{
    const loop *l = v->loop;
    lanes is_behind[N_LEGS] = {(lanes)0.0};
    if (row < l->last) {
        if (any(due))
            sample_at(v, row, row / l->every, due);
        drive(v, is_behind);
    }
    if (l->cut) { /* legs without force; their drives go on */
        lanes driven[N_LEGS], cut[N_LEGS];
        recall(v, l->acting, N_LEGS, driven);
        recall(v, l->cut, N_LEGS, cut);
        component_cut(driven, cut, v->plant.u);
        keep(v, l->acting, N_LEGS, v->plant.u, v->plant.running);
    }
    recall(v, l->acting, N_LEGS, v->plant.u);
    if (l->takes)
        take_row(v, row, is_behind);
    else
        keep_row(v, row, is_behind);
    check_limits(v, row);
}

static void place(vector *v, const batch *members, const loop *l, int64_t block)
{
    v->loop = l;
    v->first = block * WIDTH;
    v->stride = members->stride;
    v->live = l->members - v->first < WIDTH ? (int)(l->members - v->first) : WIDTH;
    v->plant.members = members;
    v->plant.running = *(const mask_anywhere *)(members->running + v->first);
}

void loop_read(const batch *members, const loop *l, int64_t row)
{
    for (int64_t block = 0; block * WIDTH < l->members && row < l->last; block++) {
        vector v;
        place(&v, members, l, block);
        recall(&v, members->states, N_STATES, v.plant.x);
        read_at(&v, row, due_at(&v, row));
    }
}

void loop_act(const batch *members, const loop *l, int64_t row)
{
    for (int64_t block = 0; block * WIDTH < l->members; block++) {
        vector v;
        place(&v, members, l, block);
        recall(&v, members->states, N_STATES, v.plant.x);
        act_at(&v, row, row < l->last ? due_at(&v, row) : v.plant.running);
        *(mask_anywhere *)(members->running + v.first) = v.plant.running;
    }
}

int64_t loop_run(const batch *members, const loop *l, int64_t first, int64_t end, int64_t to, int64_t most_work)
{
    lanes chunk[CHUNK + 1][ROW_ELEMENTS];
    for (int64_t block = first; block < end; block++) {
        vector v = {.chunk = chunk};
        if (l->at_row[block] >= to || block * WIDTH >= l->members)
            continue;
        place(&v, members, l, block);
        read_group(&v.plant, members, block, N_PARAMETERS);
        if (l->takes)
            recall(&v, l->takes->latest, ROW_ELEMENTS, chunk[0]);
        while (l->at_row[block] < to && most_work >= 0) {
            int64_t row = l->at_row[block]++;
            mask due = row < l->last ? due_at(&v, row) : v.plant.running;
            if (row < l->last)
                read_at(&v, row, due);
            act_at(&v, row, due);
            if (row < l->last)
                most_work -= step_plant(&v, row);
            if (v.taken == CHUNK)
                fold_rows(&v, row + 1);
            if (l->takes && !any(v.plant.running)) { /* no row of theirs counts any more */
                fold_rows(&v, row + 1);
                l->at_row[block] = to;
            }
        }
        if (l->takes) {
            fold_rows(&v, l->at_row[block]);
            for (int i = 0; i < ROW_ELEMENTS; i++)
                remember(&v, l->takes->latest, i, chunk[0][i]);
        }
        *(mask_anywhere *)(members->running + v.first) = v.plant.running;
        if (most_work < 0)
            return 0;
    }
    return 1;
}

#if WIDTH == 1
void loop_begin(const batch *members, const loop *l)
{
    loop unfrozen = *l; /* a sensor that is frozen from the begin has its first reading */
    vector v = {.loop = &unfrozen, .stride = members->stride, .live = 1};
    unfrozen.frozen = NULL;
    read_group(&v.plant, members, 0, N_PARAMETERS);
    read_sensors(&v, 0, l->size, l->used, everyone_of(&v));
    if (l->held)
        memcpy(l->held, l->measured, N_SIGNALS * sizeof *l->held);
    for (int i = 0; i < N_LEGS && i < l->size; i++) {
        remember(&v, l->lengths, i, remembered(&v, l->measured, l->used[i]));
        remember(&v, l->pose, i, (lanes)0.0);
    }
    feed(&v, 0, everyone_of(&v), everyone_of(&v) & 0);
}
#endif

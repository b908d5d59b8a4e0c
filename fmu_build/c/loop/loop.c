#include "loop.h"

#include "lanes.c"

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
    const batch *of;
    const loop *with;
    int64_t first; /* member */
    int live;      /* members in it */
    int64_t taken; /* rows of the chunk, after the one before */
    lanes (*chunk)[ROW_ELEMENTS];
} vector;

static lanes at(const vector *v, const table *t, int64_t row, int64_t element)
{
    const double *from = t->at + row * t->row + element * t->element;
    if (!t->member)
        return (lanes)*from;
    if (v->live == WIDTH)
        return get(from + v->first);
    lanes found = (lanes)from[v->first];
    for (int lane = 1; lane < v->live; lane++)
        LANE(found, lane) = from[v->first + lane];
    return found;
}

static lanes remembered(const vector *v, const double *memory, int64_t element)
{
    return get(memory + element * v->of->stride + v->first);
}

static void remember(const vector *v, double *memory, int64_t element, lanes x)
{
    put(memory + element * v->of->stride + v->first, x);
}

static void recall(const vector *v, const double *memory, int n, lanes found[])
{
    for (int i = 0; i < n; i++)
        found[i] = remembered(v, memory, i);
}

/* Where a mask holds. */
static void keep(const vector *v, double *memory, int n, const lanes x[], mask where)
{
    for (int i = 0; i < n; i++)
        remember(v, memory, i, choose(where, x[i], remembered(v, memory, i)));
}

static void write_numbers(const vector *v, const rows_of_numbers *to, int64_t row, int64_t element, lanes x)
{
    double *place = to->at + row * to->row + element * to->element + v->first;
    if (v->live == WIDTH)
        put(place, x);
    else
        for (int lane = 0; lane < v->live; lane++)
            place[lane] = LANE(x, lane);
}

static void write_some(const vector *v, const rows_of_numbers *to, int64_t row, int64_t element, lanes x, mask where)
{
    double *place = to->at + row * to->row + element * to->element + v->first;
    for (int lane = 0; lane < v->live; lane++)
        if (HOLDS(where, lane))
            place[lane] = LANE(x, lane);
}

static void write_flags(const vector *v, const rows_of_flags *to, int64_t row, int64_t element, lanes x, mask where)
{
    uint8_t *place = to->at + row * to->row + element * to->element + v->first;
    mask is_set = (x != 0) & 1;
    if (v->live == WIDTH && !any(~where))
        put_flags(place, is_set);
    else
        for (int lane = 0; lane < v->live; lane++)
            if (HOLDS(where, lane))
                place[lane] = (uint8_t)HOLDS(is_set, lane);
}

/* Ends members at a row: it is their last one. */
static void end(vector *v, mask which, int64_t failure, int64_t row)
{
    if (!any(which))
        return;
    for (int lane = 0; lane < v->live; lane++)
        if (HOLDS(which, lane) && HOLDS(v->plant.running, lane)) {
            v->of->failure[v->first + lane] = failure;
            v->with->ended[v->first + lane] = row;
            LANE(v->plant.running, lane) = 0;
        }
}

/* The noise (24) of a reading: 0 where there is none. */
static void draw_noise(const vector *v, int64_t reading, lanes noise[])
{
    const loop *w = v->with;
    words stream[4];
    for (int i = 0; i < N_SIGNALS; i++)
        noise[i] = (lanes)0.0;
    for (int i = 0; w->n_noisy && i < 4; i++)
        stream[i] = (words)*(const mask_anywhere *)(w->streams + i * v->of->stride + v->first);
    for (int64_t k = 0; k < w->n_noisy; k++) {
        lanes deviation = at(v, &w->deviations, 0, k);
        int64_t first = w->noisy[2 * k], n = w->noisy[2 * k + 1];
        normals(stream, reading, first, n, noise + first);
        for (int64_t i = first; i < first + n; i++)
            noise[i] = noise[i] * deviation;
    }
}

#if HAS_SPRINGS
#define AT_MOTOR 2
#define SENSES(flags) ((flags) & 1)
#else
#define SENSES(flags) (flags)
#endif

/* Readings of the members whose sample it is; those of frozen sensors stay. */
static void read_sensors(const vector *v, int64_t reading, int64_t n, const int64_t *used, mask whose)
{
    const loop *w = v->with;
    lanes noise[N_SIGNALS];
    draw_noise(v, reading, noise);
    for (int64_t i = 0; i < n; i++) {
        int64_t element = used[i];
        lanes now = remembered(v, w->signals, element);
#if HAS_SPRINGS
        if (w->senses[element] & AT_MOTOR)
            now = v->plant.x[X_MOTOR_POSITION + element - FIRST_LENGTH]; /* the velocities follow */
#endif
        if (SENSES(w->senses[element])) {
            lanes c[SENSOR_COEFFICIENTS];
            for (int k = 0; k < SENSOR_COEFFICIENTS; k++)
                c[k] = at(v, &w->sensors, 0, element * SENSOR_COEFFICIENTS + k);
            component_sensor(c, &now, &noise[element], &now);
        }
        if (w->frozen) {
            lanes last = remembered(v, w->held, element), frozen = remembered(v, w->frozen, element), found;
            component_freeze(&now, &last, &frozen, &found);
            keep(v, w->held + element * v->of->stride, 1, &found, whose);
            now = found;
        }
        remember(v, w->measured, element, now);
    }
}

/* y = M x of a matrix (6, 6) by rows, or of its transpose. */
static void times(const vector *v, const table *matrix, int64_t sample, int transposed, const lanes x[], lanes y[])
{
    for (int i = 0; i < N_LEGS; i++) {
        y[i] = (lanes)0.0;
        for (int j = 0; j < N_LEGS; j++)
            y[i] += at(v, matrix, sample, transposed ? N_LEGS * j + i : N_LEGS * i + j) * x[j];
    }
}

/* The parts of u, in task space of displacements: see harness/control/linear_law.py. */
static void feed(vector *v, int64_t sample, mask due)
{
    const loop *w = v->with;
    lanes excess[N_LEGS], step[N_LEGS], now[N_LEGS], ahead[N_LEGS], length[N_LEGS];
    recall(v, w->excess, N_LEGS, excess);
    int in_task_space = w->inverse.at != 0;
    if (in_task_space) {
        for (int i = 0; i < N_LEGS; i++) {
            length[i] = remembered(v, w->measured, w->used[i]);
            step[i] = length[i] - remembered(v, w->lengths, i);
        }
        times(v, &w->inverse, sample, 0, step, now);
        for (int i = 0; i < N_LEGS; i++) {
            now[i] += remembered(v, w->pose, i);
            step[i] = at(v, &w->reference, sample * w->every, w->used[i]) - length[i];
        }
        times(v, &w->inverse, sample, 0, step, ahead);
        if (w->kinds == 3) {
            times(v, &w->jacobian, sample, 1, excess, step);
            for (int i = 0; i < N_LEGS; i++)
                excess[i] = step[i];
        }
        keep(v, w->pose, N_LEGS, now, due);
        keep(v, w->lengths, N_LEGS, length, due);
    }
    for (int64_t i = 0; i < w->size; i++) {
        lanes r = in_task_space ? now[i] + ahead[i] : at(v, &w->reference, sample * w->every, w->used[i]);
        lanes y = in_task_space ? now[i] : remembered(v, w->measured, w->used[i]);
        remember(v, w->memory, w->n_states + i, w->kinds == 1 ? r - y : r);
        if (w->kinds > 1)
            remember(v, w->memory, w->n_states + w->size + i, y);
    }
    for (int i = 0; w->kinds == 3 && i < N_LEGS; i++)
        remember(v, w->memory, w->n_states + 2 * w->size + i, excess[i]);
}

/* y = C x + D u, x+ = A x + B u, element by element. */
static void multiply(const vector *v)
{
    const loop *w = v->with;
    for (int64_t i = 0; i < N_LEGS + w->n_states; i++)
        remember(v, w->next, i, (lanes)0.0);
    for (int64_t k = 0; k < w->entries; k++) {
        int64_t i = w->entry_row[k];
        lanes term = at(v, &w->values, 0, k) * remembered(v, w->memory, w->entry_column[k]);
        remember(v, w->next, i, remembered(v, w->next, i) + term);
    }
}

/* A user's law, which gets the time of the sample and the reference's accelerations besides references and readings. */
static void call_law(const vector *v, int64_t sample)
{
    const loop *w = v->with;
    int64_t row = sample * w->every, next = w->n_states + 2 * w->size;
    remember(v, w->memory, next, (lanes)((double)row * w->plant_step));
    for (int i = 0; i < N_ACCELERATIONS; i++)
        remember(v, w->memory, next + 1 + i, at(v, &w->reference, row, N_SIGNALS + i));
    w->law(w->memory + v->first, w->next + v->first, v->of->stride);
}

/* The controller's forces; x goes on where a sample is due. */
static void control(vector *v, int64_t sample, mask due, lanes force[])
{
    const loop *w = v->with;
    feed(v, sample, due);
    if (w->sample_state.at)
        for (int64_t i = 0; i < w->n_states; i++)
            write_some(v, &w->sample_state, sample, i, remembered(v, w->memory, i), due);
    if (w->law)
        call_law(v, sample);
    else
        multiply(v);
    for (int64_t i = 0; i < w->n_states; i++) {
        lanes next = remembered(v, w->next, N_LEGS + i);
        remember(v, w->memory, i, choose(due, next, remembered(v, w->memory, i)));
    }
    recall(v, w->next, N_LEGS, force);
    if (w->inverse.at) {
        lanes wrench[N_LEGS];
        for (int i = 0; i < N_LEGS; i++)
            wrench[i] = force[i];
        times(v, &w->inverse, sample, 1, wrench, force);
    }
}

/* The forces that reach the drives at a sample: those allowed some samples ago, each member's number of them. */
static void hold(const vector *v, int64_t sample, const lanes allowed[], mask due)
{
    const loop *w = v->with;
    int64_t slots = w->most_delay + 1;
    lanes late = at(v, &w->delay, 0, 0);
    keep(v, w->delayed + sample % slots * N_LEGS * v->of->stride, N_LEGS, allowed, due);
    for (int64_t d = 0; d < slots; d++) {
        mask which = due & (late == (double)d);
        lanes ready[N_LEGS];
        if (!any(which))
            continue;
        recall(v, w->delayed + (sample + slots - d) % slots * N_LEGS * v->of->stride, N_LEGS, ready);
        keep(v, w->target, N_LEGS, ready, which);
    }
}

static void sample_at(vector *v, int64_t row, int64_t sample, mask due)
{
    const loop *w = v->with;
    lanes command[N_LEGS], allowed[N_LEGS], is_cut[N_LEGS], excess[N_LEGS];
    lanes force[N_LEGS], most = (lanes)0.0, nothing = (lanes)0.0;
    if (w->kinds)
        control(v, sample, due, force);
    for (int i = 0; i < N_LEGS; i++) {
        command[i] = at(v, &w->feedforward, sample, i);
        if (w->injection.at)
            command[i] += at(v, &w->injection, sample, i);
        if (w->kinds)
            command[i] += force[i];
        most = larger(most, magnitude(command[i]));
        nothing += command[i] * 0;
    }
    keep(v, w->command, N_LEGS, command, due);
    end(v, due & opposite((most <= LARGEST_COMMAND) & (nothing == 0)), FAILURE_COMMAND, row);
    if (w->limits.at) {
        lanes c[LIMIT_COEFFICIENTS], before[LIMIT_STATES], after[LIMIT_STATES];
        mask goes_on = due & v->plant.running;
        for (int k = 0; k < LIMIT_COEFFICIENTS; k++)
            c[k] = at(v, &w->limits, 0, k);
        recall(v, w->planned, LIMIT_STATES, before);
        component_limits(c, before, command, after, allowed, is_cut, excess);
        keep(v, w->planned, LIMIT_STATES, after, goes_on);
        keep(v, w->excess, N_LEGS, excess, goes_on);
        keep(v, w->limited, N_LEGS, is_cut, goes_on);
        hold(v, sample, allowed, goes_on);
    } else
        hold(v, sample, command, due & v->plant.running);
    if (w->sample_command.at)
        for (int i = 0; i < N_LEGS; i++) {
            write_some(v, &w->sample_command, sample, i, command[i], due);
            write_flags(v, &w->sample_limited, sample, i, remembered(v, w->limited, i), due);
        }
    if (w->sample_measured.at)
        for (int i = 0; i < N_SIGNALS; i++)
            write_some(v, &w->sample_measured, sample, i, remembered(v, w->measured, i), due);
}

/* Mean forces until the next row, and which of them a rate limit affects. */
static void drive(vector *v, lanes is_behind[])
{
    const loop *w = v->with;
    lanes target[N_LEGS], mean[N_LEGS];
    recall(v, w->target, N_LEGS, target);
    for (int i = 0; i < N_LEGS; i++) {
        mean[i] = target[i];
        is_behind[i] = (lanes)0.0;
    }
    if (w->drives.at) {
        lanes c[DRIVE_COEFFICIENTS], before[DRIVE_STATES], after[DRIVE_STATES];
        for (int k = 0; k < DRIVE_COEFFICIENTS; k++)
            c[k] = at(v, &w->drives, 0, k);
        recall(v, w->driven, DRIVE_STATES, before);
        component_drive(c, before, target, after, mean, is_behind);
        keep(v, w->driven, DRIVE_STATES, after, v->plant.running);
    }
    keep(v, w->acting, N_LEGS, mean, v->plant.running);
}

/* Legs without force; their drives go on. */
static void cut_legs(vector *v)
{
    const loop *w = v->with;
    lanes driven[N_LEGS], cut[N_LEGS], left[N_LEGS];
    recall(v, w->acting, N_LEGS, driven);
    recall(v, w->cut, N_LEGS, cut);
    component_cut(driven, cut, left);
    keep(v, w->acting, N_LEGS, left, v->plant.running);
}

static void keep_row(vector *v, int64_t row, const lanes is_behind[])
{
    const loop *w = v->with;
    mask everyone = v->plant.running | ~v->plant.running;
    row -= w->first_row;
    if (w->row_results.at) {
        lanes y[N_RESULTS];
        kernel_outputs(v->plant.x, v->plant.u, v->plant.p, y);
        for (int i = 0; i < N_RESULTS; i++)
            write_numbers(v, &w->row_results, row, i, y[i]);
        for (int i = 0; i < N_INPUTS; i++)
            write_numbers(v, &w->row_forces, row, i, v->plant.u[i]);
    } else {
        for (int i = 0; i < N_SIGNALS; i++)
            write_numbers(v, &w->row_signals, row, i, remembered(v, w->signals, i));
        for (int i = 0; i < N_LEGS; i++)
            write_numbers(v, &w->row_forces, row, i, remembered(v, w->acting, i));
        for (int i = 0; i < N_LEGS; i++)
            write_flags(v, &w->row_force_limited, row, i, remembered(v, w->limited, i), everyone);
#if HAS_SPRINGS
        for (int i = 0; w->row_motors.at && i < 2 * N_LEGS; i++)
            write_numbers(v, &w->row_motors, row, i, v->plant.x[X_MOTOR_POSITION + i]);
#endif
    }
    for (int i = 0; i < N_LEGS; i++)
        write_flags(v, &w->row_rate_limited, row, i, is_behind[i], everyone);
}

/* The elements of a row for folds, and what is kept of it. */
static void take_row(vector *v, int64_t row, const lanes is_behind[])
{
    const loop *w = v->with;
    lanes *into = v->chunk[++v->taken];
    recall(v, w->signals, N_SIGNALS, into);
    recall(v, w->acting, N_LEGS, into + ROW_FORCES);
    for (int i = 0; i < ROW_FLAGS - ROW_ERRORS; i++) {
        int of = i < N_POSE ? i : FIRST_LENGTH + i - N_POSE;
        into[ROW_ERRORS + i] = w->reference.at ? at(v, &w->reference, row, of) - into[of] : (lanes)NAN;
    }
    if (w->reference.at) {
        lanes wanted[N_POSE - FIRST_ANGLE];
        for (int i = FIRST_ANGLE; i < N_POSE; i++)
            wanted[i - FIRST_ANGLE] = at(v, &w->reference, row, i);
        component_rotation_between(into + FIRST_ANGLE, wanted, into + ROW_ERRORS + FIRST_ANGLE);
    }
    for (int i = 0; i < N_LEGS; i++) {
        into[ROW_FLAGS + i] = remembered(v, w->limited, i);
        into[ROW_FLAGS + N_LEGS + i] = is_behind[i];
    }
    for (int i = 0; i < 2 * N_LEGS; i++)
#if HAS_SPRINGS
        into[ROW_MOTORS + i] = v->plant.x[X_MOTOR_POSITION + i];
#else
        into[ROW_MOTORS + i] = into[FIRST_LENGTH + i]; /* rigid legs have one side */
#endif
    for (const kept_rows *k = w->takes->kept; k < w->takes->kept + w->takes->n_kept; k++)
        for (int64_t i = 0; k->place[row] >= 0 && i < k->size; i++)
            write_numbers(v, &k->to, k->place[row], i, into[k->elements[i]]);
}

/* Gives the chunk of rows before `row` to the folds. */
static void fold_rows(vector *v, int64_t row)
{
    const loop *w = v->with;
    int64_t ends[WIDTH], rows = v->taken;
    for (int lane = 0; lane < WIDTH; lane++) {
        int64_t end = w->ended[v->first + lane];
        ends[lane] = end < 0 ? rows + 1 : end < row - rows ? 0 : end - (row - rows) + 1;
    }
    if (rows && w->takes->fold)
        w->takes->fold(w->takes->folding, v->first / WIDTH, row - rows, rows, ROW_ELEMENTS, ends,
                       (const double *)v->chunk);
    for (int i = 0; i < ROW_ELEMENTS; i++)
        v->chunk[0][i] = v->chunk[rows][i];
    v->taken = 0;
}

static void check_limits(vector *v, int64_t row)
{
    const loop *w = v->with;
    if (w->shortest.at) {
        lanes low = at(v, &w->shortest, 0, 0), high = at(v, &w->longest, 0, 0);
        mask beyond = v->plant.running & 0;
        for (int i = 0; i < N_LEGS; i++) {
            lanes length = remembered(v, w->signals, FIRST_LENGTH + i);
            beyond |= (length < low) | (length > high);
        }
        end(v, beyond, FAILURE_STROKE, row);
    }
    if (w->farthest.at) {
        lanes sum = (lanes)0.0;
        for (int i = 0; i < 3; i++)
            sum += sq(at(v, &w->reference, row, i) - remembered(v, w->signals, i));
        end(v, opposite(square_root(sum) <= at(v, &w->farthest, 0, 0)), FAILURE_AWAY, row); /* also for NaN */
    }
}

/* A step of the plant: its own failures end members at this row. Returns the internal steps. */
static int64_t step_plant(vector *v, int64_t row)
{
    const loop *w = v->with;
    const batch *of = v->of;
    mask ran = v->plant.running, barred = ran & (*(const mask_anywhere *)(of->failure + v->first) != 0);
    int64_t work = 1;
    if (any(barred))
        end(v, barred, FAILURE_NOT_STARTED, row);
    ran = v->plant.running;
    if (!any(ran))
        return work;
    if (w->substeps) {
        lanes error = (lanes)0.0;
        double size = w->plant_step / (double)w->substeps;
        for (int64_t k = 1; k <= w->substeps && any(v->plant.running); k++) {
            error += fixed_step(&v->plant, size);
            check_now(&v->plant, (lanes)((double)k * size));
        }
        work = 2 * w->substeps; /* each is compared with a step of order 5 */
        settle(&v->plant, ran);
        keep_errors(&v->plant, error);
        kernel_signals(v->plant.x, v->plant.p, v->plant.here.signals);
    } else {
        lanes before = get(of->internal_steps + v->first);
        advance(&v->plant, w->plant_step, w->tolerance);
        if (settle(&v->plant, ran))
            look(&v->plant);
        lanes taken = get(of->internal_steps + v->first) - before;
        for (int lane = 0; lane < WIDTH; lane++)
            work = LANE(taken, lane) > (double)work ? (int64_t)LANE(taken, lane) : work;
    }
    for (int lane = 0; lane < v->live; lane++)
        if (HOLDS(ran, lane) && !HOLDS(v->plant.running, lane)) {
            w->ended[v->first + lane] = row;
            work = MOST_LANE_STEPS;
        }
    for (int i = 0; i < N_SIGNALS; i++)
        remember(v, w->signals, i, v->plant.here.signals[i]);
    return work;
}

/* Everything at a row but the step from there. */
static void at_row(vector *v, int64_t row)
{
    const loop *w = v->with;
    lanes is_behind[N_LEGS];
    for (int i = 0; i < N_LEGS; i++)
        is_behind[i] = (lanes)0.0;
    if (row < w->last) {
        int64_t sample = row / w->every;
        mask due = v->plant.running;
        const int64_t *rows = w->sampled.at + sample * w->sampled.row;
        for (int lane = 0; lane < v->live; lane++)
            if (rows[w->sampled.member ? v->first + lane : 0] != row)
                LANE(due, lane) = 0;
        if (w->kinds && (w->reading_every ? row % w->reading_every == 0 : any(due)))
            read_sensors(v, w->reading_every ? row / w->reading_every : sample, w->size, w->used,
                         w->reading_every ? v->plant.running : due);
        if (any(due))
            sample_at(v, row, sample, due);
        drive(v, is_behind);
    }
    if (w->cut)
        cut_legs(v);
    recall(v, w->acting, N_LEGS, v->plant.u);
    if (w->takes)
        take_row(v, row, is_behind);
    else
        keep_row(v, row, is_behind);
    check_limits(v, row);
}

int64_t loop_run(const batch *of, const loop *with, int64_t first, int64_t end, int64_t to, int64_t most_work)
{
    lanes chunk[CHUNK + 1][ROW_ELEMENTS];
    for (int64_t block = first; block < end; block++) {
        vector v = {.of = of, .with = with, .first = block * WIDTH, .chunk = chunk};
        if (with->at_row[block] >= to || v.first >= with->members)
            continue;
        v.live = with->members - v.first < WIDTH ? (int)(with->members - v.first) : WIDTH;
        read_group(&v.plant, of, block, N_PARAMETERS);
        read_inputs(&v.plant);
        if (!with->substeps)
            look(&v.plant);
        if (with->takes)
            recall(&v, with->takes->latest, ROW_ELEMENTS, chunk[0]);
        while (with->at_row[block] < to) {
            int64_t row = with->at_row[block]++;
            at_row(&v, row);
            if (row < with->last)
                most_work -= step_plant(&v, row);
            if (v.taken == CHUNK)
                fold_rows(&v, row + 1);
            if (with->takes && !any(v.plant.running)) { /* no row of theirs counts any more */
                fold_rows(&v, row + 1);
                with->at_row[block] = to;
            }
            if (most_work < 0)
                break;
        }
        if (with->takes) {
            fold_rows(&v, with->at_row[block]);
            for (int i = 0; i < ROW_ELEMENTS; i++)
                remember(&v, with->takes->latest, i, chunk[0][i]);
        }
        *(mask_anywhere *)(of->running + v.first) = v.plant.running;
        if (most_work < 0)
            return 0;
    }
    return 1;
}

void loop_noise(const int64_t *streams, int64_t n, int64_t reading, int64_t readings, int64_t element,
                int64_t elements, double *noise)
{
    for (int64_t first = 0; first < n; first += WIDTH) {
        int live = n - first < WIDTH ? (int)(n - first) : WIDTH;
        words stream[4];
        lanes x[N_SIGNALS];
        for (int i = 0; i < 4; i++)
            for (int lane = 0; lane < WIDTH; lane++)
                LANE(stream[i], lane) = (uint64_t)streams[i * n + first + (lane < live ? lane : 0)];
        for (int64_t k = 0; k < readings; k++) {
            normals(stream, reading + k, element, elements, x);
            for (int64_t i = 0; i < elements; i++)
                for (int lane = 0; lane < live; lane++)
                    noise[(k * elements + i) * n + first + lane] = LANE(x[i], lane);
        }
    }
}

// Carries out runs of any model: DOP853 with dense output, search for events, their rules, samples, and derivatives of all.
//
// A model is a set of functions in the table of functions, written by `wasm.py`, and the table of integers `Model`, written by
// `trace.py`: which function is what. One call of `begin(job)` and calls of `advance(steps)` until it returns 1 carry out the
// runs of a `Job`. Everything lies in the memory that this module exports; `room` gives parts of it, and takes all that lies
// at an address or after it back by `release_room`. Memory may move in its host when it grows, so hosts make views anew.
//
// Derivatives: with n columns, S = dy/d(column) follows S' = df/dy S + df/dp seeds beside the state, whose steps do not depend
// on it. At an event, g = 0, its time moves by dt = -(dg/dy S + dg/dp) / (dg/dt + dg/dy f), the state there by dy = S + f dt;
// the rule of the event maps dy, and back at fixed time S = dy - f_next dt. (See docs/derivation.md.)
#include <math.h>
#include <stdint.h>
#include <string.h>

#define NY 13                          // entries of `State`
#define NS 7                           // entries of `Signs`
#define ENDED 7                        // `Mode.ENDED`
#define MODES 9
#define MAX_VARIABLES 13
#define MAX_COLUMNS 128                // of derivatives; hosts take more in several goes
#define MAX_EVENT_FUNCTIONS 12
#define CHECKS 5                       // points of a step at which event functions are evaluated, its ends among them
#define MAX_STEPS 200000               // in one mode, unless the job says otherwise
#define MAX_EVENTS 4000                // within a second: more are taken for endless
#define LEAVES_REST 1e-6               // `rules.REST_SERIES_DURATION`, and the first step after a release [s]
#define GRAZING_STEP 1e-6              // an event is grazed if the slope of its function was twice as large by so much earlier [s]
#define EPSILON 2.220446049250313e-16
#define EXPORT __attribute__((visibility("default")))

typedef void (*Function)(double t, const double *y, const double *s, const double *p, double *out);
#define CALL(place) ((Function)(uintptr_t)(model->first + (place)))
#define AT(address) ((void *)(uintptr_t)(uint32_t)(address))

typedef int32_t PerEvent[MAX_EVENT_FUNCTIONS], PerPhase[MAX_EVENT_FUNCTIONS][2];
typedef struct {                       // layout as in `trace._ModeRow`; functions by their places
  int32_t variables, places[15], heavy_follows, events, rates, event_values, jacobian, jacobian_structure;
  PerEvent each, gradient, gradient_structure, of_rod;
  PerPhase apply, apply_jacobian, apply_structure, code, ends, continuous;
} Mode;
typedef struct {
  int32_t release, release_jacobian, release_structure, parameters, values;
  Mode modes[MODES];
} Table;
typedef struct {                       // of a loaded model
  int32_t first, table, jacobian;      // place of its first function, address of its table, room for `values` doubles
} Model;

typedef struct {                       // addresses of what is read and written; see host.py
  double rtol;
  int32_t model, runs;
  int32_t p, durations;                // parameters of each run, end to end; limits on the simulated time
  int32_t times, starts;               // sample times of all runs, ascending in each; where each run's begin, runs + 1 of them
  int32_t samples, partials;           // NY entries of the state for each time; NY x n derivatives of them
  int32_t status;                      // for each run: `Status`
  // Rows of events, one run's after another's, and n derivatives of the time of each; for each run NY x n derivatives of the
  // state at its end, whose time moves; number of rows for which there is room
  int32_t events, event_partials, end_partials, max_events;
  // Columns of the derivatives, a multiple of 4: column c is the sum of weight x derivative by a parameter. The seeds are in
  // the order of the parameters; where each parameter's begin, `parameters` + 1 of them; their columns and weights
  int32_t n, seed_starts, seed_columns, seed_weights;
  int32_t max_steps;                   // in one mode; 0: MAX_STEPS
  int32_t dense, max_dense;            // rows of the dense output, one run's after another's, 0: not wanted; room as above
} Job;
typedef struct { int32_t failure, events, samples, dense; } Status; // what went wrong; counts, also of what had no room
enum { FINE, TOO_MANY_STEPS, BROKE_DOWN, TOO_MANY_EVENTS };

typedef struct { double mode, t, y[NY], s[NS]; } Motion;
typedef struct { double code; Motion after; } EventRow;
// Codes are places in `Event`, beside two more; STOPPED: where the run failed
enum { STOPPED = -2, RELEASED = -1, TIME_UP = 3 };
typedef struct { double t, h, mode, y[8][NY]; } DenseRow;        // y(t + x h) by `at`; the mode's other entries are 0

EXPORT double w_exp(double x) { return exp(x); }
EXPORT double w_log(double x) { return log(x); }
EXPORT double w_sin(double x) { return sin(x); }
EXPORT double w_cos(double x) { return cos(x); }
EXPORT double w_tanh(double x) { return tanh(x); }

// Room: a heap that grows, and is given back from its end
extern unsigned char __heap_base;
static uintptr_t top;
EXPORT uintptr_t room(uintptr_t bytes) {
  if (!top) top = ((uintptr_t)&__heap_base + 63) & ~63ul;
  const uintptr_t here = top, end = (top + bytes + 63) & ~63ul, size = __builtin_wasm_memory_size(0) * 65536ul;
  if (end < here || bytes > 4000000000ul) return 0;
  if (end > size && __builtin_wasm_memory_grow(0, (end - size + 65535ul) / 65536ul) == (unsigned long)-1) return 0;
  top = end;
  return here;
}
EXPORT void release_room(uintptr_t address) { top = address; }

// Of the job, the run and its mode
static const Job *job;
static const Model *model;
static const Table *table;
static const Mode *mode;
static const double *p, *times, *seed_weight;
static const int32_t *seed_start, *seed_column;
static double *samples, *partials, *event_partials, *end_partials, duration, rtol, *jacobian;
static EventRow *rows;
static DenseRow *dense_rows;
static Status *status;
static int run, started, n;            // n: columns of derivatives, a multiple of 4
static int event_count, dense_count;   // of all runs so far
static int nz, n0, N;                  // variables of the mode; place where their derivatives begin; numbers of both
static double signs[NS];
static Motion now;                     // just after the last event
static int mode_steps, sample, sample_count, late_events;
static double t, h, h_before, error_before, second;
static int first_step;                 // of a mode

#define SIZE ((MAX_VARIABLES + 1) * (1 + MAX_COLUMNS))
static double Z[SIZE], ZN[SIZE], ZS[SIZE], K[16][SIZE], D[7][SIZE];
static double S[NY * MAX_COLUMNS], S_NEXT[2 * NY * MAX_COLUMNS];  // derivatives of the whole state

// out += J S + J_p seeds, for a Jacobian of the structure at this place; out has a row of n for each of its rows
static void multiply(int place, const double *J, const double *restrict s, double *restrict out) {
  const int32_t *e = (const int32_t *)table + place;
  const int row_count = e[0], by_state = e[1], by_parameter = e[2];
  const int32_t *start = e + 3, *column = start + row_count + 1, *row = column + by_state, *parameter = row + by_parameter;
  for (int i = 0; i < row_count; i++)
    for (int c = 0; c < n; c += 4) {
      double *o = out + i * n + c;
      double a0 = o[0], a1 = o[1], a2 = o[2], a3 = o[3];
      for (int k = start[i]; k < start[i + 1]; k++) {
        const double *x = s + column[k] * n + c, j = J[k];
        a0 += j * x[0], a1 += j * x[1], a2 += j * x[2], a3 += j * x[3];
      }
      o[0] = a0, o[1] = a1, o[2] = a2, o[3] = a3;
    }
  for (int k = 0; k < by_parameter; k++)
    for (int q = seed_start[parameter[k]]; q < seed_start[parameter[k] + 1]; q++)
      out[row[k] * n + seed_column[q]] += J[by_state + k] * seed_weight[q];
}

static void rates(double time, const double *restrict z, double *restrict out) {
  if (!n) {
    CALL(mode->rates)(time, z, signs, p, out);
    return;
  }
  CALL(mode->jacobian)(time, z, signs, p, jacobian);
  memcpy(out, jacobian, nz * sizeof(double));
  memset(out + n0, 0, nz * n * sizeof(double));
  multiply(mode->jacobian_structure, jacobian + nz, z + n0, out + n0);
}

#include "stages.h" // attempt(t, h): ZN and K[12] from Z and K[0]; complete(t, h): D; err5(i), err3(i). Written by build.py.

static double error_of(double step) {
  double e5 = 0, e3 = 0;
  for (int i = 0; i < nz; i++) {
    const double a = fabs(Z[i]), b = fabs(ZN[i]), scale = 1 / (0.1 * rtol + (a > b ? a : b) * rtol);
    const double x = err5(i) * scale, y = err3(i) * scale;
    e5 += x * x, e3 += y * y;
  }
  return e5 == 0 && e3 == 0 ? 0 : step * e5 / sqrt((e5 + 0.01 * e3) * nz);
}

// The state at the fraction x of the step; also its derivatives, if `count` is N
static void at(double x, double *restrict out, int count) {
  const double r = 1 - x;
  for (int i = 0; i < count; i++)
    out[i] = Z[i] + x * (D[0][i] + r * (D[1][i] + x * (D[2][i] + r * (D[3][i] + x * (D[4][i] + r * (D[5][i] + x * D[6][i]))))));
}

static double step; // length of the step to which D belongs
static double event_at(int k, double x) {
  double z[MAX_VARIABLES], value;
  at(x, z, nz);
  CALL(mode->each[k])(t + x * step, z, signs, p, &value);
  return value;
}

// Chandrupatla's method (1997); see Scherer, Computational Physics (2010), section 6.1.7.3
static double root(int k, double a, double b, double fa, double fb) {
  double newest = b, opposite = a, f_newest = fb, f_opposite = fa, share = 0.5;
  for (int i = 0; i < 200; i++) {
    const double x = newest + share * (opposite - newest), fx = event_at(k, x);
    double previous, f_previous;
    if ((fx > 0) == (f_newest > 0) && (fx < 0) == (f_newest < 0)) previous = newest, f_previous = f_newest;
    else previous = opposite, f_previous = f_opposite, opposite = newest, f_opposite = f_newest;
    newest = x, f_newest = fx;
    const int newest_is_best = fabs(f_newest) < fabs(f_opposite);
    const double best = newest_is_best ? newest : opposite, least = newest_is_best ? f_newest : f_opposite;
    const double smallest = 2 * EPSILON * fabs(best) / fabs(opposite - newest);
    if (least == 0 || smallest > 0.5) return best;
    const double place = (newest - opposite) / (previous - opposite);
    const double height = (f_newest - f_opposite) / (f_previous - f_opposite);
    share = 0.5;
    if (height * height < place && (1 - height) * (1 - height) < 1 - place)
      share = f_newest / (f_opposite - f_newest) * (f_previous / (f_opposite - f_previous)) +
              (previous - newest) / (opposite - newest) * (f_newest / (f_previous - f_newest)) *
                  (f_opposite / (f_previous - f_opposite));
    share = share < smallest ? smallest : share > 1 - smallest ? 1 - smallest : share;
  }
  return newest;
}

// Whether a function may fall below a share of its values within a step of which l, q and r are three values at equal distances,
// by the parabola through them; its minimum may lie a little beyond them, as near an end no value on the other side tells of it
static int may_dip(double l, double q, double r, double share) {
  const double bend = l - 2 * q + r, largest = l > r ? l : r;
  return bend > 0 && fabs(l - r) <= 2.6 * bend && q - (l - r) * (l - r) / (8 * bend) <= share * largest;
}

// Where event function k falls through zero near check c, by a dip below zero: golden section. Returns whether it does; then
// [*a, *b] encloses the fall
static int dips(int k, const double *g, double *a, double *b, double *fa, double *fb, int c) {
  const double l = g[0], r = g[2 * MAX_EVENT_FUNCTIONS], golden = 0.3819660112501051;
  if (!may_dip(l, g[MAX_EVENT_FUNCTIONS], r, 0.05)) return 0;
  double low = (c - 1.0) / (CHECKS - 1), high = (c + 1.0) / (CHECKS - 1);
  *a = low, *fa = l;
  double x1 = low + golden * (high - low), x2 = high - golden * (high - low), f1 = event_at(k, x1), f2 = event_at(k, x2);
  while (high - low > 1e-9) {
    if (f1 < f2) high = x2, x2 = x1, f2 = f1, x1 = low + golden * (high - low), f1 = event_at(k, x1);
    else low = x1, x1 = x2, f1 = f2, x2 = high - golden * (high - low), f2 = event_at(k, x2);
  }
  *b = 0.5 * (low + high), *fb = event_at(k, *b);
  return *fb <= -1e-12 * (l > r ? l : r);
}

static double G[CHECKS][MAX_EVENT_FUNCTIONS];

// Whether an event function may fall through zero in the step: by the middle of a cubic through its ends, and a parabola through
// the three values. Most steps are far from any event and need no dense output, which costs a quarter of a step
static int may_end(void) {
  double z[MAX_VARIABLES], middle[MAX_EVENT_FUNCTIONS];
  for (int i = 0; i < nz; i++) z[i] = 0.5 * (Z[i] + ZN[i]) + 0.125 * step * (K[0][i] - K[12][i]);
  CALL(mode->event_values)(t + 0.5 * step, z, signs, p, middle);
  CALL(mode->event_values)(t + step, ZN, signs, p, G[CHECKS - 1]);
  for (int k = 0; k < mode->events; k++) {
    const double l = G[0][k], q = middle[k], r = G[CHECKS - 1][k];
    if ((l > 0 && q <= 0) || ((l > 0 || q > 0) && r <= 0)) return 1;
    if (!first_step && l > 0 && may_dip(l, q, r, 0.2)) return 1;
  }
  return 0;
}

// Fraction of the step at which the first event function falls through zero, or 2
static double first_event(int *which) {
  double z[MAX_VARIABLES], first = 2;
  for (int c = 1; c < CHECKS; c++) {
    const double x = (double)c / (CHECKS - 1);
    if (c < CHECKS - 1) at(x, z, nz);
    CALL(mode->event_values)(t + x * step, c < CHECKS - 1 ? z : ZN, signs, p, G[c]);
  }
  for (int k = 0; k < mode->events; k++) {
    double a, b, fa, fb;
    int fall = 1;
    while (fall < CHECKS && !(G[fall - 1][k] > 0 && G[fall][k] <= 0)) fall++;
    int found = 0;
    // In the first step of a mode functions rise from zero, where a parabola may lead below it
    if (!first_step && G[0][k] > 0)
      for (int c = 1; c + 1 < CHECKS && c + 1 < fall && !found; c++) found = dips(k, &G[c - 1][k], &a, &b, &fa, &fb, c);
    if (!found && fall < CHECKS) {
      found = 1, a = (fall - 1.0) / (CHECKS - 1), b = (double)fall / (CHECKS - 1);
      fa = G[fall - 1][k], fb = G[fall][k];
    }
    if (found) {
      const double x = root(k, a, b, fa, fb);
      if (x < first) first = x, *which = k;
    }
  }
  return first;
}

// Whole state from the variables of the mode; in rows of `width` numbers
static void whole(const double *z, double *y, int width) {
  memset(y, 0, NY * width * sizeof(double));
  for (int i = 0; i < nz; i++) memcpy(y + mode->places[i] * width, z + i * width, width * sizeof(double));
  if (mode->heavy_follows) memcpy(y + 4 * width, y + 2 * width, width * sizeof(double));
}

static void record(double code) {
  if (event_count < job->max_events) rows[event_count].code = code, rows[event_count].after = now;
  event_count++, status->events++;
}

static void record_times(const double *dt) { // derivatives of the time of the event that `record` notes next
  if (n && event_count < job->max_events) {
    double *to = event_partials + (long)event_count * n;
    if (dt) memcpy(to, dt, n * sizeof(double));
    else memset(to, 0, n * sizeof(double));
  }
}

static void enter_mode(void) {
  mode = &table->modes[(int)now.mode];
  memcpy(signs, now.s, sizeof signs);
  nz = mode->variables, n0 = n ? (nz + 3) & ~3 : nz, N = n0 + nz * n;
  for (int i = 0; i < nz; i++) {
    Z[i] = now.y[mode->places[i]];
    if (n) memcpy(Z + n0 + i * n, S + mode->places[i] * n, n * sizeof(double));
  }
  t = now.t, mode_steps = 0, first_step = 1, h_before = 0, error_before = 1;
  CALL(mode->event_values)(t, Z, signs, p, G[0]);
  rates(t, Z, K[0]);
}

// The samples that remain show the state where the run ended
static void finish(void) {
  status->samples = sample;
  if (n) memcpy(end_partials, S, NY * n * sizeof(double));
  for (; sample < sample_count; sample++) {
    memcpy(samples + (long)sample * NY, now.y, sizeof now.y);
    if (n) memcpy(partials + (long)sample * NY * n, S, NY * n * sizeof(double));
  }
  started = 0, run++;
}

static void fail(int failure) {
  now.t = t, whole(Z, now.y, 1);
  status->failure = failure;
  record_times(0);
  record(STOPPED);
  finish();
}

// The state within the series by which a run leaves rest: constant, linear and square term of the fraction of LEAVES_REST
static void in_series(const double series[3][NY], double time, double *y) {
  const double x = time / LEAVES_REST;
  for (int i = 0; i < NY; i++) y[i] = series[0][i] + x * (series[1][i] + x * series[2][i]);
}

static DenseRow *next_dense_row(void) { // 0: not wanted, or there is no room
  if (!job->dense) return 0;
  status->dense++;
  return dense_count++ < job->max_dense ? dense_rows + dense_count - 1 : 0;
}

static void end_by_time(void) {
  now.mode = ENDED;
  record_times(0);
  record(TIME_UP);
  finish();
}

static void start(void) {
  static struct { Motion released, after; double by_series, series[3][NY]; } begun;
  const int *starts = AT(job->starts);
  p = (const double *)AT(job->p) + (long)run * table->parameters;
  duration = ((const double *)AT(job->durations))[run];
  times = (const double *)AT(job->times) + starts[run], sample_count = starts[run + 1] - starts[run];
  samples = (double *)AT(job->samples) + (long)starts[run] * NY;
  partials = (double *)AT(job->partials) + (long)starts[run] * NY * n;
  end_partials = (double *)AT(job->end_partials) + (long)run * NY * n;
  status = (Status *)AT(job->status) + run;
  memset(status, 0, sizeof *status);
  sample = 0, late_events = 0, second = 0, started = 1, h = LEAVES_REST;
  CALL(table->release)(0, p, p, p, (double *)&begun);
  if (n) {
    CALL(table->release_jacobian)(0, p, p, p, jacobian);
    memset(S_NEXT, 0, 2 * NY * n * sizeof(double));
    multiply(table->release_structure, jacobian, S_NEXT, S_NEXT);
    memcpy(S, S_NEXT + NY * n, NY * n * sizeof(double));
  }
  now = begun.released, memcpy(now.s, begun.after.s, sizeof now.s);
  record_times(0);
  record(RELEASED);
  for (; sample < sample_count && times[sample] <= 0; sample++) {
    memcpy(samples + NY * sample, now.y, sizeof now.y);
    if (n) memcpy(partials + (long)sample * NY * n, S_NEXT, NY * n * sizeof(double));
  }
  now = begun.after;
  const int by_series = begun.by_series != 0, over = now.t >= duration;
  if (over) now.t = duration;
  for (; by_series && sample < sample_count && times[sample] <= now.t; sample++) {
    in_series(begun.series, times[sample], samples + NY * sample);
    if (n) memcpy(partials + (long)sample * NY * n, S, NY * n * sizeof(double));
  }
  DenseRow *row = by_series ? next_dense_row() : 0;
  if (row) {
    memset(row, 0, sizeof *row);
    row->t = 0, row->h = LEAVES_REST, row->mode = now.mode;
    // As `at` takes them: Z + x (D0 + (1 - x) D1)
    for (int i = 0; i < NY; i++) {
      row->y[0][i] = begun.series[0][i];
      row->y[1][i] = begun.series[1][i] + begun.series[2][i], row->y[2][i] = -begun.series[2][i];
    }
  }
  if (over) {
    if (by_series) in_series(begun.series, duration, now.y);
    end_by_time();
  } else
    enter_mode();
}

static void sample_until(double end) {
  for (; sample < sample_count && times[sample] <= end; sample++) {
    const double x = (times[sample] - t) / step;
    at(x, ZS, n ? N : nz);
    whole(ZS, samples + (long)sample * NY, 1);
    if (n) whole(ZS + n0, partials + (long)sample * NY * n, n);
  }
}

static void keep_dense(void) {
  DenseRow *row = next_dense_row();
  if (!row) return;
  row->t = t, row->h = step, row->mode = now.mode;
  whole(Z, row->y[0], 1);
  for (int k = 0; k < 7; k++) whole(D[k], row->y[1 + k], 1);
}

// dg/dt + dg/dz f, with the gradient of event function k in `jacobian`
static double slope_of(int k, double time, const double *z) {
  double f[MAX_VARIABLES];
  CALL(mode->rates)(time, z, signs, p, f);
  CALL(mode->gradient[k])(time, z, signs, p, jacobian);
  const int32_t *e = (const int32_t *)table + mode->gradient_structure[k], *column = e + 5;
  double slope = jacobian[0];
  for (int i = 0; i < e[1]; i++) slope += jacobian[1 + i] * f[column[i]];
  return slope;
}

// Derivatives of the time of event k at `now.t`, and of the whole state there, S; f: rates before it
static void derivatives_at_event(int k, int phase, const double *z, const double *f, double *dt) {
  double earlier[MAX_VARIABLES];
  for (int i = 0; i < nz; i++) earlier[i] = z[i] - GRAZING_STEP * f[i];
  const double before = slope_of(k, now.t - GRAZING_STEP, earlier), slope = slope_of(k, now.t, z);
  memset(dt, 0, n * sizeof(double));
  if (fabs(before) > 2 * fabs(slope)) { // grazed: its function touches zero, so that no derivative exists
    if (!mode->continuous[k][phase])
      for (int c = 0; c < n; c++) dt[c] = NAN;
  } else {
    multiply(mode->gradient_structure[k], jacobian + 1, z + n0, dt);
    for (int c = 0; c < n; c++) dt[c] = -dt[c] / slope;
  }
  memcpy(ZS, z + n0, nz * n * sizeof(double));
  for (int i = 0; i < nz; i++)
    for (int c = 0; c < n; c++) ZS[i * n + c] += f[i] * dt[c];
  whole(ZS, S, n);
}

// S of the state at the event -> S of the motion `moved` just after it, at fixed time
static void derivatives_after_event(int k, int phase, const Motion *moved, const double *dt) {
  double z[MAX_VARIABLES], f[MAX_VARIABLES];
  CALL(mode->apply_jacobian[k][phase])(now.t, now.y, signs, p, jacobian);
  memset(S_NEXT, 0, NY * n * sizeof(double));
  multiply(mode->apply_structure[k][phase], jacobian, S, S_NEXT);
  const Mode *next = &table->modes[(int)moved->mode];
  for (int i = 0; i < next->variables; i++) z[i] = moved->y[next->places[i]];
  CALL(next->rates)(now.t, z, moved->s, p, f);
  for (int i = 0; i < next->variables; i++)
    for (int c = 0; c < n; c++) S_NEXT[next->places[i] * n + c] -= f[i] * dt[c];
  if (next->heavy_follows) memcpy(S_NEXT + 4 * n, S_NEXT + 2 * n, n * sizeof(double));
  memcpy(S, S_NEXT, NY * n * sizeof(double));
}

// Event k at the end of the step that was taken: ZN at time `end`
static void apply_event(int k, double end) {
  static double dt[MAX_COLUMNS];
  const int phase = mode->of_rod[k] ? !(signs[5] != 0 && signs[6] == 0) : signs[3] != 0;
  const int code = mode->code[k][phase], continuous = mode->continuous[k][phase];
  Motion moved;
  now.t = end, whole(ZN, now.y, 1);
  CALL(mode->apply[k][phase])(end, now.y, signs, p, (double *)&moved);
  if (n) {
    derivatives_at_event(k, phase, ZN, K[12], dt);
    record_times(dt);
    if (!mode->ends[k][phase]) derivatives_after_event(k, phase, &moved, dt);
  }
  now = moved;
  record(code);
  if ((int)now.mode == ENDED) {
    finish();
    return;
  }
  if (now.t > second + 1) second = now.t, late_events = 0;
  if (++late_events > MAX_EVENTS) {
    fail(TOO_MANY_EVENTS);
    return;
  }
  enter_mode();
  h = continuous ? h : 0.2 * h;
}

// The length of the next step, of which this one's error tells; predictive, as the string's winding shortens steps steadily
static double next_step(double error, int rejected) {
  double factor = error == 0 ? 10 : 0.9 / sqrt(sqrt(sqrt(error)));
  // Now and then the estimate of the error cancels: from a step four times as long a run had 1000 times the error asked for
  const double most = mode_steps < 10 ? 10 : 1.5;
  if (factor > most) factor = most;
  if (h_before > 0 && error > 0) {
    const double again = factor * (h / h_before) * sqrt(sqrt(sqrt(error_before / error)));
    if (again < factor) factor = again;
  }
  if (factor < 0.2) factor = 0.2;
  if (rejected && factor > 1) factor = 1;
  h_before = h, error_before = error > 1e-4 ? error : 1e-4;
  return h * factor;
}

// Move the end of the step, which the dense output set at a root of event function k, to the root itself by Newton's method, as
// long as that comes closer. It may be a thousandth of a step: a slide that ended so much too early went on after its stop
static void come_closer(int k) {
  double here, beyond, z[MAX_VARIABLES];
  CALL(mode->each[k])(t + step, ZN, signs, p, &here);
  for (int i = 0; i < 4; i++) {
    const double dt = 1e-6 * step, before = step, value = here;
    for (int j = 0; j < nz; j++) z[j] = ZN[j] + dt * K[12][j];
    CALL(mode->each[k])(t + step + dt, z, signs, p, &beyond);
    const double correction = -here * dt / (beyond - here);
    if (!(fabs(correction) < 0.1 * step && fabs(correction) > 1e-2 * rtol)) return;
    step += correction, attempt(t, step);
    CALL(mode->each[k])(t + step, ZN, signs, p, &here);
    if (fabs(here) >= fabs(value)) {
      step = before, attempt(t, step);
      return;
    }
  }
}

// Take one step, shortened to the first event in it or to the limit of the time
static void take_step(void) {
  if (++mode_steps > (job->max_steps ? job->max_steps : MAX_STEPS)) {
    fail(TOO_MANY_STEPS);
    return;
  }
  const double smallest = 10 * EPSILON * (t > 1e-300 ? t : 1e-300);
  if (h < smallest) h = smallest;
  double error;
  for (int rejected = 0;; rejected = 1) {
    attempt(t, h);
    error = error_of(h);
    if (error < 1) {
      step = h, h = next_step(error, rejected);
      break;
    }
    const double factor = 0.9 / sqrt(sqrt(sqrt(error)));
    h *= factor > 0.2 ? factor : 0.2;   // also if the error is not a number
    if (!(h >= smallest)) {
      fail(BROKE_DOWN);
      return;
    }
  }
  int k = -1;
  double fraction = 2;
  if (may_end()) {
    complete(t, step);
    fraction = first_event(&k);
  } else if (job->dense || (sample < sample_count && times[sample] <= t + step))
    complete(t, step);
  const int over = t + (fraction < 1 ? fraction : 1) * step >= duration;
  if (over || fraction <= 1) {
    // Once more, exactly to there: the dense output is of a lower order
    step = over ? duration - t : fraction * step;
    attempt(t, step);
    if (!over) come_closer(k);
    complete(t, step);
    const double end = over ? duration : t + step;
    sample_until(end);
    keep_dense();
    if (over) {
      now.t = end, whole(ZN, now.y, 1);
      if (n) whole(ZN + n0, S, n);
      end_by_time();
    } else
      apply_event(k, end);
    return;
  }
  sample_until(t + step);
  keep_dense();
  first_step = 0;
  memcpy(G[0], G[CHECKS - 1], sizeof G[0]);
  t += step;
  memcpy(Z, ZN, N * sizeof(double));
  memcpy(K[0], K[12], N * sizeof(double));
}

EXPORT void begin(const Job *given) {
  job = given, model = AT(job->model), table = AT(model->table), jacobian = AT(model->jacobian);
  seed_start = AT(job->seed_starts), seed_column = AT(job->seed_columns), seed_weight = AT(job->seed_weights);
  rows = AT(job->events), event_partials = AT(job->event_partials), dense_rows = AT(job->dense);
  rtol = job->rtol, n = job->n, run = 0, started = 0, event_count = 0, dense_count = 0;
}

// Work for at most so many steps; return whether all runs have ended
EXPORT int advance(int steps) {
  while (run < job->runs) {
    if (steps-- <= 0) return 0;
    if (!started) start();
    else take_step();
  }
  return 1;
}

/* The inner loops of a revolution, compiled: from the samples between two contacts to waveforms and contact times.
 *
 * Every function has the same function in numpy beside its only caller, named in its comment; that one is the reference.
 * A function gets all arrays from its caller, the result and the working space included, and allocates nothing. Arrays
 * are C-contiguous float64 unless stated. Sizes that do not fit together raise ValueError before anything is written.
 *
 * Only what the stable ABI of Python 3.11 has is used, so that one file serves all later versions.
 */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* Compiled for wide vectors too, chosen at load, with the same bits. Only glibc's loader chooses. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define FOR_THIS_PROCESSOR __attribute__((target_clones("avx2", "default")))
#else
#define FOR_THIS_PROCESSOR
#endif

#define PI 3.14159265358979323846
#define MOST_ARRAYS 12
/* Samples by which a line begins before the first, as LEFT_PAD in gateway/core/revolutions/angle_resampling.py. */
#define LEFT_PAD 3
#define MOST_TAPS 6
/* Points of a spline worked on at once: their weights stay in the nearest cache. */
#define TOGETHER 64
/* Numbers that a contact's samples are fitted by: both shifts, gain, offset and ramp. */
#define FITTED 5
/* Highest plausible peak over the mean, and iterations, as in gateway/core/revolutions/speed_normalisation.py. */
#define MAX_PEAK_RATIO 6.0
#define ITERATIONS 3

/* ---- Arguments ------------------------------------------------------------------------------------------------- */

/* Arrays that a call holds until `release`. */
typedef struct {
    Py_buffer views[MOST_ARRAYS];
    int count;
} Held;

static void release(Held *held)
{
    while (held->count > 0)
        PyBuffer_Release(&held->views[--held->count]);
}

static Py_buffer *hold(Held *held, PyObject *object, int flags)
{
    Py_buffer *view = &held->views[held->count];
    if (PyObject_GetBuffer(object, view, flags) < 0)
        return NULL;
    held->count++;
    return view;
}

static int has_format(const Py_buffer *view, char format, Py_ssize_t size)
{
    const char *given = view->format;
    return given && given[0] == format && given[1] == '\0' && view->itemsize == size;
}

/* The numbers of an array of exactly `count` of them, any number where it is -1; NULL with an exception set. */
static double *numbers(Held *held, PyObject *object, Py_ssize_t count, int flags)
{
    Py_buffer *view = hold(held, object, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | flags);
    if (!view)
        return NULL;
    if (!has_format(view, 'd', sizeof(double))) {
        PyErr_SetString(PyExc_TypeError, "an array of float64 is needed");
        return NULL;
    }
    if (count >= 0 && view->len != count * (Py_ssize_t)sizeof(double)) {
        PyErr_SetString(PyExc_ValueError, "arrays that belong together differ in size");
        return NULL;
    }
    return view->buf;
}

static Py_ssize_t count_of(const Held *held)
{
    return held->views[held->count - 1].len / (Py_ssize_t)sizeof(double);
}

static int has_arguments(Py_ssize_t given, Py_ssize_t wanted)
{
    if (given == wanted)
        return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments are needed, not %zd", wanted, given);
    return 0;
}

/* `count` Python floats as numbers; 0 with an exception set. */
static int floats(PyObject *const *objects, int count, double *values)
{
    for (int i = 0; i < count; i++) {
        values[i] = PyFloat_AsDouble(objects[i]);
        if (values[i] == -1.0 && PyErr_Occurred())
            return 0;
    }
    return 1;
}

static PyObject *refused(Held *held, const char *why)
{
    release(held);
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, why);
    return NULL;
}

static PyObject *done(Held *held)
{
    release(held);
    Py_INCREF(Py_None);
    return Py_None;
}

/* ---- Splines: gateway/core/revolutions/angle_resampling.py ---------------------------------------------------------------- */

/* Angle against time: 0 at `start`, rate in rad/sample there, acceleration in rad/sample^2; in the order of Phase. */
typedef struct {
    double start, end, rate, acceleration;
} Phase;

/* Write samples into lines from LEFT_PAD on, lines[i * axes + axis], continued by reflection at both ends. */
static void fill_lines(const Py_buffer *samples, Py_ssize_t axes, const double *offsets, const double *factors,
                       double *lines, Py_ssize_t length)
{
    Py_ssize_t rows = samples->shape[0], end = LEFT_PAD + rows;
    Py_ssize_t row_step = samples->strides[0], axis_step = samples->ndim > 1 ? samples->strides[1] : 0;
    const char *base = samples->buf;
    double *line = lines + LEFT_PAD * axes;
    if (samples->itemsize == sizeof(int16_t)) {
        for (Py_ssize_t i = 0; i < rows; i++)
            for (Py_ssize_t axis = 0; axis < axes; axis++)
                *line++ = (*(const int16_t *)(base + i * row_step + axis * axis_step) - offsets[axis]) * factors[axis];
    } else {
        for (Py_ssize_t i = 0; i < rows; i++)
            for (Py_ssize_t axis = 0; axis < axes; axis++)
                *line++ = (*(const double *)(base + i * row_step + axis * axis_step) - offsets[axis]) * factors[axis];
    }
    for (Py_ssize_t i = 0; i < LEFT_PAD; i++)
        memcpy(lines + i * axes, lines + (2 * LEFT_PAD - i) * axes, axes * sizeof(double));
    while (end < length) {
        Py_ssize_t more = length - end < rows - 1 ? length - end : rows - 1;
        for (Py_ssize_t i = 0; i < more; i++)
            memcpy(lines + (end + i) * axes, lines + (end - 2 - i) * axes, axes * sizeof(double));
        end += more;
    }
}

/* Solve the filter's equations of one pole in place: L D L^T c = s, L having `beside` below its diagonal of ones. */
static inline void solve_pole(double *lines, Py_ssize_t length, int axes, const double *inverse, const double *beside)
{
    double *last = lines + (length - 1) * axes;
    for (int axis = 0; axis < axes; axis++) {
        lines[axis] *= 0.5;
        last[axis] *= 0.5;
    }
    for (Py_ssize_t i = 1; i < length; i++)
        for (int axis = 0; axis < axes; axis++)
            lines[i * axes + axis] -= lines[(i - 1) * axes + axis] * beside[i - 1];
    for (int axis = 0; axis < axes; axis++)
        last[axis] *= inverse[length - 1];
    for (Py_ssize_t i = length - 2; i >= 0; i--)
        for (int axis = 0; axis < axes; axis++)
            lines[i * axes + axis] = lines[i * axes + axis] * inverse[i] - lines[(i + 1) * axes + axis] * beside[i];
}

/* Apply the spline's filter; `filter` has for each pole the inverse diagonal and what stands beside it. */
static void apply_filter(double *lines, Py_ssize_t length, Py_ssize_t axes, const double *filter, Py_ssize_t poles)
{
    for (Py_ssize_t pole = 0; pole < poles; pole++, filter += 2 * length) {
        /* The number of axes as a constant lets the compiler keep them in registers. */
        switch (axes) {
        case 1: solve_pole(lines, length, 1, filter, filter + length); break;
        case 2: solve_pole(lines, length, 2, filter, filter + length); break;
        case 3: solve_pole(lines, length, 3, filter, filter + length); break;
        default: solve_pole(lines, length, (int)axes, filter, filter + length);
        }
    }
}

/* Read the splines at angles, out[axis * out_step + i]; `basis` has for each power of the place between two samples its
 * factor in each of the taps. Sample positions are kept from `low` to `high`. */
static inline void read_lines(const double *lines, int axes, int taps, const double *basis, const double *angles,
                              Py_ssize_t count, const Phase *phase, double low, double high, double *out,
                              Py_ssize_t out_step)
{
    double place[TOGETHER], weights[MOST_TAPS][TOGETHER];
    int32_t first[TOGETHER];
    double square = phase->rate * phase->rate, twice = 2.0 * phase->acceleration;
    int before = LEFT_PAD - (taps - 1) / 2;
    for (Py_ssize_t begin = 0; begin < count; begin += TOGETHER) {
        int size = count - begin < TOGETHER ? (int)(count - begin) : TOGETHER;
        for (int i = 0; i < size; i++) {
            double angle = angles[begin + i], speed2 = twice * angle + square;
            /* 2 c / (b + sqrt(b^2 + 2 a c)) avoids cancellation and division by a vanishing acceleration. */
            double position = 2.0 * angle / (sqrt(speed2 > 0.0 ? speed2 : 0.0) + phase->rate) + phase->start;
            position = position > low ? position : low;
            position = position < high ? position : high;
            first[i] = (int32_t)position;
            place[i] = position - first[i];
        }
        for (int tap = 0; tap < taps; tap++)
            for (int i = 0; i < size; i++) {
                double weight = basis[(taps - 1) * taps + tap];
                for (int power = taps - 2; power >= 0; power--)
                    weight = weight * place[i] + basis[power * taps + tap];
                weights[tap][i] = weight;
            }
        for (int i = 0; i < size; i++) {
            const double *read = lines + (first[i] + before) * (Py_ssize_t)axes;
            for (int axis = 0; axis < axes; axis++) {
                double sum = read[axis] * weights[0][i];
                for (int tap = 1; tap < taps; tap++)
                    sum += read[tap * axes + axis] * weights[tap][i];
                out[axis * out_step + begin + i] = sum;
            }
        }
    }
}

static void read_splines(const double *lines, Py_ssize_t axes, int taps, const double *basis, const double *angles,
                         Py_ssize_t count, const Phase *phase, double low, double high, double *out,
                         Py_ssize_t out_step)
{
    if (axes == 3 && taps == 4)
        read_lines(lines, 3, 4, basis, angles, count, phase, low, high, out, out_step);
    else if (axes == 3)
        read_lines(lines, 3, 6, basis, angles, count, phase, low, high, out, out_step);
    else if (axes == 1 && taps == 6)
        read_lines(lines, 1, 6, basis, angles, count, phase, low, high, out, out_step);
    else
        read_lines(lines, (int)axes, taps, basis, angles, count, phase, low, high, out, out_step);
}

/* Number of taps of a basis (taps, taps), 0 where it is neither that of a cubic nor of a quintic spline. */
static int taps_of(Py_ssize_t size)
{
    return size == 16 ? 4 : size == 36 ? 6 : 0;
}

/* resample(samples, offsets, factors, filter, basis, angles, phase, lines, out)
 *
 * One revolution on the angle grid; `_resampled_by_numpy` in gateway/core/revolutions/angle_resampling.py.
 *   samples  (m, axes) int16 or float64, any strides
 *   offsets, factors  (axes,) in counts, and m/s^2 per count times the filter's gain
 *   filter   (poles, 2, length)
 *   basis    (taps, taps)
 *   angles   (n,) rad since the revolution's start
 *   phase    (4,) as Phase
 *   lines    (length, axes) working space, length at least m + LEFT_PAD + taps
 *   out      (axes, n) m/s^2
 */
static PyObject *resample(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    if (!has_arguments(nargs, 9))
        return NULL;
    Py_buffer *samples = hold(&held, args[0], PyBUF_STRIDES | PyBUF_FORMAT);
    if (!samples)
        return refused(&held, "");
    if (samples->ndim != 2 || !(has_format(samples, 'h', sizeof(int16_t)) || has_format(samples, 'd', sizeof(double))))
        return refused(&held, "samples are (m, axes), int16 or float64");
    Py_ssize_t rows = samples->shape[0], axes = samples->shape[1];
    double *offsets = numbers(&held, args[1], axes, 0);
    double *factors = offsets ? numbers(&held, args[2], axes, 0) : NULL;
    double *filter = factors ? numbers(&held, args[3], -1, 0) : NULL;
    Py_ssize_t in_filter = filter ? count_of(&held) : 0;
    double *basis = filter ? numbers(&held, args[4], -1, 0) : NULL;
    int taps = basis ? taps_of(count_of(&held)) : 0;
    double *angles = basis ? numbers(&held, args[5], -1, 0) : NULL;
    Py_ssize_t count = angles ? count_of(&held) : 0;
    double *phase = angles ? numbers(&held, args[6], 4, 0) : NULL;
    double *lines = phase ? numbers(&held, args[7], -1, PyBUF_WRITABLE) : NULL;
    Py_ssize_t length = lines && axes ? count_of(&held) / axes : 0;
    double *out = lines ? numbers(&held, args[8], axes * count, PyBUF_WRITABLE) : NULL;
    if (!out)
        return refused(&held, "");
    const Phase *at = (const Phase *)phase;
    Py_ssize_t poles = length ? in_filter / (2 * length) : 0;
    if (!taps || rows < 2 * LEFT_PAD || length < rows + LEFT_PAD + taps || in_filter != poles * 2 * length || !poles)
        return refused(&held, "samples, filter and basis do not fit together");
    if (!(at->start >= 0.0 && at->end >= at->start && at->end <= (double)(rows - 1)))
        return refused(&held, "the samples do not cover the revolution");
    fill_lines(samples, axes, offsets, factors, lines, length);
    apply_filter(lines, length, axes, filter, poles);
    read_splines(lines, axes, taps, basis, angles, count, at, at->start, at->end, out, count);
    return done(&held);
}

/* ---- Gravity and speed: gateway/core/revolutions/speed_normalisation.py --------------------------------------------------- */

/* Cosine of angles of a few turns, within 1e-15; loops over it are vectorised.
 *
 * The versine v(x) = 1 - cos x keeps its relative accuracy under v(2 x) = 2 v(x) (2 - v(x)), so the series is needed for
 * an eighth of the angle only, up to pi / 8, where the first term left out is 2e-19 of the first.
 */
static inline double cosine(double angle)
{
    /* The nearest whole number of turns: adding 1.5 * 2^52 rounds to whole numbers. */
    const double rounding = 6755399441055744.0;
    double turns = (angle * (0.5 / PI) + rounding) - rounding;
    /* 2 pi in two parts, the first of 33 bits: its product with few turns is exact. */
    double eighth = 0.125 * ((angle - turns * 0x1.921fb544p+2) - turns * 2.430840202602477e-10);
    double x2 = eighth * eighth;
    double v = 1.0 / 87178291200.0;
    v = 1.0 / 479001600.0 - x2 * v;
    v = 1.0 / 3628800.0 - x2 * v;
    v = 1.0 / 40320.0 - x2 * v;
    v = 1.0 / 720.0 - x2 * v;
    v = 1.0 / 24.0 - x2 * v;
    v = x2 * (0.5 - x2 * v);
    v = 2.0 * v * (2.0 - v);
    v = 2.0 * v * (2.0 - v);
    v = 2.0 * v * (2.0 - v);
    return 1.0 - v;
}

/* How the steady value of an AC-coupled signal is restored. */
enum { IS_DC, BY_CONTACT, BY_STEADY_VALUE, AS_IT_IS };

/* What a revolution's normalisation starts from: speed against angle, and how the steady value is restored. */
typedef struct {
    double rate, acceleration, samples; /* rad/sample and rad/sample^2 at the start, length in samples */
    double steady;                      /* R Omega^2, m/s^2 */
    double interior[2];                 /* first and last (exclusive) point in contact */
} Row;

/* One revolution; returns whether the waveform closes into a belt. Sets shape, angle and constant. */
FOR_THIS_PROCESSOR static int normalise_row(const double *radial, const Row *row, int mode, double gravity, const double *theta,
                         const double *elapsed, Py_ssize_t n, double *shape, double *angle, double *gain,
                         double *constant)
{
    double scale = (row->samples / (2.0 * PI)) * (row->samples / (2.0 * PI));
    double square = row->rate * row->rate * scale, twice = 2.0 * row->acceleration * scale;
    int closed = mode != AS_IT_IS;
    for (Py_ssize_t i = 0; i < n; i++)
        gain[i] = 1.0 / (twice * elapsed[i] + square);
    for (Py_ssize_t i = 0; i < n; i++)
        shape[i] = radial[i] - gravity * cosine(theta[i]);
    for (int iteration = 0; iteration < (gravity != 0.0 ? ITERATIONS : 1); iteration++) {
        if (closed && mode == BY_CONTACT) {
            double sum = 0.0;
            for (Py_ssize_t i = (Py_ssize_t)row->interior[0]; i < (Py_ssize_t)row->interior[1]; i++)
                sum += shape[i];
            *constant = -sum / (row->interior[1] - row->interior[0]);
        } else if (closed && mode == BY_STEADY_VALUE) {
            double sum = 0.0, of_gain = 0.0;
            for (Py_ssize_t i = 0; i < n; i++) {
                sum += shape[i] * gain[i];
                of_gain += gain[i];
            }
            *constant = (row->steady - sum / n) / (of_gain / n);
        }
        /* angle: the integral of kappa R from theta = 0, where the belt lies on the road, by the trapezoidal rule. */
        double sum = 0.0, highest = 0.0;
        for (Py_ssize_t i = 0; i < n; i++) {
            double corrected = (shape[i] + *constant) * gain[i];
            sum += corrected;
            angle[i] = sum - 0.5 * corrected;
            corrected = fabs(corrected);
            highest = corrected > highest ? corrected : highest;
        }
        double mean = sum / n;
        /* The mean cannot be R Omega^2 when it is not positive or not finite, or peaks exceed it by far. */
        closed = closed && mean > 0.0 && mean <= DBL_MAX && highest < MAX_PEAK_RATIO * mean;
        if (closed) {
            double middle = angle[n / 2], step = 2.0 * PI / n / mean;
            for (Py_ssize_t i = 0; i < n; i++)
                angle[i] = (angle[i] - middle) * step;
        } else {
            memcpy(angle, theta, n * sizeof(double));
        }
        if (gravity != 0.0)
            for (Py_ssize_t i = 0; i < n; i++)
                shape[i] = radial[i] - gravity * cosine(angle[i]);
    }
    if (mode != AS_IT_IS)
        for (Py_ssize_t i = 0; i < n; i++)
            shape[i] = (shape[i] + *constant) * gain[i];
    return closed;
}

/* normalise(radial, rows, modes, gravity, theta, elapsed, gain, shape, angle, constant, closed)
 *
 * Revolutions without gravity and at their mean speed; `_normalised_by_numpy` in gateway/core/revolutions/speed_normalisation.py.
 *   radial   (k, n) m/s^2
 *   rows     (k, 6) as Row
 *   modes    (k,) how each steady value is restored
 *   gravity  m/s^2
 *   theta, elapsed  (n,) rad
 *   gain     (n,) working space
 *   shape, angle    (k, n) out
 *   constant, closed  (k,) out; constant is 0 before
 */
static PyObject *normalise(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double gravity;
    if (!has_arguments(nargs, 11) || !floats(&args[3], 1, &gravity))
        return NULL;
    double *modes = numbers(&held, args[2], -1, 0);
    Py_ssize_t k = modes ? count_of(&held) : 0;
    double *theta = modes ? numbers(&held, args[4], -1, 0) : NULL;
    Py_ssize_t n = theta ? count_of(&held) : 0;
    double *elapsed = theta ? numbers(&held, args[5], n, 0) : NULL;
    double *radial = elapsed ? numbers(&held, args[0], k * n, 0) : NULL;
    double *rows = radial ? numbers(&held, args[1], k * (Py_ssize_t)(sizeof(Row) / sizeof(double)), 0) : NULL;
    double *gain = rows ? numbers(&held, args[6], n, PyBUF_WRITABLE) : NULL;
    double *shape = gain ? numbers(&held, args[7], k * n, PyBUF_WRITABLE) : NULL;
    double *angle = shape ? numbers(&held, args[8], k * n, PyBUF_WRITABLE) : NULL;
    double *constant = angle ? numbers(&held, args[9], k, PyBUF_WRITABLE) : NULL;
    double *closed = constant ? numbers(&held, args[10], k, PyBUF_WRITABLE) : NULL;
    if (!closed)
        return refused(&held, "");
    for (Py_ssize_t i = 0; i < k; i++) {
        const Row *row = (const Row *)rows + i;
        if (modes[i] == BY_CONTACT &&
            !(row->interior[0] >= 0.0 && row->interior[0] < row->interior[1] && row->interior[1] <= (double)n))
            return refused(&held, "the contact lies outside the revolution");
    }
    for (Py_ssize_t i = 0; i < k; i++)
        closed[i] = normalise_row(radial + i * n, (const Row *)rows + i, (int)modes[i], gravity, theta, elapsed, n,
                                  shape + i * n, angle + i * n, gain, constant + i);
    return done(&held);
}

/* ---- Contact times: gateway/core/contacts/contact_template.py ---------------------------------------------------------- */

/* spline_lines(samples, offsets, factors, filter, lines)
 *
 * Coefficients of a spline through samples; `_coefficients_by_numpy` in gateway/core/revolutions/angle_resampling.py. Arguments
 * as of `resample`; samples may be (m,).
 */
static PyObject *spline_lines(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    if (!has_arguments(nargs, 5))
        return NULL;
    Py_buffer *samples = hold(&held, args[0], PyBUF_STRIDES | PyBUF_FORMAT);
    if (!samples)
        return refused(&held, "");
    if (samples->ndim < 1 || samples->ndim > 2 ||
        !(has_format(samples, 'h', sizeof(int16_t)) || has_format(samples, 'd', sizeof(double))))
        return refused(&held, "samples are (m,) or (m, axes), int16 or float64");
    Py_ssize_t rows = samples->shape[0], axes = samples->ndim > 1 ? samples->shape[1] : 1;
    double *offsets = numbers(&held, args[1], axes, 0);
    double *factors = offsets ? numbers(&held, args[2], axes, 0) : NULL;
    double *filter = factors ? numbers(&held, args[3], -1, 0) : NULL;
    Py_ssize_t in_filter = filter ? count_of(&held) : 0;
    double *lines = filter ? numbers(&held, args[4], -1, PyBUF_WRITABLE) : NULL;
    if (!lines)
        return refused(&held, "");
    Py_ssize_t length = axes ? count_of(&held) / axes : 0, poles = length ? in_filter / (2 * length) : 0;
    if (rows < LEFT_PAD + 1 || length < rows + LEFT_PAD || in_filter != poles * 2 * length || !poles)
        return refused(&held, "samples and filter do not fit together");
    fill_lines(samples, axes, offsets, factors, lines, length);
    apply_filter(lines, length, axes, filter, poles);
    return done(&held);
}

/* match(lines, last, phases, rates_hz, basis, angles, values, gravity, rows, model, middle, change, out)
 *
 * Contacts timed against a template; `_matched_by_numpy` in gateway/core/contacts/contact_template.py.
 *   lines    (k, length) spline coefficients of the samples around each contact
 *   last     (k,) last sample of each
 *   phases   (k, 4) as Phase, angle 0 at the approximate centre
 *   rates_hz (k,) sampling rates
 *   basis    (6, 6)
 *   angles, values, gravity  (m,) of the template: rad, waveform over the square of its angular speed, m/s^2
 *   rows     (FITTED, m) from the change of the samples to both shifts, gain, offset and ramp
 *   model    (m, FITTED) back from these
 *   middle   number of points in the leading half
 *   change   (m,) working space
 *   out      (k, FITTED): shift of either half, gain's change, sum of squares that is left in either half
 */
static PyObject *match(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double middle;
    if (!has_arguments(nargs, 13) || !floats(&args[10], 1, &middle))
        return NULL;
    double *last = numbers(&held, args[1], -1, 0);
    Py_ssize_t k = last ? count_of(&held) : 0;
    double *lines = last ? numbers(&held, args[0], -1, 0) : NULL;
    Py_ssize_t length = lines && k ? count_of(&held) / k : 0, whole = lines ? count_of(&held) : 0;
    double *phases = lines ? numbers(&held, args[2], 4 * k, 0) : NULL;
    double *rates_hz = phases ? numbers(&held, args[3], k, 0) : NULL;
    double *basis = rates_hz ? numbers(&held, args[4], MOST_TAPS * MOST_TAPS, 0) : NULL;
    double *angles = basis ? numbers(&held, args[5], -1, 0) : NULL;
    Py_ssize_t m = angles ? count_of(&held) : 0;
    double *values = angles ? numbers(&held, args[6], m, 0) : NULL;
    double *gravity = values ? numbers(&held, args[7], m, 0) : NULL;
    double *rows = gravity ? numbers(&held, args[8], FITTED * m, 0) : NULL;
    double *model = rows ? numbers(&held, args[9], m * FITTED, 0) : NULL;
    double *change = model ? numbers(&held, args[11], m, PyBUF_WRITABLE) : NULL;
    double *out = change ? numbers(&held, args[12], k * FITTED, PyBUF_WRITABLE) : NULL;
    if (!out)
        return refused(&held, "");
    if (whole != k * length || !(middle >= 0.0 && middle <= (double)m))
        return refused(&held, "contacts and template do not fit together");
    for (Py_ssize_t c = 0; c < k; c++)
        if (!(last[c] >= 0.0 && last[c] + LEFT_PAD + MOST_TAPS <= (double)length))
            return refused(&held, "the lines are too short");
    for (Py_ssize_t c = 0; c < k; c++, out += FITTED) {
        const Phase *phase = (const Phase *)phases + c;
        double square = phase->rate * phase->rate, twice = 2.0 * phase->acceleration;
        double of_rate = rates_hz[c] * rates_hz[c], fitted[FITTED] = {0.0}, left[2] = {0.0, 0.0};
        read_splines(lines + c * length, 1, MOST_TAPS, basis, angles, m, phase, 0.0, last[c], change, m);
        for (Py_ssize_t i = 0; i < m; i++)
            change[i] = (change[i] - gravity[i]) / (of_rate * (square + twice * angles[i])) - values[i];
        for (Py_ssize_t i = 0; i < m; i++)
            for (int j = 0; j < FITTED; j++)
                fitted[j] += rows[j * m + i] * change[i];
        for (Py_ssize_t i = 0; i < m; i++) {
            double rest = change[i];
            for (int j = 0; j < FITTED; j++)
                rest -= model[i * FITTED + j] * fitted[j];
            left[i >= (Py_ssize_t)middle] += rest * rest;
        }
        for (int side = 0; side < 2; side++) {
            out[side] = fitted[side] / (1.0 + fitted[2]);
            out[3 + side] = left[side];
        }
        out[2] = fitted[2];
    }
    return done(&held);
}

/* ---- Segmentation: gateway/core/contacts/segmentation.py, gateway/core/contacts/dips.py ---------------------------------------- */

/* Boxes of the dip score in units of the contact duration, as in gateway/core/contacts/dips.py. */
#define CENTRE_HALF 0.35
#define FLANK_INNER 0.75
#define FLANK_OUTER 1.5
/* Largest number of revolutions to the next contact, and shares of its depth, as in gateway/core/contacts/contact_tracking.py. */
#define MOST_TURNS 3.0
#define ACCEPT_SHARE 0.45
#define SURE_SHARE 0.25
#define ACCEPT_GRAVITY_MPS2 4.0

typedef struct {
    double centre, inner, outer;
} Boxes;

static Boxes boxes_of(double width)
{
    Boxes boxes;
    boxes.centre = fmax(1.0, rint(CENTRE_HALF * width));
    boxes.inner = fmax(boxes.centre + 1.0, rint(FLANK_INNER * width));
    boxes.outer = fmax(boxes.inner + 1.0, rint(FLANK_OUTER * width));
    return boxes;
}

static double mean_of(const double *prefix, double first, double last)
{
    return (prefix[(Py_ssize_t)last] - prefix[(Py_ssize_t)first]) / (last - first);
}

/* The value that would be at `rank` if the n values were sorted; reorders them. None may be NaN. */
static double selected(double *values, Py_ssize_t n, Py_ssize_t rank)
{
    Py_ssize_t low = 0, high = n - 1;
    while (low < high) {
        double pivot = values[low + (high - low) / 2];
        Py_ssize_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i <= j) {
                double other = values[i];
                values[i++] = values[j];
                values[j--] = other;
            }
        }
        if (rank <= j)
            high = j;
        else if (rank >= i)
            low = i;
        else
            break;
    }
    return values[rank];
}

/* Standard deviation of white noise from the median of second differences; n working values. */
static double noise_of(const double *signal, Py_ssize_t n, double *work)
{
    if (n < 8)
        return 0.0;
    Py_ssize_t count = n - 2, half = count / 2;
    for (Py_ssize_t i = 0; i < count; i++) {
        work[i] = fabs(signal[i + 1] * -2.0 + signal[i + 2] + signal[i]);
        if (isnan(work[i]))
            return NAN;
    }
    double upper = selected(work, count, half);
    if (count % 2 == 0) {
        /* The largest of those below: all of them stand before `half` now. */
        double lower = work[0];
        for (Py_ssize_t i = 1; i < half; i++)
            lower = work[i] > lower ? work[i] : lower;
        upper = 0.5 * (lower + upper);
    }
    return upper / (0.6745 * sqrt(6.0));
}

/* Absolute slope of sums of `smooth` samples over `smooth` of them on either side of a place. */
static double slope_of(const double *prefix, Py_ssize_t count, Py_ssize_t place, Py_ssize_t smooth)
{
    Py_ssize_t low = place > smooth ? place - smooth : 0;
    Py_ssize_t high = place + smooth < count - 1 ? place + smooth : count - 1;
    double rise = (prefix[high + smooth] - prefix[high]) - (prefix[low + smooth] - prefix[low]);
    double slope = fabs(rise) / (high > low ? high - low : 1) / smooth;
    return slope > DBL_MIN ? slope : DBL_MIN;
}

/* refine(radial, prefix, guess, width, first, work) -> (centre, duration, depth, centre_std) or None
 *
 * A contact by its two half-level crossings; `refine_contact` in gateway/core/contacts/segmentation.py.
 *   radial   (n,) m/s^2, positive inward
 *   prefix   (n + 1,) its cumulative sum from 0 on
 *   guess, width, first  samples
 *   work     (n,) working space
 */
static PyObject *refine(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double given[3];
    if (!has_arguments(nargs, 6) || !floats(&args[2], 3, given))
        return NULL;
    double *radial = numbers(&held, args[0], -1, 0);
    Py_ssize_t n = radial ? count_of(&held) : 0;
    double *prefix = radial ? numbers(&held, args[1], n + 1, 0) : NULL;
    double *work = prefix ? numbers(&held, args[5], n, PyBUF_WRITABLE) : NULL;
    if (!work)
        return refused(&held, "");
    if (!(given[1] > 0.0 && given[1] <= DBL_MAX))
        return refused(&held, "the width of a contact is positive");
    double width = given[1], first = given[2], middle = rint(given[0] - first), reach = ceil(1.6 * width) + 2.0;
    Boxes boxes = boxes_of(width);
    double begin = fmax(middle - reach, 0.0), end = fmin(middle + reach + 1.0, (double)n);
    /* Also False where the place or the width is not finite. */
    if (!(middle - boxes.inner >= begin + 1.0 && middle + boxes.inner + 1.0 < end))
        return done(&held);
    double low = mean_of(prefix, fmax(middle - boxes.centre, begin), fmin(middle + boxes.centre + 1.0, end));
    double left = mean_of(prefix, fmax(middle - boxes.outer, begin), middle - boxes.inner + 1.0);
    double right = mean_of(prefix, middle + boxes.inner, fmin(middle + boxes.outer + 1.0, end));
    double depth = (right < left ? right : left) - low;
    if (!(depth > 0.0))
        return done(&held);
    /* More noise needs more smoothing, or the first noisy sample beyond the level is mistaken for the edge. */
    double noise = noise_of(radial + (Py_ssize_t)begin, (Py_ssize_t)(end - begin), work);
    double wanted = (8.0 * noise / depth) * (8.0 * noise / depth);
    wanted = rint(wanted < 0.35 * width ? wanted : 0.35 * width);
    Py_ssize_t smooth = (Py_ssize_t)fmax(fmax(1.0, rint(width * 0.08)), wanted);
    const double *at = prefix + (Py_ssize_t)begin;
    Py_ssize_t count = (Py_ssize_t)(end - begin) + 1 - smooth;
    double level = (low + 0.5 * depth) * smooth, shift = 0.5 * (smooth - 1);
    double place = fmin(fmax(rint(middle - begin - shift), 0.0), (double)(count - 1));
    Py_ssize_t start = (Py_ssize_t)place, after = start, before = start;
    if (count < 1)
        return done(&held);
    while (after < count && !(at[after + smooth] - at[after] > level))
        after++;
    while (before >= 0 && !(at[before + smooth] - at[before] > level))
        before--;
    if (after == start || after == count || before == start || before < 0)
        return done(&held);
    double below = at[after - 1 + smooth] - at[after - 1], beyond = at[after + smooth] - at[after];
    double trailing = after - (beyond - level) / (beyond - below);
    below = at[before + 1 + smooth] - at[before + 1];
    beyond = at[before + smooth] - at[before];
    double leading = before + (beyond - level) / (beyond - below);
    /* Timing error of a crossing: noise after smoothing, divided by the slope over the smoothing length. */
    double std = 0.5 * noise / sqrt((double)smooth) *
                 hypot(1.0 / slope_of(at, count, after, smooth), 1.0 / slope_of(at, count, before, smooth));
    std = hypot(std, 0.1 * (width > 8.0 ? 8.0 / width : 1.0));
    release(&held);
    return Py_BuildValue("(dddd)", first + begin + shift + 0.5 * (leading + trailing), trailing - leading, depth, std);
}

/* summits(prefix, width, after, depth_period2, period, least_ratio, most_ratio) -> [(place, score), ...]
 *
 * Places that may be the next contact, the highest score of each group; `_summits_by_numpy` in
 * gateway/core/contacts/contact_tracking.py.
 *   prefix   (n + 1,) cumulative sum of the radial axis, m/s^2
 *   width    of a contact, samples
 *   after    samples from the last contact to the first score
 *   depth_period2  depth of a contact times the square of the period
 *   period   expected, samples
 *   least_ratio, most_ratio  of a period to the expected one
 */
static PyObject *summits(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double given[6];
    if (!has_arguments(nargs, 7) || !floats(&args[1], 6, given))
        return NULL;
    double *prefix = numbers(&held, args[0], -1, 0);
    if (!prefix)
        return refused(&held, "");
    if (!(given[0] > 0.0 && given[0] <= DBL_MAX))
        return refused(&held, "the width of a contact is positive");
    double width = given[0], after = given[1], depth_period2 = given[2], period = given[3];
    Boxes boxes = boxes_of(width);
    double scores = (double)count_of(&held) - 1.0 - 2.0 * boxes.outer;
    PyObject *found = PyList_New(0);
    if (!found || !(scores > 0.0)) {
        release(&held);
        return found;
    }
    Py_ssize_t count = (Py_ssize_t)scores, centre = (Py_ssize_t)boxes.centre;
    Py_ssize_t inner = (Py_ssize_t)boxes.inner, outer = (Py_ssize_t)boxes.outer;
    double of_centre = 1.0 / (2 * centre + 1), of_flank = 1.0 / (outer - inner + 1);
    /* Quick preselection by the least depth that could be accepted anywhere. */
    double farthest = fmax((after + count) / MOST_TURNS, 1.5 * period);
    double least = SURE_SHARE * (depth_period2 / (farthest * farthest));
    double apart = fmax(1.0, rint(0.5 * width)), highest = 0.0;
    Py_ssize_t last = -1, top = -1;
    for (Py_ssize_t i = 0; i <= count; i++) {
        double score = 0.0;
        int good = 0;
        if (i < count) {
            double middle = (prefix[i + outer + centre + 1] - prefix[i + outer - centre]) * of_centre;
            double left = (prefix[i + outer - inner + 1] - prefix[i]) * of_flank;
            double right = (prefix[i + 2 * outer + 1] - prefix[i + inner + outer]) * of_flank;
            score = (right < left ? right : left) - middle;
            if (!(score >= least))
                continue;
            double late = i + after, turns = fmin(fmax(rint(late / period), 1.0), MOST_TURNS);
            double expected = depth_period2 * (turns / late) * (turns / late), ratio = late / (turns * period);
            good = score >= ACCEPT_SHARE * expected - fmin(ACCEPT_GRAVITY_MPS2, 0.2 * expected) &&
                   ratio > given[4] && ratio < given[5];
            if (!good)
                continue;
        }
        if (top >= 0 && (i == count || i - last > apart)) {
            PyObject *one = Py_BuildValue("(nd)", top, highest);
            int failed = !one || PyList_Append(found, one) < 0;
            Py_XDECREF(one);
            if (failed) {
                Py_DECREF(found);
                return refused(&held, "");
            }
            top = -1;
        }
        if (good && (top < 0 || score > highest)) {
            top = i;
            highest = score;
        }
        last = i;
    }
    release(&held);
    return found;
}

/* ---- Self-calibration: gateway/core/revolutions/sensor_mounting.py ----------------------------------------------------------- */

/* Orders of the equations, bands whose disagreement shows model error, and the order that the hub's motion has. */
#define ORDERS 61
#define BANDS 11
#define HUB_ORDER 2
#define HUB_SIZE 7
#define PRODUCTS 6
#define MOUNTING_SIZE (PRODUCTS * BANDS + 4)
#define UNKNOWNS 3

static const int band_ends[BANDS] = {2, 4, 6, 9, 13, 18, 24, 31, 39, 48, ORDERS};

typedef struct {
    double re, im;
} Complex;

static double dot(Complex one, Complex other)
{
    return one.re * other.re + one.im * other.im;
}

static Complex times(Complex one, double factor)
{
    return (Complex){one.re * factor, one.im * factor};
}

/* The larger of two numbers, not a number where either is none. */
static double larger(double one, double other)
{
    return one > other || isnan(one) ? one : other;
}

/* mounting_rows(spectra, along, known, omega, omega_dot, radius, order_max, with_mean, gravity, sums, hub)
 *
 * Equations of mounting offset, tilt and zero of k revolutions; `_rows_by_numpy`.
 *   spectra  (k, 2, ORDERS) complex, of the circumferential and the radial axis, m/s^2
 *   along    (ORDERS,) complex, circumferential signal over Omega^2 per metre below the neutral layer
 *   known    (2, ORDERS) complex, gravity along the belt over g, and the reaction to angular acceleration over R times it
 *   omega, omega_dot  (k,) rad/s, rad/s^2
 *   radius   m
 *   order_max  (k,) highest order of the sampled band
 *   with_mean  0 where the sensor passes no steady value
 *   gravity  m/s^2
 *   sums     (k, MOUNTING_SIZE) out
 *   hub      (k, HUB_SIZE) out
 */
static PyObject *mounting_rows(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double radius, with_mean, gravity;
    if (!has_arguments(nargs, 11) || !floats(&args[5], 1, &radius) || !floats(&args[7], 1, &with_mean) ||
        !floats(&args[8], 1, &gravity))
        return NULL;
    double *omega = numbers(&held, args[3], -1, 0);
    Py_ssize_t k = omega ? count_of(&held) : 0;
    double *omega_dot = omega ? numbers(&held, args[4], k, 0) : NULL;
    double *order_max = omega_dot ? numbers(&held, args[6], k, 0) : NULL;
    double *spectra = order_max ? numbers(&held, args[0], k * 2 * ORDERS * 2, 0) : NULL;
    double *along = spectra ? numbers(&held, args[1], ORDERS * 2, 0) : NULL;
    double *known = along ? numbers(&held, args[2], 2 * ORDERS * 2, 0) : NULL;
    double *sums = known ? numbers(&held, args[9], k * MOUNTING_SIZE, PyBUF_WRITABLE) : NULL;
    double *hub = sums ? numbers(&held, args[10], k * HUB_SIZE, PyBUF_WRITABLE) : NULL;
    if (!hub)
        return refused(&held, "");
    const Complex *of_gravity = (const Complex *)known, *of_reaction = of_gravity + ORDERS;
    for (Py_ssize_t i = 0; i < k; i++, sums += MOUNTING_SIZE, hub += HUB_SIZE) {
        const Complex *circumferential = (const Complex *)spectra + i * 2 * ORDERS, *radial = circumferential + ORDERS;
        double reaction = omega_dot[i] * radius, square = omega[i] * omega[i];
        double count = fmin(ORDERS - 1, order_max[i]) + 1.0, of_mean = with_mean != 0.0 ? sqrt(0.5) : 0.0;
        memset(sums, 0, MOUNTING_SIZE * sizeof(double));
        for (int order = 0, band = 0; order < ORDERS; order++) {
            band += order == band_ends[band];
            Complex left = {circumferential[order].re - gravity * of_gravity[order].re - reaction * of_reaction[order].re,
                            circumferential[order].im - gravity * of_gravity[order].im - reaction * of_reaction[order].im};
            Complex by_offset = times(((const Complex *)along)[order], square), by_tilt = radial[order];
            double used = order == 0 ? of_mean : order < count;
            if (order == HUB_ORDER) {
                const double read[HUB_SIZE] = {left.re, by_offset.re, by_tilt.re, left.im, by_offset.im, by_tilt.im, 1.0};
                memcpy(hub, read, sizeof(read));
                used = 0.0;
            }
            left = times(left, used);
            by_offset = times(by_offset, used);
            by_tilt = times(by_tilt, used);
            sums[band] += dot(by_offset, by_offset);
            sums[BANDS + band] += dot(by_offset, by_tilt);
            sums[2 * BANDS + band] += dot(by_tilt, by_tilt);
            sums[3 * BANDS + band] += dot(by_offset, left);
            sums[4 * BANDS + band] += dot(by_tilt, left);
            sums[5 * BANDS + band] += dot(left, left);
            if (order == 0) {
                /* The zero-g offset has an equation in order 0 only. */
                double *zero = sums + PRODUCTS * BANDS;
                zero[0] = by_tilt.re * (2.0 * used);
                zero[1] = (2.0 * used) * (2.0 * used);
                zero[2] = left.re * (2.0 * used);
                /* The mean is one equation, every other order two. */
                zero[3] = 2.0 * count - 1.0 - (with_mean == 0.0) - 2.0 * (count > HUB_ORDER);
            }
        }
    }
    return done(&held);
}

/* mounting_solutions(sums, solutions, stds)
 *
 * Mounting offset, tilt and zero of k sets of equations, and their standard errors; `_solutions_by_numpy`.
 *   sums     (k, MOUNTING_SIZE) from `mounting_rows`
 *   solutions, stds  (k, UNKNOWNS) out
 */
static PyObject *mounting_solutions(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    if (!has_arguments(nargs, 3))
        return NULL;
    double *sums = numbers(&held, args[0], -1, 0);
    Py_ssize_t in_sums = sums ? count_of(&held) : 0, k = in_sums / MOUNTING_SIZE;
    double *solutions = sums ? numbers(&held, args[1], k * UNKNOWNS, PyBUF_WRITABLE) : NULL;
    double *stds = solutions ? numbers(&held, args[2], k * UNKNOWNS, PyBUF_WRITABLE) : NULL;
    if (!stds)
        return refused(&held, "");
    if (in_sums != k * MOUNTING_SIZE)
        return refused(&held, "sums are (k, MOUNTING_SIZE)");
    for (Py_ssize_t i = 0; i < k; i++, sums += MOUNTING_SIZE, solutions += UNKNOWNS, stds += UNKNOWNS) {
        double total[PRODUCTS] = {0.0}, scale[UNKNOWNS], inverse[UNKNOWNS][UNKNOWNS], size = 0.0;
        const double *zero = sums + PRODUCTS * BANDS;
        for (int row = 0; row < PRODUCTS; row++)
            for (int band = 0; band < BANDS; band++)
                total[row] += sums[row * BANDS + band];
        const double diagonal[UNKNOWNS] = {total[0], total[2], zero[1]}, right[UNKNOWNS] = {total[3], total[4], zero[2]};
        for (int j = 0; j < UNKNOWNS; j++) {
            /* Without equations all products with an unknown are 0, so any scale of it gives 0. */
            scale[j] = diagonal[j] > 0.0 ? 1.0 / sqrt(diagonal[j]) : 1.0;
            size += diagonal[j] > 0.0;
        }
        /* Inverse of the scaled normal matrix: order 0 has no factor of e, so one correlation is zero. */
        double with_tilt = total[1] * scale[0] * scale[1], with_zero = zero[0] * scale[1] * scale[2];
        double determinant = 1.0 - with_tilt * with_tilt - with_zero * with_zero;
        inverse[0][0] = 1.0 - with_zero * with_zero;
        inverse[0][1] = inverse[1][0] = -with_tilt;
        inverse[0][2] = inverse[2][0] = with_tilt * with_zero;
        inverse[1][1] = 1.0;
        inverse[1][2] = inverse[2][1] = -with_zero;
        inverse[2][2] = 1.0 - with_tilt * with_tilt;
        for (int j = 0; j < UNKNOWNS; j++) {
            solutions[j] = 0.0;
            for (int l = 0; l < UNKNOWNS; l++) {
                inverse[j][l] *= scale[j] * (scale[l] / (determinant > 0.0 ? determinant : NAN));
                solutions[j] += inverse[j][l] * right[l];
            }
        }
        double explained = solutions[0] * right[0] + solutions[1] * right[1] + solutions[2] * right[2];
        double white = larger(total[5] - explained, 0.0) / larger(zero[3] - size, 1.0);
        /* What the solution leaves of the right-hand sides, by band; order 0 alone has a zero-g offset. */
        double clustered[UNKNOWNS] = {0.0};
        for (int band = 0; band < BANDS; band++) {
            const double *at = sums + band;
            double left[UNKNOWNS] = {at[3 * BANDS] - at[0] * solutions[0] - at[BANDS] * solutions[1],
                                     at[4 * BANDS] - at[BANDS] * solutions[0] - at[2 * BANDS] * solutions[1], 0.0};
            if (band == 0) {
                left[1] -= zero[0] * solutions[2];
                left[2] = zero[2] - zero[0] * solutions[1] - zero[1] * solutions[2];
            }
            for (int j = 0; j < UNKNOWNS; j++) {
                double moved = inverse[j][0] * left[0] + inverse[j][1] * left[1] + inverse[j][2] * left[2];
                clustered[j] += moved * moved;
            }
        }
        for (int j = 0; j < UNKNOWNS; j++) {
            stds[j] = sqrt(larger(inverse[j][j] * white, clustered[j] * (BANDS / (BANDS - size))));
            if (!(diagonal[j] > 0.0))
                solutions[j] = stds[j] = NAN;
        }
    }
    return done(&held);
}

/* ---- Weak form: gateway/ring/weak_form_rows.py ---------------------------------------------------------------- */

/* row_sensitivity(tangent, along, axial, rotation, numbers, step, moved, out)
 *
 * Derivative of the balance's rows by the angle of the tangent; `_by_angle_by_numpy`. Points are those of the coarse grid
 * of the half circle, plane vectors are complex.
 *   tangent, along  (m,) complex, of the belt and of the undeformed belt
 *   axial    (m,) force along the belt
 *   rotation (r, f) virtual rotations at the last f points, 0 before
 *   numbers  (3,) Cw, Rs, Ts
 *   step     rad between points
 *   moved    (m,) complex, working space
 *   out      (r + 1, m); the last row is that of the vertical balance
 */
static PyObject *row_sensitivity(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double step;
    if (!has_arguments(nargs, 8) || !floats(&args[5], 1, &step))
        return NULL;
    double *axial = numbers(&held, args[2], -1, 0);
    Py_ssize_t m = axial ? count_of(&held) : 0;
    double *of_tangent = axial ? numbers(&held, args[0], 2 * m, 0) : NULL;
    double *of_along = of_tangent ? numbers(&held, args[1], 2 * m, 0) : NULL;
    Py_buffer *rotations = of_along ? hold(&held, args[3], PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) : NULL;
    if (!rotations)
        return refused(&held, "");
    if (rotations->ndim != 2 || !has_format(rotations, 'd', sizeof(double)) || rotations->shape[1] > m)
        return refused(&held, "rotations are (r, f) float64, f at most m");
    Py_ssize_t rows = rotations->shape[0], free = rotations->shape[1], begin = m - free;
    double *ring = numbers(&held, args[4], 3, 0);
    double *work = ring ? numbers(&held, args[6], 2 * m, PyBUF_WRITABLE) : NULL;
    double *out = work ? numbers(&held, args[7], (rows + 1) * m, PyBUF_WRITABLE) : NULL;
    if (!out)
        return refused(&held, "");
    const Complex *tangent = (const Complex *)of_tangent, *along = (const Complex *)of_along;
    Complex *moved = (Complex *)work;
    double cw = ring[0], rs = ring[1], ts = ring[2], half = 0.5 * step;
    for (Py_ssize_t row = 0; row <= rows; row++, out += m) {
        const double *rotation = row < rows ? (const double *)rotations->buf + row * free : NULL;
        Complex sum = {0.0, 0.0}, last = {0.0, 0.0};
        for (Py_ssize_t i = 0; i < m; i++) {
            if (!rotation) {
                moved[i] = (Complex){0.0, 2.0};
                continue;
            }
            if (i >= begin) {
                /* Virtual displacement, the integral of the normal times the rotation. */
                Complex now = {-tangent[i].im * rotation[i - begin], tangent[i].re * rotation[i - begin]};
                if (i > begin)
                    sum = (Complex){sum.re + half * (last.re + now.re), sum.im + half * (last.im + now.im)};
                last = now;
            }
            moved[i] = sum;
        }
        /* The belt beyond a point moves along its normal, which changes the work of the sidewall. */
        sum = (Complex){0.0, 0.0};
        for (Py_ssize_t i = m - 1; i >= 0; i--) {
            double radial = (rs - ts) * (along[i].im * moved[i].re - along[i].re * moved[i].im);
            Complex now = {ts * moved[i].re + radial * along[i].im, ts * moved[i].im - radial * along[i].re};
            if (i < m - 1)
                sum = (Complex){sum.re + half * (last.re + now.re), sum.im + half * (last.im + now.im)};
            last = now;
            out[i] = tangent[i].re * sum.im - tangent[i].im * sum.re;
            /* Pressure and axial force rotate. */
            if (rotation)
                out[i] -= cw * dot(tangent[i], moved[i]);
            if (rotation && i >= begin)
                out[i] += axial[i] * rotation[i - begin];
        }
    }
    return done(&held);
}

/* ---- Small systems: gateway/ring/small_systems.py ----------------------------------------------------------- */

/* solve_lower(factor, right, transposed, out) -> whether the factor is regular
 *
 * L x = right, or L^T x = right; `_solved_by_lapack`.
 *   factor   (n, n) lower triangular L
 *   right, out  (n, k)
 */
static PyObject *solve_lower(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    if (!has_arguments(nargs, 4))
        return NULL;
    int transposed = PyObject_IsTrue(args[2]);
    double *factor = transposed < 0 ? NULL : numbers(&held, args[0], -1, 0);
    Py_ssize_t n = factor ? (Py_ssize_t)sqrt((double)count_of(&held)) : 0;
    Py_ssize_t in_factor = factor ? count_of(&held) : 0;
    double *right = factor ? numbers(&held, args[1], -1, 0) : NULL;
    Py_ssize_t in_right = right ? count_of(&held) : 0, k = n ? in_right / n : 0;
    double *out = right ? numbers(&held, args[3], in_right, PyBUF_WRITABLE) : NULL;
    if (!out)
        return refused(&held, "");
    if (in_factor != n * n || in_right != n * k)
        return refused(&held, "factor and right-hand sides do not fit together");
    int regular = 1;
    for (Py_ssize_t i = 0; i < n; i++)
        regular = regular && factor[i * n + i] != 0.0;
    memcpy(out, right, in_right * sizeof(double));
    for (Py_ssize_t step = 0; regular && step < n; step++) {
        Py_ssize_t i = transposed ? n - 1 - step : step;
        const double *row = factor + i * n;
        double *solved = out + i * k;
        if (!transposed)
            for (Py_ssize_t j = 0; j < i; j++)
                for (Py_ssize_t c = 0; c < k; c++)
                    solved[c] -= row[j] * out[j * k + c];
        for (Py_ssize_t c = 0; c < k; c++)
            solved[c] /= row[i];
        if (transposed)
            for (Py_ssize_t j = 0; j < i; j++)
                for (Py_ssize_t c = 0; c < k; c++)
                    out[j * k + c] -= row[j] * solved[c];
    }
    release(&held);
    return PyBool_FromLong(regular);
}

/* least_squares(matrix, right, work, out) -> whether the columns are independent
 *
 * x of least |matrix x - right|^2 by Householder's reflections; `_fitted_by_lapack`.
 *   matrix   (m, n), m >= n
 *   right    (m, k)
 *   work     (m + 1, n + k) working space
 *   out      (n, k)
 */
static PyObject *least_squares(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    if (!has_arguments(nargs, 4))
        return NULL;
    Py_buffer *matrix = hold(&held, args[0], PyBUF_C_CONTIGUOUS | PyBUF_FORMAT);
    if (!matrix)
        return refused(&held, "");
    if (matrix->ndim != 2 || !has_format(matrix, 'd', sizeof(double)) || matrix->shape[0] < matrix->shape[1])
        return refused(&held, "the matrix is (m, n) float64, m at least n");
    Py_ssize_t m = matrix->shape[0], n = matrix->shape[1];
    double *right = numbers(&held, args[1], -1, 0);
    Py_ssize_t in_right = right ? count_of(&held) : 0, k = m ? in_right / m : 0, wide = n + k;
    double *work = right ? numbers(&held, args[2], (m + 1) * wide, PyBUF_WRITABLE) : NULL;
    double *out = work ? numbers(&held, args[3], n * k, PyBUF_WRITABLE) : NULL;
    if (!out)
        return refused(&held, "");
    if (in_right != m * k)
        return refused(&held, "matrix and right-hand sides do not fit together");
    double *sums = work + m * wide;
    for (Py_ssize_t i = 0; i < m; i++) {
        memcpy(work + i * wide, (double *)matrix->buf + i * n, n * sizeof(double));
        memcpy(work + i * wide + n, right + i * k, k * sizeof(double));
    }
    int independent = 1;
    for (Py_ssize_t j = 0; independent && j < n; j++) {
        double square = 0.0;
        for (Py_ssize_t i = j; i < m; i++)
            square += work[i * wide + j] * work[i * wide + j];
        double *top = work + j * wide, diagonal = top[j] > 0.0 ? -sqrt(square) : sqrt(square);
        independent = diagonal != 0.0;
        if (!independent)
            break;
        /* Reflect the columns behind by v = column - diagonal e_j, whose square is 2 diagonal (diagonal - top). */
        double factor = 1.0 / (diagonal * (diagonal - top[j]));
        top[j] -= diagonal;
        for (Py_ssize_t c = j + 1; c < wide; c++)
            sums[c] = 0.0;
        for (Py_ssize_t i = j; i < m; i++)
            for (Py_ssize_t c = j + 1; c < wide; c++)
                sums[c] += work[i * wide + j] * work[i * wide + c];
        for (Py_ssize_t i = j; i < m; i++)
            for (Py_ssize_t c = j + 1; c < wide; c++)
                work[i * wide + c] -= factor * work[i * wide + j] * sums[c];
        top[j] = diagonal;
    }
    for (Py_ssize_t i = n - 1; independent && i >= 0; i--) {
        const double *row = work + i * wide;
        for (Py_ssize_t c = 0; c < k; c++)
            out[i * k + c] = row[n + c];
        for (Py_ssize_t j = i + 1; j < n; j++)
            for (Py_ssize_t c = 0; c < k; c++)
                out[i * k + c] -= row[j] * out[j * k + c];
        for (Py_ssize_t c = 0; c < k; c++)
            out[i * k + c] /= row[i];
    }
    release(&held);
    return PyBool_FromLong(independent);
}

/* ---- Two filters: gateway/forces/switching_step.py --------------------------------------------------------------- */

/* As in gateway/forces/switching_step.py. */
#define MOST_STATES 16
#define MOST_MEASURED 4

/* Inverse of a symmetric positive definite matrix (m, m) and the logarithm of its determinant; NaN of any other. */
static double inverted(double matrix[MOST_MEASURED][MOST_MEASURED], int m, double inverse[MOST_MEASURED][MOST_MEASURED])
{
    double lower[MOST_MEASURED][MOST_MEASURED] = {{0.0}}, back[MOST_MEASURED][MOST_MEASURED] = {{0.0}}, logarithm = 0.0;
    for (int i = 0; i < m; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j];
            for (int k = 0; k < j; k++)
                sum -= lower[i][k] * lower[j][k];
            if (i == j)
                lower[i][i] = sum > 0.0 ? sqrt(sum) : NAN;
            else
                lower[i][j] = sum / lower[j][j];
        }
    for (int j = 0; j < m; j++) {
        logarithm += 2.0 * log(lower[j][j]);
        for (int i = j; i < m; i++) {
            double sum = i == j ? 1.0 : 0.0;
            for (int k = j; k < i; k++)
                sum -= lower[i][k] * back[k][j];
            back[i][j] = sum / lower[i][i];
        }
    }
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) {
            inverse[i][j] = 0.0;
            for (int k = i > j ? i : j; k < m; k++)
                inverse[i][j] += back[k][i] * back[k][j];
        }
    return logarithm;
}

/* switching_step(change, free_variance, fixed, switched, switched, values, rows, noises, means, covariances)
 *     -> logarithm of the ratio of likelihoods
 *
 * One step of two Kalman filters between which a system switches; `_stepped_by_numpy`.
 *   change   (4, 2, n) as in SwitchingModel, which has the next two as well
 *   switched two numbers, by filter
 *   values, noises  (m,)
 *   rows     (m, n)
 *   means    (2, n) and
 *   covariances  (2, n, n), symmetric: before and after
 */
static PyObject *switching_step(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double free_variance, fixed, shares[2];
    if (!has_arguments(nargs, 10) || !floats(&args[1], 1, &free_variance) || !floats(&args[2], 1, &fixed) ||
        !floats(&args[3], 2, shares))
        return NULL;
    double *values = numbers(&held, args[5], -1, 0);
    Py_ssize_t m = values ? count_of(&held) : 0;
    double *noises = values ? numbers(&held, args[7], m, 0) : NULL;
    double *all_means = noises ? numbers(&held, args[8], -1, PyBUF_WRITABLE) : NULL;
    Py_ssize_t in_means = all_means ? count_of(&held) : 0, n = in_means / 2;
    if (all_means && (n < 1 || n > MOST_STATES || in_means != 2 * n || m < 1 || m > MOST_MEASURED))
        return refused(&held, "states and measured values do not fit together, or are too many");
    double *change = all_means ? numbers(&held, args[0], 8 * n, 0) : NULL;
    double *rows = change ? numbers(&held, args[6], m * n, 0) : NULL;
    double *covariances = rows ? numbers(&held, args[9], 2 * n * n, PyBUF_WRITABLE) : NULL;
    if (!covariances)
        return refused(&held, "");
    double means[2][MOST_STATES], spread[2][MOST_STATES][MOST_STATES], exponent = 0.0;
    for (int filter = 0; filter < 2; filter++) {
        const double *stays = change + filter * n, *begins = stays + 2 * n, *drift = stays + 4 * n, *begun = stays + 6 * n;
        const double *mean = all_means + filter * n, *other = all_means + (1 - filter) * n;
        const double *covariance = covariances + filter * n * n, *others = covariances + (1 - filter) * n * n;
        double share = shares[filter], apart[MOST_STATES];
        for (int i = 0; i < n; i++) {
            means[filter][i] = mean[i] * stays[i];
            apart[i] = other[i] * begins[i] - means[filter][i];
        }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                double goes_on = covariance[i * n + j] * stays[i] * stays[j];
                double starts = others[i * n + j] * begins[i] * begins[j] + (i == j ? begun[i] : 0.0);
                spread[filter][i][j] = goes_on + share * (starts - goes_on) + share * (1.0 - share) * apart[i] * apart[j] +
                                       (i == j ? drift[i] : 0.0);
            }
        for (int i = 0; i < n; i++)
            means[filter][i] += share * apart[i];
    }
    for (int filter = 0; filter < 2; filter++) {
        double(*p)[MOST_STATES] = spread[filter], *mean = means[filter];
        double innovations[MOST_MEASURED], across[MOST_STATES][MOST_MEASURED], gains[MOST_STATES][MOST_MEASURED];
        double sums[MOST_MEASURED][MOST_MEASURED], inverse[MOST_MEASURED][MOST_MEASURED], weighted[MOST_MEASURED];
        for (int k = 0; k < m; k++) {
            innovations[k] = values[k];
            for (int i = 0; i < n; i++)
                innovations[k] -= mean[i] * rows[k * n + i];
            for (int i = 0; i < n; i++) {
                across[i][k] = 0.0;
                for (int j = 0; j < n; j++)
                    across[i][k] += p[i][j] * rows[k * n + j];
            }
        }
        for (int k = 0; k < m; k++)
            for (int l = 0; l < m; l++) {
                sums[k][l] = k == l ? noises[k] : 0.0;
                for (int i = 0; i < n; i++)
                    sums[k][l] += rows[k * n + i] * across[i][l];
            }
        double square = inverted(sums, (int)m, inverse);
        for (int k = 0; k < m; k++) {
            weighted[k] = 0.0;
            for (int l = 0; l < m; l++)
                weighted[k] += inverse[k][l] * innovations[l];
            square += weighted[k] * innovations[k];
        }
        exponent += filter ? -0.5 * square : 0.5 * square;
        for (int i = 0; i < n; i++)
            for (int k = 0; k < m; k++) {
                gains[i][k] = 0.0;
                for (int l = 0; l < m && !(filter == 0 && i == fixed); l++)
                    gains[i][k] += across[i][l] * inverse[l][k];
                mean[i] += gains[i][k] * innovations[k];
            }
        for (int i = 0; i < n; i++) {
            double used[MOST_MEASURED];
            for (int k = 0; k < m; k++) {
                used[k] = -across[i][k];
                for (int l = 0; l < m; l++)
                    used[k] += gains[i][l] * sums[l][k];
            }
            for (int j = 0; j <= i; j++) {
                for (int k = 0; k < m; k++)
                    p[i][j] += used[k] * gains[j][k] - gains[i][k] * across[j][k];
                p[j][i] = p[i][j];
            }
        }
        if (filter == 1) {
            double along = 0.0, moved = 0.0, unmeasured[MOST_STATES];
            for (int k = 0; k < m; k++) {
                double by_free = 0.0;
                for (int l = 0; l < m; l++)
                    by_free += inverse[k][l] * rows[l * n + n - 1];
                along += by_free * rows[k * n + n - 1];
                moved += by_free * innovations[k];
            }
            for (int i = 0; i < n; i++) {
                unmeasured[i] = i == n - 1 ? 1.0 : 0.0;
                for (int k = 0; k < m; k++)
                    unmeasured[i] -= gains[i][k] * rows[k * n + n - 1];
            }
            double variance = free_variance / (1.0 + free_variance * along);
            for (int i = 0; i < n; i++) {
                mean[i] += variance * moved * unmeasured[i];
                for (int j = 0; j < n; j++)
                    p[i][j] += variance * unmeasured[i] * unmeasured[j];
            }
        }
    }
    for (int filter = 0; filter < 2; filter++)
        for (int i = 0; i < n; i++) {
            all_means[filter * n + i] = means[filter][i];
            memcpy(covariances + (filter * n + i) * n, spread[filter][i], n * sizeof(double));
        }
    release(&held);
    return PyFloat_FromDouble(exponent);
}

/* ---- First orders: gateway/forces/turn_tracker.py ----------------------------------------------------------------- */

/* first_orders(lateral, radial, numbers, rows, centre) -> cosine and sine of the lateral record, then of the radial
 *
 * First orders that the orders above predict; `_predicted_by_numpy`.
 *   lateral, radial  (2 k,) coefficients: cosines, then sines
 *   numbers  (k,) of the orders
 *   rows     (2, 2 k) of cosine and sine about the contact's centre
 *   centre   rad
 */
static PyObject *first_orders(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    (void)self;
    Held held = {.count = 0};
    double centre, result[2][2];
    if (!has_arguments(nargs, 5) || !floats(&args[4], 1, &centre))
        return NULL;
    double *order = numbers(&held, args[2], -1, 0);
    Py_ssize_t k = order ? count_of(&held) : 0;
    double *lateral = order ? numbers(&held, args[0], 2 * k, 0) : NULL;
    double *radial = lateral ? numbers(&held, args[1], 2 * k, 0) : NULL;
    double *rows = radial ? numbers(&held, args[3], 4 * k, 0) : NULL;
    if (!rows || !k)
        return refused(&held, "there are no orders");
    const double *records[2] = {lateral, radial};
    double parts[2][2] = {{0.0}}, back_cosine = cos(order[0] * centre), back_sine = sin(order[0] * centre);
    for (Py_ssize_t i = 0; i < k; i++) {
        double c = cos(order[i] * centre), s = sin(order[i] * centre);
        for (int record = 0; record < 2; record++) {
            double along = records[record][i], across = records[record][k + i];
            double about_cosine = along * c + across * s, about_sine = across * c - along * s;
            for (int part = 0; part < 2; part++)
                parts[record][part] += rows[2 * part * k + i] * about_cosine + rows[(2 * part + 1) * k + i] * about_sine;
        }
    }
    for (int record = 0; record < 2; record++) {
        result[record][0] = parts[record][0] * back_cosine - parts[record][1] * back_sine;
        result[record][1] = parts[record][1] * back_cosine + parts[record][0] * back_sine;
    }
    release(&held);
    return Py_BuildValue("dddd", result[0][0], result[0][1], result[1][0], result[1][1]);
}

/* ---- Module ------------------------------------------------------------------------------------------------------ */

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, NULL}

static PyMethodDef methods[] = {
    METHOD(resample), METHOD(spline_lines), METHOD(normalise), METHOD(match), METHOD(refine), METHOD(summits),
    METHOD(solve_lower), METHOD(least_squares), METHOD(mounting_rows), METHOD(mounting_solutions), METHOD(row_sensitivity),
    METHOD(switching_step), METHOD(first_orders),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_core", "Compiled inner loops; see gateway/core/compiled/core.c.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__core(void)
{
    return PyModule_Create(&definition);
}

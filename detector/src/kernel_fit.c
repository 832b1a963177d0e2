/* fit_dots: fit of blurred dark ellipses and rings to grey levels, one dot after the other (twin: ellipse_descent.py,
   EllipseDescent, which says what is done and why; names here are those there).

   A part of the library of kernel.c: see the remarks at its head. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* In kernel.c. */
void solve_positive(int n, double *N, double *columns, int count, double least);

/* Two copies of the innermost function where the processor can be asked which it takes; both give the same numbers. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDEST __attribute__((target_clones("avx2", "default")))
#define INSIDE static inline __attribute__((always_inline))
#else
#define WIDEST
#define INSIDE static inline
#endif

enum { COUNT = 15, WIDTH = 16, BLOCK = 32, DISK = 12, LIGHT = 5, DARK = 6, BLUR = 7, HOLE = 12, SCALE = 14, SECTORS = 16, SUMS = 8, NODES = 5, FACTS = 7 };

/* In the order of CONSTANTS in ellipse_descent.py. */
typedef struct {
    double converged, settled, judged, unjudged, steps, rounds, step, scale_step, least_blur, most_blur, shortest;
    double outlier_share, outlier_sigma, outlier_spread, left_out, trimmed;
    double scale_prior, shine_prior; /* noise per contrast over the standard deviations of hole and reflection */
    double sharp, boxed, least_side, least_lens, tiny;
    double shift, shift_share, height, sigmas, even, misfit, unseen, quantization;
    double enough, rows;
    double nodes[NODES], weights[NODES];
    double from, per_unit, entries; /* of the table of the normal distribution: its first place, places per 1, number */
} Settings;

typedef struct {
    double m11, m12, m22, blur, per_blur, flattest, bent;
    int sharp, boxed;
} Shape;

/* What `blurred_ellipse` returns for a block of pixels, and what it needs on the way. */
typedef struct {
    double u[BLOCK], v[BLOCK], gradient_x[BLOCK], gradient_y[BLOCK], steepness[BLOCK], inward[BLOCK], depth[BLOCK];
    double density[BLOCK], ink[BLOCK], by_rho[BLOCK], by_blur[BLOCK];
} Seen;

typedef struct {
    int64_t count, room;
    double *x, *y, *grey, *residual, *tips, *other_tips, *scratch;
    uint8_t *weight, *silent, *sector;
    double p[COUNT], origin[2], size[2], step, blur_step; /* the longer semi-axis first */
    double normal[COUNT][COUNT], gradient[COUNT], sums[SECTORS][SUMS];
    int ring, filled, alive, left_out[SECTORS];
    double image_noise, saturation, unlit;
    const Settings *set;
    const double *table;
} Dot;

INSIDE double larger(double a, double b) { return a > b ? a : b; }
INSIDE double smaller(double a, double b) { return a < b ? a : b; }
INSIDE double within(double a, double low, double high) { return a < low ? low : a > high ? high : a; }

/* Normal distribution F and density f, from their values at the nearest place of a table, by Taylor's series in the
   distance d < 1/128: within 1e-12. */
INSIDE double normal_at(const Dot *dot, double t, double *density)
{
    const Settings *set = dot->set;
    const double place = (t - set->from) * set->per_unit;
    if (!(place > 0)) {
        if (density)
            *density = 0;
        return 0;
    }
    if (place >= set->entries - 1) {
        if (density)
            *density = 0;
        return 1;
    }
    const int64_t i = (int64_t)(place + 0.5);
    const double x = set->from + (double)i / set->per_unit, d = t - x, xx = x * x;
    const double *entry = dot->table + 2 * i;
    const double h2 = xx - 1, h3 = x * (xx - 3), h4 = xx * (xx - 6) + 3;
    if (density)
        *density = entry[1] * (1 + d * (-x + d * (h2 / 2 + d * (-h3 / 6 + d * (h4 / 24)))));
    return entry[0] + entry[1] * d * (1 + d * (-x / 2 + d * (h2 / 6 + d * (-h3 / 24))));
}

static void eigenvalues(const double *p, double *trace, double *root)
{
    const double apart = p[2] - p[4];
    *trace = p[2] + p[4];
    *root = sqrt(apart * apart + 4 * p[3] * p[3]);
}

/* ---- edge_psf.py ---- */

static Shape shape_of(const Settings *set, double m11, double m12, double m22, double blur)
{
    const double trace = m11 + m22, apart = m11 - m22, determinant = m11 * m22 - m12 * m12;
    Shape s = {m11, m12, m22, blur, 1 / blur, determinant / trace, determinant * determinant * blur / 2, 0, 0};
    const double steepest = trace / 2 + sqrt(larger(apart * apart / 4 + m12 * m12, 0));
    s.sharp = blur * steepest * steepest * steepest > set->sharp * determinant;
    s.boxed = blur < set->boxed;
    return s;
}

INSIDE void pixel_edge(const Dot *dot, double depth, double nx, double ny, double blur, double *ink, double *slope,
                       double *by_square)
{
    const Settings *set = dot->set;
    const double lens = sqrt(larger(blur * blur - 1.0 / 12, set->least_lens * set->least_lens));
    const double width = larger(fabs(nx), set->least_side), height = larger(fabs(ny), set->least_side);
    const double far = (width + height) / 2, near = (width - height) / 2;
    const double places[4] = {depth + far, depth - far, depth + near, depth - near};
    double a = 0, b = 0, c = 0;
    for (int k = 0; k < 4; k++) {
        double bell;
        const double z = places[k], step = normal_at(dot, z / lens, &bell), sign = k < 2 ? 1 : -1;
        const double first = z * step + bell * lens;
        a += sign * 0.5 * (z * first + lens * lens * step);
        b += sign * first;
        c += sign * step;
    }
    const double area = width * height;
    *ink = a / area;
    *slope = b / area;
    *by_square = 0.5 * c / area;
}

static double chords(const Dot *dot, const Shape *s, double u, double v, double nx, double ny)
{
    const Settings *set = dot->set;
    const double along_u = (s->m11 * nx + s->m12 * ny) * s->blur, along_v = (s->m12 * nx + s->m22 * ny) * s->blur;
    const double beside_u = (s->m12 * nx - s->m11 * ny) * s->blur, beside_v = (s->m22 * nx - s->m12 * ny) * s->blur;
    const double square = larger(along_u * along_u + along_v * along_v, set->tiny);
    const double slope0 = u * along_u + v * along_v, slope1 = beside_u * along_u + beside_v * along_v;
    const double level0 = u * u + v * v - 1, level1 = 2 * (u * beside_u + v * beside_v);
    const double level2 = beside_u * beside_u + beside_v * beside_v;
    double ink = 0;
    for (int k = 0; k < NODES; k++) {
        const double node = set->nodes[k], slope = slope0 + node * slope1;
        const double under = slope * slope - square * (level0 + node * (level1 + node * level2));
        if (under > 0) {
            const double root = sqrt(under);
            ink += set->weights[k] *
                   (normal_at(dot, (root - slope) / square, NULL) - normal_at(dot, (-root - slope) / square, NULL));
        }
    }
    return ink;
}

/* Of m pixels from `x` and `y` on. One loop for each part: the processor works on several pixels at a time. */
INSIDE void blurred_ellipse(const Dot *dot, const Shape *s, const double *x, const double *y, const double *center,
                                   int m, int fresh, double *tips, Seen *seen)
{
    const double tiny = dot->set->tiny;
    for (int i = 0; i < m; i++) {
        const double dx = x[i] - center[0], dy = y[i] - center[1];
        const double u0 = s->m11 * dx + s->m12 * dy, v0 = s->m12 * dx + s->m22 * dy;
        const double rho = larger(sqrt(u0 * u0 + v0 * v0), tiny), per_rho = 1 / rho, u = u0 * per_rho, v = v0 * per_rho;
        const double gradient_x = s->m11 * u + s->m12 * v, gradient_y = s->m12 * u + s->m22 * v;
        const double steepness = larger(sqrt(gradient_x * gradient_x + gradient_y * gradient_y), s->flattest);
        const double flat = 1 / steepness, inward = smaller(s->bent * flat * flat * flat, 0.5);
        seen->u[i] = u;
        seen->v[i] = v;
        seen->gradient_x[i] = gradient_x;
        seen->gradient_y[i] = gradient_y;
        seen->steepness[i] = steepness;
        seen->inward[i] = inward;
        seen->depth[i] = (1 - rho) * flat * s->per_blur - inward;
    }
    for (int i = 0; i < m; i++)
        seen->ink[i] = normal_at(dot, seen->depth[i], seen->density + i);
    for (int i = 0; i < m; i++) {
        seen->by_rho[i] = -seen->density[i] / seen->steepness[i] * s->per_blur;
        seen->by_blur[i] = -seen->density[i] * (seen->depth[i] + 2 * seen->inward[i]) * s->per_blur;
    }
    if (fresh)
        for (int i = 0; i < m; i++) {
            const double dx = x[i] - center[0], dy = y[i] - center[1], flat = 1 / seen->steepness[i];
            tips[i] = s->sharp ? chords(dot, s, s->m11 * dx + s->m12 * dy, s->m12 * dx + s->m22 * dy,
                                        seen->gradient_x[i] * flat, seen->gradient_y[i] * flat) -
                                     seen->ink[i]
                               : 0;
        }
    if (s->boxed)
        for (int i = 0; i < m; i++) {
            const double flat = 1 / seen->steepness[i];
            double slope, by_square;
            pixel_edge(dot, seen->depth[i] * s->blur, seen->gradient_x[i] * flat, seen->gradient_y[i] * flat, s->blur,
                       seen->ink + i, &slope, &by_square);
            seen->by_rho[i] = -slope * flat;
            seen->by_blur[i] = 2 * s->blur * by_square - 2 * seen->inward[i] * slope;
        }
    for (int i = 0; i < m; i++)
        seen->ink[i] += tips[i];
}

/* ---- outline_pixels.py ---- */

typedef struct {
    double reach, shear, half;
} RowForm;

static RowForm row_form(double a, double b, double angle)
{
    const double cosine = cos(angle), sine = sin(angle), as = a * sine, bc = b * cosine;
    RowForm form = {sqrt(as * as + bc * bc), 0, 0};
    form.shear = (a * a - b * b) * cosine * sine / (form.reach * form.reach);
    form.half = a * b / form.reach;
    return form;
}

/* Half the length of an ellipse's part of a row, 0 if there is none. */
static double half_length(RowForm form, double up)
{
    const double share = up / form.reach;
    return form.half * sqrt(larger(1 - share * share, 0));
}

static int make_room(Dot *dot, int64_t room)
{
    if (room <= dot->room)
        return 1;
    double **doubles[] = {&dot->x, &dot->y, &dot->grey, &dot->residual, &dot->tips, &dot->other_tips, &dot->scratch};
    uint8_t **bytes[] = {&dot->weight, &dot->silent, &dot->sector};
    dot->room = 0;
    for (int k = 0; k < 7; k++) {
        free(*doubles[k]);
        if (!(*doubles[k] = malloc((size_t)room * sizeof(double))))
            return 0;
    }
    for (int k = 0; k < 3; k++) {
        free(*bytes[k]);
        if (!(*bytes[k] = malloc((size_t)room)))
            return 0;
    }
    dot->room = room;
    return 1;
}

static int collect(Dot *dot, const uint8_t *image, int64_t height, int64_t width, int64_t stride, int wide,
                   const double *semi, double angle, double band)
{
    const double pi = 3.14159265358979323846, center_x = dot->origin[0], center_y = dot->origin[1];
    const double a = semi[0] + band, b = semi[1] + band;
    const double c = larger(semi[0] - band, 1e-3), d = larger(semi[1] - band, 1e-3);
    const int hollow = semi[1] > band + 1 && !dot->filled;
    dot->count = 0;
    /* Rows and columns of what is no ellipse, or of a huge one, would be no whole numbers. */
    if (!(fabs(center_x) < 1e9 && fabs(center_y) < 1e9 && a > 1e-3 && a < 1e9 && b > 1e-3 && b < 1e9 &&
          fabs(angle) < 1e9 && band >= 0))
        return make_room(dot, 1);
    const RowForm outer = row_form(a, b, angle), inner = row_form(c, d, angle);
    const int64_t top = (int64_t)within(ceil(center_y - outer.reach), 0, (double)height);
    const int64_t bottom = (int64_t)within(floor(center_y + outer.reach), -1, (double)(height - 1));
    const double area = pi * (a * b - (hollow ? c * d : 0));
    const double thinned = smaller(area / dot->set->enough, (double)(bottom - top) / dot->set->rows);
    const int64_t every = thinned < 1 ? 1 : (int64_t)thinned;
    const int64_t rows = bottom < top ? 0 : (bottom - top) / every + 1;
    const int64_t longest = (int64_t)smaller(2 * outer.half + 4, (double)(width + 4));

    if (!make_room(dot, rows * longest + 1))
        return 0;
    for (int64_t y = top; y <= bottom; y += every) {
        const double up = (double)y - center_y, half = half_length(outer, up);
        const double hole = hollow ? half_length(inner, up) : 0;
        const double middle = center_x + outer.shear * up, hole_middle = center_x + inner.shear * up;
        const double leave = hole > 0 ? floor(hole_middle - hole) : floor(middle);
        const double enter = hole > 0 ? larger(ceil(hole_middle + hole), leave + 1) : floor(middle) + 1;
        const double ends[2][2] = {{ceil(middle - half), leave}, {enter, floor(middle + half)}};
        for (int k = 0; k < 2; k++) {
            const int64_t first = (int64_t)larger(ends[k][0], 0);
            const int64_t last = (int64_t)smaller(ends[k][1], (double)(width - 1));
            for (int64_t x = first; x <= last; x++) {
                const uint8_t *at = image + y * stride + x * (wide ? 2 : 1);
                uint16_t level = *at;
                if (wide)
                    memcpy(&level, at, 2);
                dot->x[dot->count] = (double)x;
                dot->y[dot->count] = (double)y;
                dot->grey[dot->count++] = level - dot->unlit;
            }
        }
    }
    return 1;
}

static int sector_of(double u, double v)
{
    const double eighth = 0.41421356237309503, across = fabs(u), down = fabs(v);
    int turn = (down > eighth * across) + (down > across) + (eighth * down > across);
    turn = u < 0 ? SECTORS / 2 - 1 - turn : turn;
    return v < 0 ? SECTORS - 1 - turn : turn;
}

/* The upper median, by partial sorting in place; 0 if empty. */
static double middle(double *values, int64_t count)
{
    int64_t low = 0, high = count - 1;
    const int64_t wanted = count / 2;
    while (low < high) {
        const double pivot = values[(low + high) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i <= j) {
                const double swapped = values[i];
                values[i++] = values[j];
                values[j--] = swapped;
            }
        }
        if (wanted <= j)
            high = j;
        else if (wanted >= i)
            low = i;
        else
            break;
    }
    return count ? values[wanted] : 0;
}

static double noise_of(Dot *dot)
{
    int64_t found = 0;
    for (int64_t i = 0; i + 1 < dot->count; i++)
        if (dot->x[i + 1] - dot->x[i] == 1)
            dot->scratch[found++] = fabs(dot->residual[i + 1] - dot->residual[i]);
    const double least = sqrt(dot->set->quantization), white = middle(dot->scratch, found) / (0.6745 * sqrt(2.0));
    return smaller(larger(white, least), dot->image_noise);
}

static double variance_of(const Dot *dot)
{
    double squares = 0, used = 0;
    for (int64_t i = 0; i < dot->count; i++)
        if (dot->weight[i] && !dot->silent[i]) {
            squares += dot->residual[i] * dot->residual[i];
            used++;
        }
    return larger(squares / larger(used - (dot->ring ? COUNT : DISK), 1), dot->set->quantization);
}

static void strangeness(const Dot *dot, double noise, double *strange)
{
    const Settings *set = dot->set;
    double shift[SECTORS], square[SECTORS];
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k];
        shift[k] = sums[2] / larger(sums[1], set->tiny);
        square[k] = sums[7] / larger(sums[0], 1);
        for (int i = k; i > 0 && square[i] < square[i - 1]; i--) {
            const double swapped = square[i];
            square[i] = square[i - 1];
            square[i - 1] = swapped;
        }
    }
    noise = larger(noise, smaller(sqrt(square[SECTORS / 4 - 1]), set->misfit * (dot->p[LIGHT] - dot->p[DARK])));
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k], information = larger(sums[1], set->tiny), size = fabs(shift[k]);
        const double opposite = larger((shift[k] > 0 ? 1 : shift[k] < 0 ? -1 : 0) * shift[(k + SECTORS / 2) % SECTORS], 0);
        const double uneven = larger(size - opposite, size / set->even);
        const double allowed = set->shift * larger(1, dot->p[BLUR]) + set->shift_share * dot->size[0];
        const double mean = sums[4] / larger(sums[0], 1), power = larger(sums[5] - mean * sums[4], set->tiny);
        const double height = (sums[6] - mean * sums[3]) / power;
        strange[k] = larger(uneven / (allowed + set->sigmas * noise / sqrt(information)),
                            fabs(height) / (set->height + set->sigmas * noise / sqrt(power)));
        if (!(sums[0] > 0))
            strange[k] = set->unseen;
    }
}

/* ---- ellipse_descent.py ---- */

/* Adds j'j of m pixels; j has the derivatives, then the residual, then zeros. */
INSIDE void add_products(double (*total)[WIDTH], double (*j)[WIDTH], int m, int rows)
{
    for (int r = 0; r < rows; r++) {
        double row[WIDTH];
        for (int c = 0; c < WIDTH; c++)
            row[c] = total[r][c];
        for (int k = 0; k < m; k++)
            for (int c = 0; c < WIDTH; c++)
                row[c] += j[k][r] * j[k][c];
        for (int c = 0; c < WIDTH; c++)
            total[r][c] = row[c];
    }
}

WIDEST static void evaluate(Dot *dot, int fresh)
{
    const double *p = dot->p, half = 0.5 * (p[LIGHT] - p[DARK]), scale = p[SCALE];
    const int n = dot->ring ? COUNT : DISK;
    const Shape outer = shape_of(dot->set, p[2], p[3], p[4], p[BLUR]);
    const Shape inner = shape_of(dot->set, p[2] / scale, p[3] / scale, p[4] / scale, p[BLUR]);
    double total[COUNT][WIDTH] = {{0}}, block[BLOCK][WIDTH] = {{0}};
    Seen seen, hole;
    memset(dot->sums, 0, sizeof dot->sums);
    for (int64_t from = 0; from < dot->count; from += BLOCK) {
        const int m = dot->count - from < BLOCK ? (int)(dot->count - from) : BLOCK;
        const double *x = dot->x + from, *y = dot->y + from;
        blurred_ellipse(dot, &outer, x, y, p, m, fresh, dot->tips + from, &seen);
        if (dot->ring)
            blurred_ellipse(dot, &inner, x, y, p + HOLE, m, fresh, dot->other_tips + from, &hole);
        for (int i = 0; i < m; i++) {
            const double across = x[i] - dot->origin[0], down = y[i] - dot->origin[1], dx = x[i] - p[0], dy = y[i] - p[1];
            const double light = p[LIGHT] + p[8] * across + p[9] * down;
            const double contrast = light - (p[DARK] + p[10] * across + p[11] * down);
            const double u = seen.u[i], v = seen.v[i], slope = -contrast * seen.by_rho[i];
            double ink = seen.ink[i], *j = block[i];
            j[0] = -slope * seen.gradient_x[i];
            j[1] = -slope * seen.gradient_y[i];
            j[2] = slope * u * dx;
            j[3] = slope * (u * dy + v * dx);
            j[4] = slope * v * dy;
            j[BLUR] = -contrast * seen.by_blur[i];
            if (dot->ring) {
                const double hx = x[i] - p[HOLE], hy = y[i] - p[HOLE + 1], rise = contrast * hole.by_rho[i];
                const double gx = hole.gradient_x[i], gy = hole.gradient_y[i];
                ink -= hole.ink[i];
                j[HOLE] = -rise * gx;
                j[HOLE + 1] = -rise * gy;
                j[2] += rise / scale * hole.u[i] * hx;
                j[3] += rise / scale * (hole.u[i] * hy + hole.v[i] * hx);
                j[4] += rise / scale * hole.v[i] * hy;
                j[SCALE] = -rise * (hx * gx + hy * gy) / scale;
                j[BLUR] += contrast * hole.by_blur[i];
            }
            const double model = light - contrast * ink;
            const int silent = model > dot->saturation;
            const double shown = silent ? dot->saturation : model, residual = dot->grey[from + i] - shown;
            const int sector = sector_of(u, v);
            const double clipped = within(residual, -half, half), steep = slope * seen.steepness[i];
            double *sums = dot->sums[sector];
            dot->residual[from + i] = residual;
            dot->silent[from + i] = (uint8_t)silent;
            dot->sector[from + i] = (uint8_t)sector;
            sums[0] += 1;
            sums[1] += steep * steep;
            sums[2] += steep * clipped;
            sums[3] += residual;
            sums[4] += shown;
            sums[5] += shown * shown;
            sums[6] += shown * residual;
            sums[7] += clipped * clipped;
            j[LIGHT] = 1 - ink;
            j[DARK] = ink;
            j[8] = (1 - ink) * across;
            j[9] = (1 - ink) * down;
            j[10] = ink * across;
            j[11] = ink * down;
            j[n] = residual;
            if (silent || !dot->weight[from + i] || !(fabs(residual) < half))
                memset(j, 0, sizeof block[i]);
        }
        add_products(total, block, m, n);
    }
    memset(dot->normal, 0, sizeof dot->normal);
    memset(dot->gradient, 0, sizeof dot->gradient);
    for (int r = 0; r < n; r++) {
        memcpy(dot->normal[r], total[r], (size_t)n * sizeof(double));
        dot->gradient[r] = total[r][n];
    }
}

/* The normal matrix with its priors, scaled to a diagonal of ones and with a ridge of rounding's size; the gradient with
   them, and the scale. */
static void equations(const Dot *dot, double ridge, double (*a)[COUNT], double *gradient, double *scale)
{
    const double *p = dot->p, contrast = p[LIGHT] - p[DARK];
    const double norm = sqrt(p[LIGHT] * p[LIGHT] + p[DARK] * p[DARK]) * larger(fabs(p[LIGHT]), fabs(p[DARK]));
    const double of_scale = dot->ring ? dot->set->scale_prior * contrast : 0, of_shine = dot->set->shine_prior * contrast;
    const double prior = of_scale * of_scale, shine = of_shine * of_shine;
    const double of_light = -p[DARK] / norm, of_dark = p[LIGHT] / norm;
    memcpy(a, dot->normal, sizeof dot->normal);
    memcpy(gradient, dot->gradient, sizeof dot->gradient);
    for (int r = DISK; r < COUNT; r++)
        a[r][r] += !dot->ring;
    a[SCALE][SCALE] += prior;
    gradient[SCALE] += prior * (0.5 - p[SCALE]);
    for (int r = 8; r < 10; r++) {
        const double beyond = of_light * p[r] + of_dark * p[r + 2];
        a[r][r] += shine * of_light * of_light;
        a[r + 2][r] += shine * of_light * of_dark;
        a[r + 2][r + 2] += shine * of_dark * of_dark;
        gradient[r] -= shine * of_light * beyond;
        gradient[r + 2] -= shine * of_dark * beyond;
    }
    for (int r = 0; r < COUNT; r++)
        scale[r] = 1 / sqrt(larger(a[r][r], 1e-12));
    for (int r = 0; r < COUNT; r++)
        for (int c = 0; c <= r; c++)
            a[r][c] = a[r][c] * (scale[r] * scale[c]) + (r == c ? ridge : 0);
}

static void inverse(const Dot *dot, double *inverted)
{
    double a[COUNT][COUNT], gradient[COUNT], scale[COUNT];
    equations(dot, 1e-12, a, gradient, scale);
    memset(inverted, 0, COUNT * COUNT * sizeof *inverted);
    for (int r = 0; r < COUNT; r++)
        inverted[COUNT * r + r] = 1;
    solve_positive(COUNT, a[0], inverted, COUNT, 1e-14);
    for (int r = 0; r < COUNT; r++)
        for (int c = 0; c < COUNT; c++)
            inverted[COUNT * r + c] *= scale[r] * scale[c];
}

static void move(Dot *dot)
{
    const Settings *set = dot->set;
    double a[COUNT][COUNT], step[COUNT], scale[COUNT], p[COUNT], trace, root;
    int sane = 1;
    equations(dot, 1e-9, a, step, scale);
    for (int r = 0; r < COUNT; r++)
        step[r] *= scale[r];
    solve_positive(COUNT, a[0], step, 1, 1e-14);
    for (int r = 0; r < COUNT; r++) {
        step[r] *= scale[r];
        p[r] = dot->p[r] + step[r];
        sane = sane && isfinite(p[r]);
    }
    dot->step = larger(fabs(step[0]), fabs(step[1]));
    for (int r = 0; r < 2; r++)
        p[r] = dot->p[r] + within(step[r], -set->step, set->step);
    p[BLUR] = within(p[BLUR], dot->p[BLUR] / 2, dot->p[BLUR] * 2);
    p[BLUR] = within(p[BLUR], set->least_blur, set->most_blur);
    p[SCALE] = dot->p[SCALE] + within(step[SCALE], -set->scale_step, set->scale_step);
    p[SCALE] = within(p[SCALE], 0.1, 0.9);
    dot->blur_step = fabs(p[BLUR] - dot->p[BLUR]);
    eigenvalues(p, &trace, &root);
    sane = sane && trace - root > 0.6 / dot->size[0] && trace < 2 / set->shortest && p[LIGHT] > p[DARK];
    for (int r = 0; r < 2; r++)
        sane = sane && fabs(p[r] - dot->origin[r]) < dot->size[1] + 1;
    if (sane)
        memcpy(dot->p, p, sizeof p);
    else
        dot->alive = 0;
}

static int left_out(const Dot *dot)
{
    int count = 0;
    for (int k = 0; k < SECTORS; k++)
        count += dot->left_out[k];
    return count;
}

static int leave_out(Dot *dot)
{
    const Settings *set = dot->set;
    const double noise = noise_of(dot), contrast = dot->p[LIGHT] - dot->p[DARK];
    double strange[SECTORS], worst = 0;
    int bad[SECTORS], changed = 0;
    strangeness(dot, noise, strange);
    for (int k = 0; k < SECTORS; k++)
        if (!dot->left_out[k])
            worst = larger(worst, strange[k]);
    for (int k = 0; k < SECTORS; k++)
        bad[k] = strange[k] > larger(1, worst / 2);
    for (int k = 0; k < SECTORS; k++)
        dot->left_out[k] |= bad[k] || bad[(k + 1) % SECTORS] || bad[(k + SECTORS - 1) % SECTORS];
    double limit = larger(set->outlier_share * contrast, set->outlier_sigma * noise);
    limit = larger(limit, set->outlier_spread * sqrt(variance_of(dot)));
    for (int64_t i = 0; i < dot->count; i++) {
        const uint8_t kept = fabs(dot->residual[i]) < limit && !dot->left_out[dot->sector[i]];
        changed |= kept != dot->weight[i];
        dot->weight[i] = kept;
    }
    if (left_out(dot) > set->left_out)
        dot->alive = 0;
    return changed;
}

static void run(Dot *dot)
{
    int rounds = 0;
    for (int step = 0; step < dot->set->steps && dot->alive; step++) {
        int changed = 0;
        const int calm = dot->step < dot->set->judged && dot->blur_step < dot->set->judged && step >= dot->set->unjudged;
        evaluate(dot, step == 0 || step % 3 == 2);
        if (calm && rounds < dot->set->rounds)
            changed = leave_out(dot);
        rounds += changed;
        if (!changed && dot->alive)
            move(dot);
        if (!changed && calm && !(dot->step > dot->set->converged))
            return;
    }
}

static int complete(Dot *dot, double noise)
{
    double strange[SECTORS];
    int64_t trimmed = 0;
    for (int64_t i = 0; i < dot->count; i++)
        trimmed += !dot->weight[i] && !dot->left_out[dot->sector[i]];
    if (!dot->alive || !(dot->step < dot->set->settled) || (double)trimmed > dot->set->trimmed * (double)dot->count)
        return 0;
    strangeness(dot, noise, strange);
    for (int k = 0; k < SECTORS; k++)
        if (!(strange[k] <= 1) && !dot->left_out[k])
            return 0;
    return 1;
}

static void uneven(const Dot *dot, double variance, double *facts)
{
    const double tiny = dot->set->tiny;
    double sum = 0, odd = 0, pairs = 0;
    for (int k = 0; k < SECTORS; k++) {
        const int l = (k + SECTORS / 2) % SECTORS;
        const double *own = dot->sums[k], *other = dot->sums[l];
        const double information = larger(own[1], tiny), opposite = larger(other[1], tiny);
        const double shift = own[2] / information, apart = shift - other[2] / opposite;
        if (dot->left_out[k])
            continue;
        sum += information * shift * shift;
        if (k < l && !dot->left_out[l]) {
            odd += apart * apart / (1 / information + 1 / opposite);
            pairs++;
        }
    }
    facts[0] = sum / variance / fmax(SECTORS - 5 - left_out(dot), 1);
    facts[1] = odd / variance;
    facts[2] = pairs;
}

static double misfit_of(const Dot *dot)
{
    double squares = 0;
    for (int k = 0; k < SECTORS; k++)
        squares += dot->sums[k][7];
    return (double)dot->count * log(larger(squares / larger((double)dot->count, 1), dot->set->tiny));
}

/* Fits `count` dots, each from the unknowns (count, 15), which it replaces. `wide` is true for pixels of 16 bits;
   `kind` is 1 for rings, plus 2 where the inside of the outline counts as well; `noise` is the largest noise that a dot
   may have; levels, also those of `saturation` and unknowns, count from `unlit`. Writes the inverses of the normal
   matrices (count, 15, 15) and for each dot the variance, the noise, 1 or 0 for a complete outline, the misfit, and what
   EllipseDescent.uneven returns. Returns 0, or -1 without memory. */
int64_t fit_dots(const uint8_t *image, int64_t height, int64_t width, int64_t stride, int wide, int64_t count,
                 const double *semi, const double *angle, const double *band, const uint8_t *kind, double noise,
                 double saturation, double unlit, const Settings *set, const double *table, double *unknowns,
                 double *inverted, double *facts)
{
    Dot dot = {0};
    int64_t status = 0;
    dot.set = set;
    dot.table = table;
    dot.image_noise = noise;
    dot.saturation = saturation;
    dot.unlit = unlit;
    for (int64_t k = 0; k < count && !status; k++) {
        double trace, root;
        memcpy(dot.p, unknowns + COUNT * k, sizeof dot.p);
        memcpy(dot.origin, dot.p, sizeof dot.origin);
        eigenvalues(dot.p, &trace, &root);
        dot.size[0] = 2 / (trace - root);
        dot.size[1] = 2 / (trace + root);
        dot.ring = kind[k] & 1;
        dot.filled = kind[k] & 2;
        dot.alive = 1;
        dot.step = dot.blur_step = INFINITY;
        memset(dot.left_out, 0, sizeof dot.left_out);
        if (!collect(&dot, image, height, width, stride, wide, semi + 2 * k, angle[k], band[k])) {
            status = -1;
            break;
        }
        memset(dot.weight, 1, (size_t)dot.count);
        run(&dot);
        memcpy(unknowns + COUNT * k, dot.p, sizeof dot.p);
        inverse(&dot, inverted + COUNT * COUNT * k);
        facts[FACTS * k] = variance_of(&dot);
        facts[FACTS * k + 1] = noise_of(&dot);
        facts[FACTS * k + 2] = complete(&dot, facts[FACTS * k + 1]);
        facts[FACTS * k + 3] = misfit_of(&dot);
        uneven(&dot, facts[FACTS * k], facts + FACTS * k + 4);
    }
    free(dot.x);
    free(dot.y);
    free(dot.grey);
    free(dot.residual);
    free(dot.tips);
    free(dot.other_tips);
    free(dot.scratch);
    free(dot.weight);
    free(dot.silent);
    free(dot.sector);
    return status;
}

/* What detection does with many small steps per pixel or per dot, compiled: kernel_build.py builds it, kernel.py loads it.

   Plain C99 without dependencies and without state, so any number of threads may call it. Every function has a twin in
   NumPy and OpenCV, named in its comment, and gives the same numbers. Images are rows of pixels, `stride` bytes from one
   row to the next; arrays are contiguous. Sizes are checked by kernel.py. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifndef SOURCE
#define SOURCE "unknown"
#endif

/* Digest of the source that this was built from: kernel.py uses no other. */
const char *kernel_source(void) { return SOURCE; }

/* ------------------------------------------------------------------------------------------------------------------
   dark_components: connected components of the pixels that are darker than the mean of their surroundings
   (twin: components.py, _dark_components).

   A pixel p is dark if round(sum / 225) - p > step, with the sum over the 15 x 15 pixels around it, those beyond the
   image's edge repeated from the edge. Without division: sum + 112 - 225 p >= 225 (step + 1). Dark pixels that share a
   side are of one component.

   One pass, row by row. A row's runs of dark pixels join the components of the runs that they touch in the row above.
   A component without a run in a row is complete: if it has `least` pixels, it is written, and its place is used again.
   So memory is that of a few rows, whatever the image shows.

   Moments are sums over runs from column a to b, with n = b - a + 1 and s = a + b:
       2 sum x = n s    12 sum x^2 = n (3 s^2 + n^2 - 1)    2 sum xy = n s y
   modulo 2^64; relative to the corner of the component's box, they are exact again for boxes of up to 2^15 pixels' side.
   Larger ones are left out.

   Each component takes FIELDS numbers in `found`: pixels; sums of x, y, x^2, xy, y^2 relative to its box; the box's left,
   top, right and bottom column and row; and the place of its first pixel, by which the caller sorts.
   Returns their number, of which at most `capacity` were written, or -1 without memory. */

enum { HALF = 7, WINDOW = 2 * HALF + 1, AREA = WINDOW * WINDOW, FIELDS = 11, LARGEST = 1 << 15 };

typedef struct {
    int32_t first, last, component;
} Run;

typedef struct {
    uint64_t pixels, x2, y, xx12, xy2, yy;
    int64_t first;
    int32_t left, right, top, bottom;
    int32_t into; /* itself, or the component that it was joined to; the next free one */
} Component;

static int32_t final(const Component *all, int32_t i)
{
    while (all[i].into != i)
        i = all[i].into;
    return i;
}

static void join(Component *a, const Component *b)
{
    a->pixels += b->pixels;
    a->x2 += b->x2;
    a->y += b->y;
    a->xx12 += b->xx12;
    a->xy2 += b->xy2;
    a->yy += b->yy;
    if (b->first < a->first)
        a->first = b->first;
    if (b->left < a->left)
        a->left = b->left;
    if (b->right > a->right)
        a->right = b->right;
    if (b->top < a->top)
        a->top = b->top;
    if (b->bottom > a->bottom)
        a->bottom = b->bottom;
}

static int written(const Component *c, int64_t *to)
{
    const uint64_t n = c->pixels, x = (uint64_t)c->left, y = (uint64_t)c->top;
    const uint64_t sum_x = c->x2 / 2 - n * x, sum_y = c->y - n * y;
    if (c->right - c->left >= LARGEST || c->bottom - c->top >= LARGEST)
        return 0;
    if (!to)
        return 1;
    to[0] = (int64_t)n;
    to[1] = (int64_t)sum_x;
    to[2] = (int64_t)sum_y;
    to[3] = (int64_t)((c->xx12 - 12 * x * (2 * sum_x + n * x)) / 12);
    to[4] = (int64_t)((c->xy2 - 2 * (x * sum_y + y * sum_x + n * x * y)) / 2);
    to[5] = (int64_t)(c->yy - y * (2 * sum_y + n * y));
    to[6] = c->left;
    to[7] = c->top;
    to[8] = c->right;
    to[9] = c->bottom;
    to[10] = c->first;
    return 1;
}

/* Columns' sums of the 15 rows around row y, from those of the row before; `sums` has HALF more at either end. */
static void move_down(uint16_t *sums, const uint8_t *image, int64_t height, int64_t width, int64_t stride, int64_t y)
{
    uint16_t *middle = sums + HALF;
    if (y == 0) {
        for (int64_t x = 0; x < width; x++)
            middle[x] = 0;
        for (int64_t i = -HALF; i <= HALF; i++) {
            const uint8_t *row = image + stride * (i < 0 ? 0 : i < height ? i : height - 1);
            for (int64_t x = 0; x < width; x++)
                middle[x] = (uint16_t)(middle[x] + row[x]);
        }
    } else {
        const uint8_t *in = image + stride * (y + HALF < height ? y + HALF : height - 1);
        const uint8_t *out = image + stride * (y - HALF - 1 > 0 ? y - HALF - 1 : 0);
        for (int64_t x = 0; x < width; x++)
            middle[x] = (uint16_t)(middle[x] + in[x] - out[x]);
    }
    for (int64_t i = 0; i < HALF; i++) {
        sums[i] = middle[0];
        middle[width + i] = middle[width - 1];
    }
}

/* 1 where a pixel is dark, else 0. The sum of 15 is that of 8, 4, 2 and 1 neighbors, in blocks that stay in the cache. */
static void mark_dark(uint8_t *dark, const uint16_t *sums, const uint8_t *row, int64_t width, int step)
{
    enum { BLOCK = 1024 };
    uint16_t two[BLOCK + 14], four[BLOCK + 12], eight[BLOCK];
    const uint16_t least = (uint16_t)(AREA * (step + 1));
    for (int64_t from = 0; from < width; from += BLOCK) {
        const int m = width - from < BLOCK ? (int)(width - from) : BLOCK;
        const uint16_t *s = sums + from;
        const uint8_t *p = row + from;
        uint8_t *d = dark + from;
        for (int x = 0; x < m + 13; x++)
            two[x] = (uint16_t)(s[x] + s[x + 1]);
        for (int x = 0; x < m + 11; x++)
            four[x] = (uint16_t)(two[x] + two[x + 2]);
        for (int x = 0; x < m; x++)
            eight[x] = (uint16_t)(four[x] + four[x + 4]);
        for (int x = 0; x < m; x++) {
            const uint16_t sum = (uint16_t)(eight[x] + four[x + 8] + two[x + 12] + s[x + 14] + AREA / 2);
            const uint16_t own = (uint16_t)(AREA * p[x]);
            const uint16_t over = (uint16_t)(sum > own ? sum - own : 0);
            d[x] = over >= least;
        }
    }
}

/* Columns where ones begin and where they end, in turn; returns their number, which is even. `dark` has at least 8 zeros
   behind its end. In rows with texture every other branch would be mispredicted, so there is one for eight pixels. */
static int32_t find_changes(int32_t *changes, const uint8_t *dark, int64_t width)
{
    int32_t count = 0;
    uint8_t before = 0;
    for (int64_t x = 0; x <= width; x += 8) {
        uint64_t word;
        memcpy(&word, dark + x, 8);
        if (word == (before ? UINT64_C(0x0101010101010101) : 0))
            continue;
        for (int i = 0; i < 8; i++) {
            const uint8_t own = dark[x + i];
            changes[count] = (int32_t)(x + i);
            count += own ^ before;
            before = own;
        }
    }
    return count;
}

int64_t dark_components(const uint8_t *image, int64_t height, int64_t width, int64_t stride, int step, int64_t least,
                        int64_t *found, int64_t capacity)
{
    const size_t most = (size_t)width / 2 + 1; /* runs in a row */
    uint16_t *sums = malloc(((size_t)width + 2 * HALF) * sizeof *sums);
    uint8_t *dark = calloc((size_t)width + 16, 1);
    int32_t *changes = malloc((2 * most + 8) * sizeof *changes);
    Run *above = malloc((most + 1) * sizeof *above), *here = malloc((most + 1) * sizeof *here);
    /* Those of two rows, since a joined one stays until the end of its row. */
    Component *all = malloc(2 * most * sizeof *all);
    int32_t above_count = 0, free_one = -1, used = 0;
    int64_t count = 0;

    if (!sums || !dark || !changes || !above || !here || !all) {
        count = -1;
        height = 0;
    }
    if (width == 0)
        height = 0;
    /* One row more, without a dark pixel, completes what is left. */
    for (int64_t y = 0; y <= height && count >= 0 && height; y++) {
        int32_t here_count = 0, i = 0, joined = -1;
        if (y < height) {
            move_down(sums, image, height, width, stride, y);
            mark_dark(dark, sums, image + y * stride, width, step);
            here_count = find_changes(changes, dark, width) / 2;
        }
        /* First to which components the runs belong, without the sums, so that mispredicted branches cost little. */
        above[above_count] = (Run){INT32_MAX, INT32_MAX, -1};
        for (int32_t j = 0; j < here_count; j++) {
            const int32_t a = changes[2 * j], b = changes[2 * j + 1] - 1;
            int32_t own = -1;
            while (above[i].last < a)
                i++;
            for (int32_t k = i; above[k].first <= b; k++) {
                const int32_t other = final(all, above[k].component);
                if (own < 0)
                    own = other;
                else if (other != own) {
                    join(all + own, all + other);
                    all[other].into = own;
                    all[other].pixels = 0;
                    /* Kept until no run refers to it; its number of the next such one is in `left`. */
                    all[other].left = joined;
                    joined = other;
                }
            }
            if (own < 0) {
                if (free_one >= 0) {
                    own = free_one;
                    free_one = all[own].into;
                } else
                    own = used++;
                all[own] = (Component){.first = y * width + a, .left = a, .right = b, .top = (int32_t)y, .into = own};
            }
            here[j] = (Run){a, b, own};
        }
        for (int32_t j = 0; j < here_count; j++) {
            const int32_t a = here[j].first, b = here[j].last, own = final(all, here[j].component);
            const uint64_t n = (uint64_t)(b - a) + 1, s = (uint64_t)a + (uint64_t)b, v = (uint64_t)y;
            Component *c = all + own;
            c->pixels += n;
            c->x2 += n * s;
            c->y += n * v;
            c->xx12 += n * (3 * s * s + n * n - 1);
            c->xy2 += n * s * v;
            c->yy += n * v * v;
            c->left = a < c->left ? a : c->left;
            c->right = b > c->right ? b : c->right;
            c->bottom = (int32_t)y;
            here[j].component = own;
        }
        for (int32_t k = 0; k < above_count; k++) {
            const int32_t own = final(all, above[k].component);
            Component *c = all + own;
            if (c->bottom == y || !c->pixels)
                continue;
            if (c->pixels >= (uint64_t)least)
                count += written(c, count < capacity ? found + FIELDS * count : NULL);
            c->pixels = 0; /* once, although several runs may refer to it */
            c->left = joined;
            joined = own;
        }
        while (joined >= 0) {
            const int32_t next = all[joined].left;
            all[joined].into = free_one;
            free_one = joined;
            joined = next;
        }
        Run *swapped = above;
        above = here;
        here = swapped;
        above_count = here_count;
    }
    free(sums);
    free(dark);
    free(changes);
    free(above);
    free(here);
    free(all);
    return count;
}

/* ------------------------------------------------------------------------------------------------------------------
   elliptic: which components have the moments and the box of an elliptic disk, ring or band, with their outlines
   (twin: components.py, _elliptic, which says more).

   found (k, FIELDS); limits: trace^2 / determinant of the covariance; k^2 of small ones, its growth, and at all; distance
   of the box's sides, px and share. index (k), center (k, 2), spread (k, 2, 2). Returns their number. */

static int touches(double place, double side, double half, const double *limits)
{
    const double slack = limits[4] + limits[5] * half;
    return fabs(place + 0.5 - half) < slack && fabs(side + 0.5 - place - half) < slack;
}

int64_t elliptic(int64_t k, const int64_t *found, const double *limits, int64_t *index, double *center, double *spread)
{
    const double pi = 3.14159265358979323846;
    int64_t count = 0;
    for (int64_t i = 0; i < k; i++) {
        const int64_t *f = found + FIELDS * i;
        const double n = (double)f[0], x = (double)f[1] / n, y = (double)f[2] / n;
        const double xx = (double)f[3] / n - x * x + 1. / 12, xy = (double)f[4] / n - x * y;
        const double yy = (double)f[5] / n - y * y + 1. / 12, determinant = xx * yy - xy * xy;
        const double mean = 4 * pi * sqrt(determinant), outline = (n + mean) / 2, hollow = mean / outline;
        const double small = limits[1] + limits[2] * sqrt(outline / pi);
        if (!((xx + yy) * (xx + yy) < limits[0] * determinant && hollow < 1 + fmin(small, limits[3])))
            continue;
        if (!touches(x, (double)(f[8] - f[6]), 2 * sqrt(xx / hollow), limits) ||
            !touches(y, (double)(f[9] - f[7]), 2 * sqrt(yy / hollow), limits))
            continue;
        double *c = center + 2 * count, *s = spread + 4 * count;
        c[0] = x + (double)f[6];
        c[1] = y + (double)f[7];
        s[0] = xx * (4 / hollow);
        s[1] = s[2] = xy * (4 / hollow);
        s[3] = yy * (4 / hollow);
        index[count++] = i;
    }
    return count;
}

/* ------------------------------------------------------------------------------------------------------------------
   difference_squares: sums of squared differences of neighbors in pieces of 32 pixels of a row
   (twin: components.py, _difference_squares). width: a multiple of 32; sums (height, width / 32). */

void difference_squares(const uint8_t *image, int64_t height, int64_t width, int64_t stride, int64_t *sums)
{
    enum { PIECE = 32 };
    for (int64_t y = 0; y < height; y++)
        for (int64_t x = 0; x < width; x += PIECE) {
            const uint8_t *p = image + y * stride + x;
            int32_t sum = 0;
            for (int i = 0; i < PIECE - 1; i++) {
                const int16_t difference = (int16_t)(p[i + 1] - p[i]);
                sum += difference * difference;
            }
            *sums++ = sum;
        }
}

/* ------------------------------------------------------------------------------------------------------------------
   disk_outlines: image ellipses of n disks of radii r about P = R X + t with the normal N = R e_z, for k poses
   (twin: conic_projection.py, outlines, which says more).

   The dual conic is D = r^2 (I - N N') - P P'; with the last entry made 1, its last column is the center c, and the
   shape is c c' minus the rest.

   points (n, 3), radii (n); rotation (k, 3, 3), translation (k, 3); center, point (k, n, 2), shape (k, n, 2, 2),
   seen (k, n). */

void disk_outlines(int64_t k, int64_t n, const double *points, const double *radii, const double *rotation,
                   const double *translation, double *center, double *point, double *shape, uint8_t *seen)
{
    for (int64_t i = 0; i < k * n; i++) {
        const double *R = rotation + 9 * (i / n), *t = translation + 3 * (i / n), *X = points + 3 * (i % n);
        const double square = radii[i % n] * radii[i % n], a = R[2], b = R[5], c = R[8];
        const double x = R[0] * X[0] + R[1] * X[1] + R[2] * X[2] + t[0];
        const double y = R[3] * X[0] + R[4] * X[1] + R[5] * X[2] + t[1];
        const double z = R[6] * X[0] + R[7] * X[1] + R[8] * X[2] + t[2];
        const double level = z * z - square * (1 - c * c);
        double *m = center + 2 * i, *E = shape + 4 * i;
        m[0] = (x * z + square * a * c) / level;
        m[1] = (y * z + square * b * c) / level;
        E[0] = m[0] * m[0] - (x * x - square * (1 - a * a)) / level;
        E[1] = E[2] = m[0] * m[1] - (x * y + square * a * b) / level;
        E[3] = m[1] * m[1] - (y * y - square * (1 - b * b)) / level;
        point[2 * i] = x / z;
        point[2 * i + 1] = y / z;
        /* Below zero the rim reaches the plane of the camera's center. */
        seen[i] = x * a + y * b + z * c < 0 && z > 0 && level > 0;
    }
}

/* ------------------------------------------------------------------------------------------------------------------
   refine_poses: Levenberg-Marquardt on the weighted distances between measured and predicted centers of the ellipses of
   disks (twin: conic_projection.py, EllipseCenters with maths/levenberg_marquardt.py, whose steps these are one by one).

   A disk of radius r with normal N = R e_z about P = R X + t has the image center
       c = (P_xy P_z + r^2 N_z N_xy) / (P_z^2 - r^2 (1 - N_z^2)),
   and is seen if P_z > 0, the denominator is positive and P'N < 0. The derivative is that of the image of P with respect
   to (w, dt): R <- exp([w]x) R, t <- t + dt. All poses step until none needs another step.

   points (n, 3), radii (n); seen (k, n, 2); weight (k, n, 2, 2), zero for disks that do not count; rotation (k, 3, 3) and
   translation (k, 3) are overwritten; chi2 (k). damping: start, least, slack, ridge, factor. */

static double center_residuals(int64_t n, const double *points, const double *radii, const double *seen,
                               const double *weight, const double *R, const double *t, double *residual)
{
    double chi2 = 0;
    int visible = 1;
    for (int64_t i = 0; i < n; i++) {
        const double *X = points + 3 * i, *W = weight + 4 * i;
        double *r = residual + 2 * i;
        r[0] = r[1] = 0;
        if (W[0] == 0 && W[1] == 0 && W[2] == 0 && W[3] == 0)
            continue;
        double x = R[0] * X[0] + R[1] * X[1] + R[2] * X[2] + t[0];
        double y = R[3] * X[0] + R[4] * X[1] + R[5] * X[2] + t[1];
        double z = R[6] * X[0] + R[7] * X[1] + R[8] * X[2] + t[2];
        double square = radii[i] * radii[i], level = z * z - square * (1 - R[8] * R[8]);
        if (!(z > 0 && level > 0 && x * R[2] + y * R[5] + z * R[8] < 0))
            visible = 0;
        r[0] = seen[2 * i] - (x * z + square * R[8] * R[2]) / level;
        r[1] = seen[2 * i + 1] - (y * z + square * R[8] * R[5]) / level;
        chi2 += (W[0] * r[0] + W[1] * r[1]) * r[0] + (W[2] * r[0] + W[3] * r[1]) * r[1];
    }
    return visible && chi2 < INFINITY ? chi2 : INFINITY;
}

/* J'WJ (6, 6) and J'Wr (6). */
static void center_equations(int64_t n, const double *points, const double *weight, const double *R, const double *t,
                             const double *residual, double *normal, double *gradient)
{
    memset(normal, 0, 36 * sizeof *normal);
    memset(gradient, 0, 6 * sizeof *gradient);
    for (int64_t i = 0; i < n; i++) {
        const double *X = points + 3 * i, *W = weight + 4 * i, *r = residual + 2 * i;
        if (W[0] == 0 && W[1] == 0 && W[2] == 0 && W[3] == 0)
            continue;
        double a = R[0] * X[0] + R[1] * X[1] + R[2] * X[2];
        double b = R[3] * X[0] + R[4] * X[1] + R[5] * X[2];
        double c = R[6] * X[0] + R[7] * X[1] + R[8] * X[2];
        double s = 1 / (c + t[2]), x = s * (a + t[0]), y = s * (b + t[1]);
        a *= s, b *= s, c *= s;
        const double u[6] = {-x * b, c + x * a, -b, s, 0, -x * s}, v[6] = {-y * b - c, y * a, a, 0, s, -y * s};
        for (int p = 0; p < 6; p++) {
            double wu = W[0] * u[p] + W[1] * v[p], wv = W[2] * u[p] + W[3] * v[p];
            gradient[p] += (W[0] * r[0] + W[1] * r[1]) * u[p] + (W[2] * r[0] + W[3] * r[1]) * v[p];
            for (int q = 0; q <= p; q++)
                normal[6 * p + q] += wu * u[q] + wv * v[q];
        }
    }
}

/* Solves N x = b for symmetric positive N (n, n) by Cholesky's decomposition, whose factor replaces its lower triangle, for
   each of `count` b (n). Pivots are `least` or more; without that, a matrix that is not positive gives nan. */
void solve_positive(int n, double *N, double *columns, int count, double least)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = N[n * i + j];
            for (int k = 0; k < j; k++)
                sum -= N[n * i + k] * N[n * j + k];
            N[n * i + j] = i == j ? sqrt(sum > least ? sum : least) : sum / N[n * j + j];
        }
    for (double *b = columns; b < columns + n * count; b += n) {
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < i; k++)
                b[i] -= N[n * i + k] * b[k];
            b[i] /= N[n * i + i];
        }
        for (int i = n - 1; i >= 0; i--) {
            for (int k = i + 1; k < n; k++)
                b[i] -= N[n * k + i] * b[k];
            b[i] /= N[n * i + i];
        }
    }
}

/* exp([w]x) R. */
static void turned(const double *w, const double *R, double *result)
{
    double angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + 1e-150;
    double half = sin(angle / 2) / angle, sine = sin(angle) / angle, square = 2 * half * half;
    double norm = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    for (int j = 0; j < 3; j++) {
        double v[3] = {R[j], R[3 + j], R[6 + j]};
        double cross[3] = {w[1] * v[2] - w[2] * v[1], w[2] * v[0] - w[0] * v[2], w[0] * v[1] - w[1] * v[0]};
        double along = w[0] * v[0] + w[1] * v[1] + w[2] * v[2];
        for (int i = 0; i < 3; i++)
            result[3 * i + j] = v[i] + sine * cross[i] + square * (w[i] * along - norm * v[i]);
    }
}

/* Returns 0, or -1 without memory. */
int refine_poses(int64_t k, int64_t n, const double *points, const double *radii, const double *seen,
                 const double *weight, double *rotation, double *translation, double *chi2, int64_t steps,
                 double tolerance, const double *damping)
{
    const double start = damping[0], least = damping[1], slack = damping[2], ridge = damping[3], factor = damping[4];
    double *residual = malloc(sizeof(double) * (size_t)(2 * k * n + 2 * n + k + 1));
    if (!residual)
        return -1;
    double *fresh = residual + 2 * k * n, *strength = fresh + 2 * n;
    for (int64_t i = 0; i < k; i++) {
        strength[i] = start;
        chi2[i] = center_residuals(n, points, radii, seen + 2 * n * i, weight + 4 * n * i, rotation + 9 * i,
                                   translation + 3 * i, residual + 2 * n * i);
    }
    int going = k > 0;
    for (int64_t step = 0; step < steps && going; step++) {
        going = 0;
        for (int64_t i = 0; i < k; i++) {
            double *R = rotation + 9 * i, *t = translation + 3 * i, *r = residual + 2 * n * i;
            const double *own = weight + 4 * n * i;
            double normal[36], move[6], tried[9], place[3], most = 0;
            center_equations(n, points, own, R, t, r, normal, move);
            for (int p = 0; p < 6; p++)
                most = fmax(most, normal[7 * p]);
            for (int p = 0; p < 6; p++)
                normal[7 * p] += normal[7 * p] * strength[i] + ridge * most + 1e-300;
            solve_positive(6, normal, move, 1, -INFINITY);
            turned(move, R, tried);
            for (int p = 0; p < 3; p++)
                place[p] = t[p] + move[3 + p];
            double before = chi2[i];
            double after = center_residuals(n, points, radii, seen + 2 * n * i, own, tried, place, fresh);
            int good = after <= before * (1 + slack);
            if (good) {
                memcpy(R, tried, sizeof tried);
                memcpy(t, place, sizeof place);
                memcpy(r, fresh, sizeof(double) * (size_t)(2 * n));
                chi2[i] = after;
                strength[i] = fmax(strength[i] / factor, least);
            } else
                strength[i] *= factor;
            double far = sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]), moved = 0;
            for (int p = 0; p < 3; p++)
                moved = fmax(moved, fmax(fabs(move[p]), fabs(move[3 + p]) / far));
            int settled = good && after >= before * (1 - tolerance);
            going |= moved > tolerance && !settled && chi2[i] < INFINITY;
        }
    }
    free(residual);
    return 0;
}

/* ------------------------------------------------------------------------------------------------------------------
   even_edges: ellipses through the edges near rough outlines, where an edge from dark to light is all around
   (twin: candidates.py, _even_edges, which says more, and has the meaning of the limits).

   `rough` has center and axes (x, y, a, b, c) of each outline, its points (x + a u + b v, y + b u + c v) for (u, v) on
   the unit circle; `circle` has SECTORS such u, then as many v. Each edge takes EDGE numbers in `found`: center and axes,
   level outside, step, unevenness, RMS distance, difference across the edge, level in the middle, and xx, xy, yy of the
   center's covariance at unit variance. Returns their number. */

enum { SECTORS = 24, EIGHTH = SECTORS / 8, PLACES = 9, ZERO = PLACES / 2, EDGE = 14, UNKNOWNS = 5 };

static const double PROFILE[PLACES] = {-5, -3, -2, -1, 0, 1, 2, 3, 5};

typedef struct {
    double inside, outside, least_step, step_share, least_eighths, min_sectors[2], min_step, alike, max_uneven[2],
        max_rms[2][2], rounds[2], min_semi, max_elongation, least_scale, soft, middle, middle_share, middle_px;
} EdgeLimits;

typedef struct {
    const uint8_t *rows;
    int64_t height, width, stride;
} Grey;

/* What is no number becomes `low`: places in the image follow from this. */
static double between(double x, double low, double high) { return x > low ? x < high ? x : high : low; }

static double larger(double a, double b) { return a > b ? a : b; }

static double interpolated_inside(const Grey *image, double x, double y)
{
    const int64_t column = (int64_t)x, row = (int64_t)y;
    const double right = x - (double)column, down = y - (double)row;
    const uint8_t *p = image->rows + row * image->stride + column, *q = p + image->stride;
    const double top = p[0] + right * (p[1] - p[0]);
    return top + down * (q[0] + right * (q[1] - q[0]) - top);
}

static double interpolated(const Grey *image, double x, double y)
{
    return interpolated_inside(image, between(x, 0, (double)image->width - 1.001),
                               between(y, 0, (double)image->height - 1.001));
}

static double nearest_pixel(const Grey *image, double x, double y)
{
    const int64_t column = (int64_t)between(x + 0.5, 0, (double)image->width - 1);
    const int64_t row = (int64_t)between(y + 0.5, 0, (double)image->height - 1);
    return image->rows[row * image->stride + column];
}

static int within(const Grey *image, double x, double y)
{
    return x >= 0 && x <= (double)image->width - 1 && y >= 0 && y <= (double)image->height - 1;
}

static double shorter_semi(const double *e)
{
    const double half = (e[2] - e[4]) / 2;
    return (e[2] + e[4]) / 2 - sqrt(half * half + e[3] * e[3]);
}

/* Whether an outline has a normal everywhere, and places that are numbers. */
static int is_ellipse(const double *e)
{
    for (int i = 0; i < UNKNOWNS; i++)
        if (!(fabs(e[i]) < 1e9))
            return 0;
    return shorter_semi(e) > 1e-6;
}

static void outline_point(const double *e, double u, double v, double *place, double *normal)
{
    place[0] = e[0] + e[2] * u + e[3] * v;
    place[1] = e[1] + e[3] * u + e[4] * v;
    const double x = e[4] * u - e[3] * v, y = e[2] * v - e[3] * u, length = sqrt(x * x + y * y);
    normal[0] = x / length;
    normal[1] = y / length;
}

static void sort_few(double *values, int n)
{
    for (int i = 1; i < n; i++) {
        const double value = values[i];
        int j = i;
        for (; j > 0 && values[j - 1] > value; j--)
            values[j] = values[j - 1];
        values[j] = value;
    }
}

static int stands_out(const Grey *image, const double *e, const double *circle, const EdgeLimits *limits)
{
    const double inside = larger(limits->inside, -shorter_semi(e));
    double step[8], sum = 0;
    int good = 0, in_image[8];
    for (int i = 0; i < 8; i++) {
        double p[2], n[2];
        outline_point(e, circle[EIGHTH * i], circle[SECTORS + EIGHTH * i], p, n);
        step[i] = nearest_pixel(image, p[0] + limits->outside * n[0], p[1] + limits->outside * n[1])
                  - nearest_pixel(image, p[0] + inside * n[0], p[1] + inside * n[1]);
        sum += step[i];
        in_image[i] = within(image, p[0], p[1]);
    }
    const double enough = larger(limits->least_step, limits->step_share * (sum / 8));
    for (int i = 0; i < 8; i++)
        good += in_image[i] && step[i] > enough;
    return good >= limits->least_eighths;
}

/* Move the ellipse `e` to the edges near it, and fill in the rest of its row but for the middle; false without edges. */
static int at_crossings(const Grey *image, double *e, const double *circle, const EdgeLimits *limits, int pass)
{
    /* The first pass takes every other normal. */
    const int every = pass ? 1 : 2, sectors = SECTORS / every, odd = sectors / 8;
    const double least = -shorter_semi(e), reach = PROFILE[PLACES - 1] + 1;
    const double right = (double)image->width - 1 - reach, bottom = (double)image->height - 1 - reach;
    double offset[PLACES], step[SECTORS], light[SECTORS], slope[SECTORS], away[SECTORS], sorted[SECTORS];
    double rows[SECTORS][UNKNOWNS], weight[SECTORS], residual[SECTORS], N[UNKNOWNS][UNKNOWNS], solved[3 * UNKNOWNS];
    int good[SECTORS], count = 0;
    for (int j = 0; j < PLACES; j++)
        offset[j] = larger(PROFILE[j], least);
    for (int i = 0; i < sectors; i++) {
        const double u = circle[every * i], v = circle[SECTORS + every * i];
        double p[2], n[2], grey[PLACES];
        outline_point(e, u, v, p, n);
        if (p[0] > reach && p[1] > reach && p[0] < right && p[1] < bottom)
            for (int j = 0; j < PLACES; j++)
                grey[j] = interpolated_inside(image, p[0] + n[0] * offset[j], p[1] + n[1] * offset[j]);
        else
            for (int j = 0; j < PLACES; j++)
                grey[j] = interpolated(image, p[0] + n[0] * offset[j], p[1] + n[1] * offset[j]);
        double lightest = grey[ZERO], darkest = grey[ZERO];
        for (int j = 0; j < ZERO; j++) {
            lightest = larger(lightest, grey[ZERO + 1 + j]);
            darkest = grey[j] < darkest ? grey[j] : darkest;
        }
        const double half = (lightest + darkest) / 2;
        away[i] = INFINITY;
        for (int j = 0; j + 1 < PLACES; j++)
            if (grey[j] < half && grey[j + 1] >= half) {
                const double share = (half - grey[j]) / (grey[j + 1] - grey[j]);
                const double crossing = offset[j] + share * (offset[j + 1] - offset[j]);
                if (fabs(crossing) < fabs(away[i]))
                    away[i] = crossing;
            }
        light[i] = lightest;
        step[i] = sorted[i] = lightest - darkest;
        slope[i] = grey[ZERO + 1] - grey[ZERO - 1];
        good[i] = away[i] < INFINITY && within(image, p[0], p[1]);
        const double row[UNKNOWNS] = {n[0], n[1], n[0] * u, n[0] * v + n[1] * u, n[1] * v};
        memcpy(rows[i], row, sizeof row);
    }
    sort_few(sorted, sectors);
    const double median = (sorted[sectors / 2 - 1] + sorted[sectors / 2]) / 2;
    double mean = 0, square = 0, difference = 0;
    for (int i = odd; i < sectors - odd; i++)
        mean += sorted[i] / (sectors - 2 * odd);
    for (int i = odd; i < sectors - odd; i++)
        square += (sorted[i] - mean) * (sorted[i] - mean) / (sectors - 2 * odd);
    const double uneven = sqrt(square);
    for (int i = 0; i < sectors; i++) {
        good[i] = good[i] && step[i] > limits->alike * median && limits->alike * step[i] < median;
        count += good[i];
        weight[i] = good[i];
        away[i] = good[i] ? away[i] : 0;
        difference += good[i] ? slope[i] : 0;
    }
    if (!(count >= limits->min_sectors[pass] && median >= limits->min_step && uneven < limits->max_uneven[pass] * median))
        return 0;

    const int rounds = (int)limits->rounds[pass];
    for (int done = 1; done <= rounds; done++) {
        const int last = done == rounds;
        memset(N, 0, sizeof N);
        memset(solved, 0, sizeof solved);
        for (int i = 0; i < sectors; i++)
            for (int j = 0; j < UNKNOWNS; j++) {
                const double weighted = weight[i] * rows[i][j];
                for (int k = 0; k <= j; k++)
                    N[j][k] += weighted * rows[i][k];
                solved[j] += weighted * away[i];
            }
        for (int j = 0; j < UNKNOWNS; j++)
            N[j][j] += 1e-9;
        solved[UNKNOWNS] = solved[2 * UNKNOWNS + 1] = 1;
        solve_positive(UNKNOWNS, N[0], solved, last ? 3 : 1, -INFINITY);
        for (int i = 0; i < sectors; i++) {
            residual[i] = away[i];
            for (int j = 0; j < UNKNOWNS; j++)
                residual[i] -= rows[i][j] * solved[j];
            sorted[i] = good[i] ? fabs(residual[i]) : 0;
        }
        if (!last) {
            sort_few(sorted, sectors);
            const double scale = (sorted[sectors / 2 - 1] + sorted[sectors / 2]) / 2;
            const double soft = limits->soft * larger(1.48 * scale, limits->least_scale);
            for (int i = 0; i < sectors; i++) {
                const double r = residual[i] / soft, whole = 1 + r * r;
                weight[i] = good[i] / (whole * whole);
            }
        }
    }
    double total = 0, squares = 0;
    for (int i = 0; i < sectors; i++) {
        total += weight[i];
        squares += weight[i] * residual[i] * residual[i];
    }
    for (int j = 0; j < UNKNOWNS; j++)
        e[j] += solved[j];
    memcpy(sorted, light, sizeof sorted);
    sort_few(sorted, sectors);
    e[5] = (sorted[sectors / 2 - 1] + sorted[sectors / 2]) / 2;
    e[6] = median;
    e[7] = uneven / median;
    e[8] = sqrt(squares / total);
    e[9] = difference / count;
    e[11] = solved[UNKNOWNS];
    e[12] = solved[UNKNOWNS + 1];
    e[13] = solved[2 * UNKNOWNS + 1];
    const double shorter = shorter_semi(e), longer = e[2] + e[4] - shorter;
    return shorter > limits->min_semi && longer < limits->max_elongation * shorter
           && e[8] < limits->max_rms[pass][0] + limits->max_rms[pass][1] * shorter;
}

int64_t even_edges(const uint8_t *image, int64_t height, int64_t width, int64_t stride, const double *rough, int64_t k,
                   const double *circle, const double *limits, double *found)
{
    const Grey grey = {image, height, width, stride};
    const EdgeLimits *of = (const EdgeLimits *)limits;
    int64_t count = 0;
    for (int64_t i = 0; i < k; i++) {
        double *e = found + EDGE * count;
        memcpy(e, rough + UNKNOWNS * i, UNKNOWNS * sizeof *e);
        if (!is_ellipse(e) || !stands_out(&grey, e, circle, of) || !at_crossings(&grey, e, circle, of, 0)
            || !at_crossings(&grey, e, circle, of, 1))
            continue;
        const double size = larger(of->middle, of->middle_share - of->middle_px / shorter_semi(e));
        double sum = interpolated(&grey, e[0], e[1]);
        for (int j = 0; j < SECTORS; j += EIGHTH) {
            const double u = size * circle[j], v = size * circle[SECTORS + j];
            sum += interpolated(&grey, e[0] + e[2] * u + e[3] * v, e[1] + e[3] * u + e[4] * v);
        }
        e[10] = sum / 9;
        count++;
    }
    return count;
}

/* ------------------------------------------------------------------------------------------------------------------
   follow_poses: labelings to which guessed poses lead, fitted (twin: labeling_hypotheses.py, _followed and fit_labelings).

   A guess labels the blobs that are in reach of the outlines it predicts: first near the control point that it starts
   from, if `near_count` is less than n - 1, then all. The pose is fitted to them, from the guess and from its mirrored pose
   if the marker is flat, and the better one labels again, within a narrower reach, until nothing changes. Every such
   stage of every guess is written: labels (k, STAGES, n), -1 for none; misfit (k, STAGES), nan for stages that there are
   not, inf with fewer than four dots; rotation (k, STAGES, 3, 3) and translation (k, STAGES, 3).

   points (n, 3), radii (n), rings (n); near (n, near_count); start (k), or NULL for labels given in the first stage;
   center (b, 2), shape (b, 3): xx, xy, yy; strange (2, b): whether a blob is surely no disk, no ring;
   gates: reach, margin; then both of the narrower one; px, largest factor of all outlines (log), tolerance. */

enum { STAGES = 4, LEAST = 4, FIT_STEPS = 8 };

typedef struct {
    int64_t n, b, flat;
    const double *points, *radii, *center, *shape, *gates, *damping;
    const uint8_t *rings, *strange;
    double *gate[2];      /* (b, 3) inverse squared reach, wide and narrow */
    double *seen, *weight; /* (n, 2), (n, 2, 2) of the dots of a labeling */
    double *drawn;        /* (n, 6): center, shape, 1 if seen */
    double *least;        /* (n) */
} Scene;

static void draw(const Scene *s, const double *R, const double *t)
{
    for (int64_t i = 0; i < s->n; i++) {
        const double *X = s->points + 3 * i;
        double *d = s->drawn + 6 * i, square = s->radii[i] * s->radii[i];
        double x = R[0] * X[0] + R[1] * X[1] + R[2] * X[2] + t[0];
        double y = R[3] * X[0] + R[4] * X[1] + R[5] * X[2] + t[1];
        double z = R[6] * X[0] + R[7] * X[1] + R[8] * X[2] + t[2];
        double level = z * z - square * (1 - R[8] * R[8]);
        d[5] = z > 0 && level > 0 && x * R[2] + y * R[5] + z * R[8] < 0;
        d[0] = (x * z + square * R[8] * R[2]) / level;
        d[1] = (y * z + square * R[8] * R[5]) / level;
        d[2] = d[0] * d[0] - (x * x - square * (1 - R[2] * R[2])) / level;
        d[3] = d[0] * d[1] - (x * y + square * R[2] * R[5]) / level;
        d[4] = d[1] * d[1] - (y * y - square * (1 - R[5] * R[5])) / level;
    }
}

/* Labels dots, all or those of `own` (count), and returns how many have a blob. */
static int64_t label(const Scene *s, int narrow, const int64_t *own, int64_t count, int64_t *labels)
{
    const double *gate = s->gate[narrow];
    for (int64_t i = 0; i < s->n; i++) {
        labels[i] = -1;
        s->least[i] = INFINITY;
    }
    for (int64_t j = 0; j < (own ? count : s->n); j++) {
        const int64_t i = own ? own[j] : j;
        const double *d = s->drawn + 6 * i;
        const uint8_t *strange = s->strange + (s->rings[i] ? s->b : 0);
        if (d[5] == 0)
            continue;
        double best = INFINITY;
        int64_t which = -1;
        for (int64_t k = 0; k < s->b; k++) {
            double dx = d[0] - s->center[2 * k], dy = d[1] - s->center[2 * k + 1];
            double square = gate[3 * k] * dx * dx + 2 * gate[3 * k + 1] * dx * dy + gate[3 * k + 2] * dy * dy;
            if (square < best && !strange[k]) {
                best = square;
                which = k;
            }
        }
        if (best <= 1) {
            labels[i] = which;
            s->least[i] = best;
        }
    }
    /* Of two dots with the same blob, the farther one gets none. */
    int64_t labeled = 0;
    for (int64_t i = 0; i < s->n; i++)
        for (int64_t j = 0; j < s->n && labels[i] >= 0; j++)
            if (s->least[j] < s->least[i] && (labels[j] == labels[i] || labels[j] == -2 - labels[i]))
                labels[i] = -2 - labels[i];
    for (int64_t i = 0; i < s->n; i++) {
        if (labels[i] < -1)
            labels[i] = -1;
        labeled += labels[i] >= 0;
    }
    return labeled;
}

static void root(const double *e, double *result)
{
    double area = sqrt(e[0] * e[2] - e[1] * e[1]), scale = sqrt(e[0] + e[2] + 2 * area);
    result[0] = (e[0] + area) / scale;
    result[1] = e[1] / scale;
    result[2] = (e[2] + area) / scale;
}

/* The misfit of labels at a pose, in px. */
static double misfit_of(const Scene *s, const int64_t *labels, const double *R, const double *t)
{
    draw(s, R, t);
    double ratio = 0, offset = 0, outline = 0, a[3], e[3];
    int64_t count = 0;
    for (int64_t i = 0; i < s->n; i++) {
        if (labels[i] < 0)
            continue;
        const double *d = s->drawn + 6 * i, *seen = s->shape + 3 * labels[i], *at = s->center + 2 * labels[i];
        if (d[5] == 0)
            return INFINITY;
        ratio += 0.25 * log((seen[0] * seen[2] - seen[1] * seen[1]) / (d[2] * d[4] - d[3] * d[3]));
        offset += (at[0] - d[0]) * (at[0] - d[0]) + (at[1] - d[1]) * (at[1] - d[1]);
        count++;
    }
    double limit = s->gates[5], factor = exp(fmin(fmax(ratio / (double)count, -limit), limit));
    for (int64_t i = 0; i < s->n; i++) {
        if (labels[i] < 0)
            continue;
        root(s->shape + 3 * labels[i], a);
        root(s->drawn + 6 * i + 2, e);
        double xx = a[0] - factor * e[0], xy = a[1] - factor * e[1], yy = a[2] - factor * e[2];
        outline += xx * xx + 2 * xy * xy + yy * yy;
    }
    double error = s->gates[4] * sqrt(offset / (double)(count > 4 ? count - 3 : 1) + outline / (double)count);
    return error < INFINITY ? error : INFINITY;
}

/* Fits a pose to labels; returns -1 without memory. */
static int fit_pose(const Scene *s, const int64_t *labels, double *R, double *t)
{
    double chi2;
    memset(s->weight, 0, sizeof(double) * (size_t)(4 * s->n));
    for (int64_t i = 0; i < s->n; i++)
        if (labels[i] >= 0) {
            s->weight[4 * i] = s->weight[4 * i + 3] = s->gates[4] * s->gates[4];
            s->seen[2 * i] = s->center[2 * labels[i]];
            s->seen[2 * i + 1] = s->center[2 * labels[i] + 1];
        }
    return refine_poses(1, s->n, s->points, s->radii, s->seen, s->weight, R, t, &chi2, FIT_STEPS, s->gates[6],
                        s->damping);
}

/* The pose with nearly the same image of a flat marker: its normal reflected about the line of sight to its middle. */
void mirrored_pose(int64_t count, const double *points, const double *R, const double *t, double *result, double *place)
{
    double m[3] = {0, 0, 0}, p[3], l[3], target[3], axis[3], along = 0, norm = 0, cosine = 0;
    for (int64_t i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            m[a] += points[3 * i + a] / (double)count;
    for (int a = 0; a < 3; a++) {
        p[a] = R[3 * a] * m[0] + R[3 * a + 1] * m[1] + R[3 * a + 2] * m[2] + t[a];
        norm += p[a] * p[a];
    }
    norm = sqrt(norm);
    for (int a = 0; a < 3; a++) {
        l[a] = p[a] / norm;
        along += l[a] * R[3 * a + 2];
    }
    for (int a = 0; a < 3; a++) {
        target[a] = 2 * along * l[a] - R[3 * a + 2];
        cosine += target[a] * R[3 * a + 2];
    }
    const double n[3] = {R[2], R[5], R[8]};
    for (int a = 0; a < 3; a++)
        axis[a] = n[(a + 1) % 3] * target[(a + 2) % 3] - n[(a + 2) % 3] * target[(a + 1) % 3];
    /* v + axis x v + axis x (axis x v) / (1 + cosine), for each column v. */
    for (int j = 0; j < 3; j++) {
        double v[3] = {R[j], R[3 + j], R[6 + j]}, once[3], twice[3];
        for (int a = 0; a < 3; a++)
            once[a] = axis[(a + 1) % 3] * v[(a + 2) % 3] - axis[(a + 2) % 3] * v[(a + 1) % 3];
        for (int a = 0; a < 3; a++)
            twice[a] = axis[(a + 1) % 3] * once[(a + 2) % 3] - axis[(a + 2) % 3] * once[(a + 1) % 3];
        for (int a = 0; a < 3; a++)
            result[3 * a + j] = v[a] + once[a] + twice[a] / (1 + cosine);
    }
    for (int a = 0; a < 3; a++)
        place[a] = p[a] - (result[3 * a] * m[0] + result[3 * a + 1] * m[1] + result[3 * a + 2] * m[2]);
}

static int follow(const Scene *s, int64_t near_count, const int64_t *own, int64_t *labels, double *misfit,
                  double *rotation, double *translation)
{
    double R[9], t[3], other[9], place[3];
    memcpy(R, rotation, sizeof R);
    memcpy(t, translation, sizeof t);
    int64_t count = 0;
    if (own) {
        draw(s, R, t);
        if (near_count < s->n - 1) {
            if (label(s, 0, own, near_count + 1, labels) < LEAST)
                return 0;
            if (fit_pose(s, labels, R, t))
                return -1;
            draw(s, R, t);
        }
        count = label(s, 0, NULL, 0, labels);
    } else
        for (int64_t i = 0; i < s->n; i++)
            count += labels[i] >= 0;
    for (int stage = 0; stage < STAGES; stage++) {
        if (count < LEAST) {
            if (stage == 0) {
                misfit[0] = INFINITY;
                memcpy(rotation, R, sizeof R);
                memcpy(translation, t, sizeof t);
            }
            return 0;
        }
        memcpy(other, R, sizeof R);
        memcpy(place, t, sizeof t);
        if (s->flat)
            mirrored_pose(s->n, s->points, R, t, other, place);
        if (fit_pose(s, labels, R, t))
            return -1;
        misfit[stage] = misfit_of(s, labels, R, t);
        if (s->flat) {
            if (fit_pose(s, labels, other, place))
                return -1;
            double mirrored = misfit_of(s, labels, other, place);
            if (mirrored < misfit[stage]) {
                misfit[stage] = mirrored;
                memcpy(R, other, sizeof R);
                memcpy(t, place, sizeof t);
            }
        }
        memcpy(rotation + 9 * stage, R, sizeof R);
        memcpy(translation + 3 * stage, t, sizeof t);
        if (stage + 1 == STAGES)
            return 0;
        draw(s, R, t);
        int64_t *following = labels + s->n;
        count = label(s, 1, NULL, 0, following);
        for (int k = 0; k <= stage; k++)
            if (!memcmp(following, following - s->n * (k + 1), sizeof(int64_t) * (size_t)s->n))
                return 0;
        labels = following;
    }
    return 0;
}

/* Returns 0, or -1 without memory. */
int follow_poses(int64_t k, int64_t n, int64_t b, int64_t flat, int64_t near_count, const double *points,
                 const double *radii, const uint8_t *rings, const int64_t *near, const int64_t *start,
                 const double *center, const double *shape, const uint8_t *strange, const double *gates,
                 const double *damping, int64_t *labels, double *misfit, double *rotation, double *translation)
{
    double *memory = malloc(sizeof(double) * (size_t)(6 * b + 13 * n + 1));
    int64_t *own = malloc(sizeof(int64_t) * (size_t)(near_count + 1));
    int failed = !memory || !own;
    if (!failed) {
        Scene s = {n, b, flat, points, radii, center, shape, gates, damping, rings, strange, {memory, memory + 3 * b},
                   memory + 6 * b, memory + 6 * b + 2 * n, memory + 6 * b + 6 * n, memory + 6 * b + 12 * n};
        for (int narrow = 0; narrow < 2; narrow++)
            for (int64_t j = 0; j < b; j++) {
                double reach = gates[2 * narrow] * gates[2 * narrow];
                double margin = gates[2 * narrow + 1] * gates[2 * narrow + 1], *gate = s.gate[narrow] + 3 * j;
                double xx = reach * shape[3 * j] + margin, xy = reach * shape[3 * j + 1];
                double yy = reach * shape[3 * j + 2] + margin, det = xx * yy - xy * xy;
                gate[0] = yy / det;
                gate[1] = -xy / det;
                gate[2] = xx / det;
            }
        for (int64_t i = 0; i < n; i++)
            s.seen[2 * i] = s.seen[2 * i + 1] = 0;
        for (int64_t i = 0; i < k && !failed; i++) {
            if (start) {
                own[0] = start[i];
                memcpy(own + 1, near + near_count * start[i], sizeof(int64_t) * (size_t)near_count);
            }
            failed = follow(&s, near_count, start ? own : NULL, labels + STAGES * n * i, misfit + STAGES * i,
                            rotation + 9 * STAGES * i, translation + 3 * STAGES * i);
        }
    }
    free(memory);
    free(own);
    return failed ? -1 : 0;
}

/* ------------------------------------------------------------------------------------------------------------------
   guess_poses: poses guessed from pairs of blobs that a pair of dots could be (twin: pose_hypotheses.py, _round).

   The outline of the first blob has two poses of a disk, `position` in its radii and `normal` (b, 2, 3); the ray through
   the second meets their planes where that blob lies. A guess is good if its distance, size and shape are those of the
   dots within `slack` (b), and if at least `least` of the `near` (n, near_count) dots of the first one have a blob of about
   their size; `by_x` (b) has the blobs in the order of their columns.

   first, second (m); pairs (q, 2); center (b, 2), shape (b, 3), area (b); strange (2, b) as in follow_poses;
   settings: px, drift, drift in px, size (log), tolerance of the sizes' ratio. Returns the number of good guesses, of which at most `capacity` are
   written, or -1 without memory: start, votes, quality, rotation and translation. */

static double stretched(const double *e, double det, double x, double y, const double *n)
{
    double ax = n[0] - x * n[2], ay = n[1] - y * n[2];
    double xx = 1 + x * x - ax * ax, yy = 1 + y * y - ay * ay, xy = x * y - ax * ay;
    double area = fmax(xx * yy - xy * xy, 1e-12);
    double ratio = (e[0] * yy + e[2] * xx - 2 * e[1] * xy) / area / (2 * sqrt(det / area));
    return acosh(fmax(ratio, 1));
}

int64_t guess_poses(int64_t m, int64_t q, int64_t b, int64_t near_count, int64_t least, int64_t capacity,
                    const int64_t *first, const int64_t *second, const int64_t *pairs,
                    const double *points, const double *radii, const uint8_t *rings, const int64_t *near,
                    const double *center, const double *shape, const double *area, const double *slack,
                    const double *position, const double *normal, const uint8_t *strange, const int64_t *by_x,
                    const double *settings, int64_t *start, int64_t *votes, double *quality, double *rotation,
                    double *translation)
{
    const double px = settings[0], drift = settings[1], drift_px = settings[2], alike = settings[3];
    const double least_size = exp(-2 * alike), most_size = exp(2 * alike);
    /* Squared distances in radii of the first dot, which tell at once that a pair of one height is out of the question. */
    double *apart = malloc(sizeof(double) * (size_t)(q + 1));
    int64_t count = 0;
    if (!apart)
        return -1;
    for (int64_t k = 0; k < q; k++) {
        const double *X = points + 3 * pairs[2 * k], *Y = points + 3 * pairs[2 * k + 1], r = radii[pairs[2 * k]];
        const double dx = Y[0] - X[0], dy = Y[1] - X[1];
        apart[k] = X[2] == Y[2] ? (dx * dx + dy * dy) / (r * r) : NAN;
    }
    for (int64_t pair = 0; pair < 2 * m; pair++) {
        const int64_t i = first[pair % m], j = second[pair % m], side = pair / m;
        const double *p = position + 6 * i + 3 * side, *n = normal + 6 * i + 3 * side;
        const double x = center[2 * j], y = center[2 * j + 1];
        const double toward = n[0] * x + n[1] * y + n[2], allowed = hypot(slack[i], slack[j]);
        if (!(toward < 0) || !(stretched(shape + 3 * j, area[j] * area[j], x, y, n) < allowed))
            continue;
        const double limit = exp(2 * allowed), growth = exp(2 * settings[4] * allowed);
        const double away = n[0] * p[0] + n[1] * p[1] + n[2] * p[2];
        const double square_ray = x * x + y * y + 1, along_ray = x * p[0] + y * p[1] + p[2];
        const double square_p = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], deep = away / toward;
        const double far_out = deep * deep * square_ray - 2 * deep * along_ray + square_p, slack_out = limit * (1 + 1e-6);
        for (int64_t k = 0; k < q; k++) {
            if (apart[k] > far_out * slack_out || apart[k] * slack_out < far_out)
                continue;
            const int64_t a = pairs[2 * k], c = pairs[2 * k + 1];
            if (strange[rings[a] * b + i] || strange[rings[c] * b + j])
                continue;
            const double r = radii[a], *X = points + 3 * a, *Y = points + 3 * c;
            const double step[3] = {Y[0] - X[0], Y[1] - X[1], Y[2] - X[2]};
            const double lateral = step[0] * step[0] + step[1] * step[1], depth = (away * r + step[2]) / toward;
            const double far = depth * depth * square_ray - 2 * depth * r * along_ray + r * r * square_p - step[2] * step[2];
            const double size = radii[c] * radii[c] * -toward / (depth * depth * area[j]);
            /* The squares of the ratios; a guess that is no number is no good one. */
            if (!(depth > 0 && lateral < far * limit && lateral * limit > far && size < growth && size * growth > 1))
                continue;
            const double scale = sqrt(lateral / far);
            double u[3] = {depth * x - r * p[0] - step[2] * n[0], depth * y - r * p[1] - step[2] * n[1],
                           depth - r * p[2] - step[2] * n[2]};
            const double length = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), span = sqrt(lateral);
            for (int d = 0; d < 3; d++)
                u[d] /= length;
            const double v[3] = {n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0]};
            const double cosine = step[0] / span, sine = step[1] / span;
            double R[9], t[3];
            for (int d = 0; d < 3; d++) {
                R[3 * d] = cosine * u[d] - sine * v[d];
                R[3 * d + 1] = sine * u[d] + cosine * v[d];
                R[3 * d + 2] = n[d];
                t[d] = scale * r * p[d] - (R[3 * d] * X[0] + R[3 * d + 1] * X[1] + R[3 * d + 2] * X[2]);
            }
            int64_t hits = 0;
            for (int64_t l = 0; l < near_count && hits + near_count - l >= least; l++) {
                const int64_t dot = near[near_count * a + l];
                const double *Z = points + 3 * dot, dx = Z[0] - X[0], dy = Z[1] - X[1], dz = Z[2] - X[2];
                const double px_ = R[0] * Z[0] + R[1] * Z[1] + R[2] * Z[2] + t[0];
                const double py_ = R[3] * Z[0] + R[4] * Z[1] + R[5] * Z[2] + t[1];
                const double pz_ = R[6] * Z[0] + R[7] * Z[1] + R[8] * Z[2] + t[2];
                const double facing = -(px_ * n[0] + py_ * n[1] + pz_ * n[2]);
                if (!(pz_ > 0 && facing > 0))
                    continue;
                const double gate = drift * sqrt(dx * dx + dy * dy + dz * dz) / pz_ + drift_px / px;
                const double expected = radii[dot] * radii[dot] * facing / (pz_ * pz_ * pz_);
                const double ex = px_ / pz_, ey = py_ / pz_;
                int64_t low = 0, high = b;
                while (low < high) {
                    const int64_t middle = (low + high) / 2;
                    if (center[2 * by_x[middle]] < ex - gate)
                        low = middle + 1;
                    else
                        high = middle;
                }
                for (; low < b && center[2 * by_x[low]] <= ex + gate; low++) {
                    const double *at = center + 2 * by_x[low], own = area[by_x[low]];
                    if ((ex - at[0]) * (ex - at[0]) + (ey - at[1]) * (ey - at[1]) < gate * gate &&
                        own > expected * least_size && own < expected * most_size) {
                        hits++;
                        break;
                    }
                }
            }
            if (hits < least)
                continue;
            if (count < capacity) {
                start[count] = a;
                votes[count] = hits;
                quality[count] = hypot(0.5 * log(lateral / far), 0.5 * log(size)) / allowed;
                memcpy(rotation + 9 * count, R, sizeof R);
                memcpy(translation + 3 * count, t, sizeof t);
            }
            count++;
        }
    }
    free(apart);
    return count;
}

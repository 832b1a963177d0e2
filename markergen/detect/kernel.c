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

/* Solves N s = g by Cholesky, in the lower triangle of N; a matrix that is not positive gives nan. */
static void solve_six(double *N, double *s)
{
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double sum = N[6 * i + j];
            for (int k = 0; k < j; k++)
                sum -= N[6 * i + k] * N[6 * j + k];
            N[6 * i + j] = i == j ? sqrt(sum) : sum / N[6 * j + j];
        }
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++)
            s[i] -= N[6 * i + k] * s[k];
        s[i] /= N[6 * i + i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++)
            s[i] -= N[6 * k + i] * s[k];
        s[i] /= N[6 * i + i];
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
            solve_six(normal, move);
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
        max_rms[2][2], rounds[2], min_semi, max_elongation, least_scale, soft, middle;
} EdgeLimits;

typedef struct {
    const uint8_t *rows;
    int64_t height, width, stride;
} Grey;

static double between(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

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

/* Solve N x = b for symmetric positive N by Cholesky's decomposition, whose factor is left in N; `columns` of b, each
   UNKNOWNS long. */
static void solve_five(double N[UNKNOWNS][UNKNOWNS], double *b, int columns)
{
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = N[i][j];
            for (int k = 0; k < j; k++)
                sum -= N[i][k] * N[j][k];
            N[i][j] = i == j ? sqrt(sum) : sum / N[j][j];
        }
    for (int c = 0; c < columns; c++, b += UNKNOWNS) {
        for (int i = 0; i < UNKNOWNS; i++) {
            for (int k = 0; k < i; k++)
                b[i] -= N[i][k] * b[k];
            b[i] /= N[i][i];
        }
        for (int i = UNKNOWNS - 1; i >= 0; i--) {
            for (int k = i + 1; k < UNKNOWNS; k++)
                b[i] -= N[k][i] * b[k];
            b[i] /= N[i][i];
        }
    }
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
        solve_five(N, solved, last ? 3 : 1);
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
        if (!stands_out(&grey, e, circle, of) || !at_crossings(&grey, e, circle, of, 0)
            || !at_crossings(&grey, e, circle, of, 1))
            continue;
        double sum = interpolated(&grey, e[0], e[1]);
        for (int j = 0; j < SECTORS; j += EIGHTH) {
            const double u = of->middle * circle[j], v = of->middle * circle[SECTORS + j];
            sum += interpolated(&grey, e[0] + e[2] * u + e[3] * v, e[1] + e[3] * u + e[4] * v);
        }
        e[10] = sum / 9;
        count++;
    }
    return count;
}

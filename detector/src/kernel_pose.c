/* The pose of labeled dots with its covariance, and scores of labelings, compiled; see kernel.c. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* In kernel.c. */
int refine_poses(int64_t k, int64_t n, const double *points, const double *radii, const double *seen,
                 const double *weight, double *rotation, double *translation, double *chi2, int64_t steps,
                 double tolerance, const double *damping);
void disk_outlines(int64_t k, int64_t n, const double *points, const double *radii, const double *rotation,
                   const double *translation, double *center, double *point, double *shape, uint8_t *seen);
void mirrored_pose(int64_t n, const double *points, const double *R, const double *t, double *result, double *place);
void solve_positive(int n, double *N, double *columns, int count, double least);

/* ------------------------------------------------------------------------------------------------------------------
   estimate_pose: the pose of labeled dots, its mirrored rival and its covariance (twin: pose.py, _estimated).

   points (n, 3), radii (n); seen (n, 2), their image's covariance image (n, 2, 2) and that of the print, place (n, 3, 3)
   in m^2; flat: whether there is a mirrored pose; rotation (k + 2, 3, 3) and translation (k + 2, 3) begin with k starts;
   settings: tolerance, that of the mirrored pose, most difference of half chi2, sigmas of rough points; steps.
   Writes rotation, translation and chi2 (k + 2) of the better pose, then of the other one, if there are two; covariances
   (2, 6, 6) from image and print, without the scale; and the scale. Returns the number of poses, or -1 without memory. */

typedef struct {
    int64_t n;
    const double *points, *radii, *image, *place;
} Dots;

static void invert_two(const double *S, double *W)
{
    const double det = S[0] * S[3] - S[1] * S[2];
    W[0] = S[3] / det;
    W[1] = -S[1] / det;
    W[2] = -S[2] / det;
    W[3] = S[0] / det;
}

/* The derivatives (2, 6) of a dot's image with respect to the pose (w, dt), and its covariance due to the print. */
static void dot_rows(const Dots *d, int64_t i, const double *R, const double *t, double (*J)[6], double *print)
{
    const double *X = d->points + 3 * i, *S = d->place + 9 * i;
    double p[3], moved[2][3];
    for (int a = 0; a < 3; a++)
        p[a] = R[3 * a] * X[0] + R[3 * a + 1] * X[1] + R[3 * a + 2] * X[2];
    const double s = 1 / (p[2] + t[2]), x = s * (p[0] + t[0]), y = s * (p[1] + t[1]);
    const double a = s * p[0], b = s * p[1], c = s * p[2];
    const double rows[2][6] = {{-x * b, c + x * a, -b, s, 0, -x * s}, {-y * b - c, y * a, a, 0, s, -y * s}};
    memcpy(J, rows, sizeof rows);
    for (int r = 0; r < 2; r++)
        for (int q = 0; q < 3; q++)
            moved[r][q] = J[r][3] * R[q] + J[r][4] * R[3 + q] + J[r][5] * R[6 + q];
    for (int r = 0; r < 2; r++)
        for (int q = 0; q < 2; q++) {
            double sum = 0;
            for (int u = 0; u < 3; u++)
                for (int v = 0; v < 3; v++)
                    sum += moved[r][u] * S[3 * u + v] * moved[q][v];
            print[2 * r + q] = sum;
        }
}

/* Refines k poses, with weights from image and print at the poses as given. */
static int refined(const Dots *d, int64_t k, const double *seen, double *weight, double *R, double *t, double *chi2,
                   int64_t steps, double tolerance, const double *damping)
{
    for (int64_t i = 0; i < k * d->n; i++) {
        double J[2][6], spread[4];
        dot_rows(d, i % d->n, R + 9 * (i / d->n), t + 3 * (i / d->n), J, spread);
        for (int e = 0; e < 4; e++)
            spread[e] += d->image[4 * (i % d->n) + e];
        invert_two(spread, weight + 4 * i);
    }
    return refine_poses(k, d->n, d->points, d->radii, seen, weight, R, t, chi2, steps, tolerance, damping);
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Covariances from image and print, and residual_scale of pose.py; `scratch` (4, n). */
static void pose_spread(const Dots *d, const double *seen, const double *R, const double *t, double rough_sigma,
                        double *covariance, double *scale, double *scratch)
{
    double N[36] = {0}, C[36] = {0}, J[2][6], print[4], S[4], W[4];
    double *chi2 = scratch, *variance = scratch + d->n, *sorted = scratch + 2 * d->n;
    for (int64_t i = 0; i < d->n; i++) {
        double center[2], point[2], shape[4];
        uint8_t front;
        dot_rows(d, i, R, t, J, print);
        for (int e = 0; e < 4; e++)
            S[e] = d->image[4 * i + e] + print[e];
        invert_two(S, W);
        for (int p = 0; p < 6; p++)
            for (int q = 0; q < 6; q++)
                N[6 * p + q] += (W[0] * J[0][p] + W[2] * J[1][p]) * J[0][q] + (W[1] * J[0][p] + W[3] * J[1][p]) * J[1][q];
        disk_outlines(1, 1, d->points + 3 * i, d->radii + i, R, t, center, point, shape, &front);
        const double x = seen[2 * i] - center[0], y = seen[2 * i + 1] - center[1];
        chi2[i] = (W[0] * x + W[1] * y) * x + (W[2] * x + W[3] * y) * y;
        variance[i] = sorted[i] = S[0] + S[3];
    }
    for (int p = 0; p < 6; p++)
        C[7 * p] = 1;
    solve_positive(6, N, C, 6, -INFINITY);
    memset(covariance, 0, 72 * sizeof *covariance);
    for (int64_t i = 0; i < d->n; i++) {
        double G[2][6];
        dot_rows(d, i, R, t, J, print);
        for (int e = 0; e < 4; e++)
            S[e] = d->image[4 * i + e] + print[e];
        invert_two(S, W);
        for (int p = 0; p < 6; p++) {
            double u = 0, v = 0;
            for (int q = 0; q < 6; q++) {
                u += J[0][q] * C[6 * q + p];
                v += J[1][q] * C[6 * q + p];
            }
            G[0][p] = W[0] * u + W[1] * v;
            G[1][p] = W[2] * u + W[3] * v;
        }
        for (int source = 0; source < 2; source++) {
            const double *P = source ? print : d->image + 4 * i;
            for (int p = 0; p < 6; p++)
                for (int q = 0; q < 6; q++)
                    covariance[36 * source + 6 * p + q] += (G[0][p] * P[0] + G[1][p] * P[2]) * G[0][q]
                                                           + (G[0][p] * P[1] + G[1][p] * P[3]) * G[1][q];
        }
    }
    qsort(sorted, (size_t)d->n, sizeof *sorted, compare);
    const double most = rough_sigma * rough_sigma * (sorted[(d->n - 1) / 2] + sorted[d->n / 2]) / 2;
    double total = 0, freedom = -6;
    for (int64_t i = 0; i < d->n; i++)
        if (variance[i] <= most) {
            total += chi2[i];
            freedom += 2;
        }
    *scale = freedom > 0 && total / freedom > 1 ? total / freedom : 1;
}

int64_t estimate_pose(int64_t n, int64_t k, const double *points, const double *radii, const double *seen,
                      const double *image, const double *place, int64_t flat, double *rotation, double *translation,
                      double *chi2, int64_t steps, const double *settings, const double *damping, double *covariance,
                      double *scale)
{
    const Dots dots = {n, points, radii, image, place};
    const double tolerance = settings[0], coarse = settings[1], searched = settings[2];
    const int64_t most = k > 4 ? k : 4;
    double *weight = malloc(sizeof(double) * (size_t)(4 * n * most)), *measured = malloc(sizeof(double) * (size_t)(2 * n * k));
    int64_t count = -1, best = 0;
    if (!weight || !measured)
        goto end;
    for (int64_t i = 0; i < k; i++)
        memcpy(measured + 2 * n * i, seen, sizeof(double) * (size_t)(2 * n));
    if (refined(&dots, k, measured, weight, rotation, translation, chi2, steps, tolerance, damping))
        goto end;
    for (int64_t i = 1; i < k; i++)
        if (chi2[i] < chi2[best])
            best = i;
    count = chi2[best] < INFINITY;
    if (!count)
        goto end;
    double R[2][9], t[2][3], cost[2] = {chi2[best], INFINITY};
    memcpy(R[0], rotation + 9 * best, sizeof R[0]);
    memcpy(t[0], translation + 3 * best, sizeof t[0]);
    if (flat) {
        const double spread = fmax(1, cost[0] / (double)(2 * n - 6));
        mirrored_pose(n, points, R[0], t[0], R[1], t[1]);
        count = -1;
        if (refined(&dots, 1, seen, weight, R[1], t[1], cost + 1, steps, coarse, damping))
            goto end;
        if (cost[1] - cost[0] < 2 * searched * spread
            && refined(&dots, 1, seen, weight, R[1], t[1], cost + 1, steps, tolerance, damping))
            goto end;
        count = 2;
    }
    const int first = cost[1] < cost[0];
    for (int i = 0; i < 2; i++) {
        const int from = i ? !first : first;
        memcpy(rotation + 9 * i, R[from], sizeof R[0]);
        memcpy(translation + 3 * i, t[from], sizeof t[0]);
        chi2[i] = cost[from];
    }
    pose_spread(&dots, seen, rotation, translation, settings[3], covariance, scale, weight);
end:
    free(weight);
    free(measured);
    return count;
}

/* ------------------------------------------------------------------------------------------------------------------
   homography: from n points to their images by normalized DLT (twin: maths/dlt.py, estimate_homography, which says more).

   The eigenvector of the smallest eigenvalue of A'A by inverse iteration: eight steps leave the others' share, which
   shrinks by the ratio of the eigenvalues each time, below rounding. points, image (n, 2); H (3, 3). */

static void normalization(int64_t n, const double *points, double *center, double *scale)
{
    double square = 0;
    center[0] = center[1] = 0;
    for (int64_t i = 0; i < n; i++) {
        center[0] += points[2 * i] / (double)n;
        center[1] += points[2 * i + 1] / (double)n;
    }
    for (int64_t i = 0; i < n; i++)
        for (int a = 0; a < 2; a++)
            square += (points[2 * i + a] - center[a]) * (points[2 * i + a] - center[a]) / (double)n;
    *scale = sqrt(2 / square);
}

void homography(int64_t n, const double *points, const double *image, double *H)
{
    double from[2], to[2], in, out, N[81], M[81], h[9] = {1, 0.1, 0.2, 0.3, 1, 0.4, 0.5, 0.6, 1};
    normalization(n, points, from, &in);
    normalization(n, image, to, &out);
    memset(N, 0, sizeof N);
    for (int64_t i = 0; i < n; i++) {
        const double x = (points[2 * i] - from[0]) * in, y = (points[2 * i + 1] - from[1]) * in;
        const double u = (image[2 * i] - to[0]) * out, v = (image[2 * i + 1] - to[1]) * out;
        const double rows[2][9] = {{x, y, 1, 0, 0, 0, -u * x, -u * y, -u}, {0, 0, 0, x, y, 1, -v * x, -v * y, -v}};
        for (int r = 0; r < 2; r++)
            for (int p = 0; p < 9; p++)
                for (int q = 0; q < 9; q++)
                    N[9 * p + q] += rows[r][p] * rows[r][q];
    }
    for (int p = 0; p < 9; p++)
        N[10 * p] += 1e-13 * (double)n;
    for (int step = 0; step < 8; step++) {
        double norm = 0;
        memcpy(M, N, sizeof M);
        solve_positive(9, M, h, 1, 1e-300);
        for (int p = 0; p < 9; p++)
            norm += h[p] * h[p];
        for (int p = 0; p < 9; p++)
            h[p] /= sqrt(norm);
    }
    /* H = (scale and center of the image)^-1 h (scale and center of the points). */
    for (int r = 0; r < 3; r++) {
        const double a = h[3 * r] * in, b = h[3 * r + 1] * in;
        M[3 * r] = a;
        M[3 * r + 1] = b;
        M[3 * r + 2] = h[3 * r + 2] - a * from[0] - b * from[1];
    }
    for (int c = 0; c < 3; c++) {
        H[c] = M[c] / out + to[0] * M[6 + c];
        H[3 + c] = M[3 + c] / out + to[1] * M[6 + c];
        H[6 + c] = M[6 + c];
    }
    for (int e = 0; e < 9; e++)
        H[e] /= M[8];
}

/* ------------------------------------------------------------------------------------------------------------------
   judge_poses: dots that labelings miss, and the largest misfit to accept (twin: identification.py, _expected and _bound).

   labels (k, n); center (b, 2); rough (b) or NULL; pixels (k, n, 2), shape (k, n, 2, 2) and seen (k, n) of the dots as
   predicted; printing (k); settings: width, height, focal lengths, margin of the image, px, largest misfit (px, share of
   the extent), misfit of refused dots, fewest dots that are none of these, share of the bound that is left to four dots.
   missing, bound (k). */

void judge_poses(int64_t k, int64_t n, const int64_t *labels, const double *center, const double *rough,
                 const double *pixels, const double *shape, const uint8_t *seen, const double *printing,
                 const double *settings, int64_t *missing, double *bound)
{
    const double right = settings[0] - 1, bottom = settings[1] - 1, fx = settings[2], fy = settings[3], edge = settings[4];
    for (int64_t i = 0; i < k; i++) {
        double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY}, squares = 0;
        int64_t count = 0, refused = 0, absent = 0;
        for (int64_t d = n * i; d < n * (i + 1); d++) {
            if (labels[d] < 0) {
                const double x = pixels[2 * d], y = pixels[2 * d + 1];
                const double wide = sqrt(shape[4 * d]) * fx + edge, tall = sqrt(shape[4 * d + 3]) * fy + edge;
                absent += seen[d] && x - wide >= 0 && x + wide <= right && y - tall >= 0 && y + tall <= bottom;
                continue;
            }
            const double *at = center + 2 * labels[d], own = rough ? rough[labels[d]] : 0;
            for (int a = 0; a < 2; a++) {
                low[a] = at[a] < low[a] ? at[a] : low[a];
                high[a] = at[a] > high[a] ? at[a] : high[a];
            }
            squares += own * own;
            refused += rough && own == settings[8];
            count++;
        }
        const double extent = settings[5] * fmax(high[0] - low[0], high[1] - low[1]), checks = (double)(count + absent - 3);
        const double most = (settings[6] + settings[7] * extent) * (double)(count - 3) / fmax(checks, 1);
        const double unsure = sqrt(squares / (double)count);
        const int round = (double)(count - refused) >= fmax(settings[9], (double)count / 2);
        missing[i] = absent;
        /* Four corners of a square are a third of a regular 12-gon, wherever equal dots are on a grid. */
        const double sure = hypot(most, printing[i]) * (count == 4 ? settings[10] : 1);
        bound[i] = round && count >= absent ? hypot(sure, unsure) : -1;
    }
}

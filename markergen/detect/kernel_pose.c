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

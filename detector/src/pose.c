/* Poses from labeled dots: the image of a dot, refinement, and the second pose of a plane. */

#include "detector.h"

enum { POSE = 6, MOST = 7 }; /* unknowns: (w, dt), and the logarithm of the focal length */

/* ---- projection ----

   A disk of radius r about P with normal n, in the camera's frame, has the dual conic D = r^2 (I - n n') - P P'. Divided by
   its last entry, which is -level = r^2 (1 - n_z^2) - P_z^2, its last column is the ellipse's center c, and c c' less the rest
   is its shape E. Below level = 0 the rim reaches the plane of the camera's center. */

typedef struct {
    double P[3], n[3], square, level;
    int seen;
} Disk;

static void rotated(const double *R, const double *v, double *result)
{
    for (int a = 0; a < 3; a++)
        result[a] = R[3 * a] * v[0] + R[3 * a + 1] * v[1] + R[3 * a + 2] * v[2];
}

static double product(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* `turned` is R X of its place. */
static void place_disk(const Dot *dot, const double *place, const double *R, const double *t, double *turned, Disk *disk)
{
    rotated(R, place, turned);
    rotated(R, dot->normal, disk->n);
    for (int a = 0; a < 3; a++)
        disk->P[a] = turned[a] + t[a];
    const double z = disk->P[2], nz = disk->n[2];
    disk->square = dot->radius * dot->radius;
    disk->level = z * z - disk->square * (1 - nz * nz);
    disk->seen = z > 0 && disk->level > 0 && product(disk->P, disk->n) < 0;
}

static void center_of(const Disk *d, double *center)
{
    for (int a = 0; a < 2; a++)
        center[a] = (d->P[a] * d->P[2] + d->square * d->n[2] * d->n[a]) / d->level;
}

void outline_of(const Dot *dot, const double *place, const Pose *pose, Outline *outline)
{
    const double f = pose->focal;
    double turned[3], c[2];
    Disk d;
    place_disk(dot, place, pose->R, pose->t, turned, &d);
    center_of(&d, c);
    for (int k = 0; k < 3; k++) {
        const int i = k / 2, j = (k + 1) / 2;
        const double disk = d.square * ((i == j) - d.n[i] * d.n[j]);
        outline->shape[k] = f * f * (c[i] * c[j] - (d.P[i] * d.P[j] - disk) / d.level);
    }
    for (int a = 0; a < 2; a++) {
        outline->center[a] = f * c[a];
        outline->point[a] = f * (d.P[a] / d.P[2]);
    }
    outline->depth = d.P[2];
    outline->facing = -product(d.P, d.n) / sqrt(product(d.P, d.P));
    outline->seen = d.seen;
}

/* ---- refinement ---- */

/* Cholesky's decomposition N = L L', L in N's lower triangle. Pivots are `least` or more; without that, -INFINITY, a matrix
   that is not positive gives nan. */
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

/* exp([w]x) R by the formula of Rodrigues. */
static void turn(const double *w, const double *R, double *result)
{
    const double square = product(w, w), angle = sqrt(square) + 1e-150, half = sin(angle / 2) / angle;
    const double sine = sin(angle) / angle, versine = 2 * half * half;
    for (int j = 0; j < 3; j++) {
        const double v[3] = {R[j], R[3 + j], R[6 + j]}, along = product(w, v);
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            result[3 * a + j] = v[a] + sine * (w[b] * v[c] - w[c] * v[b]) + versine * (w[a] * along - square * v[a]);
        }
    }
}

/* d(X/z, Y/z) / d(w, dt) of the image of R X + t, with `turned` = R X and P = R X + t; see Dot. */
static void image_rows(const double *turned, const double *P, double *u, double *v)
{
    const double s = 1 / P[2], x = s * P[0], y = s * P[1];
    const double a = s * turned[0], b = s * turned[1], c = s * turned[2];
    const double rows[2][POSE] = {{-x * b, c + x * a, -b, s, 0, -x * s}, {-y * b - c, y * a, a, 0, s, -y * s}};
    memcpy(u, rows[0], sizeof rows[0]);
    memcpy(v, rows[1], sizeof rows[1]);
}

/* What a refinement is of; see refine_pose. */
typedef struct {
    const Dot *dots;
    const Match *matches;
    int64_t m;
    const double *seen, *weight;
    int places, unknowns;
    double prior; /* inverse variance of the logarithm of the focal length */
} Problem;

/* chi2 at a pose, with J'WJ (7, 7), its lower triangle, and J'Wr (7). The derivative of an ellipse's center is that of the
   disk's center: they differ by a thousandth, which costs a step and shifts the minimum by that share of the residuals. */
static double equations(const Problem *q, const Pose *pose, double *normal, double *gradient)
{
    const double f = pose->focal, off = log(f);
    double chi2 = q->prior * off * off, u[MOST], v[MOST], turned[3], c[2];
    memset(normal, 0, MOST * MOST * sizeof *normal);
    memset(gradient, 0, MOST * sizeof *gradient);
    for (int64_t i = 0; i < q->m; i++) {
        const double *W = q->weight + 3 * i;
        if (W[0] == 0 && W[2] == 0)
            continue;
        const Dot *dot = q->dots + q->matches[i].dot;
        Disk d;
        place_disk(dot, q->places ? dot->place : dot->xyz, pose->R, pose->t, turned, &d);
        if (!d.seen)
            return INFINITY;
        center_of(&d, c);
        image_rows(turned, d.P, u, v);
        for (int p = 0; p < POSE; p++) {
            u[p] *= f;
            v[p] *= f;
        }
        u[POSE] = f * c[0];
        v[POSE] = f * c[1];
        const double x = q->seen[2 * i] - f * c[0], y = q->seen[2 * i + 1] - f * c[1];
        const double wx = W[0] * x + W[1] * y, wy = W[1] * x + W[2] * y;
        chi2 += wx * x + wy * y;
        for (int p = 0; p < q->unknowns; p++) {
            const double wu = W[0] * u[p] + W[1] * v[p], wv = W[1] * u[p] + W[2] * v[p];
            gradient[p] += wx * u[p] + wy * v[p];
            for (int k = 0; k <= p; k++)
                normal[MOST * p + k] += wu * u[k] + wv * v[k];
        }
    }
    normal[MOST * MOST - 1] += q->prior;
    gradient[POSE] -= q->prior * off;
    return chi2 < INFINITY ? chi2 : INFINITY;
}

/* Damping: at the start, least, factor; slack by which chi2 may rise, so that rounding stops no step; ridge, a share of the
   largest diagonal entry, which holds the direction that collinear dots leave free. */
static const double DAMPING = 1e-4, LEAST_DAMPING = 1e-12, FACTOR = 10, SLACK = 1e-12, RIDGE = 1e-14;

double refine_pose(const Dot *dots, const Match *matches, int64_t m, const double *seen, const double *weight, int places,
                   double focal, int steps, double tolerance, Pose *pose, double *normal)
{
    const int n = focal > 0 ? MOST : POSE;
    const Problem q = {dots, matches, m, seen, weight, places, n, focal > 0 ? 1 / (focal * focal) : 0};
    double N[2][MOST * MOST], g[2][MOST], A[MOST * MOST], step[MOST], damping = DAMPING;
    int at = 0; /* which of N and g are those of `pose` */
    double chi2 = equations(&q, pose, N[0], g[0]);
    for (int i = 0; i < steps && chi2 < INFINITY; i++) {
        double most = 0, moved = 0;
        Pose tried = *pose;
        for (int p = 0; p < n; p++)
            most = fmax(most, N[at][(MOST + 1) * p]);
        for (int p = 0; p < n; p++) {
            for (int k = 0; k < p; k++)
                A[n * p + k] = N[at][MOST * p + k];
            const double own = N[at][(MOST + 1) * p];
            A[(n + 1) * p] = own + own * damping + RIDGE * most + 1e-300;
            step[p] = g[at][p];
        }
        solve_positive(n, A, step, 1, -INFINITY);
        turn(step, pose->R, tried.R);
        for (int p = 0; p < 3; p++)
            tried.t[p] += step[3 + p];
        if (n == MOST)
            tried.focal *= exp(fmin(fmax(step[POSE], -1), 1));
        const double after = equations(&q, &tried, N[!at], g[!at]);
        const int good = after <= chi2 * (1 + SLACK), settled = good && after >= chi2 * (1 - tolerance);
        if (good) {
            *pose = tried;
            chi2 = after;
            at = !at;
            damping = fmax(damping / FACTOR, LEAST_DAMPING);
        } else
            damping *= FACTOR;
        const double far = sqrt(product(pose->t, pose->t));
        for (int p = 0; p < n; p++)
            moved = fmax(moved, fabs(step[p]) / (p < 3 || p == POSE ? 1 : far));
        if (settled || !(moved > tolerance))
            break;
    }
    if (normal)
        for (int p = 0; p < MOST; p++)
            for (int k = 0; k < MOST; k++)
                normal[MOST * p + k] = N[at][p > k ? MOST * p + k : MOST * k + p];
    return chi2;
}

/* ---- the second pose of a plane ---- */

void mirrored_pose(const Dot *dots, const Match *matches, int64_t m, const Pose *pose, Pose *mirrored)
{
    double middle[3] = {0, 0, 0}, P[3], n[3], target[3], axis[3], cosine = 0;
    for (int64_t i = 0; i < m; i++)
        for (int a = 0; a < 3; a++)
            middle[a] += dots[matches[i].dot].place[a] / (double)m;
    rotated(pose->R, middle, P);
    for (int a = 0; a < 3; a++)
        P[a] += pose->t[a];
    rotated(pose->R, dots[matches[0].dot].normal, n);
    const double along = 2 * product(n, P) / product(P, P);
    for (int a = 0; a < 3; a++) {
        target[a] = along * P[a] - n[a];
        cosine += target[a] * n[a];
    }
    for (int a = 0; a < 3; a++)
        axis[a] = n[(a + 1) % 3] * target[(a + 2) % 3] - n[(a + 2) % 3] * target[(a + 1) % 3];
    /* The shortest turn from n to the target: v + axis x v + axis x (axis x v) / (1 + cosine), for each column v. */
    const double square = product(axis, axis);
    Pose result = *pose;
    for (int j = 0; j < 3; j++) {
        const double v[3] = {pose->R[j], pose->R[3 + j], pose->R[6 + j]}, inner = product(axis, v);
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            result.R[3 * a + j] =
                v[a] + axis[b] * v[c] - axis[c] * v[b] + (axis[a] * inner - square * v[a]) / (1 + cosine);
        }
    }
    rotated(result.R, middle, result.t);
    for (int a = 0; a < 3; a++)
        result.t[a] = P[a] - result.t[a];
    *mirrored = result;
}

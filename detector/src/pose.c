/* Poses from labeled dots: the image of a dot, refinement, and the second pose of a plane. */

#include "pose.h"

enum { MOST = POSE + 1 }; /* unknowns: (w, dt), and the logarithm of the focal length */

/* ---- projection ----

   A disk of radius r about P with normal n, in the camera's frame, has the dual conic D = r^2 (I - n n') - P P'. Divided by
   its last entry, which is -level = r^2 (1 - n_z^2) - P_z^2, its last column is the ellipse's center c, and c c' less the rest
   is its shape E. Below level = 0 the rim reaches the plane of the camera's center. */

typedef struct {
    double P[3], n[3], square, level;
    int seen;
} Disk;

void rotated(const double *R, const double *v, double *result)
{
    for (int a = 0; a < 3; a++)
        result[a] = R[3 * a] * v[0] + R[3 * a + 1] * v[1] + R[3 * a + 2] * v[2];
}

double product(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

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
    /* Operations that do not wait for each other come together. */
    for (int j = 0; j < n; j++) {
        const double pivot = N[n * j + j], root = sqrt(pivot > least ? pivot : least), inverse = 1 / root;
        N[n * j + j] = root;
        for (int i = j + 1; i < n; i++)
            N[n * i + j] *= inverse;
        for (int i = j + 1; i < n; i++)
            for (int k = j + 1; k <= i; k++)
                N[n * i + k] -= N[n * i + j] * N[n * k + j];
    }
    for (double *b = columns; b < columns + n * count; b += n) {
        for (int k = 0; k < n; k++) {
            b[k] /= N[n * k + k];
            for (int i = k + 1; i < n; i++)
                b[i] -= N[n * i + k] * b[k];
        }
        for (int i = n - 1; i >= 0; i--) {
            b[i] /= N[n * i + i];
            for (int k = 0; k < i; k++)
                b[k] -= N[n * i + k] * b[i];
        }
    }
}

void turn(const double *w, const double *R, double *result)
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

/* ---- the estimate ----

   Dots are weighted by the inverse of their covariance S from image and print, W = S^-1, so with J the derivatives of the
   image by the pose, the pose errs by G'e, G = W J (J'WJ)^-1, for errors e of the image, and has the covariance

       G' (S_image + S_print + S_camera) G.

   Errors common to dots, and the camera's, do not enter W: no weights of single dots compensate for them. */

static const double TOLERANCE = 1e-8, COARSE = 1e-3; /* of the best pose; of the second, until it is known to be a contender */
static const double SEARCHED = 20;      /* largest difference of half chi2 at which the second pose is refined completely */
static const double CONTENDER = 1e-3;   /* least likelihood of the second pose relative to the best one */
static const double DISTINCT_SIGMA = 3; /* poses whose rotations differ by less are one */
static const double ROUGH_SIGMA = 5;    /* multiple of the median dot's sigma from which a dot says nothing of others' errors */
static const double OUTLIER_SIGMA = 5;  /* beyond which a dot is dropped */
static const double FLATNESS = 0.01;    /* range of heights, as a share of the extent, of dots that have a mirrored pose */
static const double LEAST_PX = 1e-6;    /* so that weights are finite without any error */
/* Length of the short axis of a dot's image at which its center is off by 1.4 times as much as the grey levels say: by 1.0
   to 1.1 times at 5 px and more, 1.2 at 4 px, 1.7 at 3 px, where it is narrower than the blur of its edges. */
static const double SHORT_PX = 3.5;
enum { STEPS = 20, LEAST_TO_DROP = 6, SMALL = 64 /* matches without memory of their own */, PER_MATCH = 32 };

typedef struct {
    const Dot *dots;
    const Blob *blobs;
    const Match *matches;
    int64_t m;
    const Camera *camera;
    const Errors *errors;
    double *seen, *image, *widened; /* (m, 2) and twice (m, 3): centers, their covariance, and that with OUTLIER_PX */
    double *weight, *scratch;       /* twice (m, 3) */
    double *through;                /* (m, 6, 3): the pose's error by that of each place */
} Sight;

static const Dot *dot_of(const Sight *s, int64_t i) { return s->dots + s->matches[i].dot; }

static void invert_two(const double *S, double *W)
{
    const double det = S[0] * S[2] - S[1] * S[1];
    W[0] = S[2] / det;
    W[1] = -S[1] / det;
    W[2] = S[0] / det;
}

/* A S A' of a covariance px^2, for the inverse A of the lens's derivatives D. */
static void undone(const double *D, const double *S, double add, double *result)
{
    const double det = D[0] * D[3] - D[1] * D[2], A[4] = {D[3] / det, -D[1] / det, -D[2] / det, D[0] / det};
    const double xx = S[0] + add, xy = S[1], yy = S[2] + add;
    result[0] = A[0] * A[0] * xx + 2 * A[0] * A[1] * xy + A[1] * A[1] * yy;
    result[1] = A[0] * A[2] * xx + (A[0] * A[3] + A[1] * A[2]) * xy + A[1] * A[3] * yy;
    result[2] = A[2] * A[2] * xx + 2 * A[2] * A[3] * xy + A[3] * A[3] * yy;
}

void pixel_covariance(const Dot *dot, const Blob *blob, const Pose *pose, const Camera *camera, const Errors *errors, double *S)
{
    double factor = 1;
    if (errors->several) {
        Outline o;
        outline_of(dot, dot->place, pose, &o);
        const double half = (o.shape[0] - o.shape[2]) / 2, mean = (o.shape[0] + o.shape[2]) / 2;
        const double least = mean - sqrt(half * half + o.shape[1] * o.shape[1]);
        const double ratio = SHORT_PX * SHORT_PX / (4 * camera->fx * camera->fy * least);
        factor += ratio > 0 ? ratio * ratio : 0;
    }
    for (int e = 0; e < 3; e++)
        S[e] = factor * blob->covariance[e];
}

/* Fills in what is measured. */
static void measure(const Sight *s, const Pose *pose)
{
    for (int64_t i = 0; i < s->m; i++) {
        const Blob *blob = s->blobs + s->matches[i].blob;
        double D[4], pixel[2], S[3];
        memcpy(s->seen + 2 * i, blob->at, 2 * sizeof(double));
        lens_pixel(s->camera, blob->at, pixel, D);
        pixel_covariance(dot_of(s, i), blob, pose, s->camera, s->errors, S);
        undone(D, S, LEAST_PX * LEAST_PX, s->image + 3 * i);
        undone(D, S, LEAST_PX * LEAST_PX + OUTLIER_PX * OUTLIER_PX, s->widened + 3 * i);
    }
}

void dot_rows(const Dot *dot, const Pose *pose, double (*J)[POSE], double (*M)[3])
{
    double turned[3], P[3];
    rotated(pose->R, dot->place, turned);
    for (int a = 0; a < 3; a++)
        P[a] = turned[a] + pose->t[a];
    image_rows(turned, P, J[0], J[1]);
    for (int r = 0; r < 2; r++) {
        for (int p = 0; p < POSE; p++)
            J[r][p] *= pose->focal;
        for (int a = 0; a < 3; a++)
            M[r][a] = J[r][3] * pose->R[a] + J[r][4] * pose->R[3 + a] + J[r][5] * pose->R[6 + a];
    }
}

void through_place(double (*M)[3], const double *S, double *result)
{
    double A[2][3];
    for (int r = 0; r < 2; r++)
        for (int a = 0; a < 3; a++)
            A[r][a] = M[r][0] * S[a] + M[r][1] * S[3 + a] + M[r][2] * S[6 + a];
    result[0] = product(A[0], M[0]);
    result[1] = product(A[0], M[1]);
    result[2] = product(A[1], M[1]);
}

/* Rows and covariance of dot i from print and `image`. */
static void spread_of(const Sight *s, const double *image, int64_t i, const Pose *pose, double (*J)[POSE], double (*M)[3],
                      double *S)
{
    dot_rows(dot_of(s, i), pose, J, M);
    through_place(M, dot_of(s, i)->print, S);
    for (int e = 0; e < 3; e++)
        S[e] += image[3 * i + e];
}

/* Refines a pose. The print's share of the weights depends smoothly on the pose: from a start that is right to a percent,
   they are right to a percent, and the estimate then to second order. */
static double refined(const Sight *s, double tolerance, Pose *pose)
{
    double J[2][POSE], M[2][3], S[3];
    for (int64_t i = 0; i < s->m; i++) {
        spread_of(s, s->image, i, pose, J, M, S);
        invert_two(S, s->weight + 3 * i);
    }
    return refine_pose(s->dots, s->matches, s->m, s->seen, s->weight, 1, 0, STEPS, tolerance, pose, NULL);
}

/* Whether the dots are in one plane, up to the bending of a print: that of the dot `first`. */
static int nearly_flat(const Sight *s)
{
    const Dot *first = dot_of(s, 0);
    double low = 0, high = 0, extent = 0;
    for (int64_t i = 1; i < s->m; i++) {
        double from[3];
        for (int a = 0; a < 3; a++)
            from[a] = dot_of(s, i)->place[a] - first->place[a];
        const double height = product(from, first->normal);
        low = fmin(low, height);
        high = fmax(high, height);
        extent = fmax(extent, product(from, from));
    }
    return high - low <= FLATNESS * sqrt(extent);
}

/* Writes the best pose and the other one of a plane, with chi2 of both, that of the other INFINITY without it. */
static void best_poses(const Sight *s, Pose *pose, double *chi2)
{
    chi2[0] = refined(s, TOLERANCE, pose);
    chi2[1] = INFINITY;
    if (!(chi2[0] < INFINITY) || !nearly_flat(s))
        return;
    const double spread = fmax(1, chi2[0] / (double)(2 * s->m - POSE));
    mirrored_pose(s->dots, s->matches, s->m, pose, pose + 1);
    chi2[1] = refined(s, COARSE, pose + 1);
    if (chi2[1] - chi2[0] < 2 * SEARCHED * spread)
        chi2[1] = refined(s, TOLERANCE, pose + 1);
    if (chi2[1] < chi2[0]) {
        const Pose swapped = pose[0];
        const double more = chi2[0];
        pose[0] = pose[1];
        pose[1] = swapped;
        chi2[0] = chi2[1];
        chi2[1] = more;
    }
}

static double quadratic(const double *W, const double *r)
{
    return (W[0] * r[0] + W[1] * r[1]) * r[0] + (W[1] * r[0] + W[2] * r[1]) * r[1];
}

static void residual_of(const Sight *s, int64_t i, const Pose *pose, double *residual)
{
    Outline o;
    outline_of(dot_of(s, i), dot_of(s, i)->place, pose, &o);
    for (int a = 0; a < 2; a++)
        residual[a] = s->seen[2 * i + a] - o.center[a];
}

/* (J'WJ)^-1, with J'Wr in `gradient` unless NULL. `image`: as for spread_of. */
static void pose_inverse(const Sight *s, const double *image, const Pose *pose, double *inverse, double *gradient)
{
    double N[36] = {0}, J[2][POSE], M[2][3], S[3], W[3], r[2] = {0, 0};
    memset(inverse, 0, 36 * sizeof *inverse);
    for (int64_t i = 0; i < s->m; i++) {
        spread_of(s, image, i, pose, J, M, S);
        invert_two(S, W);
        if (gradient)
            residual_of(s, i, pose, r);
        for (int p = 0; p < POSE; p++) {
            const double u = W[0] * J[0][p] + W[1] * J[1][p], v = W[1] * J[0][p] + W[2] * J[1][p];
            if (gradient)
                gradient[p] += u * r[0] + v * r[1];
            for (int q = 0; q < POSE; q++)
                N[POSE * p + q] += u * J[0][q] + v * J[1][q];
        }
    }
    for (int p = 0; p < POSE; p++)
        inverse[(POSE + 1) * p] = 1;
    solve_positive(POSE, N, inverse, POSE, -INFINITY);
}

/* The match that is more than OUTLIER_SIGMA from where the others predict it; -1 if none is.

   Leaving out dot i lowers chi2 by r_i' (S_i - J_i C J_i')^-1 r_i, with S_i its covariance from image, print and OUTLIER_PX,
   and C the pose's. This is compared in units of the factor by which the others' chi2 exceeds its expectation: in a print
   that is worse than stated all dots are off, and none is an outlier. With fewer than six dots none can be identified, nor
   where all of chi2 is less than an outlier would lower it by. */
static int64_t outlier(const Sight *s, const Pose *pose, double chi2)
{
    if (s->m < LEAST_TO_DROP || chi2 <= OUTLIER_SIGMA * OUTLIER_SIGMA)
        return -1;
    double C[36], gradient[POSE] = {0}, step[POSE] = {0}, J[2][POSE], M[2][3], S[3], W[3], total = 0, most = 0;
    double *gain = s->scratch;
    pose_inverse(s, s->widened, pose, C, gradient);
    for (int p = 0; p < POSE; p++)
        for (int q = 0; q < POSE; q++)
            step[p] += C[POSE * p + q] * gradient[q];
    for (int64_t i = 0; i < s->m; i++) {
        double r[2], JC[2][POSE];
        spread_of(s, s->widened, i, pose, J, M, S);
        residual_of(s, i, pose, r);
        /* The pose was fitted with other weights: a step adapts it to these. */
        for (int a = 0; a < 2; a++)
            for (int p = 0; p < POSE; p++) {
                r[a] -= J[a][p] * step[p];
                JC[a][p] = 0;
                for (int q = 0; q < POSE; q++)
                    JC[a][p] += J[a][q] * C[POSE * q + p];
            }
        invert_two(S, W);
        total += quadratic(W, r);
        for (int p = 0; p < POSE; p++) {
            S[0] -= JC[0][p] * J[0][p];
            S[1] -= JC[0][p] * J[1][p];
            S[2] -= JC[1][p] * J[1][p];
        }
        invert_two(S, W);
        gain[i] = quadratic(W, r);
    }
    int64_t worst = -1;
    for (int64_t i = 0; i < s->m; i++) {
        const double excess = gain[i] / fmax(1, (total - gain[i]) / (double)(2 * s->m - 8));
        if (excess > most) {
            most = excess;
            worst = i;
        }
    }
    return most > OUTLIER_SIGMA * OUTLIER_SIGMA ? worst : -1;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The factor, 1 or more, by which residuals show the covariances of image and print to be too small: chi2/d, the estimate of
   a factor common to all dots by d = 2 m - 6 degrees of freedom, where it exceeds 1 (C. F. Gauss). Reflections, shadows and
   compression move dots by more than the noise of the grey levels. Dots far less precise than the others, whose covariance
   is a guess, do not take part: they hardly affect the pose, so each has two degrees of freedom. */
static double residual_scale(const Sight *s, const Pose *pose)
{
    double *variance = s->scratch, *sorted = s->scratch + s->m, *chi2 = s->scratch + 2 * s->m;
    double J[2][POSE], M[2][3], S[3], W[3], r[2], total = 0, freedom = -POSE;
    for (int64_t i = 0; i < s->m; i++) {
        spread_of(s, s->image, i, pose, J, M, S);
        invert_two(S, W);
        residual_of(s, i, pose, r);
        chi2[i] = quadratic(W, r);
        variance[i] = sorted[i] = S[0] + S[2];
    }
    qsort(sorted, (size_t)s->m, sizeof *sorted, by_size);
    const double most = ROUGH_SIGMA * ROUGH_SIGMA * (sorted[(s->m - 1) / 2] + sorted[s->m / 2]) / 2;
    for (int64_t i = 0; i < s->m; i++)
        if (variance[i] <= most) {
            total += chi2[i];
            freedom += 2;
        }
    return freedom > 0 && total / freedom > 1 ? total / freedom : 1;
}

void camera_rows(const Camera *camera, const double *ray, double *rows)
{
    static const double STEP = 1e-6;
    const int width = 4 + camera->count;
    double pixel[2], moved[2];
    lens_pixel(camera, ray, pixel, NULL);
    for (int p = 0; p < width; p++) {
        if (p < 4) {
            moved[0] = p == 0 ? (pixel[0] - camera->cx) / camera->fx : p == 2;
            moved[1] = p == 1 ? (pixel[1] - camera->cy) / camera->fy : p == 3;
        } else {
            Camera other = *camera;
            other.c[p - 4] += STEP;
            lens_pixel(&other, ray, moved, NULL);
            for (int a = 0; a < 2; a++)
                moved[a] = (moved[a] - pixel[a]) / STEP;
        }
        rows[p] = moved[0];
        rows[width + p] = moved[1];
    }
}

/* result += G' S G. */
static void add_outer(double (*G)[POSE], const double *S, double *result)
{
    for (int p = 0; p < POSE; p++) {
        const double u = G[0][p] * S[0] + G[1][p] * S[1], v = G[0][p] * S[1] + G[1][p] * S[2];
        for (int q = 0; q < POSE; q++)
            result[POSE * p + q] += u * G[0][q] + v * G[1][q];
    }
}

/* Fills in scale and covariances of `e->pose`. */
static void budget(const Sight *s, Estimate *e)
{
    const Errors *errors = s->errors;
    const int64_t common = errors->common;
    const int width = errors->calibration ? 4 + s->camera->count : 0;
    double C[36], T[CAMERA][POSE] = {{0}};
    pose_inverse(s, s->image, &e->pose, C, NULL);
    for (int64_t i = 0; i < s->m; i++) {
        const int64_t dot = s->matches[i].dot;
        double J[2][POSE], M[2][3], S[3], W[3], G[2][POSE] = {{0}};
        spread_of(s, s->image, i, &e->pose, J, M, S);
        invert_two(S, W);
        for (int p = 0; p < POSE; p++)
            for (int q = 0; q < POSE; q++) {
                G[0][p] += C[POSE * p + q] * (W[0] * J[0][q] + W[1] * J[1][q]);
                G[1][p] += C[POSE * p + q] * (W[1] * J[0][q] + W[2] * J[1][q]);
            }
        add_outer(G, s->image + 3 * i, e->image);
        through_place(M, errors->alone ? errors->alone + 9 * dot : dot_of(s, i)->print, S);
        add_outer(G, S, e->print);
        for (int p = 0; p < POSE; p++)
            for (int a = 0; a < 3; a++)
                s->through[3 * (POSE * i + p) + a] = G[0][p] * M[0][a] + G[1][p] * M[1][a];
        if (width) {
            double rows[2 * CAMERA], D[4], pixel[2];
            Outline o;
            outline_of(dot_of(s, i), dot_of(s, i)->place, &e->pose, &o);
            camera_rows(s->camera, o.point, rows);
            lens_pixel(s->camera, o.point, pixel, D);
            const double det = D[0] * D[3] - D[1] * D[2];
            for (int p = 0; p < POSE; p++) {
                const double u = (G[0][p] * D[3] - G[1][p] * D[2]) / det, v = (G[1][p] * D[0] - G[0][p] * D[1]) / det;
                for (int c = 0; c < width; c++)
                    T[c][p] += u * rows[c] + v * rows[width + c];
            }
        }
    }
    for (int64_t c = 0; c < common; c++) {
        double moved[POSE] = {0};
        for (int64_t i = 0; i < s->m; i++) {
            const double *d = errors->moved + 3 * common * s->matches[i].dot + c;
            for (int p = 0; p < POSE; p++) {
                const double *g = s->through + 3 * (POSE * i + p);
                moved[p] += g[0] * d[0] + g[1] * d[common] + g[2] * d[2 * common];
            }
        }
        for (int p = 0; p < POSE; p++)
            for (int q = 0; q < POSE; q++)
                e->print[POSE * p + q] += moved[p] * moved[q];
    }
    for (int c = 0; c < width; c++)
        for (int d = 0; d < width; d++)
            for (int p = 0; p < POSE; p++)
                for (int q = 0; q < POSE; q++)
                    e->calibration[POSE * p + q] += T[c][p] * errors->calibration[width * c + d] * T[d][q];
    e->scale = residual_scale(s, &e->pose);
    for (int p = 0; p < POSE * POSE; p++) {
        e->image[p] *= e->scale;
        e->print[p] *= e->scale;
        e->covariance[p] = e->image[p] + e->print[p] + e->calibration[p];
    }
}

/* The angle of the rotation from one pose to another. */
static double angle_between(const Pose *a, const Pose *b)
{
    double square = 0; /* |A - B|^2 = 8 sin^2(angle / 2) */
    for (int e = 0; e < 9; e++)
        square += (a->R[e] - b->R[e]) * (a->R[e] - b->R[e]);
    return 2 * asin(fmin(1, sqrt(square / 8)));
}

int64_t estimate_pose(const Dot *dots, const Blob *blobs, Match *matches, int64_t m, const Camera *camera,
                      const Errors *errors, const Pose *start, Estimate *e)
{
    double small[SMALL * PER_MATCH], chi2[2], *memory = m > SMALL ? malloc(sizeof *memory * (size_t)(PER_MATCH * m)) : small;
    Pose pose[2] = {*start, *start};
    Sight s = {dots, blobs, matches, m, camera, errors, memory, memory + 2 * m, memory + 5 * m, memory + 8 * m, memory + 11 * m,
               memory + 14 * m};
    if (!memory)
        return NO_MEMORY;
    memset(e, 0, sizeof *e);
    for (;;) {
        measure(&s, pose);
        best_poses(&s, pose, chi2);
        const int64_t worst = chi2[0] < INFINITY ? outlier(&s, pose, chi2[0]) : -1;
        if (worst < 0)
            break;
        const Match dropped = matches[worst];
        memmove(matches + worst, matches + worst + 1, sizeof *matches * (size_t)(m - worst - 1));
        matches[m - 1] = dropped;
        s.m--;
    }
    if (chi2[0] < INFINITY) {
        e->count = s.m;
        e->freedom = 2 * s.m - POSE;
        e->chi2 = chi2[0];
        e->pose = pose[0];
        budget(&s, e);
        const double likelihood = exp((chi2[0] - chi2[1]) / (2 * e->scale));
        const double sigma = sqrt(e->covariance[0] + e->covariance[7] + e->covariance[14]);
        if (likelihood > CONTENDER && angle_between(pose, pose + 1) > DISTINCT_SIGMA * sigma) {
            e->likelihood = likelihood;
            e->other = pose[1];
        }
    }
    if (memory != small)
        free(memory);
    return e->count;
}

int dot_pixel(const Dot *dot, const Blob *blob, const Pose *pose, const Camera *camera, double *pixel)
{
    Outline o;
    double ray[2];
    outline_of(dot, dot->place, pose, &o);
    for (int a = 0; a < 2; a++)
        ray[a] = blob->at[a] - (o.center[a] - o.point[a]);
    lens_pixel(camera, ray, pixel, NULL);
    return isfinite(pixel[0]) && isfinite(pixel[1]);
}

/* ---- homographies of flat dots ---- */

static void normalization(const double *points, int64_t m, double *center, double *scale)
{
    double square = 0;
    center[0] = center[1] = 0;
    for (int64_t i = 0; i < 2 * m; i++)
        center[i % 2] += points[i] / (double)m;
    for (int64_t i = 0; i < 2 * m; i++)
        square += (points[i] - center[i % 2]) * (points[i] - center[i % 2]) / (double)m;
    *scale = sqrt(2 / square);
}

/* Whether some four of the points have no three on a line: no line has all of them but one. */
static int in_general_position(const double *points, int64_t m)
{
    double center[2], scale;
    if (m < 4)
        return 0;
    normalization(points, m, center, &scale);
    if (!(scale < INFINITY))
        return 0;
    for (int64_t left_out = 0; left_out < m; left_out++) {
        double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
        const double n = (double)(m - 1);
        for (int64_t i = 0; i < m; i++) {
            const double u = (points[2 * i] - center[0]) * scale, v = (points[2 * i + 1] - center[1]) * scale;
            const double counts = i != left_out;
            x += counts * u / n;
            y += counts * v / n;
            xx += counts * u * u / n;
            xy += counts * u * v / n;
            yy += counts * v * v / n;
        }
        xx -= x * x, xy -= x * y, yy -= y * y;
        if (!(xx * yy - xy * xy > 1e-12 * (xx + yy) * (xx + yy)))
            return 0;
    }
    return 1;
}

/* Normalized DLT (R. Hartley, 1997): h is the eigenvector of the smallest eigenvalue of A'A, by inverse iteration, of which
   eight steps leave the others' share, which shrinks by the ratio of the eigenvalues each time, below rounding. */
static void solve_homography(const double *from, const double *to, int64_t m, double *H)
{
    double c[2], d[2], in, out, N[81] = {0}, L[81], h[9] = {1, 0.1, 0.2, 0.3, 1, 0.4, 0.5, 0.6, 1};
    normalization(from, m, c, &in);
    normalization(to, m, d, &out);
    for (int64_t i = 0; i < m; i++) {
        const double x = (from[2 * i] - c[0]) * in, y = (from[2 * i + 1] - c[1]) * in;
        const double u = (to[2 * i] - d[0]) * out, v = (to[2 * i + 1] - d[1]) * out;
        const double rows[2][9] = {{x, y, 1, 0, 0, 0, -u * x, -u * y, -u}, {0, 0, 0, x, y, 1, -v * x, -v * y, -v}};
        for (int r = 0; r < 2; r++)
            for (int p = 0; p < 9; p++)
                for (int q = 0; q <= p; q++)
                    N[9 * p + q] += rows[r][p] * rows[r][q];
    }
    for (int p = 0; p < 9; p++)
        N[10 * p] += 1e-13 * (double)m;
    for (int step = 0; step < 8; step++) {
        double norm = 0;
        memcpy(L, N, sizeof L);
        solve_positive(9, L, h, 1, 1e-300);
        for (int p = 0; p < 9; p++)
            norm += h[p] * h[p];
        for (int p = 0; p < 9; p++)
            h[p] /= sqrt(norm);
    }
    for (int r = 0; r < 3; r++) {
        const double a = h[3 * r] * in, b = h[3 * r + 1] * in, last = h[3 * r + 2] - a * c[0] - b * c[1];
        h[3 * r] = a, h[3 * r + 1] = b, h[3 * r + 2] = last;
    }
    for (int p = 0; p < 9; p++)
        H[p] = ((p < 6 ? h[p] / out + d[p / 3] * h[6 + p % 3] : h[p])) / h[8];
}

/* The dots' (x, y), which are to be freed; NULL without memory. */
static double *plane_points(const Dot *dots, const Match *matches, int64_t m)
{
    double *points = calloc((size_t)(2 * m + 1), sizeof *points);
    for (int64_t i = 0; points && i < m; i++)
        memcpy(points + 2 * i, dots[matches[i].dot].xyz, 2 * sizeof *points);
    return points;
}

int fit_homography(const Dot *dots, const Match *matches, int64_t m, const double *image, double *H)
{
    double *points = plane_points(dots, matches, m);
    const int good = points && in_general_position(points, m);
    if (good)
        solve_homography(points, image, m, H);
    free(points);
    return points ? good : NO_MEMORY;
}

int correct_centers(const Dot *dots, const Blob *blobs, const Match *matches, int64_t m, double *corrected, double *H)
{
    enum { ROUNDS = 2 }; /* offsets of up to a pixel are known to 3e-3 px after one, and to 4e-5 px after two */
    double *points = plane_points(dots, matches, m);
    const int good = points && in_general_position(points, m);
    for (int64_t i = 0; i < m; i++)
        memcpy(corrected + 2 * i, blobs[matches[i].blob].center, 2 * sizeof *corrected);
    for (int round = 0; good; round++) {
        double mean[2] = {0, 0};
        solve_homography(points, corrected, m, H);
        if (round == ROUNDS)
            break;
        for (int64_t i = 0; i < 2 * m; i++)
            mean[i % 2] += points[i] / (double)m;
        /* Of H and -H, the one that maps the middle of the dots to the front. The dual conic is D = r^2 (h1 h1' + h2 h2') -
           p p', with p = H (X, Y, 1). */
        const double sign = H[6] * mean[0] + H[7] * mean[1] + H[8] < 0 ? -1 : 1;
        for (int64_t i = 0; i < m; i++) {
            const double r = dots[matches[i].dot].radius;
            double p[3], c[3];
            for (int a = 0; a < 3; a++)
                p[a] = sign * (H[3 * a] * points[2 * i] + H[3 * a + 1] * points[2 * i + 1] + H[3 * a + 2]);
            for (int a = 0; a < 3; a++)
                c[a] = p[a] * p[2] - r * r * (H[3 * a] * H[6] + H[3 * a + 1] * H[7]);
            for (int a = 0; a < 2; a++)
                corrected[2 * i + a] = blobs[matches[i].blob].center[a] - (c[a] / c[2] - p[a] / p[2]);
        }
    }
    free(points);
    return points ? good : NO_MEMORY;
}

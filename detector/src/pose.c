/* Poses from labeled dots: the image of a dot, refinement, and the second pose of a plane. */

#include "pose.h"

enum { MOST = POSE + 1 }; /* unknowns: (w, dt), and the logarithm of the focal length */

/* ---- projection ----

   A disk of radius r about P with normal n, in the camera's frame, has the dual conic D = r^2 (I - n n') - P P'. Divided by
   its last entry, which is -level = r^2 (1 - n_z^2) - P_z^2, its last column is the ellipse's center c, and c c' less the rest
   is its shape E. Below level = 0 the rim reaches the plane of the camera's center. */

typedef struct {
    double turned[3], P[3], n[3], square, level, center[2]; /* R X of its place; P = R X + t */
} Disk;

/* Returns whether it is seen. */
static int place_disk(const Dot *dot, const double *place, const Pose *pose, Disk *d)
{
    rotated(pose->R, place, d->turned);
    rotated(pose->R, dot->normal, d->n);
    for (int a = 0; a < 3; a++)
        d->P[a] = d->turned[a] + pose->t[a];
    const double z = d->P[2], nz = d->n[2];
    d->square = dot->radius * dot->radius;
    d->level = z * z - d->square * (1 - nz * nz);
    for (int a = 0; a < 2; a++)
        d->center[a] = (d->P[a] * z + d->square * nz * d->n[a]) / d->level * pose->focal;
    return z > 0 && d->level > 0 && product(d->P, d->n) < 0;
}

/* d(X/z, Y/z) / d(w, dt). The derivative of an ellipse's center is that of the disk's center: they differ by a thousandth, which
   costs a step and shifts the minimum by that share of the residuals. */
static void derivatives(const Disk *d, double focal, double *u, double *v)
{
    const double z = 1 / d->P[2], x = z * d->P[0], y = z * d->P[1], s = focal * z;
    const double a = s * d->turned[0], b = s * d->turned[1], c = s * d->turned[2];
    const double rows[2][POSE] = {{-x * b, c + x * a, -b, s, 0, -x * s}, {-y * b - c, y * a, a, 0, s, -y * s}};
    memcpy(u, rows[0], sizeof rows[0]);
    memcpy(v, rows[1], sizeof rows[1]);
}

static void draw(const Disk *d, double focal, int seen, Outline *outline)
{
    for (int k = 0; k < 3; k++) {
        const int i = k / 2, j = (k + 1) / 2;
        const double disk = d->square * ((i == j) - d->n[i] * d->n[j]);
        outline->shape[k] = d->center[i] * d->center[j] - focal * focal * (d->P[i] * d->P[j] - disk) / d->level;
    }
    for (int a = 0; a < 2; a++) {
        outline->center[a] = d->center[a];
        outline->point[a] = focal * (d->P[a] / d->P[2]);
    }
    outline->depth = d->P[2];
    outline->facing = -product(d->P, d->n) / sqrt(product(d->P, d->P));
    outline->seen = seen;
}

void outline_of(const Dot *dot, const double *place, const Pose *pose, Outline *outline)
{
    Disk d;
    const int seen = place_disk(dot, place, pose, &d);
    draw(&d, pose->focal, seen, outline);
}

void image_rows(const Dot *dot, const Pose *pose, double factor, double (*J)[7])
{
    Disk d;
    place_disk(dot, dot->xyz, pose, &d);
    derivatives(&d, factor * pose->focal, J[0], J[1]);
    for (int a = 0; a < 2; a++)
        J[a][POSE] = factor * pose->focal * d.P[a] / d.P[2];
}

/* ---- refinement ---- */

/* Damping: at the start, least, factor; slack by which chi2 may rise, so that rounding stops no step; ridge, a share of the
   largest diagonal entry, which holds the direction that collinear dots leave free. */
static const double DAMPING = 1e-4, LEAST_DAMPING = 1e-12, FACTOR = 10, SLACK = 1e-12, RIDGE = 1e-14;

double descend(const Problem *problem, int steps, double tolerance, Pose *pose, double *more, double *memory)
{
    const int n = problem->n;
    double *N[2] = {memory, memory + n * n}, *A = memory + 2 * n * n, *g[2] = {A + n * n, A + n * n + n};
    double *step = g[1] + n, *changed = step + n, damping = DAMPING;
    int at = 0; /* which of N and g are those of `pose` */
    double chi2 = problem->equations(problem, pose, more, N[0], g[0]);
    for (int i = 0; i < steps && chi2 < INFINITY; i++) {
        double most = 0, moved = 0;
        Pose tried = *pose;
        for (int p = 0; p < n; p++)
            most = fmax(most, N[at][(n + 1) * p]);
        memcpy(A, N[at], sizeof *A * (size_t)(n * n));
        memcpy(step, g[at], sizeof *step * (size_t)n);
        for (int p = 0; p < n; p++)
            A[(n + 1) * p] += A[(n + 1) * p] * damping + RIDGE * most + 1e-300;
        solve_positive(n, A, step, 1, -INFINITY);
        rotate(step, pose->R, tried.R);
        for (int p = 0; p < 3; p++)
            tried.t[p] += step[3 + p];
        for (int p = POSE; p < n; p++)
            changed[p - POSE] = more[p - POSE] + step[p];
        const double after = problem->equations(problem, &tried, changed, N[!at], g[!at]);
        const int good = after <= chi2 * (1 + SLACK), settled = good && after >= chi2 * (1 - tolerance);
        if (good) {
            *pose = tried;
            memcpy(more, changed, sizeof *more * (size_t)(n - POSE));
            chi2 = after;
            at = !at;
            damping = fmax(damping / FACTOR, LEAST_DAMPING);
        } else
            damping *= FACTOR;
        const double far = sqrt(product(pose->t, pose->t));
        for (int p = 0; p < n; p++)
            moved = fmax(moved, fabs(step[p]) / (p < 3 || p >= POSE ? 1 : far));
        if (settled || !(moved > tolerance))
            break;
    }
    memcpy(memory, N[at], sizeof *memory * (size_t)(n * n));
    return chi2;
}

/* What refine_pose fits. */
typedef struct {
    const Dot *dots;
    const Match *matches;
    int64_t m;
    const double *seen, *weight;
    int places;
    double prior; /* inverse variance of the logarithm of the focal length */
} Centers;

static double center_equations(const Problem *problem, const Pose *at, const double *more, double *normal, double *gradient)
{
    const Centers *q = problem->of;
    const int n = problem->n;
    const double off = n == MOST ? more[0] : 0;
    double chi2 = q->prior * off * off, u[MOST], v[MOST], r[2];
    Pose pose = *at;
    Disk d;
    if (n == MOST)
        pose.focal = exp(off);
    memset(normal, 0, (size_t)(n * n) * sizeof *normal);
    memset(gradient, 0, (size_t)n * sizeof *gradient);
    for (int64_t i = 0; i < q->m; i++) {
        const double *W = q->weight + 3 * i;
        const Dot *dot = q->dots + q->matches[i].dot;
        if (W[0] == 0 && W[2] == 0)
            continue;
        if (!place_disk(dot, q->places ? dot->place : dot->xyz, &pose, &d))
            return INFINITY;
        derivatives(&d, pose.focal, u, v);
        u[POSE] = d.center[0];
        v[POSE] = d.center[1];
        r[0] = q->seen[2 * i] - d.center[0];
        r[1] = q->seen[2 * i + 1] - d.center[1];
        chi2 += add_rows(n, u, v, r, W, normal, gradient);
    }
    if (n == MOST) {
        normal[n * n - 1] += q->prior;
        gradient[POSE] -= q->prior * off;
    }
    return chi2 < INFINITY ? chi2 : INFINITY;
}

double refine_pose(const Dot *dots, const Match *matches, int64_t m, const double *seen, const double *weight, int places,
                   double focal, int steps, double tolerance, Pose *pose)
{
    const Centers centers = {dots, matches, m, seen, weight, places, focal > 0 ? 1 / (focal * focal) : 0};
    const Problem problem = {focal > 0 ? MOST : POSE, center_equations, &centers};
    double memory[3 * MOST * MOST + 4 * MOST], more = log(pose->focal);
    const double chi2 = descend(&problem, steps, tolerance, pose, &more, memory);
    if (focal > 0)
        pose->focal = exp(more);
    return chi2;
}

/* ---- the second pose of a plane ---- */

/* The half turns about the normal n and about the line of sight u, one after the other, are the shortest turn of n to its
   reflection 2 (u'n) u - n: (2 u u' - I) (2 n n' - I) R. */
void mirrored_pose(const Dot *dots, const Match *matches, int64_t m, const Pose *pose, Pose *mirrored)
{
    double middle[3] = {0, 0, 0}, P[3], n[3];
    Pose result = *pose;
    for (int64_t i = 0; i < m; i++)
        for (int a = 0; a < 3; a++)
            middle[a] += dots[matches[i].dot].place[a] / (double)m;
    rotated(pose->R, middle, P);
    for (int a = 0; a < 3; a++)
        P[a] += pose->t[a];
    rotated(pose->R, dots[matches[0].dot].normal, n);
    const double square = product(P, P), cosine = product(P, n);
    for (int j = 0; j < 3; j++) {
        const double v[3] = {pose->R[j], pose->R[3 + j], pose->R[6 + j]}, along = product(n, v);
        for (int a = 0; a < 3; a++)
            result.R[3 * a + j] = v[a] - 2 * along * n[a] + 2 * P[a] * (2 * along * cosine - product(P, v)) / square;
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
static const double LUCK = 1.2816;      /* of chi-squared's 90 % point, up to which residuals are as they should be */
static const double OUTLIER_SIGMA = 5;  /* beyond which a dot is dropped */
static const double FLATNESS = 0.01;    /* range of heights, as a share of the extent, of dots that have a mirrored pose */
static const double LEAST_PX = 1e-6;    /* so that weights are finite without any error */
/* Length of the short axis of a dot's image at which its center is off by 1.4 times as much as the grey levels say: by 1.0
   to 1.1 times at 5 px and more, 1.2 at 4 px, 1.7 at 3 px, where it is narrower than the blur of its edges. */
static const double SHORT_PX = 3.5;
enum { STEPS = 20, LEAST_TO_DROP = 6 };


void through_place(const Row *row, const double *S, double *result)
{
    double A[2][3];
    for (int r = 0; r < 2; r++)
        for (int a = 0; a < 3; a++)
            A[r][a] = row->M[r][0] * S[a] + row->M[r][1] * S[3 + a] + row->M[r][2] * S[6 + a];
    result[0] = product(A[0], row->M[0]);
    result[1] = product(A[0], row->M[1]);
    result[2] = product(A[1], row->M[1]);
}

void derive_row(const Dot *dot, const Blob *blob, const Pose *pose, Row *row)
{
    Disk d;
    const int seen = place_disk(dot, dot->place, pose, &d);
    draw(&d, pose->focal, seen, &row->drawn);
    derivatives(&d, pose->focal, row->J[0], row->J[1]);
    for (int r = 0; r < 2; r++) {
        row->residual[r] = blob->at[r] - d.center[r];
        for (int a = 0; a < 3; a++)
            row->M[r][a] = row->J[r][3] * pose->R[a] + row->J[r][4] * pose->R[3 + a] + row->J[r][5] * pose->R[6 + a];
    }
}

void fill_row(const Sight *s, int64_t i, const Pose *pose, Row *row)
{
    const Dot *dot = s->dots + s->matches[i].dot;
    const Blob *blob = s->blobs + s->matches[i].blob;
    const double *E = blob->shape;
    double factor = 1;
    derive_row(dot, blob, pose, row);
    through_place(row, dot->print, row->print);
    row->area = sqrt(E[0] * E[2] - E[1] * E[1]) / (blob->semi[0] * blob->semi[1]);
    if (s->errors->several) {
        const double *e = row->drawn.shape, half = (e[0] - e[2]) / 2, least = (e[0] + e[2]) / 2 - sqrt(half * half + e[1] * e[1]);
        const double ratio = SHORT_PX * SHORT_PX * row->area / (4 * least);
        factor += ratio > 0 ? ratio * ratio : 0;
    }
    for (int e = 0; e < 3; e++)
        row->image[e] = factor * blob->spread[e] + (e == 1 ? 0 : LEAST_PX * LEAST_PX * row->area);
}

/* Covariance from image and print, and of so many px beside. */
static void covariance_of(const Row *row, double px, double *S)
{
    for (int e = 0; e < 3; e++)
        S[e] = row->image[e] + row->print[e] + (e == 1 ? 0 : px * px * row->area);
}

void weight_of(const Row *row, double px, double *W)
{
    double S[3];
    covariance_of(row, px, S);
    invert_symmetric(S, W);
}

int common_count(const Camera *camera, const Errors *errors)
{
    return (int)errors->common + (errors->calibration ? 4 + camera->count : 0);
}

/* The derivatives (2) of a ray's pixel by parameter p of fx, fy, cx, cy and the coefficients. */
static void camera_column(const Camera *camera, const double *ray, const double *pixel, int p, double *column)
{
    static const double STEP = 1e-6;
    Camera other = *camera;
    column[0] = p == 0 ? (pixel[0] - camera->cx) / camera->fx : p == 2;
    column[1] = p == 1 ? (pixel[1] - camera->cy) / camera->fy : p == 3;
    if (p < 4)
        return;
    other.c[p - 4] += STEP;
    lens_pixel(&other, ray, column, NULL);
    for (int a = 0; a < 2; a++)
        column[a] = (column[a] - pixel[a]) / STEP;
}

void fill_columns(const Sight *s, int64_t i, const Row *row, double *columns)
{
    const Errors *errors = s->errors;
    const int common = (int)errors->common, k = common_count(s->camera, errors), width = k - common;
    double pixel[2], D[4], by[2];
    memset(columns, 0, (size_t)(2 * k) * sizeof *columns);
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 3; b++)
            for (int c = 0; c < common; c++)
                columns[k * a + c] += row->M[a][b] * errors->moved[(3 * s->matches[i].dot + b) * common + c];
    if (!width)
        return;
    lens_pixel(s->camera, row->drawn.point, pixel, D);
    invert_two(D, D);
    for (int p = 0; p < width; p++) {
        camera_column(s->camera, row->drawn.point, pixel, p, by);
        for (int a = 0; a < 2; a++)
            for (int c = 0; c < width; c++)
                columns[k * a + common + c] += (D[2 * a] * by[0] + D[2 * a + 1] * by[1]) * errors->calibration[width * p + c];
    }
}

/* (J'WJ)^-1 and J'Wr of all rows; `px` as for weight_of. */
static void pose_inverse(const Row *rows, int64_t m, double px, double *inverse, double *gradient)
{
    double N[36] = {0}, W[3];
    memset(inverse, 0, 36 * sizeof *inverse);
    memset(gradient, 0, POSE * sizeof *gradient);
    for (int64_t i = 0; i < m; i++) {
        weight_of(rows + i, px, W);
        add_rows(POSE, rows[i].J[0], rows[i].J[1], rows[i].residual, W, N, gradient);
    }
    for (int p = 0; p < POSE; p++)
        inverse[(POSE + 1) * p] = 1;
    solve_positive(POSE, N, inverse, POSE, -INFINITY);
}

static void fill_rows(const Sight *s, const Pose *pose, Row *rows)
{
    for (int64_t i = 0; i < s->m; i++)
        fill_row(s, i, pose, rows + i);
}

/* Refines a pose; `numbers` (5 m) is scratch. The print's share of the weights depends smoothly on the pose: from a start that is
   right to a percent, they are right to a percent, and the estimate then to second order. */
static double refined(const Sight *s, double tolerance, Row *rows, double *numbers, Pose *pose)
{
    fill_rows(s, pose, rows);
    for (int64_t i = 0; i < s->m; i++) {
        memcpy(numbers + 2 * i, s->blobs[s->matches[i].blob].at, 2 * sizeof *numbers);
        weight_of(rows + i, 0, numbers + 2 * s->m + 3 * i);
    }
    return refine_pose(s->dots, s->matches, s->m, numbers, numbers + 2 * s->m, 1, 0, STEPS, tolerance, pose);
}

/* Whether the dots are in one plane, up to the bending of a print: that of the first dot. */
static int nearly_flat(const Sight *s)
{
    const Dot *first = s->dots + s->matches[0].dot;
    double low = 0, high = 0, extent = 0;
    for (int64_t i = 1; i < s->m; i++) {
        double from[3];
        for (int a = 0; a < 3; a++)
            from[a] = s->dots[s->matches[i].dot].place[a] - first->place[a];
        const double height = product(from, first->normal);
        low = fmin(low, height);
        high = fmax(high, height);
        extent = fmax(extent, product(from, from));
    }
    return high - low <= FLATNESS * sqrt(extent);
}

/* Writes the best pose and the other one of a plane, with chi2 of both, that of the other INFINITY without it, and the rows of
   the best pose. */
static void best_poses(const Sight *s, Row *rows, double *numbers, Pose *pose, double *chi2)
{
    chi2[0] = refined(s, TOLERANCE, rows, numbers, pose);
    chi2[1] = INFINITY;
    if (chi2[0] < INFINITY && nearly_flat(s)) {
        const double spread = fmax(1, chi2[0] / (double)(2 * s->m - POSE));
        mirrored_pose(s->dots, s->matches, s->m, pose, pose + 1);
        chi2[1] = refined(s, COARSE, rows, numbers, pose + 1);
        if (chi2[1] - chi2[0] < 2 * SEARCHED * spread)
            chi2[1] = refined(s, TOLERANCE, rows, numbers, pose + 1);
    }
    if (chi2[1] < chi2[0]) {
        const Pose swapped = pose[0];
        const double more = chi2[0];
        pose[0] = pose[1];
        pose[1] = swapped;
        chi2[0] = chi2[1];
        chi2[1] = more;
    }
    fill_rows(s, pose, rows);
}

/* The row that is more than OUTLIER_SIGMA from where the others predict it; -1 if none is.

   Leaving out dot i lowers chi2 by r_i' (S_i - J_i C J_i')^-1 r_i, with S_i its covariance from image, print and OUTLIER_PX,
   and C the pose's. This is compared in units of the factor by which the others' chi2 exceeds its expectation: in a print
   that is worse than stated all dots are off, and none is an outlier. With fewer than six dots none can be identified, nor
   where all of chi2 is less than an outlier would lower it by. */
static int64_t outlier(const Row *rows, int64_t m, double chi2, double *gain)
{
    if (m < LEAST_TO_DROP || chi2 <= OUTLIER_SIGMA * OUTLIER_SIGMA)
        return -1;
    double C[36], gradient[POSE], S[3], W[3], total = 0, most = OUTLIER_SIGMA * OUTLIER_SIGMA;
    int64_t worst = -1;
    pose_inverse(rows, m, OUTLIER_PX, C, gradient);
    for (int64_t i = 0; i < m; i++) {
        double r[2] = {rows[i].residual[0], rows[i].residual[1]}, JC[2][POSE] = {{0}};
        covariance_of(rows + i, OUTLIER_PX, S);
        invert_symmetric(S, W);
        for (int p = 0; p < POSE; p++) {
            for (int q = 0; q < POSE; q++)
                for (int a = 0; a < 2; a++)
                    JC[a][p] += rows[i].J[a][q] * C[POSE * q + p];
            /* The pose was fitted with other weights: a step adapts it to these. */
            for (int a = 0; a < 2; a++)
                r[a] -= JC[a][p] * gradient[p];
            for (int e = 0; e < 3; e++)
                S[e] -= JC[e / 2][p] * rows[i].J[(e + 1) / 2][p];
        }
        total += quadratic(W, r);
        invert_symmetric(S, W);
        gain[i] = quadratic(W, r);
    }
    for (int64_t i = 0; i < m; i++) {
        const double excess = gain[i] / fmax(1, (total - gain[i]) / (double)(2 * m - 8));
        if (excess > most) {
            most = excess;
            worst = i;
        }
    }
    return worst;
}

/* The factor, 1 or more, by which residuals show the covariances of image and print to be too small: chi2/d, the estimate of
   a factor common to all dots by d = 2 m - 6 degrees of freedom, where chi2 exceeds its 90 % point (the global test of an
   adjustment; C. F. Gauss). Reflections, shadows and compression move dots by more than the noise of the grey levels. If it were
   taken wherever it exceeds 1, as luck has it in two of five views, 95 % regions would hold 96.0 to 96.7 % of 2,000 poses, not 94.5
   to 95.7. Dots far less precise than the others, whose covariance is a guess, do not take part: they hardly affect the pose, so
   each has two degrees of freedom. */
static double residual_scale(const Row *rows, int64_t m, double *scratch)
{
    double S[3], W[3], total = 0, freedom = -POSE;
    for (int64_t i = 0; i < m; i++) {
        covariance_of(rows + i, 0, S);
        scratch[i] = S[0] + S[2];
    }
    const double most = ROUGH_SIGMA * ROUGH_SIGMA * median(scratch, m);
    for (int64_t i = 0; i < m; i++) {
        covariance_of(rows + i, 0, S);
        if (S[0] + S[2] > most)
            continue;
        invert_symmetric(S, W);
        total += quadratic(W, rows[i].residual);
        freedom += 2;
    }
    return freedom > 0 && total > chi2_point(freedom, LUCK) ? total / freedom : 1;
}

/* result += g g' of n columns g (6). */
static void add_squares(const double *g, int64_t n, double *result)
{
    for (; n > 0; n--, g += POSE)
        for (int p = 0; p < POSE; p++)
            for (int q = 0; q < POSE; q++)
                result[POSE * p + q] += g[p] * g[q];
}

/* result += G' S G. */
static void add_carried(double (*G)[POSE], const double *S, double *result)
{
    for (int p = 0; p < POSE; p++)
        for (int q = 0; q < POSE; q++)
            result[POSE * p + q] += (G[0][p] * S[0] + G[1][p] * S[1]) * G[0][q] + (G[0][p] * S[1] + G[1][p] * S[2]) * G[1][q];
}

/* Fills in scale and covariances of `e->pose`; `numbers` (m + 8 common_count) is scratch. */
static void budget(const Sight *s, const Row *rows, double *numbers, Estimate *e)
{
    const int64_t k = common_count(s->camera, s->errors), common = s->errors->common;
    double C[36], gradient[POSE], W[3], S[3], *columns = numbers + s->m, *moved = columns + 2 * k;
    memset(moved, 0, (size_t)(POSE * k) * sizeof *moved);
    pose_inverse(rows, s->m, 0, C, gradient);
    for (int64_t i = 0; i < s->m; i++) {
        const double(*J)[POSE] = rows[i].J;
        double G[2][POSE] = {{0}};
        weight_of(rows + i, 0, W);
        for (int p = 0; p < POSE; p++)
            for (int q = 0; q < POSE; q++) {
                G[0][p] += C[POSE * p + q] * (W[0] * J[0][q] + W[1] * J[1][q]);
                G[1][p] += C[POSE * p + q] * (W[1] * J[0][q] + W[2] * J[1][q]);
            }
        add_carried(G, rows[i].image, e->image);
        if (s->errors->alone)
            through_place(rows + i, s->errors->alone + 9 * s->matches[i].dot, S);
        add_carried(G, s->errors->alone ? S : rows[i].print, e->print);
        fill_columns(s, i, rows + i, columns);
        for (int64_t c = 0; c < k; c++)
            for (int p = 0; p < POSE; p++)
                moved[POSE * c + p] += G[0][p] * columns[c] + G[1][p] * columns[k + c];
    }
    add_squares(moved, common, e->print);
    add_squares(moved + POSE * common, k - common, e->calibration);
    e->scale = residual_scale(rows, s->m, numbers);
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
    Sight s = {dots, blobs, matches, m, camera, errors};
    Pose pose[2] = {*start, *start};
    double chi2[2], *numbers = malloc(sizeof *numbers * (size_t)(5 * m + 8 * common_count(camera, errors) + 1));
    Row *rows = malloc(sizeof *rows * (size_t)(m + 1));
    memset(e, 0, sizeof *e);
    for (int64_t worst = 0; numbers && rows && worst >= 0;) {
        best_poses(&s, rows, numbers, pose, chi2);
        worst = chi2[0] < INFINITY ? outlier(rows, s.m, chi2[0], numbers) : -1;
        if (worst < 0)
            break;
        const Match dropped = matches[worst];
        memmove(matches + worst, matches + worst + 1, sizeof *matches * (size_t)(m - worst - 1));
        matches[m - 1] = dropped;
        s.m--;
    }
    if (numbers && rows && chi2[0] < INFINITY) {
        e->count = s.m;
        e->freedom = 2 * s.m - POSE;
        e->chi2 = chi2[0];
        e->pose = pose[0];
        budget(&s, rows, numbers, e);
        const double likelihood = exp((chi2[0] - chi2[1]) / (2 * e->scale));
        const double sigma = sqrt(e->covariance[0] + e->covariance[7] + e->covariance[14]);
        if (likelihood > CONTENDER && angle_between(pose, pose + 1) > DISTINCT_SIGMA * sigma) {
            e->likelihood = likelihood;
            e->other = pose[1];
        }
    }
    const int64_t status = numbers && rows ? e->count : NO_MEMORY;
    free(numbers);
    free(rows);
    return status;
}

/* Whether an image agrees with the camera, the print and the body as stated, and what may be wrong.

   The adjustment of a pose is made again with all errors as they are: residuals r = x - f(pose) - A c, with the covariance S
   of the image, of what every dot may be off by, and of the print, and errors c, common to dots or of the camera, of unit
   variance. The minimum of

       chi2 = sum r' S^-1 r + c'c

   by pose and c has the expectation 2 m - 6 if all is as stated. Then parameters of each cause are added, and the causes are
   ordered by what is left of chi2. One view of a plane tells few apart: its tilt and distance stand for many. */

#include "pose.h"

/* chi2 per degree of freedom up to which all is as usual. With a print of 0.1 mm, photographs of others with the right camera
   file came to 0.3 to 2.0 (11 views of flat and nearly flat papers), those with a nominal file without distortion to 3.2 to
   12, with another camera's to 0.9 to 4.7, of papers bent by 1 mm and more to 6.8 to 11; with a focal length wrong by 20 %
   or a print wrong by 3 %, six dots at a tilt of 28 degrees to 8 and 24. */
static const double USUAL = 3;

/* F statistic from which a cause explains something, and up to which another explains as much as the best one. */
static const double TELLING = 12, ALIKE = 6;

/* Share of chi2 that the best cause must leave less than to be a likely one: else several errors, or others, are at work. */
static const double EXPLAINED = 0.5;

/* What may be wrong, in order: focal length, fy/fx and k1 of the camera; stretch along x and y of a print; its rise at the
   ends along x and y and at opposite corners; the shutter; and a plate's motion (w, dt). */
enum { BENDS = 5, SHUTTERS = 8, MOTION = 9, PARAMETERS = 15 };
static const double STEP[PARAMETERS] = {1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7, 1e-6, 1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7};

/* The parameters of each cause: the first, how many, and which of these make its value, the last ones or the first alone. */
static const struct {
    int first, width, valued;
} FREE[CAUSES + 1] = {{0, 1, 0}, {1, 1, 0}, {2, 1, 0}, {3, 1, 0}, {4, 1, 0}, {5, 1, 0}, {6, 1, 0}, {8, 1, 0}, {9, 6, 3}, {0, 3, 0},
                      {5, 3, 3}, {0, 0, 0}};

enum { ROUNDS = 20, WIDTH = 6 /* most parameters of a cause */ };
static const double SETTLED = 1e-3; /* share of chi2 by which a step must lower it for another one */

typedef struct {
    int32_t kind, plate;
    double v[PARAMETERS];
} Trial;

typedef struct {
    const Dot *dots;
    const Blob *blobs;
    const Match *matches;
    int64_t m;
    const Camera *camera;
    const Plate *plates;
    double low[2], high[2]; /* of the dots on their plates, m */
    int common;
    double *weight, *columns; /* (m, 3): S^-1, px^-2; (m, 2, common): A, px */
    double *error;            /* (common): c */
    double *memory;           /* normal equations and steps */
} Case;

/* Where a dot is with what is wrong. */
static void caused_place(const Case *c, const Dot *dot, const Trial *trial, double *place)
{
    const double *v = trial->v;
    const Plate *plate = c->plates + dot->plate;
    double from[3], at[2], share[2];
    for (int a = 0; a < 3; a++)
        from[a] = dot->place[a] - plate->t[a];
    for (int a = 0; a < 2; a++) {
        at[a] = plate->R[a] * from[0] + plate->R[3 + a] * from[1] + plate->R[6 + a] * from[2];
        share[a] = (2 * at[a] - c->high[a] - c->low[a]) / fmax(c->high[a] - c->low[a], 1e-12);
    }
    const double *bend = v + BENDS, *w = v + MOTION;
    const double rise = bend[0] * share[0] * share[0] + bend[1] * share[1] * share[1] + bend[2] * share[0] * share[1];
    for (int a = 0; a < 3; a++) {
        const double *R = plate->R + 3 * a;
        place[a] = dot->place[a] + v[3] * at[0] * R[0] + v[4] * at[1] * R[1] + rise * R[2];
        if (dot->plate == trial->plate)
            place[a] += w[3 + a] + w[(a + 1) % 3] * from[(a + 2) % 3] - w[(a + 2) % 3] * from[(a + 1) % 3];
    }
}

/* Measured less predicted center of a dot, px, without the common errors. The offset from its blob is carried by the lens's
   derivatives, which know the bias of a center where the lens bends the outline. */
static int caused_residual(const Case *c, int64_t i, const Pose *pose, const Trial *trial, double *residual)
{
    const Dot *dot = c->dots + c->matches[i].dot;
    const double *at = c->blobs[c->matches[i].blob].at, *v = trial->v;
    double place[3], pixel[2], D[4];
    Outline o;
    caused_place(c, dot, trial, place);
    outline_of(dot, place, pose, &o);
    lens_pixel(c->camera, o.center, pixel, D);
    const double x = pixel[0] - c->camera->cx, y = pixel[1] - c->camera->cy;
    const double u = x / c->camera->fx, w = y / c->camera->fy, bent = 1 + v[2] * (u * u + w * w);
    const double moved[2] = {x * (exp(v[0]) * bent - 1) + y * v[SHUTTERS], y * (exp(v[0] + v[1]) * bent - 1)};
    for (int a = 0; a < 2; a++)
        residual[a] = D[2 * a] * (at[0] - o.center[0]) + D[2 * a + 1] * (at[1] - o.center[1]) - moved[a];
    return o.seen && isfinite(residual[0]) && isfinite(residual[1]);
}

/* chi2 with the normal equations of pose, common errors and the cause; INFINITY where dots are not seen. */
static double equations(const Case *c, const Pose *pose, const Trial *trial, const double *error, double *N, double *g)
{
    const int k = c->common, width = FREE[trial->kind].width, first = FREE[trial->kind].first, n = POSE + k + width;
    double *rows = g + n, chi2 = 0;
    memset(N, 0, sizeof *N * (size_t)(n * n));
    memset(g, 0, sizeof *g * (size_t)n);
    for (int p = 0; p < k; p++) {
        chi2 += error[p] * error[p];
        N[(n + 1) * (POSE + p)] = 1;
        g[POSE + p] = -error[p];
    }
    for (int64_t i = 0; i < c->m; i++) {
        Dot dot = c->dots[c->matches[i].dot];
        const double *W = c->weight + 3 * i, *A = c->columns + 2 * k * i;
        double J[2][POSE], M[2][3], D[4], pixel[2], r[2], ray[2], place[3];
        if (!caused_residual(c, i, pose, trial, r))
            return INFINITY;
        caused_place(c, &dot, trial, place);
        memcpy(dot.place, place, sizeof place);
        dot_rows(&dot, pose, J, M);
        for (int a = 0; a < 2; a++)
            ray[a] = c->blobs[c->matches[i].blob].at[a];
        lens_pixel(c->camera, ray, pixel, D);
        for (int a = 0; a < 2; a++)
            for (int p = 0; p < POSE; p++)
                rows[n * a + p] = D[2 * a] * J[0][p] + D[2 * a + 1] * J[1][p];
        for (int p = 0; p < k; p++)
            for (int a = 0; a < 2; a++)
                rows[n * a + POSE + p] = A[k * a + p];
        for (int p = 0; p < width; p++) {
            double by[2];
            Trial other = *trial;
            other.v[first + p] += STEP[first + p];
            caused_residual(c, i, pose, &other, by);
            for (int a = 0; a < 2; a++)
                rows[n * a + POSE + k + p] = (r[a] - by[a]) / STEP[first + p];
        }
        for (int p = 0; p < k; p++)
            for (int a = 0; a < 2; a++)
                r[a] -= A[k * a + p] * error[p];
        const double x = W[0] * r[0] + W[1] * r[1], y = W[1] * r[0] + W[2] * r[1];
        chi2 += x * r[0] + y * r[1];
        for (int p = 0; p < n; p++) {
            const double u = W[0] * rows[p] + W[1] * rows[n + p], v = W[1] * rows[p] + W[2] * rows[n + p];
            g[p] += x * rows[p] + y * rows[n + p];
            for (int q = 0; q <= p; q++)
                N[n * p + q] += u * rows[q] + v * rows[n + q];
        }
    }
    return chi2;
}

/* Least chi2 with a cause, from the estimate and values of 0, by steps of Levenberg and Marquardt. Its value, with the
   standard deviation at unit weight, is one of its parameters, or the length of several. */
static double adjusted(const Case *c, const Pose *start, Trial trial, double *value, double *sigma)
{
    const int k = c->common, first = FREE[trial.kind].first, width = FREE[trial.kind].width, n = POSE + k + width;
    const int several = FREE[trial.kind].valued, from = several ? width - several : 0, to = several ? width : width > 0;
    double *N = c->memory, *L = N + n * n, *kept = L + n * n, *g = kept + n * n, *step = g + 3 * n;
    double *error = c->error, *moved = error + k, *along = step + n, best = INFINITY, damping = 1e-5;
    Pose pose = *start, next = pose;
    Trial tried = trial;
    memset(error, 0, sizeof *error * (size_t)(2 * k));
    for (int round = 0; round < ROUNDS; round++) {
        const double chi2 = equations(c, &next, &tried, moved, N, g);
        const int settled = best < INFINITY && fabs(chi2 - best) <= SETTLED * best;
        if (chi2 < best) {
            best = chi2;
            pose = next;
            trial = tried;
            damping /= 10;
            memcpy(error, moved, sizeof *error * (size_t)k);
            memcpy(kept, N, sizeof *N * (size_t)(n * n));
            memcpy(along, g, sizeof *g * (size_t)n);
        } else
            damping *= 10;
        if (settled || !(best < INFINITY))
            break;
        memcpy(L, kept, sizeof *L * (size_t)(n * n));
        memcpy(step, along, sizeof *step * (size_t)n);
        for (int p = 0; p < n; p++)
            L[(n + 1) * p] *= 1 + damping;
        solve_positive(n, L, step, 1, 1e-300);
        turn(step, pose.R, next.R);
        for (int a = 0; a < 3; a++)
            next.t[a] = pose.t[a] + step[3 + a];
        for (int p = 0; p < k; p++)
            moved[p] = error[p] + step[POSE + p];
        for (int p = 0; p < width; p++)
            tried.v[first + p] = trial.v[first + p] + step[POSE + k + p];
    }
    double length = 0, variance = 0;
    for (int p = from; p < to; p++)
        length += trial.v[first + p] * trial.v[first + p];
    length = sqrt(length);
    *value = to - from == 1 ? trial.v[first + from] : length;
    *sigma = 0;
    if (!(best < INFINITY) || !(length > 0))
        return best;
    /* N^-1 times the direction of the value. */
    memset(along, 0, sizeof *along * (size_t)n);
    for (int p = from; p < to; p++)
        along[POSE + k + p] = to - from == 1 ? 1 : trial.v[first + p] / length;
    memcpy(step, along, sizeof *step * (size_t)n);
    for (int p = 0; p < n; p++)
        kept[(n + 1) * p] *= 1 + 1e-12;
    solve_positive(n, kept, step, 1, 1e-300);
    for (int p = 0; p < n; p++)
        variance += along[p] * step[p];
    *sigma = sqrt(variance);
    return best;
}

/* The factor L, S = L L', of a covariance that may be singular: columns without variance of their own are zero. */
static void factorize(const double *S, int n, double *L)
{
    memset(L, 0, sizeof *L * (size_t)(n * n));
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = S[n * i + j];
            for (int p = 0; p < j; p++)
                sum -= L[n * i + p] * L[n * j + p];
            if (i == j)
                L[n * j + j] = sum > 1e-12 * S[n * j + j] ? sqrt(sum) : 0;
            else
                L[n * i + j] = L[n * j + j] > 0 ? sum / L[n * j + j] : 0;
        }
}

/* Fills in weights, columns and the extent of the dots at the estimate. */
static void prepare(Case *c, const Errors *errors, const Pose *pose)
{
    const int width = errors->calibration ? 4 + c->camera->count : 0, shared = (int)errors->common, k = c->common;
    double L[CAMERA * CAMERA], rows[2 * CAMERA];
    if (width)
        factorize(errors->calibration, width, L);
    for (int64_t i = 0; i < c->m; i++) {
        const int64_t number = c->matches[i].dot;
        const Dot *dot = c->dots + number;
        double J[2][POSE], M[2][3], MD[2][3], D[4], pixel[2], S[3], print[3], *W = c->weight + 3 * i, *A = c->columns + 2 * k * i;
        Outline o;
        outline_of(dot, dot->place, pose, &o);
        lens_pixel(c->camera, o.center, pixel, D);
        dot_rows(dot, pose, J, M);
        for (int a = 0; a < 2; a++)
            for (int q = 0; q < 3; q++)
                MD[a][q] = D[2 * a] * M[0][q] + D[2 * a + 1] * M[1][q];
        through_place(MD, errors->alone ? errors->alone + 9 * number : dot->print, print);
        pixel_covariance(dot, c->blobs + c->matches[i].blob, pose, c->camera, errors, S);
        for (int e = 0; e < 3; e++)
            S[e] += print[e] + (e == 1 ? 0 : OUTLIER_PX * OUTLIER_PX);
        const double det = S[0] * S[2] - S[1] * S[1];
        W[0] = S[2] / det, W[1] = -S[1] / det, W[2] = S[0] / det;
        for (int p = 0; p < shared; p++)
            for (int a = 0; a < 2; a++) {
                const double *d = errors->moved + 3 * shared * number + p;
                A[k * a + p] = MD[a][0] * d[0] + MD[a][1] * d[shared] + MD[a][2] * d[2 * shared];
            }
        if (width)
            camera_rows(c->camera, o.point, rows);
        for (int p = 0; p < width; p++)
            for (int a = 0; a < 2; a++) {
                A[k * a + shared + p] = 0;
                for (int q = p; q < width; q++)
                    A[k * a + shared + p] += rows[width * a + q] * L[width * q + p];
            }
        const Plate *plate = c->plates + dot->plate;
        for (int a = 0; a < 2; a++) {
            double at = 0;
            for (int b = 0; b < 3; b++)
                at += plate->R[3 * b + a] * (dot->place[b] - plate->t[b]);
            c->low[a] = i ? fmin(c->low[a], at) : at;
            c->high[a] = i ? fmax(c->high[a], at) : at;
        }
    }
}

/* The 99.9 % point of chi-squared (E. Wilson and M. Hilferty, 1931). */
static double chi2_point(double freedom)
{
    const double spread = 2 / (9 * freedom), root = 1 - spread + 3.0902 * sqrt(spread);
    return freedom * root * root * root;
}

/* Tries a cause, and puts it in its place by what is left of chi2 for each degree of freedom, `by`, if it explains something;
   the last one falls out when all are taken. */
static void try_cause(const Case *c, const Estimate *estimate, int32_t kind, int32_t plate, Verdict *verdict, double *by)
{
    const Trial trial = {kind, plate, {0}};
    const double freedom = (double)(verdict->freedom - FREE[kind].width);
    Cause cause = {kind, plate, 0, 0, 0};
    if (!(freedom > 0))
        return;
    cause.chi2 = adjusted(c, &estimate->pose, trial, &cause.value, &cause.sigma);
    const double left = cause.chi2 / freedom, scale = fmax(1, left);
    cause.sigma *= sqrt(scale);
    if (!((verdict->chi2 - cause.chi2) / FREE[kind].width > TELLING * scale))
        return;
    int at = verdict->count < MOST_CAUSES ? verdict->count++ : MOST_CAUSES;
    for (; at > 0 && by[at - 1] > left; at--)
        if (at < MOST_CAUSES) {
            verdict->causes[at] = verdict->causes[at - 1];
            by[at] = by[at - 1];
        }
    if (at < MOST_CAUSES) {
        verdict->causes[at] = cause;
        by[at] = left;
    }
}

static void count_likely(Verdict *verdict, const double *by)
{
    verdict->likely = 0;
    for (int i = 0; i < verdict->count && verdict->causes[0].chi2 < EXPLAINED * verdict->chi2; i++)
        verdict->likely += by[i] - by[0] <= ALIKE / (double)verdict->freedom * fmax(1, by[0]);
}

int judge(const Dot *dots, const Blob *blobs, const Match *matches, const Camera *camera, const Errors *errors,
          const Plate *plates, int64_t plate_count, const Estimate *estimate, Verdict *verdict)
{
    const int64_t m = estimate->count;
    const int k = (int)errors->common + (errors->calibration ? 4 + camera->count : 0), n = POSE + k + WIDTH;
    int64_t *seen = calloc((size_t)plate_count + 1, sizeof *seen), plates_seen = 0;
    double *memory = malloc(sizeof *memory * ((size_t)m * (size_t)(3 + 2 * k) + (size_t)(2 * k + 3 * n * n + 5 * n)));
    double by[MOST_CAUSES], value, sigma;
    memset(verdict, 0, sizeof *verdict);
    if (!memory || !seen) {
        free(memory);
        free(seen);
        return NO_MEMORY;
    }
    Case c = {dots, blobs, matches, m, camera, plates, {0, 0}, {0, 0}, k, memory, memory + 3 * m, NULL, NULL};
    c.error = c.columns + 2 * k * m;
    c.memory = c.error + 2 * k;
    prepare(&c, errors, &estimate->pose);
    const Trial none = {CAUSES, -1, {0}};
    verdict->freedom = 2 * m - POSE;
    verdict->chi2 = adjusted(&c, &estimate->pose, none, &value, &sigma);
    verdict->limit = verdict->freedom > 0 ? fmax(chi2_point((double)verdict->freedom), USUAL * (double)verdict->freedom) : INFINITY;
    verdict->consistent = verdict->chi2 <= verdict->limit;
    for (int64_t i = 0; i < m; i++)
        plates_seen += seen[dots[matches[i].dot].plate]++ == 0;
    const int single = plates_seen == 1;
    for (int32_t kind = 0; kind < MISPLACED && !verdict->consistent; kind++)
        if (!(single ? kind == STRETCH_Y : kind == BEND_X || kind == BEND_Y))
            try_cause(&c, estimate, kind, -1, verdict, by);
    for (int32_t plate = 0; plate < plate_count && !single && !verdict->consistent; plate++)
        if (seen[plate] >= 3)
            try_cause(&c, estimate, MISPLACED, plate, verdict, by);
    count_likely(verdict, by);
    if (!verdict->likely && !verdict->consistent) {
        try_cause(&c, estimate, CAMERA_FILE, -1, verdict, by);
        if (single)
            try_cause(&c, estimate, BENT, -1, verdict, by);
        count_likely(verdict, by);
    }
    free(memory);
    free(seen);
    return 0;
}

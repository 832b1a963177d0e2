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
static const double RARE = 3.0902; /* of the 99.9 % point, which few dots may reach by chance */

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
static const double TOLERANCE = 1e-5;

typedef struct {
    Sight s;
    const Pose *plates;
    double low[2], high[2]; /* of the dots on their plates, m */
    int32_t kind, plate;    /* the cause that is tried */
    int k;                  /* number of common errors */
    double *weight;         /* (m, 3) */
    double *columns;        /* (m, 2, k): the image's displacement by each error */
    double *memory;         /* of `descend`, then two rows, then the unknowns beside the pose */
} Case;

/* A dot's offset from its plate's origin in the body, and its x and y on the plate. */
static void on_plate(const Case *c, const Dot *dot, double *offset, double *at)
{
    const Pose *plate = c->plates + dot->plate;
    for (int a = 0; a < 3; a++)
        offset[a] = dot->place[a] - plate->t[a];
    for (int a = 0; a < 2; a++)
        at[a] = plate->R[a] * offset[0] + plate->R[3 + a] * offset[1] + plate->R[6 + a] * offset[2];
}

/* Moves a dot to where it is with what is wrong. */
static void move_dot(const Case *c, const double *v, Dot *dot)
{
    const double *R = c->plates[dot->plate].R, *bend = v + BENDS, *motion = v + MOTION;
    double offset[3], at[2], share[2], turned[3];
    on_plate(c, dot, offset, at);
    for (int a = 0; a < 2; a++)
        share[a] = (2 * at[a] - c->high[a] - c->low[a]) / fmax(c->high[a] - c->low[a], 1e-12);
    const double rise = bend[0] * share[0] * share[0] + bend[1] * share[1] * share[1] + bend[2] * share[0] * share[1];
    cross(motion, offset, turned);
    for (int a = 0; a < 3; a++) {
        dot->place[a] += v[3] * at[0] * R[3 * a] + v[4] * at[1] * R[3 * a + 1] + rise * R[3 * a + 2];
        if (dot->plate == c->plate)
            dot->place[a] += motion[3 + a] + turned[a];
    }
}

/* The row of a match with what is wrong, without common errors. The offset from its blob is taken in normalized coordinates, which
   know the bias of a center where the lens bends the outline. */
static int caused_row(const Case *c, int64_t i, const Pose *pose, const double *values, Row *row)
{
    const Camera *camera = c->s.camera;
    Dot dot = c->s.dots[c->s.matches[i].dot];
    double v[PARAMETERS] = {0}, pixel[2], D[4], ray[2];
    memcpy(v + FREE[c->kind].first, values, (size_t)FREE[c->kind].width * sizeof *v);
    move_dot(c, v, &dot);
    derive_row(&dot, c->s.blobs + c->s.matches[i].blob, pose, row);
    lens_pixel(camera, row->drawn.center, pixel, D);
    invert_two(D, D);
    const double x = pixel[0] - camera->cx, y = pixel[1] - camera->cy;
    const double bent = 1 + v[2] * (x * x / (camera->fx * camera->fx) + y * y / (camera->fy * camera->fy));
    const double moved[2] = {x * (exp(v[0]) * bent - 1) + y * v[SHUTTERS], y * (exp(v[0] + v[1]) * bent - 1)};
    if (moved[0] != 0 || moved[1] != 0) {
        /* To first order where the lens shows nothing. */
        const int valid = lens_ray(camera, pixel[0] + moved[0], pixel[1] + moved[1], ray);
        for (int a = 0; a < 2; a++)
            row->residual[a] -= valid ? ray[a] - row->drawn.center[a] : D[2 * a] * moved[0] + D[2 * a + 1] * moved[1];
    }
    return row->drawn.seen && isfinite(row->residual[0]) && isfinite(row->residual[1]);
}

/* Of pose, common errors and the cause's parameters. */
static double equations(const Problem *problem, const Pose *pose, const double *more, double *normal, double *gradient)
{
    const Case *c = problem->of;
    const int k = c->k, width = FREE[c->kind].width, n = problem->n;
    double *rows = c->memory + 3 * n * n + 4 * n, values[WIDTH + 1], chi2 = 0;
    Row row, other;
    memset(normal, 0, sizeof *normal * (size_t)(n * n));
    memset(gradient, 0, sizeof *gradient * (size_t)n);
    memcpy(values, more + k, sizeof *values * (size_t)width);
    for (int p = 0; p < k; p++) {
        chi2 += more[p] * more[p];
        normal[(n + 1) * (POSE + p)] = 1;
        gradient[POSE + p] = -more[p];
    }
    for (int64_t i = 0; i < c->s.m; i++) {
        const double *A = c->columns + 2 * k * i;
        if (!caused_row(c, i, pose, values, &row))
            return INFINITY;
        for (int p = 0; p < width; p++) {
            const double before = values[p], step = STEP[FREE[c->kind].first + p];
            values[p] += step;
            caused_row(c, i, pose, values, &other);
            values[p] = before;
            for (int a = 0; a < 2; a++)
                rows[n * a + POSE + k + p] = (row.residual[a] - other.residual[a]) / step;
        }
        for (int a = 0; a < 2; a++) {
            memcpy(rows + n * a, row.J[a], sizeof row.J[a]);
            memcpy(rows + n * a + POSE, A + k * a, sizeof *A * (size_t)k);
            for (int p = 0; p < k; p++)
                row.residual[a] -= A[k * a + p] * more[p];
        }
        chi2 += add_rows(n, rows, rows + n, row.residual, c->weight + 3 * i, normal, gradient);
    }
    return chi2;
}

/* Least chi2 with a cause. Its value, with the standard deviation at unit weight, is one of its parameters, or the length of
   several. */
static double adjusted(Case *c, const Pose *start, Cause *cause)
{
    const int k = c->k, width = FREE[cause->kind].width, n = POSE + k + width, several = FREE[cause->kind].valued;
    const int from = several ? n - several : POSE + k, to = several || !width ? n : from + 1;
    double *N = c->memory, *along = N + n * n, *more = N + 3 * n * n + 6 * n, *values = more - POSE, length = 0, variance = 0;
    const Problem problem = {n, equations, c};
    Pose pose = *start;
    c->kind = cause->kind;
    c->plate = cause->plate;
    memset(more, 0, sizeof *more * (size_t)n);
    cause->chi2 = descend(&problem, ROUNDS, TOLERANCE, &pose, more, N);
    for (int p = from; p < to; p++)
        length += values[p] * values[p];
    length = sqrt(length);
    cause->value = to - from == 1 ? values[from] : length;
    cause->sigma = 0;
    if (!(cause->chi2 < INFINITY) || !(length > 0))
        return cause->chi2;
    /* N^-1 times the direction of the value. */
    memset(along, 0, sizeof *along * (size_t)n);
    for (int p = from; p < to; p++)
        along[p] = values[p] = values[p] / length;
    for (int p = 0; p < n; p++)
        N[(n + 1) * p] *= 1 + 1e-12;
    solve_positive(n, N, along, 1, 1e-300);
    for (int p = from; p < to; p++)
        variance += values[p] * along[p];
    cause->sigma = sqrt(variance);
    return cause->chi2;
}

/* Fills in weights, columns and the extent of the dots at a pose. */
static void prepare(Case *c, const Pose *pose)
{
    const Errors *errors = c->s.errors;
    double offset[3], at[2];
    Row row;
    for (int64_t i = 0; i < c->s.m; i++) {
        const int64_t number = c->s.matches[i].dot;
        fill_row(&c->s, i, pose, &row);
        if (errors->alone)
            through_place(&row, errors->alone + 9 * number, row.print);
        weight_of(&row, OUTLIER_PX, c->weight + 3 * i);
        fill_columns(&c->s, i, &row, c->columns + 2 * c->k * i);
        on_plate(c, c->s.dots + number, offset, at);
        for (int a = 0; a < 2; a++) {
            c->low[a] = i ? fmin(c->low[a], at[a]) : at[a];
            c->high[a] = i ? fmax(c->high[a], at[a]) : at[a];
        }
    }
}

/* Tries a cause, and puts it in its place by what is left of chi2 for each degree of freedom, `by`, if it explains something;
   the last one falls out when all are taken. */
static void try_cause(Case *c, const Pose *pose, int32_t kind, int32_t plate, Verdict *verdict, double *by)
{
    const double freedom = (double)(verdict->freedom - FREE[kind].width);
    Cause cause = {kind, plate, 0, 0, 0};
    if (!(freedom > 0))
        return;
    const double left = adjusted(c, pose, &cause) / freedom, scale = fmax(1, left);
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
          const Pose *plates, int64_t plate_count, const Estimate *estimate, Verdict *verdict)
{
    const int64_t m = estimate->count;
    const int k = common_count(camera, errors), n = POSE + k + WIDTH;
    const Pose *pose = &estimate->pose;
    int64_t *seen = calloc((size_t)plate_count + 1, sizeof *seen), plates_seen = 0;
    double *memory = malloc(sizeof *memory * ((size_t)m * (size_t)(3 + 2 * k) + (size_t)(3 * n * n + 7 * n))), by[MOST_CAUSES];
    const int memoryless = !memory || !seen;
    memset(verdict, 0, sizeof *verdict);
    if (!memoryless) {
        Case c = {{dots, blobs, matches, m, camera, errors}, plates, {0}, {0}, CAUSES, -1, k, memory, memory + 3 * m,
                  memory + (3 + 2 * k) * m};
        Cause none = {CAUSES, -1, 0, 0, 0};
        prepare(&c, pose);
        verdict->freedom = 2 * m - POSE;
        verdict->chi2 = adjusted(&c, pose, &none);
        const double freedom = (double)verdict->freedom;
        verdict->limit = freedom > 0 ? fmax(chi2_point(freedom, RARE), USUAL * freedom) : INFINITY;
        verdict->consistent = verdict->chi2 <= verdict->limit;
        for (int64_t i = 0; i < m; i++)
            plates_seen += seen[dots[matches[i].dot].plate]++ == 0;
        const int single = plates_seen == 1;
        for (int32_t kind = 0; kind < MISPLACED && !verdict->consistent; kind++)
            if (!(single ? kind == STRETCH_Y : kind == BEND_X || kind == BEND_Y))
                try_cause(&c, pose, kind, -1, verdict, by);
        for (int32_t plate = 0; plate < plate_count && !single && !verdict->consistent; plate++)
            if (seen[plate] >= 3)
                try_cause(&c, pose, MISPLACED, plate, verdict, by);
        count_likely(verdict, by);
        if (!verdict->likely && !verdict->consistent) {
            try_cause(&c, pose, CAMERA_FILE, -1, verdict, by);
            if (single)
                try_cause(&c, pose, BENT, -1, verdict, by);
            count_likely(verdict, by);
        }
    }
    free(memory);
    free(seen);
    return memoryless ? NO_MEMORY : 0;
}

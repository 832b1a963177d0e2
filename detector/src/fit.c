/* Fit of dots' ellipses to the grey levels around their outlines.

   Model: light - (light - dark) (D - D_hole), with D the share of ink (`blurred_ellipse`) and levels of light and dark that
   each have a slope over the dot; saturated where the image is. Ellipse, levels, slopes and blur are unknown, and for a ring
   the hole's center and scale too: under perspective hole and outline are not concentric. Every pixel counts by its
   information, so the center's error is near the lower bound set by the image's noise.

   Parts of the outline without an edge, or with one elsewhere (an occluder, a touching neighbor), are found sector by sector
   and left out. A fifth of the outline may be missing; with more the fit is refused, since half an ellipse also fits other
   ellipses, with other centers. What is neither dark nor light in the middle is fitted as a disk and as a ring, and is a ring
   only if that is clearly better. */

#include "detector.h"

/* Unknowns p: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur; slopes of
   light and of dark (2 each), per px; center (2) of a ring's hole, and its size relative to the outline's. */
enum { LIGHT = 5, DARK = 6, BLUR = 7, SLOPES = 8, DISK = 12, HOLE = 12, SCALE = 14, COUNT = 15, WIDTH = 16 };
enum { BLOCK = 32, SECTORS = 16, SUMS = 8, NODES = 5 };

/* A fit ends when a step moves its center by less than the first: the next would be under a third of it, a tenth of the best
   standard deviation. Outlines that still take steps above the second at the end are not dots. Pixels and sectors are left
   out once the steps of center and blur are below the third, px, but not at the first step. */
static const double CONVERGED = 2e-3, SETTLED = 0.02, JUDGED = 0.1;
enum { UNJUDGED = 1 };
/* Maximum number of steps, and of times that a dot's pixels are chosen anew. */
enum { STEPS = 16, ROUNDS = 4 };
static const double LONGEST_STEP = 2, LONGEST_SCALE_STEP = 0.1;
/* Range of the blur in px, including the pixel's own area, which alone is 0.29. */
static const double LEAST_BLUR = 0.28, MOST_BLUR = 6;
/* Minimum semi-axis, px: with less than half a pixel's blur, a dot cannot be told from a line. */
static const double SHORTEST = 0.6;
/* Pixels that are off by more than this share of the contrast, this multiple of the noise, and this multiple of the standard
   deviation of the residual belong to something else. */
static const double OUTLIER_SHARE = 0.12, OUTLIER_SIGMA = 5, OUTLIER_SPREAD = 4;
/* Maximum number of sectors left out, counting neighbors of strange ones: half an ellipse also fits other ellipses. */
enum { MAX_LEFT_OUT = 5 };
static const double MAX_TRIMMED = 0.15;
/* Standard deviations of a hole's size about half of the ring's, and of a reflection's slope, relative to the light and in
   1/px, about none; as if measured at this noise per contrast. */
static const double SCALE_SIGMA = 0.05, SHINE_SIGMA = 0.003, PRIOR_NOISE = 0.02;

/* Curvature of the tips, in units of 1/blur, above which the expansion in it is too inaccurate. */
static const double SHARP = 0.1;
/* Blur, in px with the pixel's own area, below which that area's square shape matters; above it, the result differs from a
   Gaussian by at most 0.0013 of the contrast. */
static const double BOXED = 0.65;
/* Lower limits, px, for a pixel's width along the edge's normal and for a lens's blur: smaller values change nothing, and
   would divide zero by zero. */
static const double LEAST_SIDE = 0.02, LEAST_LENS = 0.05, TINY = 1e-12;
/* Of Gauss-Hermite quadrature. */
static const double NODE[NODES] = {-2.8569700138728056, -1.355626179974266, 0, 1.355626179974266, 2.8569700138728056};
static const double NODE_WEIGHT[NODES] = {0.011257411327720677, 0.22207592200561257, 0.5333333333333335, 0.22207592200561257,
                                          0.011257411327720677};

/* Maximum deviations of the edge in a sector: its shift in px, or in blurs if these exceed a px, plus a share of the longer
   semi-axis, for print and lens; its height as a share of the contrast; both plus a multiple of their error. */
static const double SHIFT_PX = 0.05, SHIFT_SHARE = 0.004, HEIGHT = 0.3, SIGMAS = 4;
/* Additional multiple if the opposite sector is off as well. */
static const double EVEN = 4;
/* Maximum share of the contrast by which the edge may be off all around: with more, covered dots fit, too. */
static const double MISFIT = 0.025;
/* Deviation of a sector without pixels, beyond the image's edge. */
static const double UNSEEN = 1e9;
/* Variance of rounding to whole grey levels: no image has less noise. */
static const double QUANTIZATION = 1. / 12;
/* Maximum number of pixels of a dot. Larger ones are subsampled by rows, to no fewer than the second. */
static const double ENOUGH = 20000, ROWS = 64;

/* Ratio to the noise of the plainest image areas, accepted and maximum: noise grows with the light. */
static const double NOISE_SLACK = 1.5, MOST_NOISE = 2;
/* Rows enough to see the noise, of which every 8th is read. */
enum { NOISE_ROWS = 240 };
/* Half-width of the band of fitted pixels around the outline: beyond it the levels are flat and carry no information, and the
   next dot may begin. */
static const double BAND_BLURS = 3, MIN_BAND = 2.5, MAX_BAND = 9;
/* Maximum RMS residual beyond the noise, and maximum noise, at the end, as shares of the contrast. Cameras that sharpen edges
   leave 0.08. */
static const double MAX_MISFIT = 0.12, MAX_NOISE = 0.2;
static const double MIN_MAJOR = 1, MAX_ELONGATION = 10, MAX_SIGMA = 0.5, HOLE_SCALES[2] = {0.15, 0.85};
/* Ratio of a slope squared to its variance above which the slope is the dot's own: one in 20,000 by chance. */
static const double OWN_SLOPE = 10;
/* Ratio of the sectors' shifts, squared, to what noise explains, above which the covariance grows by it. One dot in a hundred
   is above. */
static const double MUCH_UNEVEN = 2;
/* Maximum distances from the rough center, of all dots and of those twice as uneven as that, px plus a share of the longer
   semi-axis: what covers a dot, or a shadow's edge across it, can pull the fit off by more. */
static const double MAX_MOVE = 0.7, UNEVEN_MOVE = 0.15, MOVE_SHARE = 0.003;
/* Levels in the middle of certain disks, glossy ones included, and certain rings; number of blurs below which a shorter
   semi-axis tells a kind badly, whatever the level. */
static const double DISK_BELOW = 0.3, RING_ABOVE = 0.7, TOLD_BLURS = 3.5;
/* Standard deviation along each axis of the center of a dot whose fit is refused. */
static const double ROUGH_PX = 0.2;

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline double within(double a, double low, double high) { return a < low ? low : a > high ? high : a; }

/* ---- normal distribution ---- */

/* F and its density f at places a 16th apart from -8 on, 8 to either side. */
enum { PER_UNIT = 16, REACH = 8, ENTRIES = 2 * REACH * PER_UNIT + 1 };

typedef struct {
    double below[ENTRIES], density[ENTRIES];
} Normal;

static void tabulate(Normal *normal)
{
    for (int i = 0; i < ENTRIES; i++) {
        const double x = (double)i / PER_UNIT - REACH;
        normal->below[i] = erfc(-x * 0.70710678118654752440) / 2;
        normal->density[i] = exp(-x * x / 2) * 0.39894228040143267794;
    }
}

/* From the values at the nearest place by Taylor's series in the distance d < 1/32: within 1e-10. */
static inline double normal_at(const Normal *normal, double t, double *density)
{
    const double place = (t + REACH) * PER_UNIT;
    if (!(place > 0)) {
        *density = 0;
        return 0;
    }
    if (place >= ENTRIES - 1) {
        *density = 0;
        return 1;
    }
    const int i = (int)(place + 0.5);
    const double x = (double)i / PER_UNIT - REACH, d = t - x, xx = x * x;
    const double h2 = xx - 1, h3 = x * (xx - 3), h4 = xx * (xx - 6) + 3, h5 = x * (xx * (xx - 10) + 15);
    const double f = normal->density[i];
    *density = f * (1 + d * (-x + d * (h2 / 2 + d * (-h3 / 6 + d * (h4 / 24 - d * h5 / 120)))));
    return normal->below[i] + f * d * (1 + d * (-x / 2 + d * (h2 / 6 + d * (-h3 / 24 + d * (h4 / 120)))));
}

/* ---- grey levels of a blurred ellipse ---- */

typedef struct {
    double m11, m12, m22, blur, per_blur, flattest, bent;
    int sharp, boxed;
} Shape;

/* What `blurred_ellipse` returns for a block of pixels, and what it needs on the way: M x / rho, grad rho, its length, half the
   outline's curvature in blurs, depth in blurs and density there; the share of ink, and its derivatives by rho and blur. */
typedef struct {
    double u[BLOCK], v[BLOCK], gradient_x[BLOCK], gradient_y[BLOCK], steepness[BLOCK], inward[BLOCK], depth[BLOCK];
    double density[BLOCK], ink[BLOCK], by_rho[BLOCK], by_blur[BLOCK];
} Seen;

static Shape shape_of(double m11, double m12, double m22, double blur)
{
    const double trace = m11 + m22, apart = m11 - m22, determinant = m11 * m22 - m12 * m12;
    Shape s = {m11, m12, m22, blur, 1 / blur, determinant / trace, determinant * determinant * blur / 2, 0, 0};
    const double steepest = trace / 2 + sqrt(larger(apart * apart / 4 + m12 * m12, 0));
    /* a/b^2 from M's eigenvalues 1/a and 1/b, of which the second is the steepest. */
    s.sharp = blur * steepest * steepest * steepest > SHARP * determinant;
    s.boxed = blur < BOXED;
    return s;
}

/* The share of ink that a square pixel sees of a straight edge through a Gaussian blur, with its derivatives by depth and by
   blur^2. Along the normal n the square is two boxes, of widths |n_x| and |n_y|. Averaging over a box is the difference of an
   integral at its ends, so the share is the second difference of H over |n_x n_y|, where H'' = F(z/s) is the edge behind a
   lens of blur s: H = [(z^2 + s^2) F + z s f]/2, H' = z F + s f, f = F'. Without a lens, a Gaussian of the same variance is
   off by 0.06 of the contrast along rows and columns, and by 0.02 along diagonals. */
static inline void pixel_edge(const Normal *normal, double depth, double nx, double ny, double blur, double *ink,
                              double *slope, double *by_square)
{
    const double lens = sqrt(larger(blur * blur - 1. / 12, LEAST_LENS * LEAST_LENS));
    const double width = larger(fabs(nx), LEAST_SIDE), height = larger(fabs(ny), LEAST_SIDE);
    const double far = (width + height) / 2, near = (width - height) / 2;
    const double places[4] = {depth + far, depth - far, depth + near, depth - near};
    double a = 0, b = 0, c = 0;
    for (int k = 0; k < 4; k++) {
        double bell;
        const double z = places[k], step = normal_at(normal, z / lens, &bell), sign = k < 2 ? 1 : -1;
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

/* The blur over chords along the normal through points near (u, v) = M x: the share of ink. |p + t along| = 1 with p = (u, v) +
   node * beside: t in units of the blur. */
static double chords(const Normal *normal, const Shape *s, double u, double v, double nx, double ny)
{
    const double along_u = (s->m11 * nx + s->m12 * ny) * s->blur, along_v = (s->m12 * nx + s->m22 * ny) * s->blur;
    const double beside_u = (s->m12 * nx - s->m11 * ny) * s->blur, beside_v = (s->m22 * nx - s->m12 * ny) * s->blur;
    const double square = larger(along_u * along_u + along_v * along_v, TINY);
    const double slope0 = u * along_u + v * along_v, slope1 = beside_u * along_u + beside_v * along_v;
    const double level0 = u * u + v * v - 1, level1 = 2 * (u * beside_u + v * beside_v);
    const double level2 = beside_u * beside_u + beside_v * beside_v;
    double ink = 0, bell;
    for (int k = 0; k < NODES; k++) {
        const double slope = slope0 + NODE[k] * slope1;
        const double under = slope * slope - square * (level0 + NODE[k] * (level1 + NODE[k] * level2));
        if (under > 0) {
            const double root = sqrt(under);
            ink += NODE_WEIGHT[k] * (normal_at(normal, (root - slope) / square, &bell) -
                                     normal_at(normal, (-root - slope) / square, &bell));
        }
    }
    return ink;
}

/* The share of ink of an ellipse seen through a Gaussian blur, and its derivatives, of m pixels from `x` and `y` on.

   With rho = |M x| and F the normal distribution, the share is F(-e/s - k s/2): e is the distance from the outline to first
   order, (rho - 1)/|grad rho|, and k is the outline's curvature det(M)^2/|grad rho|^3, by which a blur s moves a convex edge
   inward. For sharp tips, a s > b^2/10 for semi-axes a > b, the blur is integrated instead: along the edge's normal in closed
   form, over the ellipse's chord, and along its tangent by quadrature. Both are within 0.001 of the contrast (RMS) for b > 4 s;
   at b = 2 s the quadrature is off by 0.01, where the expansion would be off by 0.03. Where the pixel is most of the blur, the
   difference between its square and a Gaussian at a straight edge is added. The derivatives neglect changes of |grad rho| and
   the curvature: these are of second order at the outline, and affect only the path to the solution.

   `tips`: what the quadrature adds to the expansion, evaluated if `fresh`: it takes several times as long as all else, and
   changes little between the last steps of a fit. One loop for each part: the processor works on several pixels at a time. */
static inline void blurred_ellipse(const Normal *normal, const Shape *s, const double *x, const double *y,
                                   const double *center, int m, int fresh, double *tips, Seen *seen)
{
    for (int i = 0; i < m; i++) {
        const double dx = x[i] - center[0], dy = y[i] - center[1];
        const double u0 = s->m11 * dx + s->m12 * dy, v0 = s->m12 * dx + s->m22 * dy;
        const double rho = larger(sqrt(u0 * u0 + v0 * v0), TINY), per_rho = 1 / rho, u = u0 * per_rho, v = v0 * per_rho;
        const double gradient_x = s->m11 * u + s->m12 * v, gradient_y = s->m12 * u + s->m22 * v;
        /* At the center itself rho has no direction; |grad rho| is at least the smaller eigenvalue everywhere. */
        const double steepness = larger(sqrt(gradient_x * gradient_x + gradient_y * gradient_y), s->flattest);
        /* Curvatures above 1/s, at the tips of thin ellipses, are out of the expansion's range. */
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
        seen->ink[i] = normal_at(normal, seen->depth[i], seen->density + i);
    for (int i = 0; i < m; i++) {
        seen->by_rho[i] = -seen->density[i] / seen->steepness[i] * s->per_blur;
        seen->by_blur[i] = -seen->density[i] * (seen->depth[i] + 2 * seen->inward[i]) * s->per_blur;
    }
    if (fresh)
        for (int i = 0; i < m; i++) {
            const double dx = x[i] - center[0], dy = y[i] - center[1], flat = 1 / seen->steepness[i];
            tips[i] = s->sharp ? chords(normal, s, s->m11 * dx + s->m12 * dy, s->m12 * dx + s->m22 * dy,
                                        seen->gradient_x[i] * flat, seen->gradient_y[i] * flat) -
                                     seen->ink[i]
                               : 0;
        }
    if (s->boxed)
        for (int i = 0; i < m; i++) {
            const double flat = 1 / seen->steepness[i];
            double slope, by_square;
            pixel_edge(normal, seen->depth[i] * s->blur, seen->gradient_x[i] * flat, seen->gradient_y[i] * flat, s->blur,
                       seen->ink + i, &slope, &by_square);
            seen->by_rho[i] = -slope * flat;
            seen->by_blur[i] = 2 * s->blur * by_square - 2 * seen->inward[i] * slope;
        }
    for (int i = 0; i < m; i++)
        seen->ink[i] += tips[i];
}

/* ---- pixels ---- */

/* A dot that is being fitted, its pixels, and what the last evaluation of the model gave. `sums` of each sector, which
   `strangeness` takes, are of 1, slope^2, slope r, r, model, model^2, model r and r^2 over its pixels; in the third and the
   last, r is clipped at half the contrast. */
typedef struct {
    int64_t count, room;
    double *x, *y, *grey, *residual, *tips, *other_tips, *scratch;
    uint8_t *weight, *silent, *sector;
    double p[COUNT], origin[2], size[2], step, blur_step; /* the longer semi-axis first */
    double normal[COUNT][COUNT], gradient[COUNT], sums[SECTORS][SUMS];
    int ring, alive, left_out[SECTORS];
    double image_noise, saturation, unlit;
    Normal table;
} Descent;

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

static int make_room(Descent *dot, int64_t room)
{
    if (room <= dot->room)
        return 0;
    double **doubles[] = {&dot->x, &dot->y, &dot->grey, &dot->residual, &dot->tips, &dot->other_tips, &dot->scratch};
    uint8_t **bytes[] = {&dot->weight, &dot->silent, &dot->sector};
    dot->room = 0;
    for (int k = 0; k < 7; k++) {
        free(*doubles[k]);
        if (!(*doubles[k] = malloc((size_t)room * sizeof(double))))
            return NO_MEMORY;
    }
    for (int k = 0; k < 3; k++) {
        free(*bytes[k]);
        if (!(*bytes[k] = malloc((size_t)room)))
            return NO_MEMORY;
    }
    dot->room = room;
    return 0;
}

/* Collects the pixels within a distance of the outline, row by row, and those inside if it is `filled`. */
static int collect(Descent *dot, const Image *image, const Blob *blob, double band, int filled)
{
    const double pi = 3.14159265358979323846, center_x = blob->center[0], center_y = blob->center[1];
    const double a = blob->semi[0] + band, b = blob->semi[1] + band;
    const double c = larger(blob->semi[0] - band, 1e-3), d = larger(blob->semi[1] - band, 1e-3);
    const int hollow = blob->semi[1] > band + 1 && !filled;
    const double highest = image->inverted ? image->wide ? UINT16_MAX : UINT8_MAX : 0, sign = image->inverted ? -1 : 1;
    dot->count = 0;
    /* Rows and columns of what is no ellipse, or of a huge one, would be no whole numbers. */
    if (!(fabs(center_x) < 1e9 && fabs(center_y) < 1e9 && a > 1e-3 && a < 1e9 && b > 1e-3 && b < 1e9 &&
          fabs(blob->angle) < 1e9 && band >= 0))
        return make_room(dot, 1);
    const RowForm outer = row_form(a, b, blob->angle), inner = row_form(c, d, blob->angle);
    const int64_t top = (int64_t)within(ceil(center_y - outer.reach), 0, (double)image->height);
    const int64_t bottom = (int64_t)within(floor(center_y + outer.reach), -1, (double)(image->height - 1));
    const double area = pi * (a * b - (hollow ? c * d : 0));
    const double thinned = smaller(area / ENOUGH, (double)(bottom - top) / ROWS);
    const int64_t every = thinned < 1 ? 1 : (int64_t)thinned;
    const int64_t rows = bottom < top ? 0 : (bottom - top) / every + 1;
    const int64_t longest = (int64_t)smaller(2 * outer.half + 4, (double)(image->width + 4));

    if (make_room(dot, rows * longest + 1))
        return NO_MEMORY;
    for (int64_t y = top; y <= bottom; y += every) {
        const double up = (double)y - center_y, half = half_length(outer, up);
        const double hole = hollow ? half_length(inner, up) : 0;
        const double middle = center_x + outer.shear * up, hole_middle = center_x + inner.shear * up;
        const double leave = hole > 0 ? floor(hole_middle - hole) : floor(middle);
        const double enter = hole > 0 ? larger(ceil(hole_middle + hole), leave + 1) : floor(middle) + 1;
        const double ends[2][2] = {{ceil(middle - half), leave}, {enter, floor(middle + half)}};
        for (int k = 0; k < 2; k++) {
            const int64_t first = (int64_t)larger(ends[k][0], 0);
            const int64_t last = (int64_t)smaller(ends[k][1], (double)(image->width - 1));
            for (int64_t x = first; x <= last; x++) {
                const uint8_t *at = image->rows + y * image->stride + x * (image->wide ? 2 : 1);
                uint16_t level = *at;
                if (image->wide)
                    memcpy(&level, at, 2);
                dot->x[dot->count] = (double)x;
                dot->y[dot->count] = (double)y;
                dot->grey[dot->count++] = highest + sign * level - dot->unlit;
            }
        }
    }
    return 0;
}

/* Of 16 around the center, from x toward y, in coordinates in which the outline is a circle. */
static int sector_of(double u, double v)
{
    const double eighth = 0.41421356237309503, across = fabs(u), down = fabs(v);
    int turn = (down > eighth * across) + (down > across) + (eighth * down > across);
    turn = u < 0 ? SECTORS / 2 - 1 - turn : turn;
    return v < 0 ? SECTORS - 1 - turn : turn;
}

/* Standard deviation of the residual's white part, from the median of neighbors' differences: misfit, which is smooth, and
   foreign pixels, which are few, hardly count. In a small dot, all pixels are near an edge, and a misfit looks like noise: at
   most that of the image. */
static double noise_of(Descent *dot)
{
    int64_t count = 0;
    for (int64_t i = 0; i + 1 < dot->count; i++)
        if (dot->x[i + 1] - dot->x[i] == 1)
            dot->scratch[count++] = fabs(dot->residual[i + 1] - dot->residual[i]);
    /* The median of |N(0, 1)| is 0.6745, and a difference has twice the variance. */
    const double white = order_statistic(dot->scratch, count, count / 2) / (0.6745 * sqrt(2.0));
    return smaller(larger(white, sqrt(QUANTIZATION)), dot->image_noise);
}

/* Of the pixels that count, at least that of rounding; saturated pixels show no noise. */
static double variance_of(const Descent *dot)
{
    double squares = 0, used = 0;
    for (int64_t i = 0; i < dot->count; i++)
        if (dot->weight[i] && !dot->silent[i]) {
            squares += dot->residual[i] * dot->residual[i];
            used++;
        }
    return larger(squares / larger(used - (dot->ring ? COUNT : DISK), 1), QUANTIZATION);
}

/* The deviation of the edge's place and height from the fit, sector by sector; 1 is the maximum allowed. An edge moved outward
   by d adds -d times its slope to the grey levels, so d follows from the residual by least squares; likewise the edge's height,
   relative to the model's. */
static void strangeness(const Descent *dot, double noise, double *strange)
{
    double shift[SECTORS], square[SECTORS];
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k];
        shift[k] = sums[2] / larger(sums[1], TINY);
        square[k] = sums[7] / larger(sums[0], 1);
        for (int i = k; i > 0 && square[i] < square[i - 1]; i--) {
            const double swapped = square[i];
            square[i] = square[i - 1];
            square[i - 1] = swapped;
        }
    }
    /* Edges that the camera sharpened are off all around: a quarter of the sectors tells by how much. */
    noise = larger(noise, smaller(sqrt(square[SECTORS / 4 - 1]), MISFIT * (dot->p[LIGHT] - dot->p[DARK])));
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k], information = larger(sums[1], TINY), size = fabs(shift[k]);
        /* Blur other than the model's moves opposite edges alike, and does not move the center. */
        const double across = shift[(k + SECTORS / 2) % SECTORS], sign = (shift[k] > 0) - (shift[k] < 0);
        const double opposite = larger(sign * across, 0), uneven = larger(size - opposite, size / EVEN);
        const double allowed = SHIFT_PX * larger(1, dot->p[BLUR]) + SHIFT_SHARE * dot->size[0];
        const double mean = sums[4] / larger(sums[0], 1), power = larger(sums[5] - mean * sums[4], TINY);
        const double height = (sums[6] - mean * sums[3]) / power;
        strange[k] = larger(uneven / (allowed + SIGMAS * noise / sqrt(information)),
                            fabs(height) / (HEIGHT + SIGMAS * noise / sqrt(power)));
        if (!(sums[0] > 0))
            strange[k] = UNSEEN;
    }
}

/* ---- descent ---- */

/* Sum and difference of M's eigenvalues. */
static void eigenvalues(const double *p, double *trace, double *root)
{
    const double apart = p[2] - p[4];
    *trace = p[2] + p[4];
    *root = sqrt(apart * apart + 4 * p[3] * p[3]);
}

/* Adds j'j of m pixels; j has the derivatives, then the residual, then zeros. */
static inline void add_products(double (*total)[WIDTH], double (*j)[WIDTH], int m, int rows)
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

/* Residuals, normal matrix J'J and gradient J'r of the pixels that count. */
static void evaluate(Descent *dot, int fresh)
{
    const double *p = dot->p, half = 0.5 * (p[LIGHT] - p[DARK]), scale = p[SCALE];
    const int n = dot->ring ? COUNT : DISK;
    const Shape outer = shape_of(p[2], p[3], p[4], p[BLUR]);
    const Shape inner = shape_of(p[2] / scale, p[3] / scale, p[4] / scale, p[BLUR]);
    double total[COUNT][WIDTH] = {{0}}, block[BLOCK][WIDTH] = {{0}};
    Seen seen, hole;
    memset(dot->sums, 0, sizeof dot->sums);
    for (int64_t from = 0; from < dot->count; from += BLOCK) {
        const int m = dot->count - from < BLOCK ? (int)(dot->count - from) : BLOCK;
        const double *x = dot->x + from, *y = dot->y + from;
        blurred_ellipse(&dot->table, &outer, x, y, p, m, fresh, dot->tips + from, &seen);
        if (dot->ring)
            blurred_ellipse(&dot->table, &inner, x, y, p + HOLE, m, fresh, dot->other_tips + from, &hole);
        for (int i = 0; i < m; i++) {
            const double across = x[i] - dot->origin[0], down = y[i] - dot->origin[1], dx = x[i] - p[0], dy = y[i] - p[1];
            const double light = p[LIGHT] + p[SLOPES] * across + p[SLOPES + 1] * down;
            const double contrast = light - (p[DARK] + p[SLOPES + 2] * across + p[SLOPES + 3] * down);
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
                /* d rho/d scale = -rho/scale, and rho = x'grad rho. */
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
            j[SLOPES] = (1 - ink) * across;
            j[SLOPES + 1] = (1 - ink) * down;
            j[SLOPES + 2] = ink * across;
            j[SLOPES + 3] = ink * down;
            j[n] = residual;
            /* A neighbor's edge in the band, or a speck, is no information about this dot. */
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

/* Factors of the slopes of light and dark in what illumination does not explain, 1/px: that changes light and dark by the same
   factor, a reflection by the same amount. (light x slope of dark - dark x slope of light)/norm, relative to the greater
   level. */
static void shine(const double *p, double *factor)
{
    const double norm = sqrt(p[LIGHT] * p[LIGHT] + p[DARK] * p[DARK]) * larger(fabs(p[LIGHT]), fabs(p[DARK]));
    factor[0] = -p[DARK] / norm;
    factor[1] = p[LIGHT] / norm;
}

/* The normal matrix with its priors, scaled to a diagonal of ones and with a ridge of rounding's size, without which those of
   outlines that are not ellipses were singular; the gradient with them, and the scale. */
static void equations(const Descent *dot, double ridge, double (*a)[COUNT], double *gradient, double *scale)
{
    const double *p = dot->p, contrast = p[LIGHT] - p[DARK];
    const double of_scale = dot->ring ? PRIOR_NOISE / SCALE_SIGMA * contrast : 0;
    const double of_shine = PRIOR_NOISE / SHINE_SIGMA * contrast, prior = of_scale * of_scale, weight = of_shine * of_shine;
    double factor[2];
    memcpy(a, dot->normal, sizeof dot->normal);
    memcpy(gradient, dot->gradient, sizeof dot->gradient);
    /* A disk has no hole to move. If the blur is as wide as a ring's ink, a darker and thinner ring looks the same: a half is
       the usual size. */
    for (int r = DISK; r < COUNT; r++)
        a[r][r] += !dot->ring;
    a[SCALE][SCALE] += prior;
    gradient[SCALE] += prior * (0.5 - p[SCALE]);
    /* In small dots hardly anything is all dark. */
    shine(p, factor);
    for (int r = SLOPES; r < SLOPES + 2; r++) {
        const double beyond = factor[0] * p[r] + factor[1] * p[r + 2];
        a[r][r] += weight * factor[0] * factor[0];
        a[r + 2][r] += weight * factor[0] * factor[1];
        a[r + 2][r + 2] += weight * factor[1] * factor[1];
        gradient[r] -= weight * factor[0] * beyond;
        gradient[r + 2] -= weight * factor[1] * beyond;
    }
    for (int r = 0; r < COUNT; r++)
        scale[r] = 1 / sqrt(larger(a[r][r], 1e-12));
    for (int r = 0; r < COUNT; r++)
        for (int c = 0; c <= r; c++)
            a[r][c] = a[r][c] * (scale[r] * scale[c]) + (r == c ? ridge : 0);
}

/* Takes a step, within limits. */
static void move(Descent *dot)
{
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
        p[r] = dot->p[r] + within(step[r], -LONGEST_STEP, LONGEST_STEP);
    p[BLUR] = within(p[BLUR], dot->p[BLUR] / 2, dot->p[BLUR] * 2);
    p[BLUR] = within(p[BLUR], LEAST_BLUR, MOST_BLUR);
    p[SCALE] = dot->p[SCALE] + within(step[SCALE], -LONGEST_SCALE_STEP, LONGEST_SCALE_STEP);
    p[SCALE] = within(p[SCALE], 0.1, 0.9);
    dot->blur_step = fabs(p[BLUR] - dot->p[BLUR]);
    eigenvalues(p, &trace, &root);
    sane = sane && trace - root > 0.6 / dot->size[0] && trace < 2 / SHORTEST && p[LIGHT] > p[DARK];
    for (int r = 0; r < 2; r++)
        sane = sane && fabs(p[r] - dot->origin[r]) < dot->size[1] + 1;
    if (sane)
        memcpy(dot->p, p, sizeof p);
    else
        dot->alive = 0;
}

static int sectors_left_out(const Descent *dot)
{
    int count = 0;
    for (int k = 0; k < SECTORS; k++)
        count += dot->left_out[k];
    return count;
}

/* Gives zero weight to foreign pixels and sectors; returns whether this changed anything. */
static int leave_out(Descent *dot)
{
    const double noise = noise_of(dot), contrast = dot->p[LIGHT] - dot->p[DARK];
    double strange[SECTORS], worst = 0;
    int bad[SECTORS], changed = 0;
    strangeness(dot, noise, strange);
    /* Foreign edges distort the fit, and so make other sectors look strange: the worst go first. */
    for (int k = 0; k < SECTORS; k++)
        if (!dot->left_out[k])
            worst = larger(worst, strange[k]);
    for (int k = 0; k < SECTORS; k++)
        bad[k] = strange[k] > larger(1, worst / 2);
    /* An occluder's edge rarely ends at a sector's limit. */
    for (int k = 0; k < SECTORS; k++)
        dot->left_out[k] |= bad[k] || bad[(k + 1) % SECTORS] || bad[(k + SECTORS - 1) % SECTORS];
    /* If the blur differs from the model's, many pixels are off by a little, which is harmless. */
    double limit = larger(OUTLIER_SHARE * contrast, OUTLIER_SIGMA * noise);
    limit = larger(limit, OUTLIER_SPREAD * sqrt(variance_of(dot)));
    for (int64_t i = 0; i < dot->count; i++) {
        const uint8_t kept = fabs(dot->residual[i]) < limit && !dot->left_out[dot->sector[i]];
        changed |= kept != dot->weight[i];
        dot->weight[i] = kept;
    }
    if (sectors_left_out(dot) > MAX_LEFT_OUT)
        dot->alive = 0;
    return changed;
}

static void descend(Descent *dot)
{
    int rounds = 0;
    for (int step = 0; step < STEPS && dot->alive; step++) {
        int changed = 0;
        const int calm = dot->step < JUDGED && dot->blur_step < JUDGED && step >= UNJUDGED;
        /* The shape of the tips is computed anew at steps 0, 2, 5... */
        evaluate(dot, step == 0 || step % 3 == 2);
        if (calm && rounds < ROUNDS)
            changed = leave_out(dot);
        rounds += changed;
        /* The equations of one whose pixels changed are not of these pixels. */
        if (!changed && dot->alive)
            move(dot);
        if (!changed && calm && !(dot->step > CONVERGED))
            return;
    }
}

/* ---- verdict ---- */

/* Result of a fit: unknowns, the part of the covariance of all unknowns that the slopes' priors need, twice the negative
   log-likelihood of all pixels, up to a constant that all fits to the same pixels share; chi2 of the sectors' shifts over its
   degrees of freedom, 1 for a good fit; chi2 of the differences between opposite sectors' shifts, and their number. */
typedef struct {
    int64_t blob;
    double p[COUNT], by_slopes[COUNT][4], centers[3], misfit, uneven, odd, pairs, hole;
    int ring, good, tried;
} Fit;

static int is_complete(const Descent *dot, double noise)
{
    double strange[SECTORS];
    int64_t trimmed = 0;
    for (int64_t i = 0; i < dot->count; i++)
        trimmed += !dot->weight[i] && !dot->left_out[dot->sector[i]];
    if (!dot->alive || !(dot->step < SETTLED) || (double)trimmed > MAX_TRIMMED * (double)dot->count)
        return 0;
    strangeness(dot, noise, strange);
    for (int k = 0; k < SECTORS; k++)
        if (!(strange[k] <= 1) && !dot->left_out[k])
            return 0;
    return 1;
}

static void compare_sectors(const Descent *dot, double variance, Fit *fit)
{
    double sum = 0, squares = 0;
    fit->odd = fit->pairs = 0;
    for (int k = 0; k < SECTORS; k++) {
        const int l = (k + SECTORS / 2) % SECTORS;
        const double *own = dot->sums[k], *other = dot->sums[l];
        const double information = larger(own[1], TINY), opposite = larger(other[1], TINY);
        const double shift = own[2] / information, apart = shift - other[2] / opposite;
        squares += own[7];
        if (dot->left_out[k])
            continue;
        sum += information * shift * shift;
        if (k < l && !dot->left_out[l]) {
            fit->odd += apart * apart / (1 / information + 1 / opposite) / variance;
            fit->pairs++;
        }
    }
    /* An ellipse takes five of the shifts. */
    fit->uneven = sum / variance / larger(SECTORS - 5 - sectors_left_out(dot), 1);
    fit->misfit = (double)dot->count * log(larger(squares / larger((double)dot->count, 1), TINY));
}

/* Columns of the slopes, and of the center's rows, in the unknowns' covariance. */
static void covariances(const Descent *dot, double variance, Fit *fit)
{
    double a[COUNT][COUNT], gradient[COUNT], scale[COUNT], columns[6][COUNT] = {{0}};
    const int unknown[6] = {0, 1, SLOPES, SLOPES + 1, SLOPES + 2, SLOPES + 3};
    equations(dot, 1e-12, a, gradient, scale);
    for (int c = 0; c < 6; c++)
        columns[c][unknown[c]] = 1;
    solve_positive(COUNT, a[0], columns[0], 6, 1e-14);
    for (int c = 0; c < 6; c++)
        for (int r = 0; r < COUNT; r++)
            columns[c][r] *= variance * scale[r] * scale[unknown[c]];
    for (int c = 0; c < 4; c++)
        for (int r = 0; r < COUNT; r++)
            fit->by_slopes[r][c] = columns[2 + c][r];
    fit->centers[0] = columns[0][0];
    fit->centers[1] = columns[0][1];
    fit->centers[2] = columns[1][1];
}

/* Fits a blob as a ring or disk: 1 if it has the outline of a dot nearly all around, near the rough one, else 0. */
static int fit_blob(Descent *dot, const Image *image, const Blob *blob, int ring, int filled, Fit *fit)
{
    const double cosine = cos(blob->angle), sine = sin(blob->angle), a = 1 / blob->semi[0], b = 1 / blob->semi[1];
    double *p = dot->p, trace, root;
    memset(p, 0, sizeof dot->p);
    p[0] = p[HOLE] = dot->origin[0] = blob->center[0];
    p[1] = p[HOLE + 1] = dot->origin[1] = blob->center[1];
    p[2] = a * cosine * cosine + b * sine * sine;
    p[3] = (a - b) * cosine * sine;
    p[4] = a * sine * sine + b * cosine * cosine;
    /* Of small dots, whose middle is blurred, the rough levels are a guess. */
    p[LIGHT] = blob->light - dot->unlit;
    p[DARK] = larger(blob->dark, 0) - dot->unlit;
    p[BLUR] = within(blob->blur, 0.5, smaller(0.5 + blob->semi[1] / 3, MOST_BLUR));
    p[SCALE] = 0.5;
    dot->size[0] = blob->semi[0];
    dot->size[1] = blob->semi[1];
    dot->ring = ring;
    dot->alive = 1;
    dot->step = dot->blur_step = INFINITY;
    memset(dot->left_out, 0, sizeof dot->left_out);
    if (collect(dot, image, blob, within(BAND_BLURS * blob->blur, MIN_BAND, MAX_BAND), filled))
        return NO_MEMORY;
    memset(dot->weight, 1, (size_t)dot->count);
    descend(dot);

    const double variance = variance_of(dot), noise = noise_of(dot), contrast = p[LIGHT] - p[DARK];
    const double slack = NOISE_SLACK * noise, misfit = MAX_MISFIT * contrast;
    const double moved = hypot(p[0] - blob->center[0], p[1] - blob->center[1]);
    memcpy(fit->p, p, sizeof fit->p);
    fit->ring = ring;
    compare_sectors(dot, variance, fit);
    eigenvalues(p, &trace, &root);
    if (!is_complete(dot, noise) || !(noise < MAX_NOISE * contrast) || !(variance < slack * slack + misfit * misfit) ||
        !(trace - root < 2 / MIN_MAJOR && trace + root < 2 / SHORTEST && trace + root < MAX_ELONGATION * (trace - root)) ||
        !(moved < (fit->uneven > 2 * MUCH_UNEVEN ? UNEVEN_MOVE : MAX_MOVE) + MOVE_SHARE * blob->semi[0]) ||
        (ring && !(p[SCALE] > HOLE_SCALES[0] && p[SCALE] < HOLE_SCALES[1])))
        return 0;
    covariances(dot, variance, fit);
    return 1;
}

/* ---- slopes of the light ---- */

/* The slopes' measure (4, 4): of the illumination along x and y, and of a reflection. */
static void measure_of(const double *p, double (*measure)[4])
{
    const double square = p[LIGHT] * p[LIGHT] + p[DARK] * p[DARK];
    double factor[2];
    shine(p, factor);
    for (int r = 0; r < 2; r++)
        for (int k = 0; k < 2; k++) {
            measure[r][r + 2 * k] = p[LIGHT + k] / square;
            measure[r][1 - r + 2 * k] = 0;
            measure[2 + r][r + 2 * k] = factor[k];
            measure[2 + r][1 - r + 2 * k] = 0;
        }
}

/* What a fit says of the slopes: their measure, its values and their covariance. */
typedef struct {
    double measure[4][4], slope[4], errors[4][4];
} Slopes;

static void slopes_of(const Fit *fit, Slopes *s)
{
    measure_of(fit->p, s->measure);
    for (int i = 0; i < 4; i++) {
        double row[4];
        s->slope[i] = 0;
        for (int k = 0; k < 4; k++) {
            s->slope[i] += s->measure[i][k] * fit->p[SLOPES + k];
            row[k] = 0;
            for (int l = 0; l < 4; l++)
                row[k] += s->measure[i][l] * fit->by_slopes[SLOPES + l][k];
        }
        for (int j = 0; j < 4; j++) {
            s->errors[i][j] = 0;
            for (int k = 0; k < 4; k++)
                s->errors[i][j] += row[k] * s->measure[j][k];
        }
    }
}

/* Shrinks the slopes of the light to zero: moves the unknowns, and gives the centers' covariance.

   Free slopes cost a third of the center's information and more; without them, uneven light displaces the center. So the slope
   of the illumination and that of a reflection have normal priors about zero, each with the variance of all such slopes of the
   image beyond their own errors (DerSimonian and Laird's estimate, for the reflection less its standard error): none in even
   light, as much as needed in other light. */
static void shrink_slopes(Fit *fits, int64_t count)
{
    double shared[2], freedom = 0, odd = 0;
    for (int part = 0; part < 2; part++) {
        const double slack = part ? 1 / sqrt((double)count) : 0;
        double sum = 0, weights = 0;
        for (int64_t i = 0; i < count; i++) {
            Slopes s;
            slopes_of(fits + i, &s);
            const double *slope = s.slope + 2 * part, own = (s.errors[2 * part][2 * part] + s.errors[2 * part + 1][2 * part + 1]) / 2;
            const double least = larger(own, 1e-15), square = (slope[0] * slope[0] + slope[1] * slope[1]) / 2;
            sum += (square - (1 + slack) * own) / (least * least);
            weights += 1 / (least * least);
        }
        shared[part] = sum / weights;
    }
    for (int64_t i = 0; i < count; i++) {
        freedom += fits[i].pairs - 2;
        odd += fits[i].odd;
    }
    /* Only what moves opposite edges the same way moves a center, and it takes two of the differences. Where another blur than
       the model's makes the residuals, it is less than these say: by the upper limit of its estimate from all. */
    const double even = freedom > 0 ? smaller(1, odd / freedom * (1 + sqrt(2 / freedom))) : 1;
    for (int64_t i = 0; i < count; i++) {
        Fit *fit = fits + i;
        Slopes s;
        slopes_of(fit, &s);
        for (int part = 0; part < 2; part++) {
            const double *slope = s.slope + 2 * part, own = (s.errors[2 * part][2 * part] + s.errors[2 * part + 1][2 * part + 1]) / 2;
            /* A dot's own may be beyond doubt, as at the edge of a shadow. */
            const double beyond = (slope[0] * slope[0] + slope[1] * slope[1]) / 2 - OWN_SLOPE * own;
            for (int r = 2 * part; r < 2 * part + 2; r++)
                s.errors[r][r] += larger(larger(shared[part], beyond), 1e-12);
        }
        /* The gain of a measurement of all of these as zero, with these variances, times slopes and center. */
        double columns[3][4], crossed[COUNT][4], centers[2][2];
        for (int r = 0; r < COUNT; r++)
            for (int j = 0; j < 4; j++) {
                crossed[r][j] = 0;
                for (int k = 0; k < 4; k++)
                    crossed[r][j] += fit->by_slopes[r][k] * s.measure[j][k];
            }
        memcpy(columns[0], s.slope, sizeof columns[0]);
        memcpy(columns[1], crossed[0], 2 * sizeof columns[0]);
        solve_positive(4, s.errors[0], columns[0], 3, 1e-300);
        for (int r = 0; r < COUNT; r++)
            for (int j = 0; j < 4; j++)
                fit->p[r] -= crossed[r][j] * columns[0][j];
        const double factor = fit->uneven > MUCH_UNEVEN ? fit->uneven : even;
        for (int r = 0; r < 2; r++)
            for (int c = 0; c < 2; c++) {
                centers[r][c] = fit->centers[r + c];
                for (int j = 0; j < 4; j++)
                    centers[r][c] -= crossed[r][j] * columns[1 + c][j];
            }
        fit->centers[0] = factor * centers[0][0];
        fit->centers[1] = factor * (centers[0][1] + centers[1][0]) / 2;
        fit->centers[2] = factor * centers[1][1];
    }
}

/* How much tells for a kind: the likelihood of its fit, of which a fifth counts since residuals of neighbors are alike, and
   its blur, which all dots of one lens have but for 6 %: behind a blur as wide as a ring's ink, a disk with another blur looks
   the same. By fits alone, one of 24 blurred markers had its ring elsewhere. */
static double kind_told(const Fit *fit, double blur)
{
    if (!fit->good)
        return fit->tried ? -4 - 0.5 * 25 : -1e6;
    const double away = blur > 0 ? (fit->p[BLUR] - blur) / (0.06 * blur) : 0;
    return -0.1 * fit->misfit - 0.5 * (away * away < 25 ? away * away : 25);
}

/* The blur that most fits agree with, of one kind or the other for each dot; 0 for fewer than three dots. */
static double common_blur(const Fit *fits, int64_t count)
{
    double best = 0, most = -INFINITY;
    for (int64_t k = 0; k < 2 * count && count > 2; k++) {
        if (!fits[k].good)
            continue;
        double sum = 0;
        for (int64_t i = 0; i < count; i++) {
            const double disk = kind_told(fits + 2 * i, fits[k].p[BLUR]), ring = kind_told(fits + 2 * i + 1, fits[k].p[BLUR]);
            if (fits[2 * i].good || fits[2 * i + 1].good)
                sum += disk > ring ? disk : ring;
        }
        if (sum > most) {
            most = sum;
            best = fits[k].p[BLUR];
        }
    }
    return best;
}

static void take_fit(const Fit *fit, double unlit, Blob *blob)
{
    const double *p = fit->p;
    double trace, root;
    eigenvalues(p, &trace, &root);
    memcpy(blob->center, p, sizeof blob->center);
    /* M's smaller eigenvalue belongs to the longer axis. */
    blob->semi[0] = 2 / (trace - root);
    blob->semi[1] = 2 / (trace + root);
    blob->angle = 0.5 * atan2(-2 * p[3], p[4] - p[2]);
    memcpy(blob->covariance, fit->centers, sizeof blob->covariance);
    blob->light = p[LIGHT] + unlit;
    blob->dark = p[DARK] + unlit;
    blob->blur = p[BLUR];
    blob->hole = fit->hole;
    blob->state = FITTED;
}

static void refuse(Blob *blob)
{
    const double variance = larger((blob->covariance[0] + blob->covariance[2]) / 2, ROUGH_PX * ROUGH_PX);
    blob->covariance[0] = blob->covariance[2] = variance;
    blob->covariance[1] = 0;
    blob->state = REFUSED;
}

/* Grey level above which the image shows none: its highest one if that is the highest of so many bits. */
static double saturation_of(const Image *image)
{
    int highest = UINT8_MAX;
    if (image->wide) {
        highest = 0;
        for (int64_t y = 0; y < image->height; y++)
            for (int64_t x = 0; x < image->width; x++) {
                uint16_t level;
                memcpy(&level, image->rows + y * image->stride + 2 * x, 2);
                level = (uint16_t)(image->inverted ? UINT16_MAX - level : level);
                highest = level > highest ? level : highest;
            }
    }
    return highest >= UINT8_MAX && !(highest & (highest + 1)) ? (double)highest : (double)INFINITY;
}

int fit_blobs(const Image *image, Blob *blobs, const int64_t *which, int64_t count)
{
    if (!count)
        return 0;
    const int64_t by_rows = image->height / NOISE_ROWS, every = by_rows > 1 ? by_rows : 1;
    Image thinned = *image;
    thinned.height = (image->height + every - 1) / every;
    thinned.stride *= every;
    const double plain = grey_noise(&thinned);
    Fit *fits = malloc(2 * sizeof *fits * (size_t)count);
    Descent *dot = calloc(1, sizeof *dot);
    int64_t good = 0;
    int status = fits && dot && plain >= 0 ? 0 : NO_MEMORY;
    if (!status) {
        /* The light scales what is reflected: an inverted image is reckoned from its highest level. */
        dot->unlit = image->inverted ? image->wide ? UINT16_MAX : UINT8_MAX : 0;
        dot->saturation = saturation_of(image) - dot->unlit;
        dot->image_noise = larger(MOST_NOISE * plain + 0.5, sqrt(QUANTIZATION));
        tabulate(&dot->table);
    }
    for (int64_t i = 0; i < count && status >= 0; i++) {
        const Blob *blob = blobs + which[i];
        const int own = blob->hole > 0.5;
        const int doubtful = (blob->hole > DISK_BELOW && blob->hole < RING_ABOVE) || blob->semi[1] < TOLD_BLURS * blob->blur;
        /* Both kinds are fitted to the same pixels. */
        for (int ring = 0; ring < 2 && status >= 0; ring++) {
            Fit *fit = fits + 2 * i + ring;
            fit->good = 0;
            fit->tried = ring == own || doubtful;
            if (fit->tried) {
                status = fit_blob(dot, image, blob, ring, ring || doubtful, fit);
                fit->good = status > 0;
            }
        }
    }
    const double blur = status < 0 ? 0 : common_blur(fits, count);
    for (int64_t i = 0; i < count && status >= 0; i++) {
        const Fit *disk = fits + 2 * i, *ring = disk + 1;
        const double rough = 8 * (blobs[which[i]].hole - 0.5);
        const double told = disk->tried && ring->tried ? kind_told(ring, blur) - kind_told(disk, blur) : rough;
        Fit chosen = ring->good && (told > 0 || !disk->good) ? *ring : *disk;
        if (!chosen.good)
            continue;
        chosen.blob = which[i];
        chosen.hole = 0.5 + (told > 4 ? 4 : told < -4 ? -4 : told) / 8;
        fits[good++] = chosen;
    }
    status = status < 0 ? NO_MEMORY : 0;
    if (!status) {
        for (int64_t i = 0; i < count; i++)
            refuse(blobs + which[i]);
        shrink_slopes(fits, good);
        for (int64_t i = 0; i < good; i++)
            if (fits[i].centers[0] + fits[i].centers[2] < MAX_SIGMA * MAX_SIGMA)
                take_fit(fits + i, dot->unlit, blobs + fits[i].blob);
    }
    if (dot) {
        free(dot->x);
        free(dot->y);
        free(dot->grey);
        free(dot->residual);
        free(dot->tips);
        free(dot->other_tips);
        free(dot->scratch);
        free(dot->weight);
        free(dot->silent);
        free(dot->sector);
    }
    free(dot);
    free(fits);
    return status;
}

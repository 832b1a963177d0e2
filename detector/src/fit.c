/* Fit of dots' ellipses to the grey levels around their outlines.

   Model: light - (light - dark) (D - D_hole), with D the share of ink (`blurred_ellipse`) and levels of light and dark that
   each have a slope over the dot, and a common curvature where light saturates; saturated where the image is. Ellipse, levels,
   slopes and blur are unknown, and for a ring the hole's center and scale too: under perspective hole and outline are not
   concentric. Every pixel counts by its information, so the center's error is near the lower bound set by the image's noise. A
   lens bends the outline, by up to a third of a pixel: what is fitted is the ellipse that is nearest to it, as if no noise were
   there.

   Parts of the outline without an edge, or with one elsewhere (an occluder, a touching neighbor), are found sector by sector
   and left out. A fifth of the outline may be missing; with more the fit is refused, since half an ellipse also fits other
   ellipses, with other centers. What is neither dark nor light in the middle is fitted as a disk and as a ring, and is a ring
   only if that is clearly better. */

#include "detector.h"
#include "lanes.h"

/* Unknowns p: center (2) and M (m11, m12, m22) of the ellipse |M (x - c)| = 1; grey levels of light and dark; blur; slopes of
   light and of dark (2 each), per px; center (2) of a ring's hole, and its size relative to the outline's; what a reflection
   adds to light and dark, by x^2, x y and y^2. The latter are unknown only where light saturates: elsewhere it is the same on
   opposite sides, and moves no center. */
enum { LIGHT = 5, DARK = 6, BLUR = 7, SLOPES = 8, DISK = 12, HOLE = 12, SCALE = 14, RING = 15, CURVES = 15, COUNT = 18 };
enum { SECTORS = 16, DIFFERENCES = 256, AHEAD = 4 };

/* A fit ends when the next step would move its center by less than the first, a third of the best standard deviation. Outlines
   that still take steps above the second at the end are not dots. Pixels and sectors are left
   out once the steps of center and blur are below the third, px, but not at the first step. */
static const double CONVERGED = 1e-3, SETTLED = 0.02, JUDGED = 0.1;
enum { UNJUDGED = 1 };
/* Maximum number of steps, and of times that a dot's pixels are chosen anew. */
enum { STEPS = 16, ROUNDS = 4 };
static const double LONGEST_STEP = 2, LONGEST_SCALE_STEP = 0.1;
/* Range of the blur in px, including the pixel's own area, which alone is 0.29. */
static const double LEAST_BLUR = 0.28, MOST_BLUR = 6;
/* Minimum semi-axis, px: with less than half a pixel's blur, a dot cannot be told from a line. */
static const double SHORTEST = 0.6;
/* Pixels that are off by more than this multiple of the standard deviation of the residual belong to something else. */
static const double OUTLIER_SPREAD = 4;
/* Maximum number of sectors left out, counting neighbors of strange ones: half an ellipse also fits other ellipses. */
enum { MAX_LEFT_OUT = 5 };
/* Standard deviations of a hole's size about half of the ring's, and of a reflection's slope, relative to the light and in
   1/px, about none, and of its curvature, in 1/px^2; as if measured at this noise per contrast. With a slope of 0.003 centers
   behind a blur of 2 px are worse by a third; with 0.001 those of small dots under strong reflections, likewise. With a
   curvature of 0.0001, 91.4 % of the poses under highlights are within regions of 95 %, with 0.0003 91.8, with 0.05 no more. */
static const double SCALE_SIGMA = 0.05, SHINE_SIGMA = 0.002, CURVE_SIGMA = 0.0003, PRIOR_NOISE = 0.02;

static const double TINY = 1e-12;

/* Maximum deviations of the edge in a sector: its shift in px, or in blurs if these exceed a px, plus a share of the longer
   semi-axis, for print and lens; its height as a share of the contrast; both plus a multiple of their error. With a shift of
   0.05 px, real photographs' dots, whose outlines are 0.1 px from an ellipse, lose one sector after the other, 47 of 1,687; with
   all three times as large, 88 of 920 half covered dots are fitted 0.3 px off and more, instead of 4. */
static const double SHIFT_PX = 0.15, SHIFT_SHARE = 0.004, HEIGHT = 0.3, SIGMAS = 4;
/* Maximum share of the contrast by which the edge may be off all around: with more, covered dots fit, too. */
static const double MISFIT = 0.025;
/* Deviation of a sector without pixels, beyond the image's edge. */
static const double UNSEEN = 1e9;
/* Variance of rounding to whole grey levels: no image has less noise. */
static const double QUANTIZATION = 1. / 12;
/* Number of pixels of a dot above which some are left out, and above which the first step takes a third of them. */
static const double ENOUGH = 3000;
enum { ENOUGH_AT_FIRST = 300 };
/* Ratio to the noise of the plainest image areas, accepted and maximum: noise grows with the light. */
static const double NOISE_SLACK = 1.5, MOST_NOISE = 2;
/* Half-width of the band of fitted pixels around the outline: beyond it the levels are flat and carry no information, and the
   next dot may begin. */
static const double BAND_BLURS = 3, MIN_BAND = 2.5, MAX_BAND = 9;
/* Maximum RMS residual beyond the noise, and maximum noise, at the end, as shares of the contrast. Cameras that sharpen edges
   leave 0.08. */
static const double MAX_MISFIT = 0.12, MAX_NOISE = 0.2;
static const double MIN_MAJOR = 1, MAX_ELONGATION = 10, MAX_SIGMA = 0.5, HOLE_SCALES[2] = {0.15, 0.85};
/* Ratio of the sectors' shifts, squared, to what noise explains, above which the covariance grows by it. Where nothing but noise
   is in the image, one dot in ten is above. With 2, 91.8 instead of 92.5 % of poses under highlights are within regions of 95 %;
   with 1.25, 97 % of those in clean images. */
static const double MUCH_UNEVEN = 1.5;
/* Maximum distance from the rough center, pixels of the level in which that was measured plus a share of the longer semi-axis. In
   tracking at 4000 x 3000 px, dots of 200 px are up to 2.5 px off, and the fits of 11 of 156 were refused with 0.7 px. */
static const double MAX_MOVE = 0.7, MOVE_SHARE = 0.003;
/* Levels in the middle of certain disks, glossy ones included, and certain rings; number of blurs below which a shorter
   semi-axis tells a kind badly, whatever the level, and below which that of a ring's hole is too small for the series: no ring
   is fitted, whose fit would not end, but a disk, which is as good. Of 1,000 rings behind a blur of 1.5 to 3 px, 200 were
   lost without it. */
static const double DISK_BELOW = 0.3, RING_ABOVE = 0.7, TOLD_BLURS = 3.5, SHOWN_BLURS = 2.1, TINY_BLURS = 3;
/* Standard deviation along each axis of the center of a dot whose fit is refused. */
static const double ROUGH_PX = 0.2;

static inline double within(double a, double low, double high) { return a < low ? low : a > high ? high : a; }

/* ---- grey levels of a blurred ellipse ---- */

typedef struct {
    float x, y, m11, m12, m22, per_blur, flattest, bent, fourth, sixth;
} Shape;

/* Of four pixels: the share of ink, its derivatives by the depth of the edge, 1/px, and by blur; the edge's outward normal. */
typedef struct {
    Lanes ink, slope, by_blur, nx, ny;
} Seen;

static Shape shape_of(double x, double y, double m11, double m12, double m22, double blur)
{
    const double trace = m11 + m22, determinant = m11 * m22 - m12 * m12, square = blur * blur;
    return (Shape){
        (float)x, (float)y, (float)m11, (float)m12, (float)m22, (float)(1 / blur), (float)(determinant / trace),
        (float)(determinant * determinant * blur / 2), (float)(1 / (2880 * square * square)),
        (float)(1 / (181440 * square * square * square)),
    };
}

/* The share of ink of an ellipse seen through a Gaussian blur, in square pixels, and its derivatives.

   With rho = |M x| and F the normal distribution, the share is F(d), d = -e/s - k s/2: e is the distance from the outline to
   first order, (rho - 1)/|grad rho|, and k is the outline's curvature det(M)^2/|grad rho|^3, by which a blur s moves a convex
   edge inward. It is within 0.001 of the contrast (RMS) for semi-axes a, b with a s < b^2/10. At the tips of thinner ellipses
   it is off by up to 0.03, on both sides alike: integrals over the tips took a third of the time, and gave worse centers.

   Along the edge's normal n, a pixel is two boxes of widths |n_x| and |n_y|. The blur s is a Gaussian of the variance of lens
   and pixel; the boxes' cumulants -w^4/120 and w^6/252 add terms of Edgeworth's series, with Hermite's polynomials:
   f(d) [(n_x^4 + n_y^4) He3(d) / (24 120 s^4) - (n_x^6 + n_y^6) He5(d) / (720 252 s^6)]. Without them, sharp edges are off by
   0.06 along rows; the next term makes them worse for lenses of less than 0.2 px.

   The derivatives neglect changes of |grad rho|, the curvature and the boxes: these are of second order at the outline, and
   affect only the path to the solution. */
static inline Seen blurred_ellipse(const Shape *s, Lanes x, Lanes y)
{
    const Lanes dx = x - s->x, dy = y - s->y, u = s->m11 * dx + s->m12 * dy, v = s->m12 * dx + s->m22 * dy;
    const Lanes gx = s->m11 * u + s->m12 * v, gy = s->m12 * u + s->m22 * v;
    /* At the center itself rho has no direction; |grad rho| is at least the smaller eigenvalue everywhere. */
    const Lanes rho = root_of(most_of(u * u + v * v, all(1e-12f))), length = most_of(root_of(gx * gx + gy * gy), rho * s->flattest);
    const Lanes per_length = 1 / length, flat = rho * per_length;
    /* Curvatures above 1/s, at the tips of thin ellipses, are out of the expansion's range. */
    const Lanes inward = least_of(s->bent * flat * flat * flat, all(0.5f));
    const Lanes depth = (1 - rho) * flat * s->per_blur - inward;
    Lanes density, ink = normal_at(depth, &density);
    const Lanes nx = gx * per_length, ny = gy * per_length, nx2 = nx * nx, ny2 = ny * ny, square = depth * depth;
    ink += density * depth * (s->fourth * (nx2 * nx2 + ny2 * ny2) * (square - 3) -
                              s->sixth * (nx2 * nx2 * nx2 + ny2 * ny2 * ny2) * (15 + square * (square - 10)));
    return (Seen){ink, density * s->per_blur, -density * (depth + 2 * inward) * s->per_blur, nx, ny};
}

/* ---- pixels ---- */

/* Of each pixel: place relative to the rough center, grey level, 1 for those that are no padding, and 1 for those that count.
   Then, from the last evaluation of the model: residual, level in the model, 1 where it is not saturated, and the model's
   derivatives by a move of the center along x and y, of the outline and of the hole inward, by blur, by dark instead of
   light (the ink), and by a curvature (the square of the distance from the center, relative to the outline's). */
enum { X, Y, GREY, REAL, WEIGHT, RESIDUAL, MODEL, HEARD, ALONG, DOWN, OUTLINE, INNER, BULGE, INK, SQUARE, ARRAYS };

/* Sums over a sector's pixels: of their number; with h = derivative by the outline, r = residual and m = model, of h^2, h r, r,
   m, m^2, m r and r^2; of those that count and are heard, their number and r^2. */
enum { NUMBER, HH, HR, R, M, MM, MR, RR, USED, SQUARES, SUMS };

/* A dot that is being fitted. */
typedef struct {
    int64_t room, count; /* of pixels, with padding: each sector's begin at a multiple of LANES */
    int64_t start[SECTORS + 1];
    float *pixels[ARRAYS];
    int32_t *sector;
    double p[COUNT], origin[2], size[2], step, blur_step; /* the longer semi-axis first */
    double normal[COUNT][COUNT], gradient[COUNT], moved[COUNT], sums[SECTORS][SUMS], noise;
    double bend[SECTORS];           /* px by which the lens bends the outline inward */
    double outline[SECTORS][COUNT]; /* sums of the products of the derivatives by the outline and by the unknowns */
    int ring, curved, unknowns, alive, left_out[SECTORS]; /* `unknowns` are the first DISK, RING or all */
    double image_noise, saturation, unlit;
    float differences[DIFFERENCES + LANES];
} Descent;

/* The part of an ellipse in a row, at half + up * shear from its center; half is that in the middle row. */
typedef struct {
    double reach, shear, half;
} RowForm;

static RowForm row_form(double a, double b, double angle)
{
    const double cosine = cos(angle), sine = sin(angle), as = a * sine, bc = b * cosine, square = as * as + bc * bc;
    return (RowForm){sqrt(square), (a * a - b * b) * cosine * sine / square, a * b / sqrt(square)};
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
    free(dot->pixels[0]);
    free(dot->sector);
    dot->room = 0;
    room += room / 2;
    room -= room % LANES;
    dot->pixels[0] = malloc((size_t)room * ARRAYS * sizeof(float));
    dot->sector = malloc((size_t)room * sizeof *dot->sector);
    if (!dot->pixels[0] || !dot->sector)
        return NO_MEMORY;
    for (int k = 1; k < ARRAYS; k++)
        dot->pixels[k] = dot->pixels[0] + k * room;
    dot->room = room;
    return 0;
}

/* The sectors of places relative to the center, from x toward y, in coordinates in which the outline is a circle. */
static inline Flags sectors_of(Lanes u, Lanes v)
{
    const Lanes across = magnitude(u), down = magnitude(v);
    const Flags octant = -((down > 0.41421356f * across) + (down > across) + (0.41421356f * down > across));
    const Flags left = u < 0, above = v < 0, half = (left & (SECTORS / 2 - 1 - octant)) | (~left & octant);
    return (above & (SECTORS - 1 - half)) | (~above & half);
}

/* Collects the pixels within a distance of the outline, and those inside if it is `filled`, by sector. Of too many, those of
   rows at even distances. */
static int collect(Descent *dot, const Image *image, const Blob *blob, double band, int filled)
{
    const double pi = 3.14159265358979323846, center_x = blob->center[0], center_y = blob->center[1];
    const double a = blob->semi[0] + band, b = blob->semi[1] + band;
    const double c = larger(blob->semi[0] - band, 1e-3), d = larger(blob->semi[1] - band, 1e-3);
    const int hollow = blob->semi[1] > band + 1 && !filled;
    dot->count = 0;
    memset(dot->start, 0, sizeof dot->start);
    /* Rows and columns of what is no ellipse, or of a huge one, would be no whole numbers. */
    if (!(fabs(center_x) < 1e9 && fabs(center_y) < 1e9 && a > 1e-3 && a < 1e9 && b > 1e-3 && b < 1e9 &&
          fabs(blob->angle) < 1e9 && band >= 0))
        return make_room(dot, LANES);
    const RowForm outer = row_form(a, b, blob->angle), inner = row_form(c, d, blob->angle);
    const int64_t top = (int64_t)within(ceil(center_y - outer.reach), 0, (double)image->height);
    const int64_t bottom = (int64_t)within(floor(center_y + outer.reach), -1, (double)(image->height - 1));
    const int64_t every = 1 + (int64_t)(pi * (a * b - (hollow ? c * d : 0)) / ENOUGH);
    const int64_t rows = bottom < top ? 0 : (bottom - top) / every + 1;
    int64_t read_count = 0, ends[SECTORS] = {0};
    int highest = 0;

    if (make_room(dot, rows * (int64_t)smaller(2 * outer.half + 4, (double)(image->width + 4)) + SECTORS * LANES))
        return NO_MEMORY;
    /* As they are read, places and levels are kept where the model's come later. */
    float *xs = dot->pixels[MODEL], *ys = dot->pixels[INK], *levels = dot->pixels[RESIDUAL];
    for (int64_t y = top; y <= bottom; y += every) {
        const double up = (double)y - center_y, half = half_length(outer, up), hole = hollow ? half_length(inner, up) : 0;
        const double middle = center_x + outer.shear * up, hole_middle = center_x + inner.shear * up;
        const uint8_t *row = image->rows + y * image->stride;
        const int64_t last = (int64_t)smaller(middle + half, (double)(image->width - 1));
        const int64_t leave = hole > 0 ? (int64_t)larger(hole_middle - hole, -1) : last, enter = (int64_t)ceil(hole_middle + hole);
        const int64_t first = (int64_t)ceil(larger(middle - half, 0));
        const float from = (float)((double)first - center_x);
        __builtin_prefetch(row + AHEAD * image->stride + (image->wide ? 2 * first : first));
        for (int64_t x = first; x <= last; x = x == leave && enter > x ? enter : x + 1) {
            uint16_t level = row[image->wide ? 2 * x : x];
            if (image->wide)
                memcpy(&level, row + 2 * x, 2);
            highest = level > highest ? level : highest;
            xs[read_count] = from + (float)(int32_t)(x - first);
            ys[read_count] = (float)up;
            levels[read_count++] = image->inverted ? -(float)level : (float)level;
        }
    }
    const float m11 = (float)dot->p[2], m12 = (float)dot->p[3], m22 = (float)dot->p[4];
    for (int64_t i = 0; i < read_count; i += LANES) {
        const Lanes x = read(xs + i), y = read(ys + i);
        const Flags sectors = sectors_of(m11 * x + m12 * y, m12 * x + m22 * y);
        memcpy(dot->sector + i, &sectors, sizeof sectors);
    }
    for (int64_t i = 0; i < read_count; i++)
        ends[dot->sector[i]]++;
    for (int k = 0; k < SECTORS; k++) {
        dot->start[k + 1] = dot->start[k] + (ends[k] + LANES - 1) / LANES * LANES;
        for (int64_t i = dot->start[k] + ends[k]; i < dot->start[k + 1]; i++)
            dot->pixels[X][i] = dot->pixels[Y][i] = dot->pixels[GREY][i] = dot->pixels[REAL][i] = 0;
        ends[k] = dot->start[k];
    }
    dot->count = dot->start[SECTORS];
    /* The highest level of so many bits. */
    dot->saturation = image->inverted ? 0 : highest >= UINT8_MAX && !(highest & (highest + 1)) ? highest : (double)INFINITY;
    for (int64_t j = 0; j < read_count; j++) {
        const int64_t i = ends[dot->sector[j]]++;
        dot->pixels[X][i] = xs[j];
        dot->pixels[Y][i] = ys[j];
        dot->pixels[GREY][i] = levels[j];
        dot->pixels[REAL][i] = 1;
    }
    memcpy(dot->pixels[WEIGHT], dot->pixels[REAL], (size_t)dot->count * sizeof(float));
    return 0;
}

/* Standard deviation of the residual's white part, from the median of neighbors' differences: misfit, which is smooth, and
   foreign pixels, which are few, hardly count. In a small dot, all pixels are near an edge, and a misfit looks like noise: at
   most that of the image. */
static double noise_of(Descent *dot)
{
    const float *x = dot->pixels[X], *y = dot->pixels[Y], *residual = dot->pixels[RESIDUAL];
    const int64_t every = 1 + dot->count / DIFFERENCES;
    int64_t count = 0;
    for (int64_t i = 0; i + 1 < dot->count; i += every) {
        dot->differences[count] = fabsf(residual[i + 1] - residual[i]);
        count += (y[i + 1] == y[i]) & (fabsf(x[i + 1] - x[i] - 1) < 0.5f);
    }
    /* The median of |N(0, 1)| is 0.6745, and a difference has twice the variance. */
    const double white = ranked(dot->differences, count, count / 2) / (0.6745 * sqrt(2.0));
    return smaller(larger(white, sqrt(QUANTIZATION)), dot->image_noise);
}

/* Of the pixels that count, at least that of rounding; saturated pixels show no noise. */
static double variance_of(const Descent *dot)
{
    double squares = 0, used = 0;
    for (int k = 0; k < SECTORS; k++) {
        squares += dot->sums[k][SQUARES];
        used += dot->sums[k][USED];
    }
    return larger(squares / larger(used - dot->unknowns, 1), QUANTIZATION);
}

/* What the residuals of the last evaluation say. */
static void sum_sectors(Descent *dot)
{
    float *const *pixels = dot->pixels;
    for (int k = 0; k < SECTORS; k++) {
        Lanes sums[SUMS] = {{0}};
        for (int64_t i = dot->start[k]; i < dot->start[k + 1]; i += LANES) {
            const Lanes real = read(pixels[REAL] + i), heard = read(pixels[HEARD] + i), r = read(pixels[RESIDUAL] + i);
            const Lanes h = real * heard * read(pixels[OUTLINE] + i), m = real * read(pixels[MODEL] + i);
            const Lanes used = heard * read(pixels[WEIGHT] + i);
            sums[NUMBER] += real;
            sums[HH] += h * h;
            sums[HR] += h * r;
            sums[R] += r * real;
            sums[M] += m;
            sums[MM] += m * m;
            sums[MR] += m * r;
            sums[RR] += real * r * r;
            sums[USED] += used;
            sums[SQUARES] += used * r * r;
        }
        for (int j = 0; j < SUMS; j++)
            dot->sums[k][j] = sum_of(sums[j]);
    }
    dot->noise = noise_of(dot);
}

/* The deviation of the edge's place and height from the fit, sector by sector, in units of what print, lens and noise explain.
   An edge moved inward by d adds d times its slope to the grey levels, so d follows from the residual by least squares; likewise
   the edge's height, relative to the model's. */
static void strangeness(const Descent *dot, double noise, double *strange)
{
    double outward[SECTORS], square[SECTORS];
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k];
        outward[k] = sums[HR] / larger(sums[HH], TINY);
        square[k] = sums[RR] / larger(sums[NUMBER], 1);
        for (int i = k; i > 0 && square[i] < square[i - 1]; i--) {
            const double swapped = square[i];
            square[i] = square[i - 1];
            square[i - 1] = swapped;
        }
    }
    /* Edges that the camera sharpened are off all around: a quarter of the sectors tells by how much. */
    noise = larger(noise, smaller(sqrt(square[SECTORS / 4 - 1]), MISFIT * (dot->p[LIGHT] - dot->p[DARK])));
    for (int k = 0; k < SECTORS; k++) {
        const double *sums = dot->sums[k], information = larger(sums[HH], TINY), size = fabs(outward[k]);
        /* Blur other than the model's moves opposite edges alike, and does not move the center. */
        const double across = outward[(k + SECTORS / 2) % SECTORS];
        const double uneven = outward[k] * across > 0 ? larger(size - fabs(across), 0) : size;
        const double allowed = SHIFT_PX * larger(1, dot->p[BLUR]) + SHIFT_SHARE * dot->size[0];
        const double mean = sums[M] / larger(sums[NUMBER], 1), power = larger(sums[MM] - mean * sums[M], TINY);
        const double height = (sums[MR] - mean * sums[R]) / power;
        strange[k] = larger(uneven / (allowed + SIGMAS * noise / sqrt(information)),
                            fabs(height) / (HEIGHT + SIGMAS * noise / sqrt(power)));
        if (!(sums[NUMBER] > 0))
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

/* The model and its derivatives at every so many pixels. */
static void evaluate(Descent *dot, int every)
{
    const double *p = dot->p, scale = p[SCALE], *o = dot->origin;
    const Shape outer = shape_of(p[0] - o[0], p[1] - o[1], p[2], p[3], p[4], p[BLUR]);
    const Shape inner = shape_of(p[HOLE] - o[0], p[HOLE + 1] - o[1], p[2] / scale, p[3] / scale, p[4] / scale, p[BLUR]);
    const float light = (float)p[LIGHT], dark = (float)p[DARK], light_x = (float)p[SLOPES], light_y = (float)p[SLOPES + 1];
    const float dark_x = (float)p[SLOPES + 2], dark_y = (float)p[SLOPES + 3], saturation = (float)dot->saturation;
    const float xx = (float)p[CURVES], xy = (float)p[CURVES + 1], yy = (float)p[CURVES + 2];
    float *const *pixels = dot->pixels;
    const int ring = dot->ring, curved = dot->curved;
    for (int k = 0; k < SECTORS; k++) {
        const float bend = (float)dot->bend[k], inner_bend = (float)(dot->bend[k] * scale * scale);
        for (int64_t i = dot->start[k]; i < dot->start[k + 1]; i += every * LANES) {
            const Lanes x = read(pixels[X] + i), y = read(pixels[Y] + i);
            Seen seen = blurred_ellipse(&outer, x, y);
            Lanes level = light + light_x * x + light_y * y;
            const Lanes contrast = level - (dark + dark_x * x + dark_y * y);
            if (curved) {
                const Lanes dx = x - outer.x, dy = y - outer.y;
                const Lanes u = outer.m11 * dx + outer.m12 * dy, v = outer.m12 * dx + outer.m22 * dy;
                write(pixels[SQUARE] + i, u * u + v * v);
                level += (xx * x + xy * y) * x + yy * y * y;
            }
            write(pixels[ALONG] + i, -contrast * seen.slope * seen.nx);
            write(pixels[DOWN] + i, -contrast * seen.slope * seen.ny);
            write(pixels[OUTLINE] + i, contrast * seen.slope);
            Lanes bent = bend * seen.slope;
            if (ring) {
                const Seen hole = blurred_ellipse(&inner, x, y);
                bent -= inner_bend * hole.slope;
                seen.ink -= hole.ink;
                seen.by_blur -= hole.by_blur;
                write(pixels[INNER] + i, -contrast * hole.slope);
            }
            const Lanes model = level - contrast * (seen.ink - bent), clipped = least_of(model, all(saturation));
            write(pixels[BULGE] + i, -contrast * seen.by_blur);
            write(pixels[INK] + i, seen.ink);
            write(pixels[MODEL] + i, clipped);
            write(pixels[RESIDUAL] + i, read(pixels[GREY] + i) - clipped);
            write(pixels[HEARD] + i, pick(model > saturation, all(0), all(1)));
        }
    }
}

/* Derivatives of which an unknown's are multiples, the same in all of a sector: by a move of the hole, of the center, of the
   outline; by blur, light and dark; then the residual; by curvature; and by a move of outline and hole as M moves them. */
enum { OF_HOLE, OF_X, OF_Y, OF_OUTLINE, OF_BLUR, OF_LIGHT, OF_DARK, OF_RESIDUAL, OF_CURVE, OF_BOTH, LOCAL };

static inline void add_row(Lanes *sums, Lanes factor, const Lanes *terms, int count)
{
    for (int c = 0; c < count; c++)
        sums[c] += factor * terms[c];
}

/* Their products, summed over the pixels of a sector that count. */
static inline void sum_products(const Descent *dot, int sector, int every, int ring, double (*total)[LOCAL])
{
    float *const *pixels = dot->pixels;
    const float half = (float)(0.5 * (dot->p[LIGHT] - dot->p[DARK]));
    Lanes sums[OF_BOTH][OF_BOTH] = {{{0}}};
    for (int64_t i = dot->start[sector]; i < dot->start[sector + 1]; i += every * LANES) {
        const Lanes r = read(pixels[RESIDUAL] + i), ink = read(pixels[INK] + i);
        const Lanes a[OF_CURVE] = {ring ? read(pixels[INNER] + i) : all(0), read(pixels[ALONG] + i), read(pixels[DOWN] + i),
                                   read(pixels[OUTLINE] + i), read(pixels[BULGE] + i), 1 - ink, ink, r};
        /* A neighbor's edge in the band, or a speck, is no information about this dot. */
        const Lanes weight = read(pixels[WEIGHT] + i) * pick(magnitude(r) < half, read(pixels[HEARD] + i), all(0));
        if (ring)
            add_row(sums[0], weight * a[0], a, 8);
        add_row(sums[1] + 1, weight * a[1], a + 1, 7);
        add_row(sums[2] + 2, weight * a[2], a + 2, 6);
        add_row(sums[3] + 3, weight * a[3], a + 3, 5);
        add_row(sums[4] + 4, weight * a[4], a + 4, 4);
        add_row(sums[5] + 5, weight * a[5], a + 5, 3);
        add_row(sums[6] + 6, weight * a[6], a + 6, 2);
        if (dot->curved) {
            const Lanes square = read(pixels[SQUARE] + i), factor = weight * square;
            for (int k = !ring; k < OF_CURVE; k++)
                sums[k][OF_CURVE] += factor * a[k];
            sums[OF_CURVE][OF_CURVE] += factor * square;
        }
    }
    memset(total, 0, LOCAL * sizeof *total);
    for (int r = !ring; r < OF_BOTH; r++)
        for (int c = r; c < OF_BOTH; c++)
            total[r][c] = total[c][r] = sum_of(sums[r][c]);
    const double scale = dot->p[SCALE];
    for (int c = 0; c < OF_BOTH; c++)
        total[OF_BOTH][c] = total[c][OF_BOTH] = total[OF_OUTLINE][c] + scale * total[OF_HOLE][c];
    total[OF_BOTH][OF_BOTH] = total[OF_OUTLINE][OF_BOTH] + scale * total[OF_HOLE][OF_BOTH];
}

/* The derivatives that the unknowns' are multiples of, and whether the factors change their sign on the opposite side. */
static const int LOCAL_OF[COUNT] = {OF_X,     OF_Y,     OF_BOTH, OF_BOTH, OF_BOTH, OF_LIGHT, OF_DARK, OF_BLUR,
                                    OF_LIGHT, OF_LIGHT, OF_DARK, OF_DARK, OF_HOLE, OF_HOLE,  OF_HOLE,
                                    OF_CURVE, OF_CURVE, OF_CURVE};
static const int ODD[COUNT] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0};

/* These factors, in the middle of one of the first sectors. */
static void factors_of(const double *p, int sector, double *factor)
{
    static const double COSINE[4] = {0.98078528040323043, 0.83146961230254524, 0.55557023301960218, 0.19509032201612827};
    const double u = sector < 4 ? COSINE[sector] : -COSINE[7 - sector], v = COSINE[sector < 4 ? 3 - sector : sector - 4];
    /* M maps the outline's point (x, y) to (u, v). */
    const double determinant = p[2] * p[4] - p[3] * p[3];
    const double x = (p[4] * u - p[3] * v) / determinant, y = (p[2] * v - p[3] * u) / determinant;
    const double gx = p[2] * u + p[3] * v, gy = p[3] * u + p[4] * v, flat = 1 / sqrt(gx * gx + gy * gy);
    const double factors[COUNT] = {1, 1, u * x * flat, (u * y + v * x) * flat, v * y * flat, 1, 1, 1,
                                   x, y, x, y, -gx * flat, -gy * flat, -flat, x * x, x * y, y * y};
    memcpy(factor, factors, sizeof factors);
}

/* The normal matrix J'J and the gradient J'r of every so many pixels, from the sums of the sectors: in all of a sector, an
   outline's size and shape move it, and the light's slope changes it, as in the sector's middle. That is 16 times 28 products of
   pixels instead of 120 for all; derivatives that are a little off change nothing of where it ends, at no correlation with the
   residuals, nor of the center's precision. Sectors opposite to each other share their factors but for the sign. */
static void sum_equations(Descent *dot, int every)
{
    memset(dot->normal, 0, sizeof dot->normal);
    memset(dot->gradient, 0, sizeof dot->gradient);
    for (int k = 0; k < SECTORS / 2; k++) {
        double here[LOCAL][LOCAL], there[LOCAL][LOCAL], sums[2][LOCAL][LOCAL];
        if (dot->ring) {
            sum_products(dot, k, every, 1, here);
            sum_products(dot, k + SECTORS / 2, every, 1, there);
        } else {
            sum_products(dot, k, every, 0, here);
            sum_products(dot, k + SECTORS / 2, every, 0, there);
        }
        for (int r = 0; r < LOCAL; r++)
            for (int c = 0; c < LOCAL; c++) {
                sums[0][r][c] = here[r][c] + there[r][c];
                sums[1][r][c] = here[r][c] - there[r][c];
            }
        double factor[COUNT];
        factors_of(dot->p, k, factor);
        for (int r = 0; r < dot->unknowns; r++) {
            for (int c = 0; c <= r; c++)
                dot->normal[r][c] += factor[r] * factor[c] * sums[ODD[r] ^ ODD[c]][LOCAL_OF[r]][LOCAL_OF[c]];
            dot->gradient[r] += factor[r] * sums[ODD[r]][LOCAL_OF[r]][OF_RESIDUAL];
            dot->outline[k][r] = factor[r] * here[OF_OUTLINE][LOCAL_OF[r]];
            dot->outline[k + SECTORS / 2][r] = (ODD[r] ? -factor[r] : factor[r]) * there[OF_OUTLINE][LOCAL_OF[r]];
        }
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
static void equations(const Descent *dot, double ridge, double *a, double *gradient, double *scale)
{
    const int n = dot->unknowns;
    const double *p = dot->p, contrast = p[LIGHT] - p[DARK], of_shine = PRIOR_NOISE / SHINE_SIGMA * contrast;
    const double weight = of_shine * of_shine;
    double factor[2];
    for (int r = 0; r < n; r++)
        memcpy(a + n * r, dot->normal[r], (size_t)n * sizeof *a);
    memcpy(gradient, dot->gradient, sizeof dot->gradient);
    /* If the blur is as wide as a ring's ink, a darker and thinner ring looks the same: a half is the usual size. */
    if (dot->ring) {
        const double of_scale = PRIOR_NOISE / SCALE_SIGMA * contrast, prior = of_scale * of_scale;
        a[n * SCALE + SCALE] += prior;
        gradient[SCALE] += prior * (0.5 - p[SCALE]);
    }
    /* In small dots hardly anything is all dark. */
    shine(p, factor);
    for (int r = SLOPES; r < SLOPES + 2; r++) {
        const double beyond = factor[0] * p[r] + factor[1] * p[r + 2];
        a[n * r + r] += weight * factor[0] * factor[0];
        a[n * (r + 2) + r] += weight * factor[0] * factor[1];
        a[n * (r + 2) + r + 2] += weight * factor[1] * factor[1];
        gradient[r] -= weight * factor[0] * beyond;
        gradient[r + 2] -= weight * factor[1] * beyond;
    }
    const double of_curve = PRIOR_NOISE / CURVE_SIGMA * contrast / larger(fabs(p[LIGHT]), 1);
    for (int r = CURVES; r < CURVES + 3 && dot->curved; r++) {
        a[n * r + r] += of_curve * of_curve;
        gradient[r] -= of_curve * of_curve * p[r];
    }
    for (int r = 0; r < n; r++)
        scale[r] = 1 / sqrt(larger(a[n * r + r], 1e-12));
    for (int r = 0; r < n; r++)
        for (int c = 0; c <= r; c++)
            a[n * r + c] = a[n * r + c] * (scale[r] * scale[c]) + (r == c ? ridge : 0);
}

/* Takes a step, within limits. */
static void move(Descent *dot)
{
    const int n = dot->unknowns;
    double a[COUNT * COUNT], step[COUNT], scale[COUNT], p[COUNT], trace, root;
    int sane = 1;
    equations(dot, 1e-9, a, step, scale);
    for (int r = 0; r < n; r++)
        step[r] *= scale[r];
    solve_positive(n, a, step, 1, 1e-14);
    for (int r = 0; r < COUNT; r++) {
        step[r] = r < n ? step[r] * scale[r] : 0;
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
    for (int r = 0; r < COUNT; r++)
        dot->moved[r] = p[r] - dot->p[r];
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
    double strange[SECTORS], worst = 0;
    int bad[SECTORS];
    strangeness(dot, dot->noise, strange);
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
    const float limit = (float)(OUTLIER_SPREAD * sqrt(variance_of(dot)));
    Flags changes = {0};
    for (int k = 0; k < SECTORS; k++) {
        const Lanes most = all(dot->left_out[k] ? 0 : limit);
        for (int64_t i = dot->start[k]; i < dot->start[k + 1]; i += LANES) {
            const Lanes kept = pick(magnitude(read(dot->pixels[RESIDUAL] + i)) < most, read(dot->pixels[REAL] + i), all(0));
            changes |= kept != read(dot->pixels[WEIGHT] + i);
            write(dot->pixels[WEIGHT] + i, kept);
        }
    }
    if (sectors_left_out(dot) > MAX_LEFT_OUT)
        dot->alive = 0;
    return any(changes);
}

static void descend(Descent *dot)
{
    int rounds = 0, every = 1, calm = 0;
    for (int step = 0; step < STEPS && dot->alive; step++) {
        const double before = dot->step;
        const int every_before = every;
        /* Some pixels show well enough where all are to be looked at. All move the blur again, and some would
           move it back. */
        calm = calm || (before < JUDGED && dot->blur_step < JUDGED && step >= UNJUDGED);
        every = calm || dot->count < ENOUGH_AT_FIRST ? 1 : 3;
        int changed = 0;
        evaluate(dot, every);
        if (calm) {
            sum_sectors(dot);
            changed = rounds < ROUNDS && leave_out(dot);
            rounds += changed;
        }
        if (!dot->alive)
            return;
        sum_equations(dot, every);
        move(dot);
        /* Steps shrink by a factor that two show, and by a tenth from some pixels to all. */
        if (calm && !changed && dot->step * smaller(every_before > 1 ? 0.1 : 1, dot->step / before) < CONVERGED)
            return;
    }
    evaluate(dot, 1);
    sum_sectors(dot);
    memset(dot->moved, 0, sizeof dot->moved);
}

/* What the last step changes in the sums of the residuals' squares and in the outline's shifts, to first order: instead of
   another evaluation. */
static void follow_step(Descent *dot)
{
    const double *moved = dot->moved;
    double gain = 0, used = 0;
    for (int r = 0; r < dot->unknowns; r++) {
        gain += moved[r] * (2 * dot->gradient[r] - moved[r] * dot->normal[r][r]);
        for (int c = 0; c < r; c++)
            gain -= 2 * moved[r] * moved[c] * dot->normal[r][c];
    }
    for (int k = 0; k < SECTORS; k++)
        used += dot->sums[k][USED];
    for (int k = 0; k < SECTORS; k++) {
        for (int r = 0; r < dot->unknowns; r++)
            dot->sums[k][HR] -= moved[r] * dot->outline[k][r];
        dot->sums[k][SQUARES] -= gain * dot->sums[k][USED] / larger(used, 1);
    }
}

/* ---- verdict ---- */

/* Result of a fit: unknowns, the part of the covariance of all unknowns that the slopes' priors need, twice the negative
   log-likelihood of all pixels, up to a constant that all fits to the same pixels share; chi2 of the sectors' shifts over its
   degrees of freedom, 1 for a good fit; chi2 of the differences between opposite sectors' shifts, and their number. */
typedef struct {
    int64_t blob;
    double p[COUNT], by_slopes[COUNT][4], centers[3], misfit, uneven, odd, pairs, hole, other;
    int ring, good, tried;
} Fit;

static int is_complete(const Descent *dot)
{
    double strange[SECTORS];
    if (!dot->alive || !(dot->step < SETTLED))
        return 0;
    strangeness(dot, dot->noise, strange);
    for (int k = 0; k < SECTORS; k++)
        if (!(strange[k] <= 1) && !dot->left_out[k])
            return 0;
    return 1;
}

static void compare_sectors(const Descent *dot, double variance, Fit *fit)
{
    double sum = 0, squares = 0, number = 0;
    fit->odd = fit->pairs = 0;
    for (int k = 0; k < SECTORS; k++) {
        const int l = (k + SECTORS / 2) % SECTORS;
        const double *sums = dot->sums[k], *across = dot->sums[l];
        const double information = larger(sums[HH], TINY), opposite = larger(across[HH], TINY);
        const double outward = sums[HR] / information, apart = outward - across[HR] / opposite;
        squares += sums[RR];
        number += sums[NUMBER];
        if (dot->left_out[k])
            continue;
        sum += information * outward * outward;
        if (k < l && !dot->left_out[l]) {
            fit->odd += apart * apart / (1 / information + 1 / opposite) / variance;
            fit->pairs++;
        }
    }
    /* An ellipse takes five of the shifts. */
    fit->uneven = sum / variance / larger(SECTORS - 5 - sectors_left_out(dot), 1);
    fit->misfit = number * log(larger(squares / larger(number, 1), TINY));
}

/* Columns of the slopes, and of the center's rows, in the unknowns' covariance. */
static void covariances(const Descent *dot, double variance, Fit *fit)
{
    const int n = dot->unknowns, unknown[6] = {0, 1, SLOPES, SLOPES + 1, SLOPES + 2, SLOPES + 3};
    double a[COUNT * COUNT], gradient[COUNT], scale[COUNT], columns[6 * COUNT] = {0};
    equations(dot, 1e-12, a, gradient, scale);
    for (int c = 0; c < 6; c++)
        columns[6 * unknown[c] + c] = 1;
    solve_positive(n, a, columns, 6, 1e-14);
    for (int r = 0; r < n; r++)
        for (int c = 0; c < 6; c++)
            columns[6 * r + c] *= variance * scale[r] * scale[unknown[c]];
    for (int r = 0; r < COUNT; r++)
        memcpy(fit->by_slopes[r], columns + 6 * r + 2, 4 * sizeof *columns); /* zero from n on */
    fit->centers[0] = columns[0];
    fit->centers[1] = columns[6];
    fit->centers[2] = columns[7];
}

/* Fits a blob as a ring or disk: 1 if it has the outline of a dot nearly all around, near the rough one, else 0. */
static int fit_blob(Descent *dot, const Image *image, const Camera *camera, const Blob *blob, int ring, int filled, Fit *fit)
{
    const double size = ring == (blob->hole > 0.5) ? 1 : blob->other;
    const double a = 1 / (size * blob->semi[0]), b = 1 / (size * blob->semi[1]);
    const double cosine = cos(blob->angle), sine = sin(blob->angle);
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
    memset(dot->bend, 0, sizeof dot->bend);
    if (camera)
        outline_bend(camera, blob, SECTORS, dot->bend);
    if (collect(dot, image, blob, within(BAND_BLURS * blob->blur, MIN_BAND, MAX_BAND), filled))
        return NO_MEMORY;
    dot->curved = isfinite(dot->saturation) && !image->inverted;
    /* The unknowns of a hole come before the curvature's: those of a disk have no derivatives, and stay. */
    dot->unknowns = dot->curved ? COUNT : ring ? RING : DISK;
    descend(dot);
    follow_step(dot);

    const double variance = variance_of(dot), noise = dot->noise, contrast = p[LIGHT] - p[DARK];
    const double slack = NOISE_SLACK * noise, misfit = MAX_MISFIT * contrast;
    const double moved = hypot(p[0] - blob->center[0], p[1] - blob->center[1]);
    memcpy(fit->p, p, sizeof fit->p);
    fit->ring = ring;
    compare_sectors(dot, variance, fit);
    eigenvalues(p, &trace, &root);
    if (!is_complete(dot) || !(noise < MAX_NOISE * contrast) || !(variance < slack * slack + misfit * misfit) ||
        !(trace - root < 2 / MIN_MAJOR && trace + root < 2 / SHORTEST && trace + root < MAX_ELONGATION * (trace - root)) ||
        !(moved < MAX_MOVE * larger(blob->side, 1) + MOVE_SHARE * blob->semi[0]) ||
        (ring && !(p[SCALE] > HOLE_SCALES[0] && p[SCALE] < HOLE_SCALES[1])))
        return 0;
    covariances(dot, variance, fit);
    return 1;
}

/* ---- slopes of the light ---- */

/* What the slopes (4) of a fit say of the illumination along an axis, if `part` is 0, or of a reflection: by which they are
   multiplied; returns this, its variance and its covariances with all unknowns. */
static double measure_slopes(const Fit *fit, int part, int axis, double *variance, double *crossed)
{
    const double *p = fit->p, square = p[LIGHT] * p[LIGHT] + p[DARK] * p[DARK];
    double factor[2] = {p[LIGHT] / square, p[DARK] / square};
    if (part)
        shine(p, factor);
    for (int r = 0; r < COUNT; r++)
        crossed[r] = factor[0] * fit->by_slopes[r][axis] + factor[1] * fit->by_slopes[r][axis + 2];
    *variance = factor[0] * crossed[SLOPES + axis] + factor[1] * crossed[SLOPES + axis + 2];
    return factor[0] * p[SLOPES + axis] + factor[1] * p[SLOPES + axis + 2];
}

/* Means over both axes of the square and of the variance. */
static double square_slopes(const Fit *fit, int part, double *variance)
{
    double crossed[COUNT], variances[2];
    const double x = measure_slopes(fit, part, 0, variances, crossed), y = measure_slopes(fit, part, 1, variances + 1, crossed);
    *variance = (variances[0] + variances[1]) / 2;
    return (x * x + y * y) / 2;
}

/* Takes a measurement of one as zero, of a variance, into account: in the unknowns and in their covariances. */
static void shrink_slope(Fit *fit, int part, int axis, double variance)
{
    double crossed[COUNT], measured;
    const double slope = measure_slopes(fit, part, axis, &measured, crossed), per = 1 / (measured + variance);
    for (int r = 0; r < COUNT; r++) {
        fit->p[r] -= crossed[r] * slope * per;
        for (int k = 0; k < 4; k++)
            fit->by_slopes[r][k] -= crossed[r] * crossed[SLOPES + k] * per;
    }
    for (int k = 0; k < 3; k++)
        fit->centers[k] -= crossed[k / 2] * crossed[(k + 1) / 2] * per;
}

/* Shrinks the slopes of the light to zero: moves the unknowns, and gives the centers' covariance.

   Free slopes cost a third of the center's information and more; without them, uneven light displaces the center. So the slope
   of the illumination and that of a reflection have normal priors about zero, each with the variance of all such slopes of the
   image beyond their own errors (DerSimonian and Laird's estimate, for the reflection less its standard error): none in even
   light, as much as needed in other light. */
static void shrink_slopes(Fit *fits, int64_t count)
{
    double freedom = 0, odd = 0, expected, shared[2];
    for (int part = 0; part < 2; part++) {
        const double slack = part ? 1 / sqrt((double)count) : 0;
        double sum = 0, weights = 0;
        for (int64_t i = 0; i < count; i++) {
            const double square = square_slopes(fits + i, part, &expected), weight = 1 / larger(expected * expected, 1e-30);
            sum += (square - (1 + slack) * expected) * weight;
            weights += weight;
        }
        shared[part] = sum / weights;
    }
    for (int64_t i = 0; i < count; i++) {
        freedom += fits[i].pairs - 2;
        odd += fits[i].odd;
    }
    /* Only what moves opposite edges the same way moves a center, and it takes two of the differences. Where another blur than
       the model's makes the residuals, it is less than these say: by the estimate from all, if that is two standard deviations
       below one. By its upper limit instead, 98.8 % of motion-blurred markers' poses are within regions of 95 %. */
    const double ratio = freedom > 0 ? odd / freedom : 1;
    const double even = ratio * (1 + 2 * sqrt(2 / larger(freedom, 1))) < 1 ? ratio : 1;
    for (int64_t i = 0; i < count; i++) {
        Fit *fit = fits + i;
        for (int part = 0; part < 2; part++)
            for (int axis = 0; axis < 2; axis++)
                shrink_slope(fit, part, axis, larger(shared[part], 1e-12));
        for (int k = 0; k < 3; k++)
            fit->centers[k] *= fit->uneven > MUCH_UNEVEN ? fit->uneven : even;
    }
}

/* How much tells for a kind: the likelihood of its fit, of which a fifth counts, since residuals of neighbors are alike, and
   less the wider the blur, which makes more of them alike; and its blur, which all dots of one lens have but for 6 %: behind a
   blur as wide as a ring's ink, a disk with another blur looks the same. With a fifth for all, one of 24 blurred markers had its
   ring elsewhere. */
static double kind_evidence(const Fit *fit, double blur)
{
    if (!fit->tried)
        return -1e6;
    const double narrow = 0.8 / fit->p[BLUR], share = 0.1 * (narrow < 1 ? narrow * narrow : 1);
    const double away = !fit->good ? 6 : blur > 0 ? (fit->p[BLUR] - blur) / (0.06 * blur) : 0;
    return -share * (fit->misfit < 1e5 ? fit->misfit : 1e5) - 0.5 * (away * away < 36 ? away * away : 36);
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
            const double disk = kind_evidence(fits + 2 * i, fits[k].p[BLUR]), ring = kind_evidence(fits + 2 * i + 1, fits[k].p[BLUR]);
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

/* Standard deviation of a center along each axis, px, where the edge is as wide as pixels alone make it, times the square root of
   the mean semi-axis: the series for square pixels leaves so much without noise (0.0026 px at 6 px across, 0.0016 at 15). It
   falls to none between these blurs; of dots of 4 to 14 px with 2 grey levels of noise, squared errors were 1.3 times as large as
   claimed without it. */
static const double SHARP_PX = 0.004, SHARP_BLUR = 0.4, SOFT_BLUR = 0.6;
/* The same of blobs that the border cuts, as a share of what is outside: of 340 fits, half were as far off as they
   say, a tenth by more than 0.05 to 0.2 times what is outside. */
static const double CUT_FITTED = 0.02;

/* Geometric mean of the semi-axes. */
static double size_of(const Fit *fit) { return 1 / sqrt(fit->p[2] * fit->p[4] - fit->p[3] * fit->p[3]); }

static void take_fit(const Image *image, const Fit *fit, double unlit, Blob *blob)
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
    blob->other = fit->other;
    blob->state = FITTED;
    const double sharp = SHARP_PX * within((SOFT_BLUR - blob->blur) / (SOFT_BLUR - SHARP_BLUR), 0, 1);
    less_sure(blob, 2 * sharp * sharp / (blob->semi[0] + blob->semi[1]) + pow(CUT_FITTED * cut_px(image, blob), 2));
}

static void refuse(Blob *blob)
{
    const double variance = larger((blob->covariance[0] + blob->covariance[2]) / 2, ROUGH_PX * ROUGH_PX);
    blob->covariance[0] = blob->covariance[2] = variance;
    blob->covariance[1] = 0;
    blob->state = REFUSED;
}

/* Whether a hole in the middle is neither seen nor excluded. */
static int is_unknown(const Blob *blob) { return blob->hole > DISK_BELOW && blob->hole < RING_ABOVE; }

/* Whether a blob is then too small, as a disk, to be fitted as a ring. */
static int is_tiny(const Blob *blob)
{
    return is_unknown(blob) && blob->semi[1] * (blob->hole > 0.5 ? blob->other : 1) < TINY_BLURS * blob->blur;
}

int fit_blobs(const Image *image, const Camera *camera, Blob *blobs, const int64_t *which, int64_t count)
{
    if (!count)
        return 0;
    const double plain = grey_noise(image);
    Fit *fits = malloc(2 * sizeof *fits * (size_t)count);
    Descent *dot = calloc(1, sizeof *dot);
    int64_t good = 0;
    int status = fits && dot && plain >= 0 ? 0 : NO_MEMORY;
    if (!status) {
        /* The light scales what is reflected: an inverted image is reckoned from its highest level. */
        dot->unlit = image->inverted ? image->wide ? UINT16_MAX : UINT8_MAX : 0;
        dot->image_noise = larger(MOST_NOISE * plain + 0.5, sqrt(QUANTIZATION));
    }
    for (int64_t i = 0; i < count && status >= 0; i++) {
        const Blob *blob = blobs + which[i];
        const int tiny = is_tiny(blob), likely = blob->hole > 0.5 && !tiny;
        const int doubtful = !tiny && (is_unknown(blob) || blob->semi[1] < TOLD_BLURS * blob->blur);
        /* Both kinds are fitted to the same pixels. */
        for (int ring = 0; ring < 2 && status >= 0; ring++) {
            Fit *fit = fits + 2 * i + ring;
            fit->good = 0;
            fit->tried = ring == likely || doubtful;
            if (fit->tried) {
                status = fit_blob(dot, image, camera, blob, ring, ring || doubtful, fit);
                fit->good = status > 0;
            }
        }
    }
    const double blur = status < 0 ? 0 : common_blur(fits, count);
    for (int64_t i = 0; i < count && status >= 0; i++) {
        const Fit *disk = fits + 2 * i, *ring = disk + 1;
        const Blob *blob = blobs + which[i];
        const int tiny = is_tiny(blob);
        const double rough = tiny ? 0 : 18 * (blob->hole - 0.5);
        double log_ratio = disk->tried && ring->tried ? kind_evidence(ring, blur) - kind_evidence(disk, blur) : rough;
        /* What is no wider than this shows no hole, whatever fits say. */
        if (blob->semi[1] < SHOWN_BLURS * (blur > 0 ? blur : blob->blur))
            log_ratio = log_ratio > 1 ? 1 : log_ratio < -1 ? -1 : log_ratio;
        Fit chosen = ring->good && (log_ratio > 0 || !disk->good) ? *ring : *disk;
        if (!chosen.good)
            continue;
        chosen.blob = which[i];
        chosen.hole = 0.5 + (log_ratio > 9 ? 9 : log_ratio < -9 ? -9 : log_ratio) / 18; /* as label.c reads it */
        if (tiny)
            chosen.other = blob->hole > 0.5 ? 1 / blob->other : blob->other;
        else
            chosen.other = disk->good && ring->good ? size_of(chosen.ring ? disk : ring) / size_of(&chosen) : 1;
        fits[good++] = chosen;
    }
    status = status < 0 ? NO_MEMORY : 0;
    if (!status) {
        for (int64_t i = 0; i < count; i++)
            refuse(blobs + which[i]);
        shrink_slopes(fits, good);
        for (int64_t i = 0; i < good; i++)
            if (fits[i].centers[0] + fits[i].centers[2] < MAX_SIGMA * MAX_SIGMA)
                take_fit(image, fits + i, dot->unlit, blobs + fits[i].blob);
    }
    if (dot) {
        free(dot->pixels[0]);
        free(dot->sector);
    }
    free(dot);
    free(fits);
    return status;
}

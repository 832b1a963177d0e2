/* Reads a square tag at its known place: where its dots are found, nothing is left to search.

   All of it is in cells of the place, u right and v down from the top left corner of the black square: the border is the
   outermost ring of 0 <= u, v <= n, the quiet zone the ring around that. The square's edges are moved to where they are
   seen; then each inner cell is compared with the levels of border and quiet zone near it, and the code with the largest
   likelihood is taken. */

#include "numbers.h"

enum { MOST_CELLS = 10, TONES = MOST_CELLS + 2, PROFILES = 16, STEPS = 8, ORIENTATIONS = 8, BYTES = 8 };

/* Half the length of a profile across an edge: in cells, short of the next edge by its blur; px, as long as the blur of
   images in which tags are read. */
static const double PROFILE_CELLS = 0.7, PROFILE_PX = 6;
/* Samples within a cell lie on 3 x 3 places this far apart, cells: farther out, blur and an inexact place count. */
static const double SPREAD = 0.2;
/* Standard deviation of blur, pixels and interpolation together, px. At cells of 2 px, 4 x 4 bits read in 97 % of views over
   the usual poses, in 91 % if blur is not taken back; at cells of 1.5 px in 85 and 53 %, with fewer wrong. */
static const double BLUR_PX = 0.9;
/* Step from border to quiet zone: a share of the median below which it is not seen; the share of such cells that makes a tag
   covered; noise of a cell's mean that hides it. */
static const double STEP_SHARE = 0.3, COVERED_SHARE = 0.3, FAINT = 3;
/* Standard deviation of a cell's darkness, from 0 for light to 1 for dark, beside that of noise; the most that a cell says,
   log of 100 to 1: it may be dirty. */
static const double UNEVEN = 0.2, CERTAIN = 4.6;
/* Least share of cells that something covers, as light as any. */
static const double DIRTY = 0.05, PI = 3.14159265358979323846;
/* Log likelihood ratio at which a code is taken, about two cells', and that of mirrored tags before anything is seen: several
   families have tags that are others' mirror images. */
static const double STANDS_OUT = 9, RARELY_MIRRORED = -4.7;
/* RMS of darkness about the code from which on that ratio shrinks. Right readings are below it in 90 % of views at cells of 2 px
   and 0.7 px of blur; without it, those at 2 px of blur are wrong in 10 % at cells below 2 px. */
static const double MISFIT = 0.25;
/* One of this many cells may be wrong. */
enum { CELLS_PER_ERROR = 12 };

typedef struct {
    const Image *image;
    const Camera *camera;
    int64_t n;                           /* cells along a side */
    double focal, corner[3], cell[2][3]; /* of the pose; top left corner, and one cell to the right and down from it: camera's frame */
    double side[4][2];                   /* top, right, bottom, left: cells by which the edge is farther in v or u, at 0 and n */
    double tone[TONES][TONES];           /* mean grey level of cells, by row and column from -1; nan outside the image */
} View;

/* Grey level between pixels, nan outside the image. */
static double level(const Image *image, double x, double y)
{
    if (!(x >= 0 && y >= 0 && x <= (double)(image->width - 1) && y <= (double)(image->height - 1)))
        return NAN;
    int64_t column = (int64_t)x, row = (int64_t)y;
    double a = x - (double)column, b = y - (double)row, p[4];
    int64_t right = column + 1 < image->width ? column + 1 : column;
    const uint8_t *upper = image->rows + row * image->stride;
    const uint8_t *lower = row + 1 < image->height ? upper + image->stride : upper;
    if (image->wide) {
        const uint16_t *up = (const uint16_t *)(const void *)upper, *low = (const uint16_t *)(const void *)lower;
        p[0] = up[column], p[1] = up[right], p[2] = low[column], p[3] = low[right];
    } else {
        p[0] = upper[column], p[1] = upper[right], p[2] = lower[column], p[3] = lower[right];
    }
    double grey = (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * p[2] + a * p[3]);
    return image->inverted ? (image->wide ? 65535.0 : 255.0) - grey : grey;
}

/* Pixel of a place in cells; nan where there is none. */
static void pixel_of(const View *view, double u, double v, double *pixel)
{
    double X[3], ray[2];
    for (int k = 0; k < 3; k++)
        X[k] = view->corner[k] + u * view->cell[0][k] + v * view->cell[1][k];
    for (int k = 0; k < 2; k++)
        ray[k] = X[2] > 0 ? view->focal * X[k] / X[2] : NAN;
    lens_pixel(view->camera, ray, pixel, NULL);
}

/* Farther in v at the top or bottom edge, in u at the right or left one, in cells, at a place along it. */
static double moved(const View *view, int side, double along)
{
    double share = along / (double)view->n;
    return (1 - share) * view->side[side][0] + share * view->side[side][1];
}

/* Pixel of a place in the square as its edges were found. */
static void seen_at(const View *view, double u, double v, double *pixel)
{
    double x = u / (double)view->n, y = v / (double)view->n;
    pixel_of(view, u + (1 - x) * moved(view, 3, v) + x * moved(view, 1, v),
             v + (1 - y) * moved(view, 0, u) + y * moved(view, 2, u), pixel);
}

/* Moves one edge to where it is seen: across it at places along it, with light and dark the means at the profile's ends, it is
   where an ideal step has the profile's sum. A line is fitted through these places, without those far from it. */
static void move_edge(View *view, int side, int fine)
{
    double n = (double)view->n, outer = side == 0 || side == 3 ? 0 : n, outward = outer > 0 ? 1 : -1;
    double along[PROFILES], farther[PROFILES], steps[PROFILES], sorted[PROFILES];
    int count = 0;
    for (int k = 0; k < PROFILES; k++) {
        double t = 0.6 + (n - 1.2) * k / (PROFILES - 1), edge = outer + moved(view, side, t), values[2 * STEPS + 1];
        double half = PROFILE_CELLS * outward, p[2], q[2], ends[2] = {0, 0}, sum = 0;
        pixel_of(view, side % 2 ? edge - half : t, side % 2 ? t : edge - half, p);
        pixel_of(view, side % 2 ? edge + half : t, side % 2 ? t : edge + half, q);
        double x = (p[0] + q[0]) / 2, y = (p[1] + q[1]) / 2, dx = (q[0] - p[0]) / 2, dy = (q[1] - p[1]) / 2;
        double length = hypot(dx, dy), shrunk = fine && length > PROFILE_PX ? PROFILE_PX / length : 1;
        half = PROFILE_CELLS * shrunk;
        for (int i = 0; i <= 2 * STEPS; i++) {
            double w = shrunk * (i - STEPS) / STEPS;
            values[i] = level(view->image, x + w * dx, y + w * dy);
            sum += values[i];
        }
        for (int i = 0; i < 3; i++)
            ends[0] += values[i] / 3, ends[1] += values[2 * STEPS - i] / 3;
        double step = ends[1] - ends[0];
        if (!(step > 0) || !isfinite(sum))
            continue;
        /* Dark over a length a, light over the rest: sum / steps = (dark a + light (2 half - a)) / (2 half). */
        double dark = 2 * half * (ends[1] - sum / (2 * STEPS + 1)) / step;
        if (!(dark > 0.1 * half && dark < 1.9 * half))
            continue;
        along[count] = t, farther[count] = outward * (dark - half), sorted[count] = steps[count] = step, count++;
    }
    if (count < PROFILES / 2)
        return;
    double least = median(sorted, count) / 2, a = 0, b = 0, far = INFINITY;
    for (int pass = 0; pass < 3; pass++) {
        double s = 0, st = 0, stt = 0, sw = 0, stw = 0;
        for (int k = 0; k < count; k++) {
            double off = farther[k] - (a + b * along[k]);
            if (steps[k] < least || fabs(off) > far)
                continue;
            s += 1, st += along[k], stt += along[k] * along[k], sw += farther[k], stw += along[k] * farther[k];
        }
        double det = s * stt - st * st;
        if (s < PROFILES / 2 || !(det > 1e-6 * s * stt))
            return;
        a = (stt * sw - st * stw) / det, b = (s * stw - st * sw) / det;
        for (int k = 0; k < count; k++)
            sorted[k] = fabs(farther[k] - (a + b * along[k]));
        far = 3 * fmax(median(sorted, count), 0.005);
    }
    view->side[side][0] += a, view->side[side][1] += a + b * n;
}

/* Takes back what blur has mixed along one axis: with a share a of each neighbor, a cell's level is (1 - 2a) x + a (x- + x+), and
   to first order in a, x is its level plus a / (1 - 4 a) times its difference to both neighbors. */
static void sharpen(View *view, int across)
{
    int64_t n = view->n + 2;
    double p[2], q[2], middle = (double)view->n / 2;
    seen_at(view, across ? 0 : middle, across ? middle : 0, p);
    seen_at(view, across ? (double)view->n : middle, across ? middle : (double)view->n, q);
    double cell = hypot(q[0] - p[0], q[1] - p[1]) / (double)view->n;
    double share = fmin(0.5 * erfc(0.5 * cell / BLUR_PX / sqrt(2)), 0.15), factor = share / (1 - 4 * share);
    for (int64_t i = 0; i < n; i++) {
        double *tone = across ? view->tone[i] : &view->tone[0][i], before = tone[0];
        int64_t step = across ? 1 : TONES;
        for (int64_t k = 1; k < n - 1; k++) {
            double here = tone[k * step];
            tone[k * step] = here + factor * (2 * here - before - tone[(k + 1) * step]);
            before = here;
        }
    }
}

/* Mean grey levels of the inner parts of all cells. */
static void see_cells(View *view)
{
    for (int64_t row = -1; row <= view->n; row++) {
        for (int64_t column = -1; column <= view->n; column++) {
            double sum = 0, u = (double)column + 0.5, v = (double)row + 0.5, p[2], right[2], down[2];
            seen_at(view, u, v, p);
            seen_at(view, u + SPREAD, v, right);
            seen_at(view, u, v + SPREAD, down);
            for (int i = 0; i < 9; i++) {
                double a = i % 3 - 1, b = i / 3 - 1;
                sum += level(view->image, p[0] + a * (right[0] - p[0]) + b * (down[0] - p[0]),
                             p[1] + a * (right[1] - p[1]) + b * (down[1] - p[1]));
            }
            view->tone[row + 1][column + 1] = sum / 9;
        }
    }
    sharpen(view, 0), sharpen(view, 1);
}

/* A step from the border to the quiet zone: place of the border's cell, its level and that beyond; whether it is seen. */
typedef struct {
    double u, v, dark, light;
    int seen;
} Step;

typedef struct {
    int64_t count;
    Step steps[4 * MOST_CELLS];
    double contrast, noise;
} Ring;

/* Returns the state. */
static int see_ring(const View *view, Ring *ring)
{
    int64_t n = view->n, count = 0, changes = 0;
    double sorted[4 * MOST_CELLS], change[4 * MOST_CELLS], last = NAN;
    for (int64_t k = 0; k < 4 * n; k++) {
        /* Around the square, with the corners' cells twice. */
        int64_t side = k / n, i = k % n, edge = side == 1 || side == 2 ? n - 1 : 0, beyond = edge ? n : -1;
        int64_t row = side % 2 ? i : edge, column = side % 2 ? edge : i;
        double dark = view->tone[row + 1][column + 1];
        double light = side % 2 ? view->tone[row + 1][beyond + 1] : view->tone[beyond + 1][column + 1];
        if (!isfinite(light - dark))
            continue;
        ring->steps[count] = (Step){(double)column, (double)row, dark, light, 0};
        sorted[count++] = light - dark;
        if (i && isfinite(last))
            change[changes++] = fabs(light - dark - last);
        last = light - dark;
    }
    if (count < 2 * n || !changes)
        return TAG_OUTSIDE;
    ring->contrast = median(sorted, count);
    /* A change of steps has the variance of four cells: sigma = 1.48 / 2 of its median. */
    ring->noise = 0.74 * median(change, changes);
    if (!(ring->contrast > FAINT * ring->noise && ring->contrast > 1))
        return TAG_FAINT;
    int64_t seen = 0;
    ring->count = count;
    for (Step *step = ring->steps; step < ring->steps + count; step++)
        seen += step->seen = step->light - step->dark >= STEP_SHARE * ring->contrast;
    return (double)(count - seen) > COVERED_SHARE * (double)count ? TAG_COVERED : TAG_READ;
}

/* How dark a cell is, from 0 as the quiet zone to 1 as the border, by the levels of these weighted by 1 / distance^2; and the
   share of steps that are not seen, weighted likewise. */
static double darkness(const View *view, const Ring *ring, int64_t row, int64_t column, double *covered)
{
    double light = 0, dark = 0, total = 0, hidden = 0, tone = view->tone[row + 1][column + 1];
    for (const Step *step = ring->steps; step < ring->steps + ring->count; step++) {
        double x = (double)column - step->u, y = (double)row - step->v, weight = 1 / (x * x + y * y);
        if (step->seen)
            light += weight * step->light, dark += weight * step->dark, total += weight;
        else
            hidden += weight;
    }
    double value = (light - total * tone) / (light - dark);
    *covered = hidden / (hidden + total);
    return isfinite(value) ? value : 0.5;
}

/* Place's cell in which a cell of the tag is seen: mirrored from 4 on, then in quarter turns counterclockwise. */
static int64_t seen_cell(int64_t bits, int orientation, int64_t row, int64_t column)
{
    int64_t y = row, x = orientation < 4 ? column : bits - 1 - column;
    for (int k = 0; k < orientation % 4; k++) {
        int64_t former = y;
        y = bits - 1 - x, x = former;
    }
    return y * bits + x;
}

static int is_black(const TagFamily *family, int64_t id, int64_t k) { return family->codes[id] >> k & 1; }

/* Whether two tags look the same, such as one that is its own mirror image. */
static int same_look(const TagFamily *family, int64_t a, int a_orientation, int64_t b, int b_orientation)
{
    int64_t bits = family->cells - 2, black[MOST_CELLS * MOST_CELLS];
    for (int64_t k = 0; k < bits * bits; k++)
        black[seen_cell(bits, a_orientation, k / bits, k % bits)] = is_black(family, a, k);
    for (int64_t k = 0; k < bits * bits; k++)
        if (black[seen_cell(bits, b_orientation, k / bits, k % bits)] != is_black(family, b, k))
            return 0;
    return 1;
}

/* The code with the largest likelihood of all in four turns, and mirrored. A code's log likelihood is the sum over its black
   cells of min((z - 1/2) / sigma^2, CERTAIN), z their darkness, by tables of its bytes' sums. */
static int decode(const TagFamily *family, const double *dark, double sigma, TagReading *reading)
{
    int64_t bits = family->cells - 2, count = bits * bits, bytes = (count + 7) / 8;
    double table[BYTES][256], black[MOST_CELLS * MOST_CELLS], best = -INFINITY, second = -INFINITY, most = 0;
    int first = 0;
    for (int64_t k = 0; k < count; k++) {
        black[k] = fmin(fmax((dark[k] - 0.5) / (sigma * sigma + UNEVEN * UNEVEN), -CERTAIN), CERTAIN);
        most += fmax(black[k], 0);
    }
    for (int orientation = 0; orientation < ORIENTATIONS; orientation++) {
        if (orientation == 4 && best - second >= STANDS_OUT && best - (most + RARELY_MIRRORED) >= STANDS_OUT)
            break; /* no mirrored tag can come near */
        double turned[8 * BYTES] = {0};
        for (int64_t k = 0; k < count; k++)
            turned[k] = black[seen_cell(bits, orientation, k / bits, k % bits)];
        for (int64_t k = 0; k < bytes; k++) {
            table[k][0] = k ? 0 : (orientation < 4 ? 0 : RARELY_MIRRORED);
            for (int byte = 1; byte < 256; byte++) {
                int bit = 0;
                while (!(byte >> bit & 1))
                    bit++;
                table[k][byte] = table[k][byte & (byte - 1)] + turned[8 * k + bit];
            }
        }
        for (int64_t i = 0; i < family->count; i++) {
            uint64_t code = family->codes[i];
            double sum = 0;
            for (int64_t k = 0; k < bytes; k++)
                sum += table[k][code >> (8 * k) & 255];
            if (sum > best)
                second = best, best = sum, reading->id = i, first = orientation;
            else if (sum > second && !(orientation > 3 && same_look(family, reading->id, first, i, orientation)))
                second = sum;
        }
    }
    reading->rotation = first % 4, reading->mirrored = first / 4;
    if (reading->id < 0)
        return 0;
    double loss = 0, misfit = 0;
    for (int64_t k = 0; k < count; k++) {
        int64_t at = seen_cell(bits, first, k / bits, k % bits);
        double sign = is_black(family, reading->id, k) ? 1 : -1, off = dark[at] - 0.5 - sign / 2;
        loss += fmax(-sign * black[at], 0), misfit += off * off / (double)count;
    }
    /* Cells that are neither dark nor light say less. */
    return (best - second) * fmin(1, MISFIT * MISFIT / misfit) >= STANDS_OUT && loss <= CERTAIN * (double)count / CELLS_PER_ERROR;
}

int read_tag(const Image *image, const Camera *camera, const Pose *pose, const double (*corners)[3],
             const TagFamily *family, double least_px, TagReading *reading)
{
    View view = {.image = image, .camera = camera, .n = family->cells, .focal = pose->focal};
    Ring ring;
    double dark[MOST_CELLS * MOST_CELLS], place[4][2], seen[4][3], area = 0, longest = 0;
    const int64_t n = family->cells;
    *reading = (TagReading){.id = -1, .state = TAG_OUTSIDE};
    if (n < 3 || n > MOST_CELLS)
        return 0;
    for (int k = 0; k < 4; k++)
        rotated(pose->R, corners[k], seen[k]);
    for (int a = 0; a < 3; a++) {
        view.corner[a] = seen[0][a] + pose->t[a];
        view.cell[0][a] = (seen[1][a] - seen[0][a]) / (double)n;
        view.cell[1][a] = (seen[3][a] - seen[0][a]) / (double)n;
    }
    for (int k = 0; k < 4; k++) {
        const double u = k == 1 || k == 2 ? (double)n : 0, v = k > 1 ? (double)n : 0;
        pixel_of(&view, u > 0 ? u + 1 : -1, v > 0 ? v + 1 : -1, place[k]); /* of the quiet zone */
        if (!isfinite(place[k][0]))
            return 0;
        pixel_of(&view, u, v, place[k]);
    }
    for (int k = 0; k < 4; k++) {
        const double *p = place[k], *q = place[(k + 1) % 4];
        area += (p[0] * q[1] - p[1] * q[0]) / 2, longest = fmax(longest, hypot(q[0] - p[0], q[1] - p[1]));
    }
    memcpy(reading->corners, place, sizeof place);
    reading->state = TAG_SMALL;
    if (!(fabs(area) / (double)n >= least_px * longest) || !(longest > 0))
        return 0;
    for (int side = 0; side < 8; side++)
        move_edge(&view, side % 4, side > 3);
    for (int k = 0; k < 4; k++)
        seen_at(&view, k == 1 || k == 2 ? (double)n : 0, k > 1 ? (double)n : 0, reading->corners[k]);
    see_cells(&view);
    reading->state = see_ring(&view, &ring);
    if (reading->state != TAG_READ && reading->state != TAG_COVERED)
        return 0;
    const double sigma = ring.noise / ring.contrast, wide = sigma * sigma + UNEVEN * UNEVEN;
    for (int64_t row = 1; row < n - 1; row++)
        for (int64_t column = 1; column < n - 1; column++) {
            const int64_t k = (row - 1) * (n - 2) + column - 1;
            double covered;
            dark[k] = darkness(&view, &ring, row, column, &covered);
            covered = fmax(covered, DIRTY);
            for (int black = 0; black < 2; black++) {
                const double off = dark[k] - black;
                reading->cells[black][k] = (1 - covered) * exp(-0.5 * off * off / wide) / sqrt(2 * PI * wide) + covered / 2;
            }
        }
    if (reading->state == TAG_READ && !decode(family, dark, sigma, reading))
        reading->state = TAG_UNCLEAR, reading->id = -1;
    return reading->state == TAG_READ;
}

double agreement(const TagFamily *family, const TagReading *reading, int64_t code)
{
    const int64_t inner = (family->cells - 2) * (family->cells - 2);
    const double *light = reading->cells[0], *black = reading->cells[1];
    double sum = 0;
    for (int64_t k = 0; k < inner && light[0] > 0; k++)
        sum += log(2 * (is_black(family, code, k) ? black[k] : light[k]) / (light[k] + black[k]));
    return sum;
}

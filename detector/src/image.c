/* From grey levels to rough ellipses: an image pyramid, its dark components, the edges around them, and what is behind
   blurred outlines. */

#include "detector.h"
#include "lanes.h"

static const double PI = 3.14159265358979323846;

/* What is no number becomes `low`: places in the image follow from this. */
static inline double between(double x, double low, double high) { return x > low ? x < high ? x : high : low; }

/* ---- grey levels ---- */

double order_statistic(double *values, int64_t count, int64_t k)
{
    int64_t low = 0, high = count - 1;
    while (low < high) {
        const double pivot = values[(low + high) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i <= j) {
                const double swapped = values[i];
                values[i++] = values[j];
                values[j--] = swapped;
            }
        }
        if (k <= j)
            high = j;
        else if (k >= i)
            low = i;
        else
            break;
    }
    return count ? values[k] : 0;
}

/* Halving the range takes a dozen passes without a branch that depends on the numbers: for hundreds, a third of the time of
   order_statistic. */
double ranked(float *values, int64_t count, int64_t k)
{
    Lanes most = all(0), least = all(INFINITY);
    write(values + count, most);
    for (int64_t i = 0; i < count; i += LANES)
        most = most_of(most, read(values + i));
    write(values + count, least);
    /* As many are below `low` and below `high`. */
    float low = 0, high = 2 * largest_of(most) + 1e-6f;
    int64_t under = 0, over = count;
    while (over - under > 1) {
        const float middle = low + (high - low) / 2;
        Flags below = {0};
        if (!(middle > low && middle < high))
            break;
        for (int64_t i = 0; i < count; i += LANES)
            below -= read(values + i) < middle;
        const int64_t number = below[0] + below[1] + below[2] + below[3];
        if (number <= k) {
            low = middle;
            under = number;
        } else {
            high = middle;
            over = number;
        }
    }
    for (int64_t i = 0; i < count; i += LANES) {
        const Lanes four = read(values + i);
        least = least_of(least, pick(four < low, all(INFINITY), four));
    }
    return count ? (double)-largest_of(-least) : 0;
}

/* Pieces of this many pixels in a row, in this many rows at least, of which those at this quantile show plain paper, if
   anything does. */
enum { PIECE = 32, PIECE_ROWS = 32 };
static const double PLAIN = 0.2;

double grey_noise(const Image *image)
{
    const int64_t pieces = image->width / PIECE, by_rows = image->height / PIECE_ROWS, every = by_rows > 8 ? by_rows : 8;
    float *sums = malloc(sizeof *sums * (size_t)(pieces * (image->height / every + 1) + 1 + LANES));
    int64_t count = 0;
    if (!sums)
        return NO_MEMORY;
    for (int64_t y = 0; y < image->height; y += every) {
        const uint8_t *row = image->rows + y * image->stride;
        for (int64_t x = 0; x < PIECE * pieces; x += PIECE) {
            double sum = 0;
            if (image->wide) {
                uint16_t p[PIECE];
                memcpy(p, row + 2 * x, sizeof p);
                for (int i = 0; i < PIECE - 1; i++)
                    sum += (double)(p[i + 1] - p[i]) * (double)(p[i + 1] - p[i]);
            } else {
                const uint8_t *p = row + x;
                int32_t whole = 0;
                for (int i = 0; i < PIECE - 1; i++) {
                    const int16_t difference = (int16_t)(p[i + 1] - p[i]);
                    whole += difference * difference;
                }
                sum = whole;
            }
            /* Saturated pieces show no noise. */
            sums[count] = (float)sum;
            count += sum > 0;
        }
    }
    const double square = ranked(sums, count, (int64_t)(PLAIN * (double)count));
    free(sums);
    return sqrt(square / (PIECE - 1) / 2);
}

/* ---- pyramid ---- */

/* Shorter side of the smallest level, and size of the largest one, px: time and memory. Dots of 5 px and more are found in a
   level of their size. */
enum { MIN_SIDE = 48, MAX_PIXELS = 40000000, LEAST_DOT = 5, LEVELS = 32 };

/* The levels are of 8 bits: 0 stands for the grey level `low`, 1 for `unit` more. Pixels of level i are 2^i px wide. */
typedef struct {
    Image level[LEVELS];
    int first, end;
    double low, unit;
    uint8_t *memory;
} Pyramid;

static uint16_t wide_level(const Image *image, int64_t x, int64_t y)
{
    uint16_t level;
    memcpy(&level, image->rows + y * image->stride + 2 * x, 2);
    return (uint16_t)(image->inverted ? UINT16_MAX - level : level);
}

/* The lowest level and the range to map to 8 bits. Of 16 bits, a thousandth is cut off at either end, of so many pixels. */
enum { RANGE_PIXELS = 100000 };

static int set_range(const Image *image, Pyramid *p)
{
    const int64_t every = 1 + (int64_t)sqrt((double)(image->height * image->width) / RANGE_PIXELS);
    int64_t count = 0;
    p->low = 0;
    p->unit = 1;
    if (!image->wide)
        return 0;
    double *levels = malloc(sizeof *levels * (size_t)((image->height / every + 1) * (image->width / every + 1)));
    if (!levels)
        return NO_MEMORY;
    for (int64_t y = 0; y < image->height; y += every)
        for (int64_t x = 0; x < image->width; x += every)
            levels[count++] = wide_level(image, x, y);
    p->low = order_statistic(levels, count, count / 1000);
    p->unit = larger(order_statistic(levels, count, count - 1 - count / 1000) - p->low, 255) / 255;
    free(levels);
    return 0;
}

/* Row y of an image in 8 bits. */
static void read_row(const Image *image, const Pyramid *p, int64_t y, uint8_t *restrict to)
{
    const float low = (float)p->low, scale = (float)(1 / p->unit);
    const uint8_t *row = image->rows + y * image->stride;
    for (int64_t x = 0; x < image->width; x++)
        if (image->wide) {
            const float level = ((float)wide_level(image, x, y) - low) * scale;
            to[x] = (uint8_t)(level > 0 ? level < 255 ? level : 255 : 0);
        } else
            to[x] = (uint8_t)(UINT8_MAX - row[x]);
}

/* Means of 2 x 2 pixels of two rows, halves rounded up. */
static void halve(const uint8_t *restrict a, const uint8_t *restrict b, uint8_t *restrict to, int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        uint16_t above, below;
        memcpy(&above, a + 2 * x, 2);
        memcpy(&below, b + 2 * x, 2);
        to[x] = (uint8_t)((uint16_t)((above & UINT8_MAX) + (above >> 8) + (below & UINT8_MAX) + (below >> 8) + 2) >> 2);
    }
}

/* Row y of a level: from the finer one where that is kept, else from rows made in `spare`, so that an image of which only
   coarse levels are used is read once. */
static void make_row(const Image *image, const Pyramid *p, int level, int64_t y, uint8_t *spare, uint8_t *to)
{
    const uint8_t *pair[2];
    if (!level) {
        read_row(image, p, y, to);
        return;
    }
    const Image *finer = p->level + level - 1;
    for (int k = 0; k < 2; k++) {
        pair[k] = finer->rows + (2 * y + k) * finer->stride;
        if (!finer->rows) {
            uint8_t *row = spare + k * finer->width;
            make_row(image, p, level - 1, 2 * y + k, spare + 2 * finer->width, row);
            pair[k] = row;
        }
    }
    halve(pair[0], pair[1], to, finer->width / 2);
}

/* An odd column or row at the far edges of a level is left out of the next. One more than those that are searched gives the
   means around the pixels of the coarsest. */
static int build_pyramid(const Image *image, double smallest, Pyramid *p)
{
    const int copied = image->wide || image->inverted;
    int64_t height = image->height, width = image->width, pixels = 0, shorter = height < width ? height : width;
    p->first = p->end = 0;
    p->memory = NULL;
    while ((smallest >= ldexp(2 * LEAST_DOT, p->first) || height * width > (int64_t)MAX_PIXELS << (2 * p->first)) &&
           (shorter >> p->first) >= 2 * MIN_SIDE)
        p->first++;
    if (set_range(image, p))
        return NO_MEMORY;
    for (int i = 0;; i++, height /= 2, width /= 2) {
        p->level[i] = (Image){NULL, height, width, width, 0, 0};
        pixels += i < p->first || (i == 0 && !copied) ? 0 : height * width;
        if (p->end)
            break;
        p->end = (height < width ? height : width) < 2 * MIN_SIDE ? i + 1 : 0;
    }
    p->memory = malloc((size_t)(pixels + 4 * image->width + 1));
    if (!p->memory)
        return NO_MEMORY;
    uint8_t *place = p->memory, *spare = place + pixels;
    if (!copied)
        p->level[0] = *image;
    for (int i = copied ? p->first : p->first > 1 ? p->first : 1; i <= p->end; i++) {
        Image *level = p->level + i;
        for (int64_t y = 0; y < level->height; y++)
            make_row(image, p, i, y, spare, place + y * level->width);
        level->rows = place;
        place += level->height * level->width;
    }
    return 0;
}

/* ---- dark components ----

   A pixel p is dark if m - p > step, with m the mean of the 14 x 14 pixels around it, those beyond the image's edge repeated
   from the edge: of 7 x 7 of the next coarser level, which is a quarter of the work. Dark pixels that share a side are of one
   component. The window is wider than a blurred edge, narrow compared to a dot's surroundings; the inside of a larger dot does
   not differ from its mean, but a closed band along its edge does.

   One pass, row by row. A row's runs of dark pixels join the components of the runs that they touch in the row above.
   A component without a run in a row is complete, and its place is used again: memory is that of a few rows. */

enum { HALF = 3 };

/* Least depth below the local mean of dark pixels: in grey levels of the finest level, which has most of the texture, and of
   the others; and as a multiple of the noise. */
static const double MIN_DEPTH[2] = {6, 3}, DEPTH_SIGMA = 3.5;
/* Noise above which the image is smoothed first, grey levels: smoothing closes gaps of a pixel or two. */
static const double SMOOTH_ABOVE = 3;
/* Least number of pixels. */
enum { LEAST_PIXELS = 7 };
static const double MAX_ELONGATION = 12;
/* Maximum distance of the box's sides from the outline's, px and as a share of its half width. Disks and bands with a
   fifth of their outline hidden have less, squares up to 0.22. */
static const double BOX_PX = 0.5, BOX_SHARE = 0.12;

typedef struct {
    int32_t first, last, component;
} Run;

/* Sums over its pixels: 1, x, y, x^2, xy, y^2. */
typedef struct {
    double pixels, x, y, xx, xy, yy;
    int32_t left, right, top, bottom; /* the last one -1 for one that is free */
    int32_t into; /* itself, or the component that it was joined to; the next free one */
} Component;

/* An even edge in pixels and grey levels of a level of the pyramid; of a component, the outline alone. That is an ellipse by its
   center and the symmetric matrix whose product with the unit circle is its outline relative to it: points (x + a u + b v, y +
   b u + c v), e = x, y, a, b, c. */
typedef struct {
    double e[5];
    double light, step, uneven, rms; /* level outside; median step; its unevenness; distance of the edge from the ellipse */
    double slope, middle;            /* difference of the mean levels 1 px outside and inside; level in the middle */
    double inverse[3];               /* of the center's covariance if every crossing's variance were 1 */
    double side;                     /* of the level's pixels, px of the image */
} Edge;

typedef struct {
    Edge *all;
    int64_t count, room;
} Edges;

static int add_edge(Edges *list, const Edge *edge)
{
    if (list->count == list->room) {
        const int64_t room = 2 * list->room + 256;
        Edge *more = realloc(list->all, sizeof *more * (size_t)room);
        if (!more)
            return NO_MEMORY;
        list->all = more;
        list->room = room;
    }
    list->all[list->count++] = *edge;
    return 0;
}

static int32_t final(const Component *all, int32_t i)
{
    while (all[i].into != i)
        i = all[i].into;
    return i;
}

static void join(Component *a, const Component *b)
{
    a->pixels += b->pixels;
    a->x += b->x;
    a->y += b->y;
    a->xx += b->xx;
    a->xy += b->xy;
    a->yy += b->yy;
    a->left = b->left < a->left ? b->left : a->left;
    a->right = b->right > a->right ? b->right : a->right;
    a->top = b->top < a->top ? b->top : a->top;
    a->bottom = b->bottom > a->bottom ? b->bottom : a->bottom;
}

static int touches(double place, double side, double half)
{
    const double slack = BOX_PX + BOX_SHARE * half;
    /* The outermost pixels end half a pixel beyond their centers. */
    return fabs(place + 0.5 - half) < slack && fabs(side + 0.5 - place - half) < slack;
}

/* Whether a component has the moments and the box of an elliptic disk, ring or band, and its outline. Area n and covariance
   C give size and hole: with the semi-axes a and b of the outline and k times that of the hole, n = pi a b (1 - k^2) and C =
   S (1 + k^2) / 4, where S is the outline's spread. So with D = sqrt(det 4 C), 1 + k^2 = 2 pi D / (n + pi D), which is from
   1 for disks to 2 for thin bands. */
static int is_elliptic(const Component *c, Edge *outline)
{
    const double pixels = c->pixels, x = c->x / pixels, y = c->y / pixels;
    /* Pixels are squares. */
    const double xx = c->xx / pixels - x * x + 1. / 12, xy = c->xy / pixels - x * y, yy = c->yy / pixels - y * y + 1. / 12;
    const double determinant = xx * yy - xy * xy;
    const double mean = 4 * PI * sqrt(determinant), area = (pixels + mean) / 2, hollow = mean / area;
    const double elongation = MAX_ELONGATION + 1 / MAX_ELONGATION;
    if (!((xx + yy) * (xx + yy) < elongation * elongation * determinant))
        return 0;
    if (!touches(x - c->left, c->right - c->left, 2 * sqrt(xx / hollow)) ||
        !touches(y - c->top, c->bottom - c->top, 2 * sqrt(yy / hollow)))
        return 0;
    /* The root of the spread. */
    const double scale = 4 / hollow, root = scale * sqrt(larger(determinant, 1e-12));
    const double size = sqrt(scale * (xx + yy) + 2 * root);
    *outline = (Edge){.e = {x, y, (scale * xx + root) / size, scale * xy / size, (scale * yy + root) / size}};
    return 1;
}

/* The 3 x 3 binomial mean of row y; rows and columns mirrored about the outermost ones. */
static void smooth_row(const Image *image, int64_t y, uint16_t *sums, uint8_t *to)
{
    const int64_t height = image->height, width = image->width;
    const uint8_t *row = image->rows + y * image->stride;
    const uint8_t *above = y > 0 ? row - image->stride : row + image->stride;
    const uint8_t *below = y + 1 < height ? row + image->stride : row - image->stride;
    for (int64_t x = 0; x < width; x++)
        sums[x + 1] = (uint16_t)(above[x] + 2 * row[x] + below[x]);
    sums[0] = sums[2];
    sums[width + 1] = sums[width - 1];
    for (int64_t x = 0; x < width; x++)
        to[x] = (uint8_t)((sums[x] + 2 * sums[x + 1] + sums[x + 2] + 8) >> 4);
}

/* The sums of the columns of the 7 rows of the coarser level around the present one, with HALF more at either end, and the
   means around its pixels less the step. */
typedef struct {
    const Image *coarse;
    int64_t row;
    uint16_t *sums;
    uint8_t *limits;
    int step;
} Window;

/* Limits around the pixels of row y of the coarser level, each written twice. */
static void move_down(Window *w, int64_t y)
{
    const int64_t height = w->coarse->height, width = w->coarse->width;
    uint16_t *restrict middle = w->sums + HALF;
    uint8_t *restrict limits = w->limits;
    const uint16_t step = (uint16_t)w->step;
    if (w->row < 0)
        for (int64_t i = -HALF; i <= HALF; i++) {
            const uint8_t *row = w->coarse->rows + w->coarse->stride * (i < 0 ? 0 : i < height ? i : height - 1);
            for (int64_t x = 0; x < width; x++)
                middle[x] = (uint16_t)(middle[x] + row[x]);
        }
    else {
        const uint8_t *in = w->coarse->rows + w->coarse->stride * (y + HALF < height ? y + HALF : height - 1);
        const uint8_t *out = w->coarse->rows + w->coarse->stride * (y - HALF - 1 > 0 ? y - HALF - 1 : 0);
        for (int64_t x = 0; x < width; x++)
            middle[x] = (uint16_t)(middle[x] + in[x] - out[x]);
    }
    w->row = y;
    for (int64_t i = 0; i < HALF; i++) {
        w->sums[i] = middle[0];
        middle[width + i] = middle[width - 1];
    }
    const uint16_t *s = w->sums;
    for (int64_t x = 0; x < width; x++) {
        /* 1338 / 2^16 is 1/49. */
        const uint16_t sum = (uint16_t)(s[x] + s[x + 1] + s[x + 2] + s[x + 3] + s[x + 4] + s[x + 5] + s[x + 6] + 24);
        const uint16_t mean = (uint16_t)((uint32_t)(sum * 1338) >> 16), limit = (uint16_t)(mean > step ? mean - step : 0);
        const uint16_t twice = (uint16_t)(limit | limit << 8);
        memcpy(limits + 2 * x, &twice, 2);
    }
    limits[2 * width] = limits[2 * width - 1];
}

/* 1 where a pixel is darker than the limit, else 0. */
static void mark_dark(uint8_t *restrict dark, const uint8_t *restrict limits, const uint8_t *restrict row, int64_t width)
{
    for (int64_t x = 0; x < width; x++)
        dark[x] = row[x] < limits[x];
}

/* Columns where ones begin and where they end, in turn; returns their number, which is even. `dark` has at least 64 zeros
   behind its end. In rows with texture every other branch would be mispredicted, so there is one for 64 pixels. */
static int32_t find_changes(int32_t *changes, const uint8_t *dark, int64_t width)
{
    int32_t count = 0;
    uint64_t before = 0;
    for (int64_t x = 0; x <= width; x += 64) {
        uint64_t eights[8], any = before, bits = 0;
        memcpy(eights, dark + x, sizeof eights);
        for (int i = 0; i < 8; i++)
            any |= eights[i];
        if (!any)
            continue;
        /* Eight bytes to eight bits, the first one the lowest. */
        for (int i = 0; i < 8; i++)
            bits |= (eights[i] * UINT64_C(0x0102040810204080) >> 56) << (8 * i);
        for (uint64_t edges = bits ^ (bits << 1 | before); edges; edges &= edges - 1)
            changes[count++] = (int32_t)(x + __builtin_ctzll(edges));
        before = bits >> 63;
    }
    return count;
}

/* Outlines of the components that could be dots, of the finest level that is searched or another one. */
static int find_components(const Image *image, const Image *coarse, int finest, Edges *edges)
{
    const int64_t height = image->height, width = image->width;
    if (height < 3 || width < 3)
        return 0;
    double noise = grey_noise(image);
    if (noise < 0)
        return NO_MEMORY;
    const int smooth = noise > SMOOTH_ABOVE;
    /* The weights 1/4, 1/2, 1/4 in both directions reduce the noise to 3/8. */
    noise *= smooth ? 3. / 8 : 1;
    const int step = (int)smaller(larger(MIN_DEPTH[!finest], DEPTH_SIGMA * noise), 255);
    const size_t most = (size_t)width / 2 + 1; /* runs in a row */
    Window window = {coarse, -1, calloc((size_t)coarse->width + 2 * HALF, sizeof *window.sums), malloc((size_t)width + 2), step};
    uint16_t *scratch = malloc(((size_t)width + 2) * sizeof *scratch);
    uint8_t *smoothed = malloc((size_t)width + 1), *dark = calloc((size_t)width + 72, 1);
    int32_t *changes = malloc((2 * most + 8) * sizeof *changes);
    Run *above = malloc((most + 1) * sizeof *above), *here = malloc((most + 1) * sizeof *here);
    /* Those of two rows, since a joined one stays until the end of its row. */
    Component *all = malloc(2 * most * sizeof *all);
    int32_t above_count = 0, free_one = -1, used = 0;
    const int enough = window.sums && window.limits && scratch && smoothed && dark && changes && above && here && all;
    int status = enough ? 0 : NO_MEMORY;
    /* One row more, without a dark pixel, completes what is left. */
    for (int64_t y = 0; y <= height && !status; y++) {
        int32_t here_count = 0, i = 0;
        if (y < height) {
            const uint8_t *row = image->rows + y * image->stride;
            const int64_t of_coarse = y / 2 < coarse->height ? y / 2 : coarse->height - 1;
            if (of_coarse != window.row)
                move_down(&window, of_coarse);
            if (smooth)
                smooth_row(image, y, scratch, smoothed);
            mark_dark(dark, window.limits, smooth ? smoothed : row, width);
            here_count = find_changes(changes, dark, width) / 2;
        }
        /* First to which components the runs belong, without the sums, so that mispredicted branches cost little. */
        above[above_count] = (Run){INT32_MAX, INT32_MAX, -1};
        for (int32_t j = 0; j < here_count; j++) {
            const int32_t a = changes[2 * j], b = changes[2 * j + 1] - 1;
            int32_t joined = -1;
            while (above[i].last < a)
                i++;
            for (int32_t k = i; above[k].first <= b; k++) {
                const int32_t other = final(all, above[k].component);
                if (joined < 0)
                    joined = other;
                else if (other != joined) {
                    join(all + joined, all + other);
                    all[other].into = joined;
                }
            }
            if (joined < 0) {
                if (free_one >= 0) {
                    joined = free_one;
                    free_one = all[joined].into;
                } else
                    joined = used++;
                all[joined] = (Component){.left = a, .right = b, .top = (int32_t)y, .into = joined};
            }
            here[j] = (Run){a, b, joined};
        }
        for (int32_t j = 0; j < here_count; j++) {
            const int32_t a = here[j].first, b = here[j].last, component = here[j].component = final(all, here[j].component);
            const double n = b - a + 1, s = a + b, v = (double)y;
            Component *c = all + component;
            c->pixels += n;
            c->x += n * s / 2;
            c->y += n * v;
            c->xx += n * (3 * s * s + n * n - 1) / 12;
            c->xy += n * s * v / 2;
            c->yy += n * v * v;
            c->left = a < c->left ? a : c->left;
            c->right = b > c->right ? b : c->right;
            c->bottom = (int32_t)y;
        }
        /* Those of the row above that do not go on: joined ones, and complete ones. Several runs may refer to one. */
        for (int32_t k = 0; k < above_count; k++) {
            const int32_t component = above[k].component;
            Component *c = all + component;
            Edge outline;
            if (c->bottom == y || c->bottom < 0)
                continue;
            if (c->into == component && c->pixels >= LEAST_PIXELS && is_elliptic(c, &outline) && add_edge(edges, &outline))
                status = NO_MEMORY;
            c->bottom = -1;
            c->into = free_one;
            free_one = component;
        }
        Run *swapped = above;
        above = here;
        here = swapped;
        above_count = here_count;
    }
    free(window.sums);
    free(window.limits);
    free(scratch);
    free(smoothed);
    free(dark);
    free(changes);
    free(above);
    free(here);
    free(all);
    return status;
}

/* ---- edges ----

   Where components have an edge from dark to light all around, of about the same step, the place where the grey level is
   halfway between both sides is found on 24 normals of the outline. An ellipse is fitted to these places, with little
   weight on those that disagree, twice. Up to seven of the 24 may be missing: hidden, in a highlight, or beyond the image's
   edge. Of a sharp dot, center and semi-axes are good to a few hundredths of a pixel. */

enum { NORMALS = 24, EIGHTH = NORMALS / 8, PLACES = 9, ZERO = PLACES / 2, UNKNOWNS = 5 };

/* Places across the outline where its profile is sampled, px. */
static const float PROFILE[PLACES] = {-5, -3, -2, -1, 0, 1, 2, 3, 5};
/* The first, cheap test: 6 of 8 directions have a step of at least 4 grey levels and 0.3 of the mean between pixels inside
   and outside of the outline of a component, which is too large by about a pixel. Of inside, the darker of two places: at
   -2 px alone, of rings with holes of 0.6 and 0.7 and a shorter axis below 6.5 px, 1 to 20 % showed their hole there. */
static const float INSIDE_PX = -2, THIN_PX = -1, OUTSIDE_PX = 1.5f, LEAST_STEP = 4, STEP_SHARE = 0.3f;
enum { LEAST_EIGHTHS = 6 };
/* Normals that must have an edge, of every other one at first, then of all: a quarter or a little more may be hidden,
   washed out by light, or cut off. */
static const float MIN_NORMALS[2] = {9, 17};
/* Minimum step: in grey levels of 8 bits, and, like the inverse of its maximum, relative to the median. */
static const float MIN_STEP = 6, ALIKE = 0.35f;
/* Step below which an edge is faint. */
static const double FAINT = 12;
/* Maximum standard deviation of the step over the normals, without the three least and three largest, over its median, of a
   component's outline and of the ellipse found. In photographs, dots have 0.02, 95 % of them below 0.15; leaves, letters,
   cloth and stones 0.1 to 0.6. */
static const float MAX_UNEVEN[2] = {0.5f, 0.38f};
/* Maximum RMS distance of the edge from the ellipse, px, and what is added for each px of its shorter semi-axis. Dots have
   0.02 to 0.15, clutter 0.1 to 1. */
static const float MAX_RMS[2][2] = {{0.28f, 0.03f}, {0.22f, 0.015f}};
static const float MIN_SEMI = 0.5f;
/* Solutions of least squares, each with weights by the residuals of the one before. */
static const int ROUNDS[2] = {2, 3};
/* Residuals of more than 2.5 times their scale, which is at least 0.04 px, lose most of their weight. */
static const float LEAST_SCALE = 0.04f, SOFT = 2.5f;
/* The middle is the mean of center and eight points at 0.2 of the outline less 0.6 px of its shorter semi-axis, but at 0.05
   at least: where the hole is wide, noise is averaged away. */
static const float MIDDLE_LEAST = 0.05f, MIDDLE_SHARE = 0.2f, MIDDLE_PX = 0.6f;
/* How far from the outline levels are looked at, with room for a fit's moves, px. */
static const double REACH = 8;
/* Distance of an edge that there is not, px. */
static const float NOWHERE = 1e6f;
/* Limits, px, beyond which a rough outline is none. */
static const double SMALLEST_SEMI = 1e-6, FARTHEST = 1e9;

/* Of the normals' angles; the sine is a quarter of them behind. */
static const float COSINE[NORMALS] = {1,      0.96592583f,  0.8660254f,  0.70710678f,  0.5f,  0.25881905f,
                                      0,      -0.25881905f, -0.5f,       -0.70710678f, -0.8660254f, -0.96592583f,
                                      -1,     -0.96592583f, -0.8660254f, -0.70710678f, -0.5f, -0.25881905f,
                                      0,      0.25881905f,  0.5f,        0.70710678f,  0.8660254f,  0.96592583f};

static double shorter_semi(const double *e)
{
    const double half = (e[2] - e[4]) / 2;
    return (e[2] + e[4]) / 2 - sqrt(half * half + e[3] * e[3]);
}

static double mean_semi(const double *e) { return sqrt(e[2] * e[4] - e[3] * e[3]); }

/* Whether an outline has a normal everywhere, and places that are numbers. */
static int is_ellipse(const double *e)
{
    for (int i = 0; i < UNKNOWNS; i++)
        if (!(fabs(e[i]) < FARTHEST))
            return 0;
    return shorter_semi(e) > SMALLEST_SEMI;
}

/* Four ellipses at a time, whose places count from a pixel of each one's: the corner of what is looked at, if all of it is
   `inside` the image. */
typedef struct {
    const uint8_t *at[LANES];
    int64_t stride, x[LANES], y[LANES];
    Flags left, right, top, bottom; /* the image's outermost pixels */
    Lanes e[UNKNOWNS], shorter;
    int inside;
} Four;

static Four four_of(const Image *image, const Edge *edges, int64_t count)
{
    const double right = (double)image->width - 1, bottom = (double)image->height - 1;
    Four f = {.stride = image->stride, .inside = 1};
    double corner[LANES][2];
    for (int k = 0; k < LANES; k++) {
        const double *e = edges[k < count ? k : count - 1].e;
        const double across = sqrt(e[2] * e[2] + e[3] * e[3]) + REACH, down = sqrt(e[3] * e[3] + e[4] * e[4]) + REACH;
        corner[k][0] = e[0] - across;
        corner[k][1] = e[1] - down;
        f.inside &= corner[k][0] >= 0 && corner[k][1] >= 0 && e[0] + across < right && e[1] + down < bottom;
    }
    for (int k = 0; k < LANES; k++) {
        const double *e = edges[k < count ? k : count - 1].e;
        f.x[k] = (int64_t)between(f.inside ? corner[k][0] : e[0], 0, right);
        f.y[k] = (int64_t)between(f.inside ? corner[k][1] : e[1], 0, bottom);
        f.at[k] = image->rows + f.y[k] * image->stride + f.x[k];
        f.left[k] = (int32_t)-f.x[k];
        f.top[k] = (int32_t)-f.y[k];
        f.right[k] = (int32_t)(image->width - 1 - f.x[k]);
        f.bottom[k] = (int32_t)(image->height - 1 - f.y[k]);
        f.e[0][k] = (float)(e[0] - (double)f.x[k]);
        f.e[1][k] = (float)(e[1] - (double)f.y[k]);
        for (int j = 2; j < UNKNOWNS; j++)
            f.e[j][k] = (float)e[j];
        f.shorter[k] = (float)shorter_semi(e);
    }
    return f;
}

static inline Flags clamped(Flags x, Flags low, Flags high)
{
    const Flags under = x < low, over = x > high;
    return (under & low) | (over & high) | (~(under | over) & x);
}

/* The next smaller whole number. */
static inline Flags whole_of(Lanes x)
{
    const Flags whole = __builtin_convertvector(x, Flags);
    return whole + (__builtin_convertvector(whole, Lanes) > x);
}

/* Between four pixels; beyond the image's edge as at the edge. */
static inline Lanes sample(const Four *f, Lanes x, Lanes y)
{
    Flags column = __builtin_convertvector(x, Flags), row = __builtin_convertvector(y, Flags), above, below;
    if (!f->inside) {
        column = clamped(whole_of(x), f->left, f->right - 1);
        row = clamped(whole_of(y), f->top, f->bottom - 1);
        x = most_of(least_of(x, __builtin_convertvector(f->right, Lanes)), __builtin_convertvector(f->left, Lanes));
        y = most_of(least_of(y, __builtin_convertvector(f->bottom, Lanes)), __builtin_convertvector(f->top, Lanes));
    }
    const Lanes right = x - __builtin_convertvector(column, Lanes), down = y - __builtin_convertvector(row, Lanes);
    for (int k = 0; k < LANES; k++) {
        const uint8_t *at = f->at[k] + row[k] * f->stride + column[k];
        uint16_t pair, next;
        memcpy(&pair, at, 2);
        memcpy(&next, at + f->stride, 2);
        above[k] = pair;
        below[k] = next;
    }
    /* The first byte is the lower one. */
    const Flags a = above & UINT8_MAX, c = below & UINT8_MAX;
    const Lanes upper = __builtin_convertvector(a, Lanes) + right * __builtin_convertvector((above >> 8) - a, Lanes);
    const Lanes lower = __builtin_convertvector(c, Lanes) + right * __builtin_convertvector((below >> 8) - c, Lanes);
    return upper + down * (lower - upper);
}

static inline Lanes nearest_pixel(const Four *f, Lanes x, Lanes y)
{
    const Flags column = clamped(whole_of(x + 0.5f), f->left, f->right), row = clamped(whole_of(y + 0.5f), f->top, f->bottom);
    Flags level;
    for (int k = 0; k < LANES; k++)
        level[k] = f->at[k][row[k] * f->stride + column[k]];
    return __builtin_convertvector(level, Lanes);
}

static inline Flags is_within(const Four *f, Lanes x, Lanes y)
{
    return (x >= __builtin_convertvector(f->left, Lanes)) & (x <= __builtin_convertvector(f->right, Lanes)) &
           (y >= __builtin_convertvector(f->top, Lanes)) & (y <= __builtin_convertvector(f->bottom, Lanes));
}

static inline void outline_point(const Four *f, int normal, Lanes *place, Lanes *direction)
{
    const float u = COSINE[normal], v = COSINE[(normal + NORMALS - NORMALS / 4) % NORMALS];
    const Lanes *e = f->e, x = e[4] * u - e[3] * v, y = e[2] * v - e[3] * u, per_length = 1 / root_of(x * x + y * y);
    place[0] = e[0] + e[2] * u + e[3] * v;
    place[1] = e[1] + e[3] * u + e[4] * v;
    direction[0] = x * per_length;
    direction[1] = y * per_length;
}

/* In the order of their size, by Batcher's exchanges, the same ones whatever the numbers are. */
static inline void sort_lanes(Lanes *values, int n)
{
    for (int p = 1; p < n; p *= 2)
        for (int k = p; k > 0; k /= 2)
            for (int j = k % p; j + k < n; j += 2 * k)
                for (int i = j; i < j + k && i + k < n; i++)
                    if ((i ^ (i + k)) < 2 * p) {
                        const Lanes a = values[i], b = values[i + k];
                        values[i] = least_of(a, b);
                        values[i + k] = most_of(a, b);
                    }
}

/* Whether pixels outside of an outline are lighter than those inside, nearly all around; and how uneven these steps are. */
static Flags stand_out(const Image *image, Edge *edges, int64_t count)
{
    const Four f = four_of(image, edges, count);
    const Lanes inside = most_of(all(INSIDE_PX), -f.shorter);
    Lanes step[8], sum = all(0), squares = all(0);
    Flags in_image[8], good = {0};
    for (int i = 0; i < 8; i++) {
        Lanes p[2], n[2];
        outline_point(&f, EIGHTH * i, p, n);
        step[i] = nearest_pixel(&f, p[0] + OUTSIDE_PX * n[0], p[1] + OUTSIDE_PX * n[1]) -
                  least_of(nearest_pixel(&f, p[0] + inside * n[0], p[1] + inside * n[1]),
                           nearest_pixel(&f, p[0] + THIN_PX * n[0], p[1] + THIN_PX * n[1]));
        sum += step[i];
        squares += step[i] * step[i];
        in_image[i] = is_within(&f, p[0], p[1]);
    }
    const Lanes enough = most_of(all(LEAST_STEP), STEP_SHARE / 8 * sum);
    for (int i = 0; i < 8; i++)
        good -= in_image[i] & (step[i] > enough);
    for (int k = 0; k < LANES && k < count; k++)
        edges[k].uneven = 8 * (double)squares[k] / ((double)sum[k] * (double)sum[k]) - 1;
    return good >= LEAST_EIGHTHS;
}

/* Solves N x = b by Cholesky's decomposition, N of which the lower triangle is there and is replaced, for b (count). */
static inline void solve_lanes(Lanes (*N)[UNKNOWNS], Lanes (*b)[UNKNOWNS], int count)
{
    Lanes inverse[UNKNOWNS];
    for (int j = 0; j < UNKNOWNS; j++) {
        inverse[j] = 1 / root_of(most_of(N[j][j], all(1e-9f)));
        for (int i = j + 1; i < UNKNOWNS; i++) {
            N[i][j] *= inverse[j];
            for (int k = j + 1; k <= i; k++)
                N[i][k] -= N[i][j] * N[k][j];
        }
    }
    for (int c = 0; c < count; c++) {
        for (int i = 0; i < UNKNOWNS; i++) {
            for (int k = 0; k < i; k++)
                b[c][i] -= N[i][k] * b[c][k];
            b[c][i] *= inverse[i];
        }
        for (int i = UNKNOWNS - 1; i >= 0; i--) {
            for (int k = i + 1; k < UNKNOWNS; k++)
                b[c][i] -= N[k][i] * b[c][k];
            b[c][i] *= inverse[i];
        }
    }
}

/* Moves four ellipses to the edges near them, and fills in the rest of `edges`; those without edges all around stay. */
static Flags move_to_edges(const Image *image, Edge *edges, int64_t of, int pass)
{
    /* The first pass takes every other normal. */
    const int every = pass ? 1 : 2, normals = NORMALS / every, odd = normals / 8;
    Four f = four_of(image, edges, of);
    Lanes offset[PLACES], step[NORMALS], light[NORMALS], slope[NORMALS], away[NORMALS], sorted[NORMALS];
    Lanes rows[NORMALS][UNKNOWNS], weight[NORMALS], residual[NORMALS], solved[3][UNKNOWNS];
    Flags good[NORMALS];
    /* At most as far inside as the middle of the shorter axis. */
    for (int j = 0; j < PLACES; j++)
        offset[j] = most_of(all(PROFILE[j]), -f.shorter);
    for (int i = 0; i < normals; i++) {
        const float u = COSINE[every * i], v = COSINE[(every * i + NORMALS - NORMALS / 4) % NORMALS];
        Lanes p[2], n[2], grey[PLACES];
        outline_point(&f, every * i, p, n);
        for (int j = 0; j < PLACES; j++)
            grey[j] = sample(&f, p[0] + n[0] * offset[j], p[1] + n[1] * offset[j]);
        /* The nearest place where the level rises past the mean of the lightest outside and the darkest inside. */
        Lanes lightest = grey[ZERO], darkest = grey[ZERO];
        for (int j = 0; j < ZERO; j++) {
            lightest = most_of(lightest, grey[ZERO + 1 + j]);
            darkest = least_of(darkest, grey[j]);
        }
        const Lanes half = (lightest + darkest) * 0.5f;
        Lanes nearest = all(NOWHERE);
        for (int j = 0; j + 1 < PLACES; j++) {
            const Flags rises = (grey[j] < half) & (grey[j + 1] >= half);
            const Lanes share = (half - grey[j]) / pick(rises, grey[j + 1] - grey[j], all(1));
            const Lanes crossing = offset[j] + share * (offset[j + 1] - offset[j]);
            nearest = pick(rises & (magnitude(crossing) < magnitude(nearest)), crossing, nearest);
        }
        away[i] = nearest;
        light[i] = lightest;
        step[i] = sorted[i] = lightest - darkest;
        slope[i] = grey[ZERO + 1] - grey[ZERO - 1];
        good[i] = (nearest < NOWHERE) & is_within(&f, p[0], p[1]);
        /* The derivatives of the distance along the normal with respect to center and axes. */
        rows[i][0] = n[0];
        rows[i][1] = n[1];
        rows[i][2] = n[0] * u;
        rows[i][3] = n[0] * v + n[1] * u;
        rows[i][4] = n[1] * v;
    }
    sort_lanes(sorted, normals);
    const Lanes median = (sorted[normals / 2 - 1] + sorted[normals / 2]) * 0.5f;
    const float share = 1 / (float)(normals - 2 * odd);
    Lanes mean = all(0), square = all(0), difference = all(0), count = all(0);
    for (int i = odd; i < normals - odd; i++)
        mean += sorted[i] * share;
    for (int i = odd; i < normals - odd; i++)
        square += (sorted[i] - mean) * (sorted[i] - mean) * share;
    const Lanes uneven = root_of(square);
    for (int i = 0; i < normals; i++) {
        good[i] &= (step[i] > ALIKE * median) & (ALIKE * step[i] < median);
        weight[i] = pick(good[i], all(1), all(0));
        away[i] = pick(good[i], away[i], all(0));
        difference += weight[i] * slope[i];
        count += weight[i];
    }
    Flags even = (count >= MIN_NORMALS[pass]) & (median >= MIN_STEP) & (uneven < MAX_UNEVEN[pass] * median);
    if (!any(even))
        return even;

    for (int done = 1; done <= ROUNDS[pass]; done++) {
        const int last = done == ROUNDS[pass];
        Lanes N[UNKNOWNS][UNKNOWNS] = {{{0}}};
        memset(solved, 0, sizeof solved);
        for (int i = 0; i < normals; i++)
            for (int j = 0; j < UNKNOWNS; j++) {
                const Lanes weighted = weight[i] * rows[i][j];
                for (int k = 0; k <= j; k++)
                    N[j][k] += weighted * rows[i][k];
                solved[0][j] += weighted * away[i];
            }
        for (int j = 0; j < UNKNOWNS; j++)
            N[j][j] += 1e-6f;
        solved[1][0] = solved[2][1] = all(1);
        solve_lanes(N, solved, last ? 3 : 1);
        for (int i = 0; i < normals; i++) {
            residual[i] = away[i];
            for (int j = 0; j < UNKNOWNS; j++)
                residual[i] -= rows[i][j] * solved[0][j];
            sorted[i] = pick(good[i], magnitude(residual[i]), all(0));
        }
        if (last)
            break;
        sort_lanes(sorted, normals);
        const Lanes scale = (sorted[normals / 2 - 1] + sorted[normals / 2]) * 0.5f;
        const Lanes per_soft = 1 / (SOFT * most_of(1.48f * scale, all(LEAST_SCALE)));
        for (int i = 0; i < normals; i++) {
            const Lanes r = residual[i] * per_soft, whole = 1 + r * r;
            weight[i] = pick(good[i], 1 / (whole * whole), all(0));
        }
    }
    Lanes total = all(0), squares = all(0);
    for (int i = 0; i < normals; i++) {
        total += weight[i];
        squares += weight[i] * residual[i] * residual[i];
    }
    for (int j = 0; j < UNKNOWNS; j++)
        f.e[j] += solved[0][j];
    f.inside = 0;
    const Lanes *e = f.e, apart = (e[2] - e[4]) * 0.5f, shorter = (e[2] + e[4]) * 0.5f - root_of(apart * apart + e[3] * e[3]);
    const Lanes longer = e[2] + e[4] - shorter, rms = root_of(squares / total);
    const float most = MAX_RMS[pass][0], growth = MAX_RMS[pass][1];
    even &= (shorter > MIN_SEMI) & (longer < (float)MAX_ELONGATION * shorter) & (rms < most + growth * shorter);
    Lanes middle = all(0);
    if (pass) {
        const Lanes size = most_of(all(MIDDLE_LEAST), MIDDLE_SHARE - MIDDLE_PX / shorter);
        sort_lanes(light, normals);
        middle = sample(&f, e[0], e[1]);
        for (int j = 0; j < NORMALS; j += EIGHTH) {
            const Lanes u = size * COSINE[j], v = size * COSINE[(j + NORMALS - NORMALS / 4) % NORMALS];
            middle += sample(&f, e[0] + e[2] * u + e[3] * v, e[1] + e[3] * u + e[4] * v);
        }
    }
    for (int k = 0; k < LANES && k < of; k++) {
        const double outline[UNKNOWNS] = {(double)f.x[k] + (double)e[0][k], (double)f.y[k] + (double)e[1][k], (double)e[2][k],
                                      (double)e[3][k], (double)e[4][k]};
        if (!even[k] || !is_ellipse(outline)) {
            even[k] = 0;
            continue;
        }
        memcpy(edges[k].e, outline, sizeof outline);
        edges[k].light = (double)(light[normals / 2 - 1][k] + light[normals / 2][k]) / 2;
        edges[k].step = (double)median[k];
        edges[k].uneven = (double)(uneven[k] / median[k]);
        edges[k].rms = (double)rms[k];
        edges[k].slope = (double)(difference[k] / count[k]);
        edges[k].middle = (double)middle[k] / 9;
        edges[k].inverse[0] = (double)solved[1][0][k];
        edges[k].inverse[1] = (double)solved[1][1][k];
        edges[k].inverse[2] = (double)solved[2][1][k];
    }
    return even;
}

/* ---- what is behind blurred outlines ----

   With the normal distribution F, a straight edge blurred by s has the level F(e/s) at the distance e outside of it, so
   F(1/s) - F(-1/s) is the share of the step within 1 px of it. Curvature k moves the half-level inward by k s^2 / 2. The
   darkest place of a small dot is not as dark as the ink: in the middle of a disk, by the mean of 1 - exp(-r^2 / 2 s^2) over
   the directions to its outline at r. So the half of what is visible lies outside of the edge. Small dots do not tell blur
   and darkness of their ink apart: they are given about the blur of the others, which comes from the lens. */

enum { QUARTERS = 12, STEPS = 3 };

/* Variances along any direction, px^2: of the mean kernel of bilinear interpolation, and of a pixel's area. */
static const double BILINEAR = 1. / 6, PIXEL = 1. / 12;
static const double LEAST_BLUR = 0.28;
/* Limits for the share of the step within 1 px of the edge, which is less even for the sharpest, and for the share of the
   ink's darkness that is left of a small dot. */
static const double LEAST_SHARE = 0.05, MAX_SHARE = 0.954, LEAST_DEPTH = 0.5;
/* Shorter semi-axis, in blurs, beyond which the middle is as dark as the ink. */
static const double FAR_BLURS = 6;
/* A disk of this depth is one, unless it is sharper than usual by that factor, as if it were a blurred ring; without a usual blur,
   one of that depth. The usual blur is that at this quantile of the outlines that are certain and of at least that depth, if there
   are three; that of small ones may differ from it by this factor. Of 1,250 blurred rings, 26 more are lost where a depth of 0.97
   is enough for all three; without SHARPER, disks of 6 px may be rings. */
static const double WIDE = 0.97, SURELY_WIDE = 0.9995, SHARPER = 0.9, TELLS_BLUR = 0.8, USUAL = 0.5, BLUR_RATIO = 1.06;
static const double CLEAR_DOUBT = 0.5;
enum { LEAST_WIDE = 3 };
/* Level in the middle above which an outline may be a ring's, below which the level expected of a ring is less and less
   evidence, and the least one expected, without which noise tells; relative to the visible step. */
static const double OPEN_ABOVE = 0.05, TELLING = 0.6, LEAST_LEVEL = 0.02;
/* Share by which the step of a disk is less steep than a straight edge's, less what is lost of its depth, at a radius of r blurs:
   A exp(-B r), within 0.01 of the noncentral chi-squared distribution's, and of smaller ones as at that many. Without it, disks of
   1.5 to 2 blurs are measured a sixth too small, and their blur a third too large. */
static const double ROUND_A = 1.4, ROUND_B = 1.31, ROUND_LEAST = 1.6;
/* Radius of a ring, in blurs, below which it looks the same whatever its size. */
static const double SMALLEST_RING = 1.2;
/* Squared cosines of an ellipse's parameter at even steps over a quarter of it. */
static const Lanes QUARTER[QUARTERS / LANES] = {{0.99572243f, 0.96193977f, 0.89667667f, 0.80438071f},
                                                {0.69134172f, 0.5652631f, 0.4347369f, 0.30865828f},
                                                {0.19561929f, 0.10332333f, 0.03806023f, 0.00427757f}};

/* An outline as it is seen, in pixels of its level: semi-axes at half of the visible step; difference of the mean levels 1 px
   outside and 1 px inside, relative to the visible step; level in the middle, from 0 where it is as dark as the darkest along
   the outline to 1 where it is light. */
typedef struct {
    double longer, shorter, slope, middle, side;
} Seen;

/* And what is behind it: semi-axes; blur with that of sampling; the visible step as a share of that between paper and ink;
   for a ring, the level expected in the middle. */
typedef struct {
    double semi[2], blur, depth, level;
} Behind;

/* The inverse of the normal distribution for probabilities from 0.02 to 0.98, within 1e-8: P. J. Acklam's approximation. */
static double normal_quantile(double p)
{
    const double q = p - 0.5, r = q * q;
    return q * (((((-39.69683028665376 * r + 220.9460984245205) * r - 275.9285104469687) * r + 138.3577518672690) * r -
                 30.66479806614716) * r + 2.506628277459239) /
           (((((-54.47609879822406 * r + 161.5858368580409) * r - 155.6989798598866) * r + 66.80131188771972) * r -
             13.28068155288572) * r + 1);
}

/* How dark the middle of a blurred ellipse is, from 0 to 1: at even steps of the ellipse's parameter, a direction counts by
   its angle, in proportion to 1/r^2. */
static double darkness(double a, double b, double s)
{
    const float longer = (float)(a * a), shorter = (float)(b * b), per_blur = (float)(-0.72134752 / (s * s));
    Lanes light = all(0), whole = all(0);
    if (b > FAR_BLURS * s)
        return 1;
    for (int i = 0; i < QUARTERS / LANES; i++) {
        const Lanes square = longer * QUARTER[i] + shorter * (1 - QUARTER[i]), weight = 1 / square;
        light += weight * power_of_2(most_of(per_blur * square, all(-120)));
        whole += weight;
    }
    return 1 - sum_of(light) / sum_of(whole);
}

/* How dark a blurred ring is at its darkest, with a hole of half its radius, in blurs; and its level in the middle, relative to
   the visible step. The ink in the middle is exact, that of a straight band as wide is made up for curvature: in all, within
   0.004 of the noncentral chi-squared distribution's. */
static double ring_darkness(double radius, double *level)
{
    const double middle = exp(-radius * radius / 8) - exp(-radius * radius / 2);
    const double band = erf(radius / 5.656854) * (1 + 1.5 / (radius * radius * radius));
    const double depth = larger(middle, radius > 1.5 ? band : 0);
    *level = 1 - middle / depth;
    return larger(depth, LEAST_DEPTH);
}

/* What is behind a blurred disk or ring, with a blur within limits, px of its level. Two places beside a ring's edge are not at
   its steepest part, and the rise to the hole's level begins. The ellipse through the half-level has the least squares of
   distances along the normal to the edge moved inward by k s^2 / 2, which no ellipse follows. */
static Behind unblurred(const Seen *seen, int ring, double least, double most, int steps)
{
    const double a = seen->longer, b = seen->shorter, mean = a * b / sqrt((a * a + b * b) / 2);
    double lost = 0, outside = 0, s = 1, steep = 1;
    Behind behind = {.depth = 1};
    for (int step = 0; step < steps; step++) {
        const double share = smaller(larger(seen->slope * behind.depth / steep + lost, LEAST_SHARE), MAX_SHARE);
        s = smaller(larger(1 / normal_quantile((1 + share) / 2), least), most);
        if (ring) {
            const double at = larger((mean - outside) / s, 0), radius = larger(at / 2 + sqrt(at * at / 4 + 0.5), SMALLEST_RING);
            behind.depth = ring_darkness(radius, &behind.level);
            outside = -s * normal_quantile(behind.depth / 2) * (1 - 0.7 / (radius * radius));
            const float inner = (float)((1 - outside) / s), outer = (float)((-1 - outside) / s), width = (float)(radius / 2);
            Lanes density;
            const Lanes edges = normal_at((Lanes){inner, outer, inner - width, outer - width}, &density);
            lost = erf(0.70710678 / s) - (double)(edges[0] - edges[1] - edges[2] + edges[3]);
        } else {
            behind.depth = larger(darkness(a, b, s), LEAST_DEPTH);
            steep = 1 - ROUND_A * exp(-ROUND_B * larger(mean / s, ROUND_LEAST));
            outside = -s * normal_quantile(behind.depth / 2);
        }
    }
    behind.semi[0] = a - outside + smaller(s * s * (a / b + 2 - b / a) / (4 * b), s);
    behind.semi[1] = b - outside + larger(s * s * (b / a + 2 - a / b) / (4 * a), -s);
    behind.blur = s;
    return behind;
}

static Seen seen_edge(const Edge *edge)
{
    const double *e = edge->e, shorter = shorter_semi(e);
    return (Seen){e[2] + e[4] - shorter, shorter, edge->slope / edge->step, 1 - (edge->light - edge->middle) / edge->step,
                  edge->side};
}

static double lens_square(double blur, double side) { return (blur * blur - BILINEAR - PIXEL) * side * side; }

/* How unlike those of dots an edge is, from 0: uneven, off the ellipse, or faint. */
static double doubt_of(const Edge *edge)
{
    const double limit = (double)MAX_RMS[1][0] + (double)MAX_RMS[1][1] * shorter_semi(edge->e);
    const double uneven = edge->uneven / (double)MAX_UNEVEN[1], off = edge->rms / limit, faint = FAINT / edge->step;
    return uneven * uneven + off * off + faint * faint;
}

/* The blur of wide outlines that are certain, px of the image squared, without sampling; NAN if there are too few. */
static int usual_blur(const Edges *edges, double *usual)
{
    double *squares = malloc(sizeof *squares * (size_t)(edges->count + 1));
    int64_t count = 0;
    if (!squares)
        return NO_MEMORY;
    for (int64_t i = 0; i < edges->count; i++) {
        const Seen seen = seen_edge(edges->all + i);
        if (!(doubt_of(edges->all + i) < CLEAR_DOUBT))
            continue;
        const Behind disk = unblurred(&seen, 0, 0, INFINITY, STEPS);
        if (disk.depth > TELLS_BLUR)
            squares[count++] = lens_square(disk.blur, seen.side);
    }
    *usual = count < LEAST_WIDE ? NAN : larger(order_statistic(squares, count, (int64_t)(USUAL * (double)count)), 0);
    free(squares);
    return 0;
}

/* ---- blobs ---- */

/* Minimum shorter semi-axis of a component of a coarser level than the finest: the finer level has seen smaller dots
   better. */
static const double MIN_COARSE = 3;
/* Dots whose edge is more even than this, and closer to the ellipse, in pixels of a coarser level, are not measured again there,
   where their components are larger than they by up to a pixel. */
static const double CLEAR_UNEVEN = 0.2, CLEAR_RMS = 0.075, GROWN_PX = 1;
/* Outlines whose centers and semi-axes differ by less than these shares of the shorter semi-axis are of one dot; of coarser
   levels, also if the semi-axes differ by a pixel of the level. */
static const double SAME_PLACE = 0.5, SAME_SIZE = 0.3, BLURRED_PX = 1;
/* Variance of the crossings relative to the weighted mean square of their distances from the ellipse: five of 24 degrees of
   freedom went into it, and the largest distances count less. */
static const double MISFIT = 1.6;
/* Least standard deviation of a crossing, and of a center beyond what follows from the crossings, in pixels of the level:
   edges are neither straight nor of one width, and pixels are squares. */
static const double CROSSING_PX = 0.04, CENTER_PX = 0.015;
/* The same of blobs that the border cuts, as a share of what is outside: of 400 rough disks and rings of 5 to 40 px, half were off
   by 0.01 to 0.06 times that, and a tenth by more than 0.05 to 0.17 times, while their crossings said a tenth of it. */
static const double CUT_ROUGH = 0.05;
/* Most outlines of a level that are measured, those with the most even steps: three times as many as the dots of the largest
   boards, of which no page of text has more. */
enum { MOST_MEASURED = 1500 };

/* Place of an edge's center along an axis in a level whose pixels have this side, px of the image. */
static double place_in(const Edge *edge, double side, int axis) { return (edge->side * (edge->e[axis] + 0.5)) / side - 0.5; }

/* The edges that no level with pixels of this side shows better, in lists by their row there: the first one of each of its rows,
   then the next one of each edge; -1 at an end. NULL without memory. */
static int64_t *list_clear(const Edges *edges, double side, int64_t height)
{
    int64_t *first = malloc(sizeof *first * (size_t)(height + edges->count + 1));
    for (int64_t i = 0; first && i < height; i++)
        first[i] = -1;
    for (int64_t i = 0; first && i < edges->count; i++) {
        const Edge *edge = edges->all + i;
        const int64_t row = (int64_t)between(rint(place_in(edge, side, 1)), 0, (double)(height - 1));
        if (edge->uneven < CLEAR_UNEVEN && edge->rms * edge->side < CLEAR_RMS * side) {
            first[height + i] = first[row];
            first[row] = i;
        }
    }
    return first;
}

/* Whether an outline of the level has the size and, but for a pixel or two, the place of a dot in the lists. */
static int is_clear(const Edges *edges, const int64_t *first, double side, int64_t height, const double *e)
{
    const int64_t row = (int64_t)between(rint(e[1]), 0, (double)(height - 1));
    const double semi = mean_semi(e);
    for (int64_t y = row > 0 ? row - 1 : 0; y <= row + 1 && y < height; y++)
        for (int64_t i = first[y]; i >= 0; i = first[height + i]) {
            const Edge *edge = edges->all + i;
            const double size = mean_semi(edge->e) * edge->side / side;
            if (fabs(place_in(edge, side, 0) - e[0]) < 1.5 && fabs(semi - size) < SAME_SIZE * size + GROWN_PX)
                return 1;
        }
    return 0;
}

/* The edges among `count` that a test passes, in front of the others. */
static int64_t keep_passing(Flags (*test)(const Image *, Edge *, int64_t), const Image *image, Edge *edges, int64_t count)
{
    int64_t kept = 0;
    for (int64_t i = 0; i < count; i += LANES) {
        const Flags good = test(image, edges + i, count - i);
        for (int64_t k = 0; k < LANES && i + k < count; k++)
            if (good[k])
                edges[kept++] = edges[i + k];
    }
    return kept;
}

/* Those of the most even steps, if there are too many; their number, or NO_MEMORY. */
static int64_t keep_even(Edge *edges, int64_t count)
{
    int64_t kept = 0;
    double *uneven = count > MOST_MEASURED ? malloc(sizeof *uneven * (size_t)count) : NULL;
    if (count <= MOST_MEASURED)
        return count;
    if (!uneven)
        return NO_MEMORY;
    for (int64_t i = 0; i < count; i++)
        uneven[i] = edges[i].uneven;
    const double most = order_statistic(uneven, count, MOST_MEASURED);
    for (int64_t i = 0; i < count; i++)
        if (edges[i].uneven < most)
            edges[kept++] = edges[i];
    free(uneven);
    return kept;
}

static Flags first_pass(const Image *image, Edge *edges, int64_t count) { return move_to_edges(image, edges, count, 0); }
static Flags second_pass(const Image *image, Edge *edges, int64_t count) { return move_to_edges(image, edges, count, 1); }

/* Even edges of all levels, of coarser ones measured in the finer level at last, which gives more exact ellipses, and where
   corners show. */
static int find_edges(const Pyramid *p, Edges *edges)
{
    Edges rough = {NULL, 0, 0};
    int status = 0;
    for (int i = p->first; i < p->end && !status; i++) {
        const Image *level = p->level + i, *finer = i > p->first ? level - 1 : level;
        const double side = ldexp(1, i), scale = finer == level ? 1 : 2;
        int64_t count = 0, *clear = list_clear(edges, side, level->height);
        rough.count = 0;
        status = clear ? find_components(level, level + 1, finer == level, &rough) : NO_MEMORY;
        for (int64_t k = 0; k < rough.count && !status; k++) {
            const double *e = rough.all[k].e;
            if (is_ellipse(e) && (finer == level || shorter_semi(e) > MIN_COARSE) && !is_clear(edges, clear, side, level->height, e))
                rough.all[count++] = rough.all[k];
        }
        free(clear);
        count = keep_even(rough.all, keep_passing(stand_out, level, rough.all, count));
        status = count < 0 ? NO_MEMORY : status;
        count = keep_passing(first_pass, level, rough.all, count);
        for (int64_t k = 0; k < count; k++) {
            double *e = rough.all[k].e;
            for (int j = 0; j < UNKNOWNS; j++)
                e[j] = scale * e[j] + (j < 2 ? (scale - 1) / 2 : 0);
            rough.all[k].side = side / scale;
        }
        count = keep_passing(second_pass, finer, rough.all, count);
        for (int64_t k = 0; k < count && !status; k++)
            status = add_edge(edges, rough.all + k);
    }
    free(rough.all);
    return status;
}

static void make_blob(const Edge *edge, const Pyramid *p, double usual, Blob *blob)
{
    const Seen seen = seen_edge(edge);
    const double *e = edge->e, side = edge->side;
    double least = 0, most = INFINITY, hole = seen.middle, other = 1;
    Behind behind = unblurred(&seen, 0, least, most, 1);
    int wide = behind.depth > SURELY_WIDE;
    if (usual >= 0) {
        const double blur = sqrt(usual / (side * side) + BILINEAR + PIXEL);
        least = blur / BLUR_RATIO;
        most = blur * BLUR_RATIO;
        wide = (wide || (behind.depth > WIDE && behind.blur > SHARPER * blur)) && darkness(seen.longer, seen.shorter, blur) > WIDE;
    }
    if (!wide)
        behind = unblurred(&seen, 0, least, most, STEPS);
    if (!wide || seen.middle > OPEN_ABOVE) {
        /* A blurred hole is less light, relative to the ink around it, than a wide one; of the smallest nothing is seen. */
        const Behind ring = unblurred(&seen, 1, least, most, STEPS);
        const double expected = larger(ring.level, LEAST_LEVEL), telling = smaller(expected / TELLING, 1);
        const double share = between(seen.middle / expected, -0.2, 1.2);
        hole = 0.5 + (share - 0.5) * telling * telling;
        other = between(sqrt(ring.semi[0] * ring.semi[1] / larger(behind.semi[0] * behind.semi[1], 1e-9)), 0.5, 2);
        if (hole > 0.5) {
            behind = ring;
            other = 1 / other;
        }
    }
    const double variance = larger(MISFIT * edge->rms * edge->rms, CROSSING_PX * CROSSING_PX), square = side * side;
    const double center = CENTER_PX * CENTER_PX, light = p->low + p->unit * edge->light;
    *blob = (Blob){
        .center = {side * e[0] + (side - 1) / 2, side * e[1] + (side - 1) / 2},
        .semi = {side * larger(behind.semi[0], (double)MIN_SEMI), side * larger(behind.semi[1], (double)MIN_SEMI)},
        .angle = atan2(2 * e[3], e[2] - e[4]) / 2,
        .covariance = {square * (edge->inverse[0] * variance + center), square * edge->inverse[1] * variance,
                       square * (edge->inverse[2] * variance + center)},
        .light = light,
        .dark = light - p->unit * edge->step / behind.depth,
        .blur = sqrt(larger(lens_square(behind.blur, side) + PIXEL, LEAST_BLUR * LEAST_BLUR)),
        .hole = between(hole, 0, 1),
        .other = other,
        .doubt = doubt_of(edge),
        .side = side,
        .state = ROUGH,
    };
}

double cut_px(const Image *image, const Blob *blob)
{
    const double cosine = cos(blob->angle), sine = sin(blob->angle), a = blob->semi[0], b = blob->semi[1];
    const double x = blob->center[0] + 0.5, y = blob->center[1] + 0.5, wide = hypot(a * cosine, b * sine), tall = hypot(a * sine, b * cosine);
    const double across = larger(wide - x, wide + x - (double)image->width), down = larger(tall - y, tall + y - (double)image->height);
    return larger(larger(across, down), 0);
}

void less_sure(Blob *blob, double variance)
{
    blob->covariance[0] += variance;
    blob->covariance[2] += variance;
}

static int by_column(const void *a, const void *b)
{
    const Blob *first = a, *second = b;
    return (first->center[0] > second->center[0]) - (first->center[0] < second->center[0]);
}

static int by_doubt(const void *a, const void *b)
{
    const Blob *first = a, *second = b;
    if (first->doubt != second->doubt)
        return first->doubt < second->doubt ? -1 : 1;
    return by_column(a, b);
}

/* Leaves out blobs of the same place and size as one whose center is more certain, sorts the others by their doubt, and
   returns their number. */
static int64_t sort_distinct(Blob *blobs, int64_t count)
{
    int64_t kept = 0;
    qsort(blobs, (size_t)count, sizeof *blobs, by_column);
    for (int64_t i = 0; i < count; i++) {
        Blob *a = blobs + i;
        const double reach = SAME_PLACE * a->semi[1], variance = a->covariance[0] + a->covariance[2];
        for (int64_t j = i + 1; j < count; j++) {
            Blob *b = blobs + j;
            if (!(b->center[0] - a->center[0] < reach))
                break;
            if (!(fabs(b->center[1] - a->center[1]) < reach))
                continue;
            const double same = SAME_SIZE * larger(a->semi[1], b->semi[1]) +
                                (a->side == b->side ? 0 : BLURRED_PX * larger(a->side, b->side));
            if (fabs(a->semi[0] - b->semi[0]) < same && fabs(a->semi[1] - b->semi[1]) < same)
                (variance <= b->covariance[0] + b->covariance[2] ? b : a)->state = REFUSED;
        }
    }
    for (int64_t i = 0; i < count; i++)
        if (blobs[i].state == ROUGH)
            blobs[kept++] = blobs[i];
    qsort(blobs, (size_t)kept, sizeof *blobs, by_doubt);
    return kept;
}

int64_t find_blobs(const Image *image, double smallest, int64_t most, Blob **blobs)
{
    Pyramid pyramid;
    Edges edges = {NULL, 0, 0};
    double usual;
    int64_t count = NO_MEMORY;
    *blobs = NULL;
    if (!build_pyramid(image, smallest, &pyramid) && !find_edges(&pyramid, &edges) && !usual_blur(&edges, &usual) &&
        (*blobs = malloc(sizeof **blobs * (size_t)(edges.count + 1)))) {
        for (int64_t i = 0; i < edges.count; i++) {
            make_blob(edges.all + i, &pyramid, usual, *blobs + i);
            less_sure(*blobs + i, pow(CUT_ROUGH * cut_px(image, *blobs + i), 2));
        }
        count = sort_distinct(*blobs, edges.count);
        count = count < most ? count : most;
    }
    free(pyramid.memory);
    free(edges.all);
    return count;
}

void blobs_free(Blob *blobs) { free(blobs); }

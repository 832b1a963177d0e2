/* Which blobs are the dots of a body: guessed poses, the labelings that they lead to, and the evidence for each.

   A labeling is judged by the logarithm of its likelihood ratio to clutter (evidence_of), so everything that tells for or
   against it has one unit: places and outlines in standard deviations, kinds where they are known, dots that are missing.
   The average of the ratio over all images of clutter is one, so clutter exceeds e^x in at most e^-x of them: the expected
   number of accidental finds is at most e^-evidence (A. A. Markov's inequality; the idea of bounding it by what is in the
   image is that of A. Desolneux, L. Moisan and J.-M. Morel). */

#include "lanes.h"
#include "label.h"
#include "numbers.h"

/* Tolerated error of a semi-axis of a rough ellipse: a share of it, without a camera, whose perspective is then a guess, and with
   one; and px over the smaller semi-axis, where outlines of small dots are blurred most. The same of where a guess has a near
   dot, as a share of its distance: first as much, then DRIFT, without which 3 of 613 covered or tiny markers are missed, and px; of
   two sizes' ratio, in units of it; and the ratio of areas. With a camera, shares of 0.02 to 0.2 find the same in 560 views of dots
   of 5 to 40 px; beside 40 dots of another marker, 10 of 360 are missed with 0.1, since the search is cut, 2 with this. */
static const double SLACK[] = {0.2, 0.05}, SLACK_PX = 0.4, DRIFT = 0.2, DRIFT_PX = 1.5, GROWTH = 0.75, ALIKE = 2.2255;

/* Evidence of a ring below which a blob is surely a disk, and beyond one minus which it is surely a ring. */
static const double DOUBTFUL = 0.25;

/* Farthest from its place that a blob is taken for a dot: radii of the blob are Layout.reach, or at most NEAR_REACH once a
   pose was fitted; plus px. */
static const double GUESS_PX = 2, NEAR_REACH = 0.5, NEAR_PX = 1;

/* Largest difference of the logarithms of a dot's and a blob's size. */
static const double SIZE = 0.6;

/* The same, beyond which two dots are seen as one: they differ by 0.35, but for the light between them. */
static const double TWO = 0.25;

/* Standard deviation that a place has beyond its own while poses are searched, px: blur and perspective displace a rough
   center by this. */
static const double SEARCH_PX = 0.2;

/* Distance of two outlines below which dots may be one blob, px. With 1.5, one of 48 views of dots of 2.5 and 3 px has a dot
   between two; with 2.5, 16 have no labels instead of 4. */
static const double MERGED_PX = 2.0;

static const double PI = 3.14159265358979323846;

/* Shorter semi-axis of a shape in normalized coordinates, with the focal length px. */
double shorter_px(double px, const double *shape)
{
    const double half = (shape[0] + shape[2]) / 2, det = shape[0] * shape[2] - shape[1] * shape[1];
    return px * sqrt(larger(half - sqrt(larger(half * half - det, 0)), 0));
}

static void symmetric_root(const double *e, double *root)
{
    const double area = sqrt(larger(e[0] * e[2] - e[1] * e[1], 0)), scale = sqrt(e[0] + e[2] + 2 * area);
    root[0] = (e[0] + area) / scale;
    root[1] = e[1] / scale;
    root[2] = (e[2] + area) / scale;
}

/* ---- the scene ---- */

/* Eigenvalues, ascending, and eigenvectors as columns of a symmetric matrix (3, 3), by C. G. J. Jacobi's rotations. */
static void eigen(double A[3][3], double *values, double V[3][3])
{
    memset(V, 0, 9 * sizeof(double));
    V[0][0] = V[1][1] = V[2][2] = 1;
    for (int sweep = 0; sweep < 12; sweep++) {
        const double off = fabs(A[0][1]) + fabs(A[0][2]) + fabs(A[1][2]);
        if (!(off > 1e-18 * (fabs(A[0][0]) + fabs(A[1][1]) + fabs(A[2][2]))))
            break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                if (A[p][q] == 0)
                    continue;
                const double theta = (A[q][q] - A[p][p]) / (2 * A[p][q]);
                const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const double c = 1 / sqrt(t * t + 1), s = t * c, apq = A[p][q];
                A[p][p] -= t * apq;
                A[q][q] += t * apq;
                A[p][q] = A[q][p] = 0;
                const int r = 3 - p - q;
                const double arp = A[r][p], arq = A[r][q];
                A[r][p] = A[p][r] = c * arp - s * arq;
                A[r][q] = A[q][r] = s * arp + c * arq;
                for (int k = 0; k < 3; k++) {
                    const double vp = V[k][p], vq = V[k][q];
                    V[k][p] = c * vp - s * vq;
                    V[k][q] = s * vp + c * vq;
                }
            }
    }
    int order[3] = {0, 1, 2};
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2 - i; j++)
            if (A[order[j]][order[j]] > A[order[j + 1]][order[j + 1]]) {
                const int swapped = order[j];
                order[j] = order[j + 1];
                order[j + 1] = swapped;
            }
    double W[3][3];
    memcpy(W, V, sizeof W);
    for (int i = 0; i < 3; i++) {
        values[i] = A[order[i]][order[i]];
        for (int k = 0; k < 3; k++)
            V[k][i] = W[k][order[i]];
    }
}

/* Both poses of a disk of radius 1 that is seen as an ellipse, up to the rotation about its normal.

   The ellipse's dual conic D is proportional to I - n n' - P P' (see outline_of). With eigenvalues m1 >= m2 > 0 > m3 of D and
   a = 1 - m2/m1, b = 1 - m3/m1, the normal is n = +-s v2 + sqrt(1 - s^2) v3 with s^2 = a (b - 1)/(b - a), and P follows from
   P P' = I - D/m1 - n n'. */
static void circle_poses(const Blob *blob, double focal, double (*position)[3], double (*normal)[3])
{
    const double c[2] = {blob->at[0] / focal, blob->at[1] / focal}, square = focal * focal;
    const double e[3] = {blob->shape[0] / square, blob->shape[1] / square, blob->shape[2] / square};
    double D[3][3] = {{e[0] - c[0] * c[0], e[1] - c[0] * c[1], -c[0]}, {e[1] - c[0] * c[1], e[2] - c[1] * c[1], -c[1]},
                      {-c[0], -c[1], -1}}, A[3][3], V[3][3], m[3];
    memcpy(A, D, sizeof A);
    eigen(A, m, V);
    const double a = 1 - m[1] / m[2], b = 1 - m[0] / m[2];
    const double s = sqrt(smaller(larger(a * (b - 1) / (b - a), 0), 1)), k = sqrt(1 - s * s);
    for (int side = 0; side < 2; side++) {
        double n[3], gram[3], facing = 0;
        for (int i = 0; i < 3; i++)
            n[i] = (side ? -s : s) * V[i][1] + k * V[i][0];
        for (int i = 0; i < 3; i++)
            gram[i] = (i == 2) - D[i][2] / m[2] - n[i] * n[2];
        const double depth = sqrt(larger(gram[2], 1e-12));
        for (int i = 0; i < 3; i++) {
            position[side][i] = gram[i] / depth;
            facing += n[i] * position[side][i];
        }
        for (int i = 0; i < 3; i++)
            normal[side][i] = facing > 0 ? -n[i] : n[i];
    }
}

/* Writes where and how large a blob is to its place in the squares. */
static void place_spot(Scene *scene, int64_t k)
{
    const int64_t spot = scene->looks[k].spot;
    for (int a = 0; a < 2; a++)
        scene->spots[a][spot] = (float)scene->blobs[k].at[a];
    scene->spots[2][spot] = (float)scene->looks[k].area;
    scene->member[spot] = (int32_t)k;
}

static void show_blob(Scene *scene, int64_t k, double focal)
{
    Look *look = scene->looks + k;
    double e[3];
    for (int i = 0; i < 3; i++)
        e[i] = scene->blobs[k].shape[i] / (focal * focal);
    const double det = larger(e[0] * e[2] - e[1] * e[1], 1e-300);
    look->area = sqrt(det);
    place_spot(scene, k);
    look->size = log(det) / 4;
    look->slack = SLACK[scene->calibrated] + SLACK_PX / larger(shorter_px(scene->px * focal, e), 1e-150);
}

/* Lists the blobs by squares of the image, in each in their order. */
static void number_blobs(Scene *scene)
{
    const int64_t squares = scene->columns * scene->rows;
    memset(scene->first, 0, (size_t)(squares + 2) * sizeof *scene->first);
    int32_t *end = scene->first + 1, count = 0;
    for (int64_t k = 0; k < scene->count; k++)
        if (scene->blobs[k].reached) {
            end[square_of(scene, scene->blobs[k].at)]++;
            count++;
        }
    for (int64_t s = 1; s < squares; s++)
        end[s] += end[s - 1];
    for (int64_t k = scene->count - 1; k >= 0; k--)
        if (scene->blobs[k].reached)
            scene->looks[k].spot = --end[square_of(scene, scene->blobs[k].at)];
    /* Now end[s] is where square s begins. */
    memmove(scene->first, end, (size_t)squares * sizeof *end);
    scene->first[squares] = count;
    for (int64_t k = 0; k < scene->count; k++)
        if (scene->blobs[k].reached)
            place_spot(scene, k);
}

/* Number of blobs up to which their densities are kept, 8 MB of which only rows of labeled blobs are touched: the search for a
   grid of 336 dots takes 3.5 times as long without. */
enum { MOST_PAIRED = 1024 };

/* Takes an image's blobs, and prepares what poses are guessed from. */
int scene_of(Scene *scene, const Camera *camera, int calibrated, Blob *blobs, int64_t count)
{
    memset(scene, 0, sizeof *scene);
    scene->camera = camera;
    scene->calibrated = calibrated;
    scene->px = sqrt(camera->fx * camera->fy);
    scene->blobs = blobs;
    scene->count = count;
    scene->focal = 1;
    const double area = (double)camera->width * (double)camera->height;
    scene->side = larger(sqrt(area / (double)(count + 16)), 8) / scene->px;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (int64_t k = 0; k < count; k++)
        for (int a = 0; a < 2 && blobs[k].reached; a++) {
            low[a] = smaller(low[a], blobs[k].at[a]);
            high[a] = larger(high[a], blobs[k].at[a]);
        }
    if (!(low[0] <= high[0]))
        low[0] = low[1] = high[0] = high[1] = 0;
    /* Wide lenses stretch the corners: more squares than this do not help. */
    scene->columns = (int64_t)smaller((high[0] - low[0]) / scene->side, 255) + 1;
    scene->rows = (int64_t)smaller((high[1] - low[1]) / scene->side, 255) + 1;
    scene->side = larger(larger((high[0] - low[0]) / (double)scene->columns, (high[1] - low[1]) / (double)scene->rows), scene->side);
    scene->low[0] = low[0];
    scene->low[1] = low[1];
    scene->looks = malloc((size_t)(count + 1) * sizeof *scene->looks);
    scene->room = count + LANES;
    scene->pairs = count <= MOST_PAIRED ? malloc(2 * (size_t)(count * scene->room + 1) * sizeof *scene->pairs) : NULL;
    scene->seen[0] = calloc(SEEN * (size_t)scene->room, sizeof(float));
    scene->taken = malloc((size_t)scene->room);
    scene->first = calloc((size_t)(scene->columns * scene->rows) + 2, sizeof *scene->first);
    scene->spots[0] = calloc(3 * (size_t)scene->room, sizeof(float));
    scene->member = malloc((size_t)scene->room * sizeof *scene->member);
    scene->owner = malloc((size_t)(count + 1) * sizeof *scene->owner);
    if (!scene->looks || !scene->seen[0] || !scene->taken || !scene->first || !scene->spots[0] || !scene->member || !scene->owner)
        return NO_MEMORY;
    for (int i = 1; i < SEEN; i++)
        scene->seen[i] = scene->seen[0] + i * scene->room;
    memset(scene->taken, 1, (size_t)scene->room);
    for (int i = 1; i < 3; i++)
        scene->spots[i] = scene->spots[0] + i * scene->room;
    for (int64_t k = 0; k < count; k++) {
        scene->owner[k] = -1;
        scene->looks[k].clutter = -1;
        scene->taken[k] = !blobs[k].reached;
    }
    number_blobs(scene);
    double rings = 0.5, usable = 1;
    for (int64_t k = 0; k < count; k++) {
        rings += blobs[k].reached && blobs[k].hole > 1 - DOUBTFUL;
        usable += blobs[k].reached;
    }
    scene->rings = smaller(larger(rings / usable, 0.02), 0.5);
    for (int64_t k = 0; k < count; k++)
        if (blobs[k].reached) {
            update_blob(scene, k);
            show_blob(scene, k, 1);
        }
    return 0;
}

void scene_free(Scene *scene)
{
    free(scene->looks);
    free(scene->seen[0]);
    free(scene->pairs);
    free(scene->taken);
    free(scene->first);
    free(scene->spots[0]);
    free(scene->member);
    free(scene->owner);
}

/* Takes over a blob that is better known now. Its square stays: it moves by less than the reach of any search. */
void update_blob(Scene *scene, int64_t k)
{
    Look *look = scene->looks + k;
    symmetric_root(scene->blobs[k].shape, look->root);
    for (int i = 0; i < 3; i++)
        look->root[i] *= scene->px;
    look->mean = (look->root[0] + look->root[2]) / 2;
    const Blob *blob = scene->blobs + k;
    place_spot(scene, k);
    for (int i = 0; i < SEEN; i++)
        scene->seen[i][k] = (float)(i < 2 ? scene->px * blob->at[i] : look->root[i - 2]);
    /* Standard deviation of each entry of `root`, px: of fits to grey levels, of rough ellipses, and of those that the fit
       refuses; with half of it, dots under print of 600 dpi are lost, with twice, a board's dot of twice the size is. */
    const double least = blob->state == FITTED ? 0.08 : blob->state == REFUSED ? 0.3 : 0.15 * larger(blob->side, 1);
    const double share = blob->state == FITTED ? 0.015 : 0.03;
    look->sigma = hypot(least, share * look->mean);
    look->broad = -1;
}

/* ---- evidence ---- */

/* Two ideas of what clutter is; a labeling has to be better than either.

   Blobs of all shapes: density at a blob per px^2 of place and px^3 of the root of its shape, from what the other blobs of the
   image show, half of it near them, and a broad guess of what none shows. With s as half the trace of a root R, sizes s from 1
   to 500 px are equally likely on a logarithmic scale, and R - s I has a standard deviation of 0.3 s along each of two axes.

   Equal disks in the plane of the labeling's own pose, such as another marker's: their shapes tell nothing but that plane, and
   their density per px^2 is that of blobs whose shape is much like this one's, and of one that none shows.

   If the labeling is an accident, its own dots are clutter, too, and one leads to the next: each makes a quarter of another one
   like it likely to follow, in the order of the blobs, so that labelings of the same blobs compare. Without this, a marker of
   30 dots is found in every five hundredth image of another one of 24; with a half, four of eight dots are too few. */
static const double FOLLOWS = 0.25;

static double frame_area(const Scene *scene) { return (double)scene->camera->width * (double)scene->camera->height; }

/* (1 - q/32)^16 of q/32, which is exp(-q/2) but for 1 % where it is large, in a tenth of the time: a labeling of 24 dots asks 576
   times. */
static inline Lanes bump(Lanes q)
{
    const Lanes a = most_of(1 - q, all(0)), b = a * a, c = b * b, d = c * c;
    return d * d;
}

/* What the densities at a blob depend on: its `seen`; for squares of distances, 1/32 of their inverse variances; and largest values. */
typedef struct {
    float seen[SEEN], of_narrow, of_wide, of_disk, of_region, of_close, even, region, close, narrow, wide;
} Kernel;

static Kernel kernel_of(const Scene *scene, int64_t k)
{
    const Look *look = scene->looks + k;
    const double mean = look->mean * look->mean, narrow = look->sigma * look->sigma, wide = larger(9 * narrow, 0.01 * mean);
    /* Clutter gathers: over the image, over a sixteenth of its width, and as near as dots of a marker are to each other. */
    const double width = 0.06 * (double)scene->camera->width, one = width * width, other = smaller(64 * mean, one);
    const double shape = 15.749610 /* (2 pi)^1.5 */;
    Kernel kernel = {
        .of_narrow = (float)(1 / (32 * narrow)), .of_wide = (float)(1 / (32 * wide)), .of_disk = (float)(1 / (2 * mean)),
        .of_region = (float)(1 / (32 * one)), .of_close = (float)(1 / (32 * other)), .even = (float)(0.25 / frame_area(scene)),
        .region = (float)(0.25 / (2 * PI * one)), .close = (float)(0.5 / (2 * PI * other)),
        .narrow = (float)(0.8 / (shape * narrow * look->sigma)), .wide = (float)(0.2 / (shape * wide * sqrt(wide))),
    };
    for (int i = 0; i < SEEN; i++)
        kernel.seen[i] = scene->seen[i][k];
    return kernel;
}

/* Densities of both kinds at a blob that LANES others show, from this one on. */
static inline void densities_of(const Scene *scene, const Kernel *at, int64_t from, Lanes *shaped, Lanes *alike)
{
    Lanes off[SEEN];
    for (int i = 0; i < SEEN; i++)
        off[i] = at->seen[i] - read(scene->seen[i] + from);
    const Lanes square = off[2] * off[2] + 2 * off[3] * off[3] + off[4] * off[4], apart = off[0] * off[0] + off[1] * off[1];
    const Lanes place = at->even + at->region * bump(at->of_region * apart) + at->close * bump(at->of_close * apart);
    *shaped = place * (at->narrow * bump(at->of_narrow * square) + at->wide * bump(at->of_wide * square));
    *alike = place * bump(at->of_disk * square);
}

/* What is asked again and again of a labeled blob: the density at it of clutter that none of the others shows, the logarithms of
   that, of the factor of its outline's normal distribution, and of the probability of what is seen of its kind, for a ring or a disk
   relative to clutter, of which `rings` are rings: zero where no kind is seen. A sure ring is e^9 times as likely to be one as not:
   with e^6, a pentagon of which a dot is hidden has no labels. A sure disk is only e^6 times: holes fill with ink, and a pentagon
   whose ring is hidden should have none. */
static void weigh(const Scene *scene, int64_t k)
{
    Look *look = scene->looks + k;
    const double s = look->mean, spread = 0.3 * s, dx = (look->root[0] - look->root[2]) / sqrt(2), dy = sqrt(2) * look->root[1];
    /* Shapes that are longer than this says are as likely as at three of its standard deviations. */
    const double round = larger(exp(-0.5 * (dx * dx + dy * dy) / (spread * spread)), 0.0111);
    look->broad = round / (2 * PI * spread * spread * sqrt(2) * s * 6.2) / frame_area(scene);
    look->log_broad = log(look->broad);
    look->log_shape = 1.5 * log(2 * PI * look->sigma * look->sigma);
    const double log_ratio = smaller(larger(18 * (scene->blobs[k].hole - 0.5), -6), 9);
    look->disk = -log(scene->rings * exp(log_ratio) + 1 - scene->rings);
    look->ring = log_ratio + look->disk;
}

/* Densities of both kinds that the other blobs show at blob k of a labeling. */
static void clutter_of(const Scene *scene, int64_t k, const int64_t *labels, int64_t n, double *shaped, double *alike)
{
    Look *look = scene->looks + k;
    float *row = scene->pairs ? scene->pairs + 2 * k * scene->room : NULL;
    Kernel at = {.even = 0};
    Lanes densities[2];
    if (look->clutter < 0 || !row)
        at = kernel_of(scene, k);
    if (look->clutter < 0) {
        double sums[2][LANES] = {{0}};
        for (int64_t from = 0; from < scene->count; from += LANES) {
            densities_of(scene, &at, from, densities, densities + 1);
            if (row)
                for (int i = 0; i < 2; i++)
                    write(row + i * scene->room + from, densities[i]);
            for (int l = 0; l < LANES; l++)
                for (int i = 0; i < 2; i++)
                    sums[i][l] += scene->taken[from + l] || from + l == k ? 0 : (double)densities[i][l];
        }
        look->clutter = (sums[0][0] + sums[0][1]) + (sums[0][2] + sums[0][3]);
        look->alike = (sums[1][0] + sums[1][1]) + (sums[1][2] + sums[1][3]);
    }
    *shaped = look->clutter;
    *alike = look->alike;
    for (int64_t i = 0; i < n; i++)
        if (labels[i] >= 0 && labels[i] != k) {
            const double less = labels[i] < k ? 1 - FOLLOWS : 1;
            if (!row)
                densities_of(scene, &at, labels[i], densities, densities + 1);
            *shaped -= less * (double)(row ? row[labels[i]] : densities[0][0]);
            *alike -= less * (double)(row ? row[scene->room + labels[i]] : densities[1][0]);
        }
    *shaped = larger(*shaped, 0) + look->broad;
    *alike = larger(*alike, 0) + 1 / frame_area(scene);
}

/* Evidence below which a first fit of the labels of a guess does not lead to the right ones: these begin above -60. */
static const double HOPELESS = -100;

/* Standard deviations that places may have beyond their own, px, with how likely each is: lens, print and refraction are
   never quite as the files say. The largest grows by a share of the layout's extent in the image: files of other cameras
   displace dots by as much. With 1.3 px for all, small markers of which a dot is elsewhere are found with it. */
static const double BEYOND[] = {0.04, 0.13, 0.4, 0.3}, BEYOND_SHARE[] = {0.4, 0.3, 0.2, 0.1}, BEYOND_EXTENT = 0.005;
enum { BEYONDS = 4 };

/* Logarithm of the range of distances that are equally likely, a factor of 100. */
static const double RANGE = 4.6;

/* Ink spreads, and bright surroundings eat into dark dots: standard deviation of the logarithm of a common factor. */
static const double INK = 0.1;

/* A dot in plain view is missed for reasons other than its size in 1 % of cases (a highlight, a scratch); one seen flat or of
   few pixels, in 30 %, of still fewer in 90 %. In one view of 25 something covers any share of a body: with one of ten, a marker
   whose dots are all but two of another one is not told from that. */
static const double MISSED = 0.01, MISSED_AT_LIMIT = 0.3, SEEN_BELOW = 0.1, COVERED = 0.04;
static const double PLAIN_PX = 4.5, LIMIT_PX = 3, PLAIN_FACING = 0.2, LIMIT_FACING = 0.08, EDGE_PX = 3;

/* Whether a dot lies inside the image with all its outline, and a margin. */
static int in_frame(const Scene *scene, const Outline *drawn)
{
    double pixel[2];
    lens_pixel(scene->camera, drawn->center, pixel, NULL);
    const double wide = sqrt(drawn->shape[0]) * scene->camera->fx + EDGE_PX;
    const double tall = sqrt(drawn->shape[2]) * scene->camera->fy + EDGE_PX;
    return pixel[0] - wide >= 0 && pixel[0] + wide <= (double)scene->camera->width - 1 && pixel[1] - tall >= 0 &&
           pixel[1] + tall <= (double)scene->camera->height - 1;
}

/* Whether a dot should be seen with a pose: from the front, large enough, and inside the image. */
int in_plain_view(const Scene *scene, const Dot *dot, const Pose *pose)
{
    Outline drawn;
    outline_of(dot, dot->xyz, pose, &drawn);
    return drawn.seen && drawn.facing > PLAIN_FACING && 2 * shorter_px(scene->px, drawn.shape) > PLAIN_PX && in_frame(scene, &drawn);
}

/* Whether a dot and its nearest neighbor may be one blob. */
static int merges(const Scene *scene, const Layout *layout, const Pose *pose, int64_t dot, const Outline *drawn)
{
    const Dot *neighbor = layout->dots + layout->dots[dot].neighbor;
    Outline other;
    outline_of(neighbor, neighbor->xyz, pose, &other);
    const double x = other.center[0] - drawn->center[0], y = other.center[1] - drawn->center[1], distance = hypot(x, y);
    const double reach = sqrt(drawn->shape[0] * x * x + 2 * drawn->shape[1] * x * y + drawn->shape[2] * y * y) +
                         sqrt(other.shape[0] * x * x + 2 * other.shape[1] * x * y + other.shape[2] * y * y);
    return other.seen && scene->px * (distance * distance - reach) < MERGED_PX * distance;
}

/* The logarithm of the probability that of dots in plain view these `missing` ones are missed and `count` are not: each for
   reasons of its own, or k of m where something covers any share of them, k! (m - k)! / (m + 1)!. */
static double missed_together(int64_t missing, int64_t count)
{
    double covered = COVERED / (double)(missing + count + 1);
    for (int64_t k = 1; k <= missing; k++)
        covered *= (double)k / (double)(count + k);
    return log((1 - COVERED) * pow(MISSED, (double)missing) * pow(1 - MISSED, (double)count) + covered + 1e-300);
}

/* Whether a blob is surely a ring, and the dot a disk, or the other way round. */
static int is_other_kind(const Dot *dot, const Blob *blob) { return dot->ring ? blob->hole < DOUBTFUL : blob->hole > 1 - DOUBTFUL; }

/* The blob nearest to a place, -1 if none is in reach: `least` is the square of its distance in units of what is allowed, `reach`
   times its outline and `margin` around that, at most `far`. Its area is that of a dot within a factor of `ratio`, its kind the
   dot's, unless that is NULL. */
static inline int64_t nearest_blob(const Scene *scene, const Dot *dot, const double *at, double far, double reach, double margin,
                                   double area, double ratio, double *least)
{
    const double reach2 = reach * reach, margin2 = margin * margin;
    int64_t which = -1, from[2], to[2];
    *least = 1;
    if (!squares_around(scene, at, far, from, to))
        return -1;
    /* Four at a time, with room for rounding; what is behind a row's end is somewhere else. */
    const float x = (float)at[0], y = (float)at[1], beyond = 1.0001f * (float)far, low = 0.9999f * (float)(area / ratio);
    const float high = 1.0001f * (float)(area * ratio);
    for (int64_t row = from[1]; row <= to[1]; row++) {
        const int64_t end = scene->first[row * scene->columns + to[0] + 1];
        for (int64_t spot = scene->first[row * scene->columns + from[0]]; spot < end; spot += LANES) {
            const Lanes size = read(scene->spots[2] + spot);
            const Flags there = (magnitude(read(scene->spots[0] + spot) - x) < beyond) & (size > low) & (size < high) &
                                (magnitude(read(scene->spots[1] + spot) - y) < beyond);
            for (int l = 0; l < LANES && any(there); l++) {
                if (!there[l] || spot + l >= end || scene->taken[scene->member[spot + l]])
                    continue;
                const int64_t k = scene->member[spot + l];
                const Blob *blob = scene->blobs + k;
                const double size_there = scene->looks[k].area, dx = blob->at[0] - at[0], dy = blob->at[1] - at[1];
                const double xx = reach2 * blob->shape[0] + margin2, xy = reach2 * blob->shape[1];
                const double yy = reach2 * blob->shape[2] + margin2;
                const double square = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy);
                if (square < *least && fabs(dx) < far && fabs(dy) < far && size_there < area * ratio && area < size_there * ratio &&
                    !(dot && is_other_kind(dot, blob))) {
                    *least = square;
                    which = k;
                }
            }
        }
    }
    return which;
}

/* The same for where a dot, or one of any kind (NULL), is drawn. */
static int64_t blob_of(const Scene *scene, const Dot *dot, const Outline *drawn, double reach, double margin, double *least)
{
    const double *e = drawn->shape, semi = sqrt(larger(e[0], e[2])), area = sqrt(larger(e[0] * e[2] - e[1] * e[1], 1e-300));
    const double alike = SIZE + SLACK_PX / larger(scene->px * sqrt(area), 0.3), focal = scene->focal;
    return nearest_blob(scene, dot, drawn->center, reach * 1.9 * semi + margin, reach, margin, area / (focal * focal), exp(2 * alike),
                        least);
}

/* Whether a blob of a dot's size, of either kind, is where the dot is: then it was not missed, although the border cuts it. */
static int has_one(const Scene *scene, const Layout *layout, const Outline *drawn)
{
    double least;
    return blob_of(scene, NULL, drawn, smaller(NEAR_REACH, layout->reach), NEAR_PX / scene->px, &least) >= 0;
}

/* Takes half of the logarithms of products from a sum, before they leave the range of numbers. */
static void take_roots(double *sum, double *products)
{
    for (int b = 0; b < BEYONDS; b++) {
        sum[b] -= 0.5 * log(products[b]);
        products[b] = 1;
    }
}

/* The root of a dot's shape, as a blob should have it. Small blurred rings and disks look alike, of different sizes: where a blob
   is not of the dot's kind, the nearer of its two sizes counts, since those of the smallest are known badly. With that of the
   dot's kind alone, a sixth of 100 markers with dots of 2.5 and 3 px is lost. */
static void expected_root(const Scene *scene, const Dot *dot, const Outline *drawn, int64_t k, double *root)
{
    const Blob *blob = scene->blobs + k;
    symmetric_root(drawn->shape, root);
    const double half = scene->px * (root[0] + root[2]) / 2, mean = scene->looks[k].mean;
    if (dot->ring != (blob->hole > 0.5) && fabs(mean - half / blob->other) < fabs(mean - half))
        for (int i = 0; i < 3; i++)
            root[i] /= blob->other;
}

/* The evidence for a labeling with a fitted pose: the logarithm of

       prod over dots N(r; S) N(dR; s) P(kind) / clutter  x  prod over missing dots P(missed)  x  (2 pi)^3 det(N)^-1/2 p(pose),

   averaged over standard deviations that places may have beyond their own. S is the covariance of the place, from image and
   print; dR the difference of the outline's root, px, but for a common factor; the last two are P.-S. Laplace's integral over
   poses, whose prior p is even over directions, over the image and over the logarithm of the distance within a factor of
   100. Dots outside the frame have no part in it, nor those that the border cuts, unless a blob is left out there: else a
   regular layout would be turned at no cost so that a ring at the border is none of its dots. work->each has every labeled dot's own
   part. Below HOPELESS, it is less than what is returned. */
double evidence_of(const Scene *scene, const Layout *layout, Labeling *labeling, Work *work)
{
    const Pose *pose = &labeling->pose;
    const int parameters = scene->calibrated ? 6 : 7;
    double N[49][BEYONDS], sum[BEYONDS] = {0}, dets[BEYONDS] = {1, 1, 1, 1}, beyond[BEYONDS];
    double shapes = 0, disks = 0, common = 0, weights = 1 / (INK * INK), kinds = 0, chi2 = 0;
    double offset = 0;
    const double *middle = layout->middle, *turned = pose->R + 6;
    const double far = turned[0] * middle[0] + turned[1] * middle[1] + turned[2] * middle[2] + pose->t[2];
    const double extent = scene->px * pose->focal * layout->extent / larger(far, 1e-9);
    for (int b = 0; b < BEYONDS; b++)
        beyond[b] = b + 1 < BEYONDS ? BEYOND[b] : larger(BEYOND[b] + BEYOND_EXTENT * extent, BEYOND[b - 1]);
    memset(N, 0, sizeof N);
    labeling->count = labeling->missing = labeling->absent = 0;
    labeling->evidence = work->judged = -INFINITY;
    double missed = 0;
    for (int64_t i = 0; i < layout->count; i++) {
        Outline *drawn = work->drawn + i;
        outline_of(layout->dots + i, layout->dots[i].xyz, pose, drawn);
        if (labeling->labels[i] < 0) {
            if (!drawn->seen || drawn->facing < LIMIT_FACING || !(in_frame(scene, drawn) || has_one(scene, layout, drawn)))
                continue;
            const double across = 2 * shorter_px(scene->px, drawn->shape);
            if (across < LIMIT_PX)
                continue;
            const int plain = across > PLAIN_PX && drawn->facing > PLAIN_FACING && !merges(scene, layout, pose, i, drawn);
            labeling->missing += plain;
            labeling->absent++;
            missed += plain ? 0 : log(MISSED_AT_LIMIT);
            continue;
        }
        if (!drawn->seen)
            return -INFINITY;
        const Look *look = scene->looks + labeling->labels[i];
        double root[3];
        if (look->broad < 0)
            weigh(scene, labeling->labels[i]);
        expected_root(scene, layout->dots + i, drawn, labeling->labels[i], root);
        const double ratio = 0.5 * log((look->root[0] * look->root[2] - look->root[1] * look->root[1]) /
                                       larger((root[0] * root[2] - root[1] * root[1]) * scene->px * scene->px, 1e-300));
        const double weight = 2 * look->mean * look->mean / (look->sigma * look->sigma);
        common += weight * ratio;
        weights += weight;
        labeling->count++;
    }
    common /= weights;
    const double common_shape = -0.5 * common * common / (INK * INK) - 0.5 * log(weights * INK * INK);
    shapes = common_shape;
    const double factor = exp(common) * scene->px;
    /* What the outlines alone tell of their plane's tilt, along it and across: information, and slope of its logarithm. */
    double plane[2] = {0}, slope[2] = {0}, outlines = 0;
    int64_t plain = 0, multiplied = 0;
    for (int64_t i = 0; i < layout->count; i++) {
        const int64_t k = labeling->labels[i];
        if (k < 0)
            continue;
        const Outline *drawn = work->drawn + i;
        const Look *look = scene->looks + k;
        const Blob *blob = scene->blobs + k;
        double root[3], J[2][7], W[3][BEYONDS], miss[BEYONDS], area[BEYONDS];
        expected_root(scene, layout->dots + i, drawn, labeling->labels[i], root);
        const double xx = look->root[0] - factor * root[0], xy = look->root[1] - factor * root[1];
        const double yy = look->root[2] - factor * root[2];
        const double square = (xx * xx + 2 * xy * xy + yy * yy) / (look->sigma * look->sigma);
        /* One outline in ten is three times as far off. */
        const double usual = 0.9 * exp(-0.5 * square), coarse = 0.1 / 27 * exp(-0.5 * square / 9) + 1e-300;
        const double shape = log(usual + coarse) - look->log_shape;
        /* The root changes by -r sin(tilt) m m' with the tilt, m the minor axis, and is turned with the direction of it. */
        const double cosine = smaller(drawn->facing, 1), sine = sqrt(1 - cosine * cosine), half = factor * (root[0] - root[2]) / 2;
        const double q = hypot(half, factor * root[1]), along = q > 0 ? half / q : 1, across = q > 0 ? factor * root[1] / q : 0;
        const double u = along * (xx - yy) / 2 + across * xy, v = along * xy - across * (xx - yy) / 2;
        const double radius = factor * (root[0] + root[2]) / (1 + cosine), bend = 2 * radius * (1 - cosine) / larger(sine, 1e-9);
        const double trust = (usual + coarse / 9) / ((usual + coarse) * look->sigma * look->sigma);
        slope[0] -= trust * radius * sine * ((xx + yy) / 2 - u);
        slope[1] += trust * bend * v;
        plane[0] += trust * radius * radius * sine * sine / (1 + cosine * cosine);
        plane[1] += trust * bend * bend / 2;
        outlines += trust * radius * radius;
        const double kind = layout->dots[i].ring ? look->ring : look->disk;
        work->shape[i] = shape;
        shapes += shape - look->log_broad;
        /* Where most dots are too small to be seen, those that seem to be are others. */
        const double px = 2 * shorter_px(scene->px, drawn->shape);
        kinds += kind + log(px < LIMIT_PX ? SEEN_BELOW : px < PLAIN_PX ? 1 - MISSED_AT_LIMIT : 1);
        plain += px > PLAIN_PX;
        chi2 += square;
        const double x = (blob->at[0] - drawn->center[0]) * scene->px, y = (blob->at[1] - drawn->center[1]) * scene->px;
        const double print = layout->print * scene->px * pose->focal / drawn->depth, wide = scene->px * scene->px;
        image_rows(layout->dots + i, pose, scene->px, J);
        for (int b = 0; b < BEYONDS; b++) {
            const double more = beyond[b] * beyond[b] + print * print;
            const double a = wide * blob->spread[0] + more, c = wide * blob->spread[1], d = wide * blob->spread[2] + more;
            const double det = a * d - c * c, per = 1 / det;
            W[0][b] = d * per;
            W[1][b] = -c * per;
            W[2][b] = a * per;
            miss[b] = W[0][b] * x * x + 2 * W[1][b] * x * y + W[2][b] * y * y;
            sum[b] -= 0.5 * miss[b];
            dets[b] *= area[b] = 4 * PI * PI * det;
        }
        if (++multiplied % 8 == 0)
            take_roots(sum, dets);
        work->per_dot[i] = kind - 0.5 * miss[2] - 0.5 * log(area[2]);
        chi2 += miss[0];
        for (int p = 0; p < parameters; p++) {
            double u[BEYONDS], v[BEYONDS];
            for (int b = 0; b < BEYONDS; b++) {
                u[b] = W[0][b] * J[0][p] + W[1][b] * J[1][p];
                v[b] = W[1][b] * J[0][p] + W[2][b] * J[1][p];
            }
            for (int q = 0; q <= p; q++)
                for (int b = 0; b < BEYONDS; b++)
                    N[parameters * p + q][b] += u[b] * J[0][q] + v[b] * J[1][q];
        }
        offset += x * x + y * y;
    }
    const double z = far;
    /* Without a camera, four dots of more have a homography with nearly any labels. */
    const int few = !scene->calibrated && labeling->count == LEAST_DOTS && layout->count > LEAST_DOTS;
    if (!(z > 0) || labeling->count < LEAST_DOTS || few)
        return -INFINITY;
    const Camera *camera = scene->camera;
    const double frustum = (double)camera->width / camera->fx * (double)camera->height / camera->fy / (pose->focal * pose->focal);
    double prior = -log(4 * PI * PI) - log(RANGE * 2.25 * frustum * z * z * z);
    if (parameters == 7)
        prior -= 0.5 * log(2 * PI) + 0.5 * log(pose->focal) * log(pose->focal);
    /* The prior is no wider than a radian, its distance and a factor e in focal length: dots in a line leave one open. */
    take_roots(sum, dets);
    for (int b = 0; b < BEYONDS; b++)
        for (int i = 0; i < parameters; i++) {
            double *pivot = N[(parameters + 1) * i] + b;
            *pivot = larger(*pivot + (i < 3 || i == 6 ? 1 : 1 / (z * z)), 1e-300);
            sum[b] -= 0.5 * log(*pivot);
            for (int j = i + 1; j < parameters; j++) {
                const double factor = N[parameters * j + i][b] / *pivot;
                for (int q = i + 1; q <= j; q++)
                    N[parameters * j + q][b] -= factor * N[parameters * q + i][b];
            }
        }
    double total = -INFINITY;
    int best = 0;
    for (int b = 0; b < BEYONDS; b++) {
        sum[b] += 0.5 * parameters * log(2 * PI) + log(BEYOND_SHARE[b]);
        if (sum[b] > total) {
            total = sum[b];
            best = b;
        }
    }
    double ratio = 0;
    for (int b = 0; b < BEYONDS; b++)
        ratio += exp(sum[b] - total);
    missed += missed_together(labeling->missing, plain);
    labeling->sigma = sqrt(offset / (double)(2 * labeling->count - 6 > 1 ? 2 * labeling->count - 6 : 1));
    labeling->chi2 = chi2;
    labeling->beyond = beyond[best];
    labeling->evidence = total + log(ratio) + kinds + missed + prior;
    if (labeling->evidence + shapes < HOPELESS)
        return labeling->evidence += shapes;
    shapes = common_shape;
    for (int64_t i = 0; i < layout->count; i++) {
        const int64_t k = labeling->labels[i];
        double clutter, alike;
        if (k < 0)
            continue;
        clutter_of(scene, k, labeling->labels, layout->count, &clutter, &alike);
        shapes += work->shape[i] - log(clutter);
        disks -= log(alike);
        work->per_dot[i] += smaller(work->shape[i] - log(clutter), -log(alike));
    }
    /* Equal disks, too, have the outlines that they have by a plane that is one of many, and at a distance: what outlines tell
       of these is no accident, and no evidence. At small tilts they change by its square. */
    disks += log(RANGE / (sqrt(2 * PI) * INK)) - 0.5 * common * common / (INK * INK);
    for (int i = 0; i < 2; i++) {
        const double variance = plane[i] + sqrt(outlines) / 2;
        disks += 0.5 * log(variance) - 0.5 * slope[i] * slope[i] / variance;
    }
    labeling->evidence += smaller(shapes, disks);
    if (!(labeling->evidence < INFINITY))
        labeling->evidence = -INFINITY;
    return work->judged = labeling->evidence;
}

/* ---- labelings ---- */

/* Labels dots, all or those with a distance in `among` up to `within`; returns how many have a blob. */
static int64_t label(const Scene *scene, const Layout *layout, const Pose *pose, double reach, double margin,
                     const double *among, double within, Work *work, int64_t *labels)
{
    int64_t count = 0;
    for (int64_t i = 0; i < layout->count; i++) {
        labels[i] = -1;
        if (among && !(among[i] <= within))
            continue;
        outline_of(layout->dots + i, layout->dots[i].xyz, pose, work->drawn + i);
        if (!work->drawn[i].seen || work->drawn[i].facing < LIMIT_FACING / 2)
            continue;
        const int64_t k = blob_of(scene, layout->dots + i, work->drawn + i, reach, margin, work->least + i);
        if (k < 0)
            continue;
        /* Of two dots with the same blob, the farther one gets none. */
        const int64_t other = scene->owner[k];
        if (other >= 0) {
            if (work->least[other] <= work->least[i])
                continue;
            labels[other] = -1;
        }
        scene->owner[k] = i;
        labels[i] = k;
    }
    for (int64_t i = 0; i < layout->count; i++)
        if (labels[i] >= 0) {
            scene->owner[labels[i]] = -1;
            count++;
        }
    return count;
}

static int64_t matches_of(const Scene *scene, const Layout *layout, const int64_t *labels, Work *work)
{
    int64_t m = 0;
    const double more = (SEARCH_PX * SEARCH_PX) / (scene->px * scene->px);
    for (int64_t i = 0; i < layout->count; i++) {
        if (labels[i] < 0)
            continue;
        const Blob *blob = scene->blobs + labels[i];
        const double a = blob->spread[0] + more, b = blob->spread[1], c = blob->spread[2] + more, det = a * c - b * b;
        work->matches[m] = (Match){i, labels[i]};
        work->seen[2 * m] = blob->at[0];
        work->seen[2 * m + 1] = blob->at[1];
        work->weight[3 * m] = c / det;
        work->weight[3 * m + 1] = -b / det;
        work->weight[3 * m + 2] = a / det;
        m++;
    }
    return m;
}

enum { FIT_STEPS = 8 };
static const double FIT_TOLERANCE = 1e-4;

/* Chi-square per degree of freedom beyond which neighbors are none, if their semi-axes have up to so many px, without a camera
   and with one; beyond, it grows with their square, as what a lens bends does. Of those that lead to labels it is below 125,
   without a camera through a lens with k1 -0.45; of a keyboard's keys, half have 590 or more, and the image takes twice as long
   without this limit. */
static const double IMPLAUSIBLE = 250, COARSE_PX[] = {5, 10};

static double fit(const Scene *scene, const Layout *layout, int64_t m, Work *work, Pose *pose)
{
    return refine_pose(layout->dots, work->matches, m, work->seen, work->weight, 0, scene->calibrated ? 0 : 1, FIT_STEPS,
                       FIT_TOLERANCE, pose);
}

/* Whether all dots matched are on one plate. */
static int on_one_plate(const Layout *layout, const Work *work, int64_t m)
{
    for (int64_t i = 1; i < m; i++)
        if (layout->dots[work->matches[i].dot].plate != layout->dots[work->matches[0].dot].plate)
            return 0;
    return 1;
}

/* Leaves out dots that may be one blob with their neighbors, where it has not the outline of one dot. */
static void leave_merged(const Scene *scene, const Layout *layout, Labeling *labeling)
{
    for (int64_t i = 0; i < layout->count; i++) {
        Outline drawn;
        if (labeling->labels[i] < 0 || scene->blobs[labeling->labels[i]].state == ROUGH)
            continue;
        outline_of(layout->dots + i, layout->dots[i].xyz, &labeling->pose, &drawn);
        const double area = drawn.shape[0] * drawn.shape[2] - drawn.shape[1] * drawn.shape[1];
        const double size = scene->looks[labeling->labels[i]].size + log(scene->focal) - 0.25 * log(larger(area, 1e-300));
        const int single = scene->blobs[labeling->labels[i]].state == FITTED && size < TWO;
        if (!single && merges(scene, layout, &labeling->pose, i, &drawn))
            labeling->labels[i] = -1;
    }
}

/* Fits the pose of a labeling, from its pose and from the mirrored one, and keeps the better. */
void fit_labeling(const Scene *scene, const Layout *layout, Labeling *labeling, Work *work)
{
    leave_merged(scene, layout, labeling);
    const int64_t m = matches_of(scene, layout, labeling->labels, work);
    Pose other;
    labeling->count = m;
    labeling->evidence = -INFINITY;
    if (m < LEAST_DOTS)
        return;
    const int mirrors = on_one_plate(layout, work, m);
    if (mirrors)
        mirrored_pose(layout->dots, work->matches, m, &labeling->pose, &other);
    const double chi2 = fit(scene, layout, m, work, &labeling->pose);
    evidence_of(scene, layout, labeling, work);
    if (!mirrors)
        return;
    /* Outlines tell them apart, too: where centers fit far worse, they have no say. */
    const double mirrored = fit(scene, layout, m, work, &other);
    if (!(mirrored < 4 * chi2 + 100) && labeling->evidence > -INFINITY)
        return;
    Labeling second = *labeling;
    second.pose = other;
    if (evidence_of(scene, layout, &second, work) > labeling->evidence)
        *labeling = second;
}

/* More evidence than three dots left out have been seen to add, in boards of up to 336 dots: 100. */
static const double TRIMMED = 200;

/* Leaves out dots, one by one, whose blobs are more likely clutter. */
static void trim(const Scene *scene, const Layout *layout, Labeling *labeling, Work *work)
{
    for (int round = 0; round < 3 && labeling->count > LEAST_DOTS; round++) {
        int64_t worst = -1;
        double least = -3;
        if (work->judged != labeling->evidence)
            evidence_of(scene, layout, labeling, work);
        for (int64_t i = 0; i < layout->count; i++)
            if (labeling->labels[i] >= 0 && work->per_dot[i] < least) {
                least = work->per_dot[i];
                worst = i;
            }
        if (worst < 0)
            return;
        Labeling fewer = *labeling;
        fewer.labels = work->trial;
        memcpy(fewer.labels, labeling->labels, (size_t)layout->count * sizeof *fewer.labels);
        fewer.labels[worst] = -1;
        fit_labeling(scene, layout, &fewer, work);
        if (!(fewer.evidence > labeling->evidence))
            return;
        memcpy(labeling->labels, fewer.labels, (size_t)layout->count * sizeof *fewer.labels);
        fewer.labels = labeling->labels;
        *labeling = fewer;
    }
}

/* Labels again where the fitted pose has the dots, until nothing changes; those that are too far below `rival` to come near
   it are left as they are. */
void settle(const Scene *scene, const Layout *layout, Labeling *labeling, double rival, Work *work)
{
    const double reach = smaller(NEAR_REACH, layout->reach);
    fit_labeling(scene, layout, labeling, work);
    for (int round = 0; round < 3 && labeling->evidence > HOPELESS; round++) {
        int64_t *labels = work->next;
        label(scene, layout, &labeling->pose, reach, NEAR_PX / scene->px, NULL, 0, work, labels);
        if (!memcmp(labels, labeling->labels, (size_t)layout->count * sizeof *labels))
            break;
        Labeling next = *labeling;
        next.labels = labels;
        fit_labeling(scene, layout, &next, work);
        if (!(next.evidence > labeling->evidence))
            break;
        memcpy(labeling->labels, labels, (size_t)layout->count * sizeof *labels);
        next.labels = labeling->labels;
        *labeling = next;
    }
    if (labeling->count > LEAST_DOTS && labeling->evidence > larger(HOPELESS, rival - TRIMMED))
        trim(scene, layout, labeling, work);
}

static uint64_t digest(const int64_t *labels, int64_t n)
{
    uint64_t hash = 14695981039346656037u;
    for (int64_t i = 0; i < n; i++)
        hash = (hash ^ (uint64_t)(labels[i] + 2)) * 1099511628211u;
    return hash;
}

/* Fits the pose of the labels of a guess, also the mirrored one if asked for, and keeps the better; 0 if neither fits at all. */
static int fits_roughly(const Scene *scene, const Layout *layout, int mirrors, Labeling *labeling, Work *work)
{
    const int64_t m = matches_of(scene, layout, labeling->labels, work);
    Pose other = labeling->pose;
    mirrors = mirrors && on_one_plate(layout, work, m);
    if (mirrors)
        mirrored_pose(layout->dots, work->matches, m, &labeling->pose, &other);
    const double chi2 = fit(scene, layout, m, work, &labeling->pose);
    const double mirrored = mirrors ? fit(scene, layout, m, work, &other) : INFINITY;
    if (mirrored < chi2)
        labeling->pose = other;
    const double semi = scene->looks[work->matches[0].blob].mean, coarse = larger(1, semi / COARSE_PX[scene->calibrated]);
    return smaller(chi2, mirrored) <= IMPLAUSIBLE * coarse * coarse * (double)(2 * m - 6);
}

/* Whether labels were tried before; they are now. Of many, some are forgotten: they are tried twice. */
static int tried(Work *work, const int64_t *labels, int64_t n)
{
    const uint64_t hash = digest(labels, n) | 1;
    uint64_t *place = work->tried + (hash >> 3) % TRIED;
    if (*place == hash)
        return 1;
    *place = hash;
    return 0;
}

/* Adds a labeling to the best ones, if it is among these and not there yet; returns its place or -1. */
static int64_t keep(Pool *pool, const Layout *layout, const Labeling *labeling)
{
    const size_t size = (size_t)layout->count * sizeof *labeling->labels;
    if (!(labeling->evidence > -INFINITY))
        return -1;
    for (int64_t i = 0; i < pool->count; i++)
        if (!memcmp(pool->best[i].labels, labeling->labels, size)) {
            if (!(labeling->evidence > pool->best[i].evidence))
                return -1;
            int64_t *labels = pool->best[i].labels;
            pool->best[i] = *labeling;
            pool->best[i].labels = labels;
            return i;
        }
    int64_t place = pool->count;
    if (place == KEPT) {
        place = 0;
        for (int64_t i = 1; i < KEPT; i++)
            if (pool->best[i].evidence < pool->best[place].evidence)
                place = i;
        if (!(labeling->evidence > pool->best[place].evidence))
            return -1;
    } else
        pool->count++;
    int64_t *labels = pool->best[place].labels;
    memcpy(labels, labeling->labels, size);
    pool->best[place] = *labeling;
    pool->best[place].labels = labels;
    return place;
}

/* Steps of a search that count for each dot of a guess that is followed, fitted and settled: as many as take that long. */
enum { FOLLOWING = 6, FITTING = 25, SETTLING = 45 };

/* The labeling to which a guess leads, grown from the dot that it starts from. Returns its place in the pool or -1. */
static int64_t follow(const Scene *scene, const Layout *layout, const Guess *guess, Work *work, Pool *pool)
{
    const Constellation *part = layout->constellations + guess->constellation;
    const double *origin = layout->dots[part->dots[guess->start]].xyz;
    Labeling labeling = {0};
    labeling.labels = work->labels;
    labeling.pose = guess->pose;
    double within = INFINITY, farthest = 0;
    for (int64_t i = 0; i < layout->count; i++) {
        const double *X = layout->dots[i].xyz, x = X[0] - origin[0], y = X[1] - origin[1], z = X[2] - origin[2];
        work->apart[i] = sqrt(x * x + y * y + z * z);
        farthest = larger(farthest, work->apart[i]);
    }
    if (part->neighbor_count < layout->count - 1) {
        within = 0;
        const int64_t *neighbors = part->neighbors + part->neighbor_count * guess->start;
        for (int64_t j = 0; j < part->neighbor_count; j++)
            within = larger(within, work->apart[part->dots[neighbors[j]]]);
        within *= 1 + 1e-9;
    }
    /* Far from where it starts, a guess is not good enough to tell dots from their neighbors: it grows by 1.6 each time; by
       2.5, boards of 300 dots lose their corners. */
    int64_t count = 0;
    int begins = 1;
    for (int round = 0; round < 40; round++) {
        count = label(scene, layout, &labeling.pose, layout->reach, GUESS_PX / scene->px, work->apart, within, work, labeling.labels);
        if (count < LEAST_DOTS && within < farthest) {
            within *= 1.6;
            if (round > 3)
                return -1;
            continue;
        }
        if (count < LEAST_DOTS)
            return -1;
        if (!(within < farthest))
            break;
        /* Others that begin alike end alike; what is labeled later may stay the same to the end. */
        if (begins && tried(work, labeling.labels, layout->count))
            return -1;
        begins = 0;
        if (!fits_roughly(scene, layout, round == 0, &labeling, work))
            return -1;
        within *= 1.6;
    }
    if (tried(work, labeling.labels, layout->count) && begins)
        return -1;
    /* A quarter of what should be seen has to be; of several plates, some may not be where the first one has them. */
    int64_t inside = 0;
    for (int64_t i = 0; i < layout->count && layout->plate_count == 1; i++)
        inside += labeling.labels[i] < 0 && work->drawn[i].seen && work->drawn[i].facing > PLAIN_FACING && in_frame(scene, work->drawn + i);
    if (inside > 3 * count)
        return -1;
    if (begins) {
        work->steps += FITTING * layout->count;
        if (!fits_roughly(scene, layout, 1, &labeling, work))
            return -1;
    }
    work->steps += SETTLING * layout->count;
    settle(scene, layout, &labeling, best_of(pool)->evidence, work);
    return keep(pool, layout, &labeling);
}

/* ---- guesses ---- */

static int hop(const Scene *scene, const Layout *layout, Pool *pool, Work *work);

/* How much longer an ellipse is than that of a disk with a normal there, as the hyperbolic cosine of the logarithm: the image of a
   small disk is proportional to G = A (I - n n') A', A = [I, -x]. */
static double stretched(const double *e, double area, double x, double y, const double *n)
{
    const double ax = n[0] - x * n[2], ay = n[1] - y * n[2];
    const double xx = 1 + x * x - ax * ax, yy = 1 + y * y - ay * ay, xy = x * y - ax * ay;
    const double det = larger(xx * yy - xy * xy, 1e-12);
    return (e[0] * yy + e[2] * xx - 2 * e[1] * xy) / (2 * area * sqrt(det));
}

static void add_guess(Work *work, const Guess *guess)
{
    if (work->guess_count < GUESSES) {
        work->guesses[work->guess_count++] = *guess;
        return;
    }
    /* Full: one with less support goes; if there is none near, this one does. */
    for (int64_t tries = 0; tries < 16; tries++) {
        work->replaced = (work->replaced + 7919) % GUESSES;
        Guess *other = work->guesses + work->replaced;
        if (other->support < guess->support) {
            *other = *guess;
            return;
        }
    }
}

/* Poses guessed from blob `i`, which work->position and work->normal are of, as the first and `j` as the second of a pair of dots:
   the outline of the first gives the plane, twice, up to the rotation about its normal; the ray through the second meets that
   plane where its dot is. */
static void guess_pair(const Scene *scene, const Layout *layout, int32_t which, int64_t i, int64_t j, double drift, int64_t least,
                       Work *work)
{
    const Constellation *part = layout->constellations + which;
    const Pose to_body = inverse_of(layout->plates + part->plate);
    const Look *first = scene->looks + i, *second = scene->looks + j;
    const double f = scene->focal, x = scene->blobs[j].at[0] / f, y = scene->blobs[j].at[1] / f;
    const double allowed = hypot(first->slack, second->slack), growth = exp(2 * GROWTH * allowed), longest = cosh(allowed);
    const double *e = scene->blobs[j].shape, area = f * f * second->area, limit = exp(hypot(allowed, 2 * INK));
    for (int side = 0; side < 2; side++) {
        const double *p = work->position[side], *n = work->normal[side];
        const double toward = n[0] * x + n[1] * y + n[2];
        work->steps++;
        if (!(toward < 0) || !(stretched(e, area, x, y, n) < longest))
            continue;
        const double away = n[0] * p[0] + n[1] * p[1] + n[2] * p[2];
        int64_t low = 0, high = part->pair_count;
        if (part->flat) {
            const double deep = away / toward, qx = deep * x - p[0], qy = deep * y - p[1], qz = deep - p[2];
            const double far = sqrt(qx * qx + qy * qy + qz * qz);
            low = lower_bound(part->ratio, part->pair_count, far / limit);
            high = lower_bound(part->ratio, part->pair_count, far * limit);
        }
        for (int64_t k = low; k < high; k++) {
            const int64_t a = part->pairs[2 * k], c = part->pairs[2 * k + 1];
            const Dot *A = layout->dots + part->dots[a], *C = layout->dots + part->dots[c];
            work->steps++;
            if (is_other_kind(A, scene->blobs + i) || is_other_kind(C, scene->blobs + j))
                continue;
            const double r = A->radius, *X = part->points + 3 * a, *Y = part->points + 3 * c;
            const double step[3] = {Y[0] - X[0], Y[1] - X[1], Y[2] - X[2]};
            const double lateral = step[0] * step[0] + step[1] * step[1], depth = (away * r + step[2]) / toward;
            double u[3] = {depth * x - r * p[0] - step[2] * n[0], depth * y - r * p[1] - step[2] * n[1],
                           depth - r * p[2] - step[2] * n[2]};
            const double far = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
            const double size = C->radius * C->radius * -toward / (depth * depth * second->area);
            if (!(depth > 0 && lateral < far * limit * limit && lateral * limit * limit > far && size < growth && size * growth > 1))
                continue;
            const double scale = sqrt(lateral / far), length = sqrt(far), span = sqrt(lateral);
            for (int d = 0; d < 3; d++)
                u[d] /= length;
            const double v[3] = {n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0]};
            const double cosine = step[0] / span, sine = step[1] / span;
            Pose in_camera = {{0}, {0}, f};
            double *R = in_camera.R, *t = in_camera.t;
            for (int d = 0; d < 3; d++) {
                R[3 * d] = cosine * u[d] - sine * v[d];
                R[3 * d + 1] = sine * u[d] + cosine * v[d];
                R[3 * d + 2] = n[d];
                /* The distance between dots tells the scale better than the size of one. */
                t[d] = scale * r * p[d] - (R[3 * d] * X[0] + R[3 * d + 1] * X[1] + R[3 * d + 2] * X[2]);
            }
            int64_t votes = 0;
            double support = 0;
            for (int64_t l = 0; l < part->neighbor_count && votes + part->neighbor_count - l >= least; l++) {
                const int64_t b = part->neighbors[part->neighbor_count * a + l];
                const double *Z = part->points + 3 * b, dx = Z[0] - X[0], dy = Z[1] - X[1], dz = Z[2] - X[2];
                const double px = R[0] * Z[0] + R[1] * Z[1] + R[2] * Z[2] + t[0];
                const double py = R[3] * Z[0] + R[4] * Z[1] + R[5] * Z[2] + t[1];
                const double pz = R[6] * Z[0] + R[7] * Z[1] + R[8] * Z[2] + t[2];
                const double facing = -(px * n[0] + py * n[1] + pz * n[2]), radius = layout->dots[part->dots[b]].radius;
                work->steps++;
                if (b == c) {
                    votes++;
                    support += 1;
                    continue;
                }
                if (!(pz > 0 && facing > 0))
                    continue;
                /* How close the nearest blob is: 1 at the place, 0 beyond the gate, less by the square of the distance. */
                const double per = 1 / pz, at[2] = {f * px * per, f * py * per};
                const double gate = f * drift * sqrt(dx * dx + dy * dy + dz * dz) * per + DRIFT_PX / scene->px;
                double away_from;
                nearest_blob(scene, NULL, at, gate, 0, gate, radius * radius * facing * per * per * per, ALIKE, &away_from);
                const double close = 1 - away_from;
                votes += close > 0;
                support += close;
            }
            if (votes < least)
                continue;
            const Guess guess = {joined(&in_camera, &to_body), support, which, a};
            add_guess(work, &guess);
        }
    }
}

/* The up to `most` nearest to blob i of the first `before` blobs, within `far` and of about its size. */
static int64_t partners_of(const Scene *scene, int64_t i, int64_t before, int64_t most, double far, double alike, Work *work)
{
    const double *at = scene->blobs[i].at, size = scene->looks[i].size, side = scene->side;
    const int64_t square = square_of(scene, at), column = square % scene->columns, row = square / scene->columns;
    const int64_t rings = scene->columns > scene->rows ? scene->columns : scene->rows;
    int64_t count = 0;
    for (int64_t ring = 0; ring <= rings; ring++) {
        const double inside = (double)(ring - 1) * side;
        /* What is in the squares farther out is farther away than this. */
        if (inside > far || (ring > 0 && count >= most && work->neighbors[most - 1].distance < inside * inside))
            break;
        for (int64_t y = row - ring < 0 ? 0 : row - ring; y <= row + ring && y < scene->rows; y++) {
            const int64_t step = y == row - ring || y == row + ring || ring == 0 ? 1 : 2 * ring;
            for (int64_t x = column - ring; x <= column + ring; x += step) {
                if (x < 0 || x >= scene->columns)
                    continue;
                const int64_t square = y * scene->columns + x;
                for (int32_t q = scene->first[square]; q < scene->first[square + 1]; q++) {
                    const int64_t j = scene->member[q];
                    if (j >= before)
                        break; /* they are in order */
                    if (scene->taken[j] || j == i)
                        continue;
                    const double dx = scene->blobs[j].at[0] - at[0], dy = scene->blobs[j].at[1] - at[1];
                    const double distance = dx * dx + dy * dy;
                    work->steps++;
                    if (distance > far * far || fabs(scene->looks[j].size - size) > alike ||
                        (count >= most && distance >= work->neighbors[most - 1].distance))
                        continue;
                    int64_t place = count < most ? count++ : most - 1;
                    for (; place > 0 && work->neighbors[place - 1].distance > distance; place--)
                        work->neighbors[place] = work->neighbors[place - 1];
                    work->neighbors[place] = (Neighbor){distance, j};
                }
            }
        }
    }
    return count;
}

static int by_support(const void *a, const void *b)
{
    const Guess *x = a, *y = b;
    if (x->support != y->support)
        return x->support > y->support ? -1 : 1;
    return x->start < y->start ? -1 : x->start > y->start;
}

/* Whether nothing is missing of what faces the camera. Of a body of several plates, two have to be seen: of one alone, the pose may be
   mirrored, with the others turned away. */
static int is_whole(const Layout *layout, const Labeling *labeling)
{
    int64_t facing = 0, plate = -1, plates = 0;
    if (labeling->absent || !(labeling->evidence > SURE))
        return 0;
    for (int64_t i = 0; i < layout->count; i++) {
        Outline drawn;
        outline_of(layout->dots + i, layout->dots[i].xyz, &labeling->pose, &drawn);
        facing += drawn.seen && drawn.facing > LIMIT_FACING;
        if (labeling->labels[i] >= 0 && layout->dots[i].plate != plate) {
            plate = layout->dots[i].plate;
            plates++;
        }
    }
    return 4 * labeling->count >= 3 * (plates > 1 ? facing : layout->count);
}

/* Follows the up to `most` likeliest guesses, and forgets the others; returns 1 if the search may end. */
static int follow_all(const Scene *scene, const Layout *layout, int64_t most, Work *work, Pool *pool)
{
    if (work->guess_count > 1)
        qsort(work->guesses, (size_t)work->guess_count, sizeof *work->guesses, by_support);
    int whole = 0;
    for (int64_t i = 0; i < work->guess_count && i < most && !whole; i++) {
        work->steps += FOLLOWING * layout->count;
        const int64_t place = follow(scene, layout, work->guesses + i, work, pool);
        if (place < 0)
            continue;
        if (pool->best + place == best_of(pool))
            while (hop(scene, layout, pool, work))
                ;
        whole = is_whole(layout, best_of(pool));
    }
    work->guess_count = 0;
    return whole;
}

const Labeling *best_of(const Pool *pool)
{
    static const Labeling none = {.evidence = -INFINITY};
    const Labeling *best = &none;
    for (int64_t i = 0; i < pool->count; i++)
        if (pool->best[i].evidence > best->evidence)
            best = pool->best + i;
    return best;
}

/* Few dots pair with the nearest 16 blobs, many with the nearest 6, which are their neighbors; rings with more, since pairs
   with a ring are few. */
enum { MANY_DOTS = 16, NEAR_BLOBS = 16, NEAREST_BLOBS = 6, RINGED_BLOBS = 40 };

/* Guesses from one blob as the first of pairs with any of the first `blobs`; with `fresh` of these done, pairs of two of
   them are not made again. */
static void guess_from(const Scene *scene, const Layout *layout, int64_t i, int64_t fresh, int64_t blobs, int strong, Work *work)
{
    const int ring = layout->ringed && scene->blobs[i].hole > 1 - DOUBTFUL;
    int posed = 0;
    for (int32_t c = 0; c < layout->constellation_count; c++) {
        const Constellation *part = layout->constellations + c;
        const int64_t neighbors = part->neighbor_count, usual = neighbors / 2 > 2 ? neighbors / 2 : 2 < neighbors ? 2 : neighbors;
        const int64_t least = strong ? neighbors - neighbors / 4 : usual;
        const double drift = strong || !scene->calibrated ? scene->looks[i].slack : DRIFT;
        if (!part->pair_count)
            continue;
        const int64_t most = ring ? RINGED_BLOBS : strong || part->count > MANY_DOTS ? NEAREST_BLOBS : NEAR_BLOBS;
        /* The factor of 2 covers the perspective of near views, in which radii shrink toward the far side. */
        const double far = 2 * part->ratio[part->pair_count - 1] * larger(scene->looks[i].root[0], scene->looks[i].root[2]) / scene->px;
        int64_t count = partners_of(scene, i, blobs, most, far, part->sizes + 1, work);
        if (count < LEAST_DOTS - 1)
            continue;
        for (int64_t q = 0; q < count; q++)
            if (i >= fresh || work->neighbors[q].blob >= fresh) {
                if (!posed++)
                    circle_poses(scene->blobs + i, scene->focal, work->position, work->normal);
                guess_pair(scene, layout, c, i, work->neighbors[q].blob, drift, least, work);
            }
    }
}

/* Where many dots have a labeling, but not the whole layout, the search takes so many times its steps: layouts that nearly repeat
   have labelings of most dots. Of 167 dots in three rows around a disk, of which 20 to 100 were hidden, 3 of 300 views had wrong
   labels without. */
enum { LONGER = 3 };

/* Finds the labelings of the blobs that are not taken, the best `pool`.

   The first n + 4 blobs, which are the most dot-like, are searched, then twice as many, and so on. Guesses that most of the
   near dots confirm are followed at once; those with half of them when none is left among twice as many blobs, if the search is
   thorough. */
void search(Scene *scene, const Layout *layout, const Budget *budget, int thorough, Work *work, Pool *pool)
{
    int64_t before = 0, fresh = 0, blobs = layout->count + 4, after = -1;
    /* Each constellation is searched; larger layouts take longer to label; further copies are in plain sight. */
    const int64_t begin = work->steps;
    const int64_t span = budget->steps * layout->constellation_count * (32 + layout->count) / (thorough ? 32 : 96);
    work->guess_count = work->replaced = work->cut = 0;
    memset(work->tried, 0, TRIED * sizeof *work->tried);
    while (fresh < scene->count) {
        blobs = blobs < scene->count ? blobs : scene->count;
        for (int pass = 0; pass < (thorough ? 3 : 1); pass++) {
            const int strong = pass == 0;
            const int64_t from = pass == 1 ? before : fresh, to = pass == 1 ? fresh : blobs;
            if (pass == 2 && blobs < scene->count)
                break;
            for (int64_t i = 0; i < to; i++) {
                if (scene->taken[i])
                    continue;
                guess_from(scene, layout, i, from, to, strong, work);
                if (strong && work->guess_count && follow_all(scene, layout, FOLLOWED, work, pool))
                    return;
                const int longer = layout->count > MANY_DOTS && best_of(pool)->evidence > SURE;
                work->cut = work->steps - begin > (longer ? LONGER * span : span) || budget->late(budget);
                if (work->cut)
                    break;
            }
            if (!strong && follow_all(scene, layout, LAST_FOLLOWED, work, pool))
                return;
            /* With some of the dots hidden, the strong guesses have led there. */
            if (work->cut || best_of(pool)->evidence > SURE + 20)
                break;
        }
        /* What is found is looked for among twice as many blobs, and no more. */
        if (work->cut || (after >= 0 && blobs >= after))
            return;
        if (after < 0 && best_of(pool)->evidence > SURE)
            after = 2 * blobs;
        before = fresh;
        fresh = blobs;
        blobs *= 2;
    }
}

/* ---- rivals ---- */

/* A pose moved within the plane of a plate: dots at `from` come to where those at `to` are, turned by the angle. */
static Pose moved_pose(const Pose *plate, const Pose *pose, const double *from, const double *to, double cosine, double sine)
{
    /* In the plate X -> T X + s with T a rotation about z. */
    const Pose within = {{cosine, -sine, 0, sine, cosine, 0, 0, 0, 1},
                         {to[0] - cosine * from[0] + sine * from[1], to[1] - sine * from[0] - cosine * from[1], 0}, 1};
    const Pose in_camera = joined(pose, plate), there = joined(&in_camera, &within), to_body = inverse_of(plate);
    return joined(&there, &to_body);
}

/* The constellation most of whose dots have a blob. */
static const Constellation *main_part(const Layout *layout, const int64_t *labels)
{
    const Constellation *best = layout->constellations;
    int64_t most = -1;
    for (int64_t c = 0; c < layout->constellation_count; c++) {
        int64_t count = 0;
        for (int64_t i = 0; i < layout->constellations[c].count; i++)
            count += labels[layout->constellations[c].dots[i]] >= 0;
        if (count > most) {
            most = count;
            best = layout->constellations + c;
        }
    }
    return best;
}

static int64_t common_divisor(int64_t a, int64_t b) { return b ? common_divisor(b, a % b) : a; }

/* Dots of large layouts by which rivals are probed. */
enum { PROBES = 40 };

/* Whether a labeling with a pose may have blobs for `least` dots: of up to `probes`, as many less three standard deviations of
   what such a sample has, `stride` apart. */
static int may_label(const Scene *scene, const Layout *layout, const Pose *pose, int64_t probes, int64_t stride, int64_t least)
{
    const double share = (double)least / (double)layout->count, left = (double)(layout->count - probes) / (double)layout->count;
    double spare = (double)probes * (1 - share) + 3 * sqrt(left * (double)probes * share * (1 - share)) + 1;
    for (int64_t k = 0, i = 0; k < probes && spare >= 0; k++, i = (i + stride) % layout->count) {
        Outline drawn;
        double nearest;
        outline_of(layout->dots + i, layout->dots[i].xyz, pose, &drawn);
        spare -= !drawn.seen || blob_of(scene, layout->dots + i, &drawn, layout->reach, GUESS_PX / scene->px, &nearest) < 0;
    }
    return spare >= 0;
}

/* Other labelings of a labeling's dots: the plate is moved onto itself so that any pair of dots comes to where a pair of
   labeled neighbors is. Those that label at least `least` dots are fitted and kept, at most `most` of them, until one has
   `enough` evidence. */
static void rigid_rivals(const Scene *scene, const Layout *layout, const Labeling *chosen, int64_t least, int64_t most,
                         double enough, Work *work, Pool *pool)
{
    const Constellation *part = main_part(layout, chosen->labels);
    const Pose pose = chosen->pose;
    const int64_t probes = layout->count < PROBES ? layout->count : PROBES;
    /* They are spread by the golden section, since every second dot of a grid is in the same columns. */
    int64_t stride = (int64_t)(0.618 * (double)layout->count) + 1;
    while (common_divisor(stride, layout->count) > 1)
        stride++;
    /* Two bases: a rival may lack one of the dots of the first. Of short pairs, all images are among the pairs of neighbors. */
    int64_t used[2] = {-1, -1};
    for (int base = 0; base < 2; base++) {
        int64_t first = -1, second = -1;
        for (int64_t k = 0; k < part->pair_count && first < 0; k++) {
            const int64_t a = part->pairs[2 * k], c = part->pairs[2 * k + 1];
            if (chosen->labels[part->dots[a]] >= 0 && chosen->labels[part->dots[c]] >= 0 && a != used[0] && a != used[1] &&
                c != used[0] && c != used[1]) {
                first = a;
                second = c;
            }
        }
        if (first < 0)
            return;
        used[0] = first;
        used[1] = second;
        const double *A = part->points + 3 * first, *C = part->points + 3 * second, x = C[0] - A[0], y = C[1] - A[1];
        const double length = hypot(x, y);
        int64_t tries = 0;
        for (int64_t k = 0; k < part->pair_count && tries < most; k++) {
            const double *B = part->points + 3 * part->pairs[2 * k], *D = part->points + 3 * part->pairs[2 * k + 1];
            const double u = D[0] - B[0], v = D[1] - B[1], span = hypot(u, v);
            if ((part->pairs[2 * k] == first && part->pairs[2 * k + 1] == second) || fabs(log(span / length)) > 0.25)
                continue;
            const double area = span * length;
            const Pose tilted = moved_pose(layout->plates + part->plate, &pose, B, A, (u * x + v * y) / area, (u * y - v * x) / area);
            work->steps += 4 * probes;
            if (!may_label(scene, layout, &tilted, probes, stride, least))
                continue;
            Labeling rival = {0};
            rival.labels = work->labels;
            rival.pose = tilted;
            const int64_t count = label(scene, layout, &tilted, layout->reach, GUESS_PX / scene->px, NULL, 0, work, rival.labels);
            if (count < least || count < LEAST_DOTS || tried(work, rival.labels, layout->count))
                continue;
            tries++;
            settle(scene, layout, &rival, chosen->evidence, work);
            keep(pool, layout, &rival);
            if (rival.evidence > enough)
                return;
        }
    }
}

/* Of few dots, any affine map of the plate near a rotation, since their outlines tell the tilt only roughly: one that takes
   any three dots to three labeled ones. */
static void affine_rivals(const Scene *scene, const Layout *layout, const Labeling *chosen, int64_t least, Work *work, Pool *pool)
{
    const Constellation *part = main_part(layout, chosen->labels);
    int64_t labeled[FEW_DOTS], m = 0, base[3] = {-1, -1, -1};
    for (int64_t i = 0; i < part->count && m < FEW_DOTS; i++)
        if (chosen->labels[part->dots[i]] >= 0)
            labeled[m++] = i;
    double widest = 0, shortest = INFINITY;
    for (int64_t a = 0; a < m; a++) {
        shortest = smaller(shortest, shorter_px(scene->px, scene->blobs[chosen->labels[part->dots[labeled[a]]]].shape));
        for (int64_t b = a + 1; b < m; b++)
            for (int64_t c = b + 1; c < m; c++) {
                const double *A = part->points + 3 * labeled[a], *B = part->points + 3 * labeled[b], *C = part->points + 3 * labeled[c];
                const double area = fabs((B[0] - A[0]) * (C[1] - A[1]) - (B[1] - A[1]) * (C[0] - A[0]));
                if (area > widest) {
                    widest = area;
                    base[0] = labeled[a];
                    base[1] = labeled[b];
                    base[2] = labeled[c];
                }
            }
    }
    if (base[0] < 0)
        return;
    const double limit = 0.2 + 1 / larger(shortest, 0.5), most = exp(2 * limit);
    const double *A = part->points + 3 * base[0], *B = part->points + 3 * base[1], *C = part->points + 3 * base[2];
    for (int64_t a = 0; a < part->count; a++)
        for (int64_t b = 0; b < part->count; b++)
            for (int64_t c = 0; c < part->count; c++) {
                if (a == b || b == c || a == c || (a == base[0] && b == base[1] && c == base[2]))
                    continue;
                const double *P = part->points + 3 * a, *Q = part->points + 3 * b, *S = part->points + 3 * c;
                const double p = Q[0] - P[0], q = S[0] - P[0], r = Q[1] - P[1], s = S[1] - P[1], det = p * s - q * r;
                if (!(fabs(det) > 0.02 * widest))
                    continue;
                /* L [Q - P, S - P] = [B - A, C - A]. */
                const double bx = B[0] - A[0], by = B[1] - A[1], cx = C[0] - A[0], cy = C[1] - A[1];
                const double L[4] = {(bx * s - cx * r) / det, (cx * p - bx * q) / det, (by * s - cy * r) / det, (cy * p - by * q) / det};
                const double area = L[0] * L[3] - L[1] * L[2];
                const double half = (L[0] * L[0] + L[1] * L[1] + L[2] * L[2] + L[3] * L[3]) / 2;
                const double longest = half + sqrt(larger(half * half - area * area, 0));
                work->steps++;
                if (!(area > 0 && longest < most && area * area / longest > 1 / most))
                    continue;
                Labeling rival = {0};
                int64_t count = 0;
                rival.labels = work->labels;
                for (int64_t i = 0; i < layout->count; i++)
                    rival.labels[i] = -1;
                for (int64_t i = 0; i < part->count; i++) {
                    const double *X = part->points + 3 * i;
                    const double x = A[0] + L[0] * (X[0] - P[0]) + L[1] * (X[1] - P[1]);
                    const double y = A[1] + L[2] * (X[0] - P[0]) + L[3] * (X[1] - P[1]);
                    double nearest = 1;
                    int64_t which = -1;
                    for (int64_t l = 0; l < m; l++) {
                        const int64_t dot = part->dots[labeled[l]];
                        const double *Y = part->points + 3 * labeled[l], radius = layout->dots[dot].radius;
                        const double far = layout->reach * radius + GUESS_PX * radius / larger(shortest, 0.5);
                        const double square = ((x - Y[0]) * (x - Y[0]) + (y - Y[1]) * (y - Y[1])) / (far * far);
                        if (square < nearest) {
                            nearest = square;
                            which = chosen->labels[dot];
                        }
                    }
                    int there = 0;
                    for (int64_t l = 0; l < i; l++)
                        there |= which >= 0 && rival.labels[part->dots[l]] == which;
                    if (which >= 0 && !there) {
                        rival.labels[part->dots[i]] = which;
                        count++;
                    }
                }
                if (count < least || count < LEAST_DOTS || tried(work, rival.labels, layout->count))
                    continue;
                const double cosine = L[0] + L[3], sine = L[2] - L[1], norm = hypot(cosine, sine);
                rival.pose = moved_pose(layout->plates + part->plate, &chosen->pose, P, A, cosine / norm, sine / norm);
                if (chosen->count < layout->count)
                    settle(scene, layout, &rival, chosen->evidence, work);
                else
                    fit_labeling(scene, layout, &rival, work);
                keep(pool, layout, &rival);
            }
}

/* Goes on from the best labeling of a board to one of more dots, such as by a row: returns 1 if there was one. */
static int hop(const Scene *scene, const Layout *layout, Pool *pool, Work *work)
{
    const Labeling *best = best_of(pool);
    if (layout->count <= MANY_DOTS || best->missing == 0 || !(best->evidence > SURE))
        return 0;
    const double before = best->evidence;
    rigid_rivals(scene, layout, best, best->count, 200, before + 1, work, pool);
    return best_of(pool)->evidence > before + 1;
}

/* Adds to a pool the labelings that may rival its best one. */
void add_rivals(const Scene *scene, const Layout *layout, Work *work, Pool *pool)
{
    Labeling chosen = *best_of(pool);
    if (!(chosen.evidence > -INFINITY))
        return;
    memcpy(work->chosen, chosen.labels, (size_t)layout->count * sizeof *chosen.labels);
    chosen.labels = work->chosen;
    memset(work->tried, 0, TRIED * sizeof *work->tried);
    tried(work, chosen.labels, layout->count);
    const int64_t lack = 1 + chosen.count / 16, least = chosen.count - lack > LEAST_DOTS ? chosen.count - lack : LEAST_DOTS;
    if (layout->count <= FEW_DOTS)
        affine_rivals(scene, layout, &chosen, least, work, pool);
    else
        rigid_rivals(scene, layout, &chosen, least, 64, INFINITY, work, pool);
}

/* Whether two labelings of the same layout give a blob two labels, and not in single dots only. */
int contradict(const Layout *layout, const Labeling *one, const Labeling *other)
{
    int64_t same = 0, shared = 0;
    for (int64_t i = 0; i < layout->count; i++) {
        if (one->labels[i] < 0)
            continue;
        same += other->labels[i] == one->labels[i];
        for (int64_t j = 0; j < layout->count; j++)
            shared += other->labels[j] == one->labels[i];
    }
    const int64_t fewer = one->count < other->count ? one->count : other->count;
    return shared > 0 && 10 * same < 6 * fewer;
}

/* ---- memory ---- */

int work_for(Work *work, int64_t dots)
{
    const size_t n = (size_t)dots + 1;
    memset(work, 0, sizeof *work);
    work->drawn = malloc(n * sizeof *work->drawn);
    work->numbers = malloc(9 * n * sizeof *work->numbers);
    work->indices = malloc(4 * n * sizeof *work->indices);
    work->matches = malloc(n * sizeof *work->matches);
    work->guesses = malloc(GUESSES * sizeof *work->guesses);
    work->neighbors = malloc(NEIGHBORS * sizeof *work->neighbors);
    work->tried = malloc(TRIED * sizeof *work->tried);
    if (!work->drawn || !work->numbers || !work->indices || !work->matches || !work->guesses || !work->neighbors || !work->tried)
        return NO_MEMORY;
    work->seen = work->numbers;
    work->weight = work->numbers + 2 * n;
    work->least = work->numbers + 5 * n;
    work->per_dot = work->numbers + 6 * n;
    work->apart = work->numbers + 7 * n;
    work->shape = work->numbers + 8 * n;
    work->labels = work->indices;
    work->next = work->indices + n;
    work->trial = work->indices + 2 * n;
    work->chosen = work->indices + 3 * n;
    return 0;
}

void work_free(Work *work)
{
    free(work->drawn);
    free(work->numbers);
    free(work->indices);
    free(work->matches);
    free(work->guesses);
    free(work->neighbors);
    free(work->tried);
}

int pool_for(Pool *pool, int64_t dots)
{
    pool->count = 0;
    pool->memory = malloc((size_t)(KEPT * dots + 1) * sizeof *pool->memory);
    if (!pool->memory)
        return NO_MEMORY;
    for (int64_t i = 0; i < KEPT; i++)
        pool->best[i].labels = pool->memory + i * dots;
    return 0;
}

/* Guesses from here on are made with another focal length. */
void scene_focal(Scene *scene, double focal)
{
    scene->focal = focal;
    for (int64_t k = 0; k < scene->count; k++)
        if (scene->blobs[k].reached)
            show_blob(scene, k, focal);
}

/* Removes a labeling from a pool; the last one takes its place. */
void drop(Pool *pool, int64_t place)
{
    const Labeling dropped = pool->best[place];
    pool->best[place] = pool->best[--pool->count];
    pool->best[pool->count] = dropped;
}

/* Mirrors the scene left to right; done twice, it is as before. */
void mirror_scene(Scene *scene)
{
    const double middle = scene->low[0] + 0.5 * scene->side * (double)scene->columns;
    for (int64_t k = 0; k < scene->count; k++)
        if (scene->blobs[k].reached) {
            scene->blobs[k].at[0] = 2 * middle - scene->blobs[k].at[0];
            scene->blobs[k].shape[1] = -scene->blobs[k].shape[1];
            scene->blobs[k].spread[1] = -scene->blobs[k].spread[1];
            update_blob(scene, k);
        }
    number_blobs(scene);
}

/* By which angles about the plate's normal the labelings are turned that contradict a chosen one and are about as likely, rad;
   at most TURNS, each once. */
int64_t turns_of(const Layout *layout, const Pool *pool, int64_t chosen, double margin, double *angles)
{
    const Labeling *best = pool->best + chosen;
    const double *N = layout->dots[0].normal;
    int64_t count = 0;
    for (int64_t i = 0; i < pool->count && count < TURNS; i++) {
        const Labeling *other = pool->best + i;
        if (i == chosen || !(best->evidence - other->evidence < margin) || !contradict(layout, best, other))
            continue;
        /* It turns about N: its angle is that of its skew part along N and its trace. */
        const Pose to_body = inverse_of(&best->pose), turned = joined(&to_body, &other->pose);
        const double *T = turned.R;
        const double sine = ((T[7] - T[5]) * N[0] + (T[2] - T[6]) * N[1] + (T[3] - T[1]) * N[2]) / 2, cosine = (T[0] + T[4] + T[8] - 1) / 2;
        const double angle = atan2(sine, cosine);
        int there = 0;
        for (int64_t k = 0; k < count; k++)
            there |= fabs(remainder(angles[k] - angle, 2 * PI)) < 0.05;
        if (!there)
            angles[count++] = angle;
    }
    return count;
}

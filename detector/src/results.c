/* From labels to results: the pose with its uncertainty, the dots that are no outliers, and where their centers are. */

#include "detector.h"

static int by_dot(const void *a, const void *b)
{
    const int64_t x = ((const Match *)a)->dot, y = ((const Match *)b)->dot;
    return (x > y) - (x < y);
}

/* Fills in `pixels` and H from the pose, or without a camera from the homography; `corrected` (m, 2) is scratch. */
static int places(const Layout *layout, const Camera *camera, int calibrated, const Blob *blobs, const Match *matches,
                  double *corrected, Finding *finding)
{
    const int64_t m = finding->count;
    int good = 0;
    if (!calibrated) {
        good = correct_centers(layout->dots, blobs, matches, m, finding->pixels, finding->H);
        finding->plane = good > 0;
        return good < 0 ? good : 0;
    }
    for (int64_t i = 0; i < m; i++) {
        const Blob *blob = blobs + matches[i].blob;
        Outline drawn;
        double *pixel = finding->pixels + 2 * i;
        if (!dot_pixel(layout->dots + matches[i].dot, blob, &finding->estimate.pose, camera, pixel))
            memcpy(pixel, blob->center, 2 * sizeof *pixel);
        outline_of(layout->dots + matches[i].dot, layout->dots[matches[i].dot].place, &finding->estimate.pose, &drawn);
        corrected[2 * i] = camera->fx * (blob->at[0] - drawn.center[0] + drawn.point[0]) + camera->cx;
        corrected[2 * i + 1] = camera->fy * (blob->at[1] - drawn.center[1] + drawn.point[1]) + camera->cy;
    }
    if (layout->flat)
        good = fit_homography(layout->dots, matches, m, corrected, finding->H);
    finding->plane = good > 0;
    return good < 0 ? good : 0;
}

int complete_finding(const Layout *layout, const Camera *camera, int calibrated, const Blob *blobs, Finding *finding)
{
    static const Errors NONE = {0, NULL, NULL, NULL, 0};
    const int64_t m = finding->count;
    int64_t kept = m, status = 0;
    Match *matches = malloc((size_t)(m + 1) * sizeof *matches);
    double *corrected = malloc((size_t)(2 * m + 1) * sizeof *corrected);
    finding->pixels = malloc((size_t)(2 * m + 1) * sizeof *finding->pixels);
    if (!matches || !corrected || !finding->pixels)
        status = NO_MEMORY;
    for (int64_t i = 0; i < m && !status; i++)
        matches[i] = (Match){finding->dots[i], finding->blobs[i]};
    if (calibrated && !status) {
        kept = estimate_pose(layout->dots, blobs, matches, m, camera, layout->errors ? layout->errors : &NONE, &finding->pose,
                             &finding->estimate);
        status = kept < 0 ? kept : 0;
    }
    if (!status && kept > 0) {
        qsort(matches, (size_t)kept, sizeof *matches, by_dot);
        for (int64_t i = 0; i < m; i++) {
            finding->dots[i] = matches[i].dot;
            finding->blobs[i] = matches[i].blob;
        }
        finding->count = kept;
        finding->dropped = m - kept;
        status = places(layout, camera, calibrated, blobs, matches, corrected, finding);
        if (calibrated && !status)
            status = judge(layout->dots, blobs, matches, camera, layout->errors ? layout->errors : &NONE, layout->plates,
                           layout->plate_count, &finding->estimate, &finding->verdict);
    } else if (!status && finding->state == FOUND) {
        finding->state = UNFIT;
        finding->count = 0;
    }
    free(matches);
    free(corrected);
    return (int)status;
}

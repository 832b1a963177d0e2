/* What a loader asks before it calls anything else. */

#include "detector.h"

#ifndef SOURCE
#define SOURCE ""
#endif

const char *detector_source(void)
{
    return SOURCE;
}

int64_t detector_sizes(int64_t *sizes, int64_t capacity)
{
    const size_t of[] = {
        sizeof(Image), sizeof(Blob), sizeof(Camera), sizeof(Pose), sizeof(Dot), sizeof(Match), sizeof(Outline), sizeof(Errors),
        sizeof(Estimate), sizeof(TagFamily), sizeof(TagReading), sizeof(Plate), sizeof(Constellation), sizeof(Layout),
        sizeof(Labeling), sizeof(Cause), sizeof(Verdict), sizeof(Member), sizeof(Model), sizeof(Track), sizeof(Options),
        sizeof(Finding), sizeof(Findings),
    };
    int64_t count = (int64_t)(sizeof of / sizeof *of);
    for (int64_t i = 0; i < count && i < capacity; i++)
        sizes[i] = (int64_t)of[i];
    return count;
}

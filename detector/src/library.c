/* What a loader asks before it calls anything else. */

#include "detector.h"

#ifndef SOURCE
#define SOURCE ""
#endif

const char *detector_source(void)
{
    return SOURCE;
}

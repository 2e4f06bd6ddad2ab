#include "harness.h"

uint32_t random_below(Random *random, uint32_t bound)
{
    random->state = random->state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((random->state >> 33) % bound);
}

bool ends_request(const ArmwireEvent *event, Others *others)
{
    switch (event->kind) {
    case ARMWIRE_EVENT_KIND_ANSWER:
    case ARMWIRE_EVENT_KIND_SENT:
    case ARMWIRE_EVENT_KIND_TIMED_OUT:
    case ARMWIRE_EVENT_KIND_UNACCEPTABLE:
    case ARMWIRE_EVENT_KIND_ERROR_FRAME:
    case ARMWIRE_EVENT_KIND_BROKEN:
        return true;
    case ARMWIRE_EVENT_KIND_NOISE:
        CHECK(event->bytes != NULL && event->len > 0 && event->fault.code != ARMWIRE_FAULT_CODE_NONE);
        others->noise += (unsigned)event->len;
        return false;
    case ARMWIRE_EVENT_KIND_LATE:
        others->late++;
        return false;
    case ARMWIRE_EVENT_KIND_UNSOLICITED:
        others->unsolicited++;
        return false;
    case ARMWIRE_EVENT_KIND_ECHO:
        others->echo++;
        return false;
    default:
        CHECK(event->kind == ARMWIRE_EVENT_KIND_UNKNOWN);
        others->unknown++;
        return false;
    }
}

/* Read-backs of what a Ling arm does not confirm, in virtual time. Usage: effects ROWS, the file with the rows of readings */
#include "harness.h"

static const char *const effects[] = {"torque-off", "torque-on", "zero"};
/* By the kind of the last step. */
static const char *const verdicts[] = {
    [ARMWIRE_LING_READ_BACK_STEP_KIND_CONFIRMED] = "confirmed",
    [ARMWIRE_LING_READ_BACK_STEP_KIND_NOT_SHOWN] = "not-shown",
    [ARMWIRE_LING_READ_BACK_STEP_KIND_CONTRADICTED] = "contradicted",
    [ARMWIRE_LING_READ_BACK_STEP_KIND_NO_READING] = "no-reading",
};

typedef struct Reading {
    unsigned status;
    unsigned ticks;
} Reading;

/* Reads an effect back from an arm whose readings change at this time after the request. A call takes 5 ms. Returns the
 * verdict. */
static const char *verdict(uint32_t effect, Reading before, uint64_t change_us, Reading after)
{
    ArmwireLingReadBack read_back;
    ArmwireLingReadBackStep step;
    const uint64_t start_us = 3000000;
    uint64_t now = start_us;
    unsigned requests = 0;
    CHECK_OK(armwire_ling_read_back_init(&read_back, ARMWIRE_VERSION, effect));
    for (;;) {
        CHECK_OK(armwire_ling_read_back_poll(&read_back, now, &step));
        switch (step.kind) {
        case ARMWIRE_LING_READ_BACK_STEP_KIND_WAIT:
            CHECK(step.until_us > now);
            now = step.until_us;
            break;
        case ARMWIRE_LING_READ_BACK_STEP_KIND_READ_JOINTS: {
            const Reading reading = now - start_us < change_us ? before : after;
            ArmwireLingResponse joints = {.kind = ARMWIRE_LING_RESPONSE_KIND_JOINTS,
                                          .motion_status = (uint8_t)reading.status};
            for (size_t joint = 0; joint < ARMWIRE_LING_JOINTS; joint++) {
                joints.position_ticks[joint] = (uint16_t)reading.ticks;
            }
            now += 5000;
            CHECK_OK(armwire_ling_read_back_on_joints(&read_back, now, &joints));
            break;
        }
        case ARMWIRE_LING_READ_BACK_STEP_KIND_SET_TORQUE:
            CHECK(effect == (step.torque_on ? ARMWIRE_LING_EFFECT_TORQUE_ON : ARMWIRE_LING_EFFECT_TORQUE_OFF));
            requests++;
            break;
        case ARMWIRE_LING_READ_BACK_STEP_KIND_SET_ZERO:
            CHECK(effect == ARMWIRE_LING_EFFECT_ZERO);
            requests++;
            break;
        default:
            CHECK(requests == 1 && step.kind < sizeof verdicts / sizeof *verdicts);
            CHECK(now - start_us == (step.kind == ARMWIRE_LING_READ_BACK_STEP_KIND_CONFIRMED ? change_us + 5000 : 500000));
            return verdicts[step.kind];
        }
    }
}

static uint32_t effect_of(const char *name)
{
    for (uint32_t effect = 0; effect < sizeof effects / sizeof *effects; effect++) {
        if (strcmp(name, effects[effect]) == 0) {
            return effect;
        }
    }
    CHECK(!"an effect");
    return 0;
}

int main(int argc, char **argv)
{
    char line[200], effect[20], expected[20];
    unsigned rows = 0;
    CHECK(argc == 2);
    FILE *file = fopen(argv[1], "r");
    CHECK(file != NULL);
    while (fgets(line, sizeof line, file) != NULL) {
        Reading before, after;
        unsigned change_ms;
        if (line[0] == '#') {
            continue;
        }
        CHECK(sscanf(line, "%19s %x %u %u %x %u %19s", effect, &before.status, &before.ticks, &change_ms, &after.status,
                     &after.ticks, expected) == 7);
        const char *got = verdict(effect_of(effect), before, change_ms * UINT64_C(1000), after);
        if (strcmp(got, expected) != 0) {
            fprintf(stderr, "%s: %s", got, line);
            return 1;
        }
        rows++;
    }
    fclose(file);
    CHECK(rows > 0);
    printf("%u rows\n", rows);
    return 0;
}

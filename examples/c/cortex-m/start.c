/* The vector table and the reset handler. */
#include <stdint.h>

int main(void);
extern uint32_t data_start, data_end, data_in_flash, bss_start, bss_end, stack_top;

void reset(void)
{
    const uint32_t *from = &data_in_flash;
    for (uint32_t *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    main();
    for (;;) {
    }
}

static void fault(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void)) & stack_top, reset, fault, fault, fault, fault, fault};

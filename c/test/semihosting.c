/* Start-up code of a test on a Cortex-M in QEMU, with output and exit by semihosting. */
#include <stdint.h>
#include <stdlib.h>

int main(int argc, char **argv);
void initialise_monitor_handles(void);
void _init(void);
void _fini(void);
void reset(void);
/* The initial stack pointer, the first entry of the vector table. */
void stack_top(void);
extern uint32_t data_start, data_end, data_in_flash, bss_start, bss_end;

/* Called by the C library. */
void _init(void)
{
}

void _fini(void)
{
}

void reset(void)
{
    static char *words[] = {"test", "3000", NULL};
    const uint32_t *from = &data_in_flash;
    for (uint32_t *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    initialise_monitor_handles();
    exit(main(2, words));
}

static void fault(void)
{
    exit(2);
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    stack_top, reset, fault, fault, fault, fault, fault};

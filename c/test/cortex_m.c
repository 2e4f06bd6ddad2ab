/* The example for a Cortex-M in QEMU, on a UART to a virtual arm. Usage: cortex_m ARMWIRE QEMU ELF */
#define _POSIX_C_SOURCE 200809L

#include "harness.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    static const char *const words[] = {"ling", "--plant", "ideal", NULL};
    char name[300], line[200];
    unsigned long long out, in;
    unsigned ticks[6];
    int ends[2], status;
    CHECK(argc == 4);
    Port port = arm_start(argv[1], words);
    arm_name(&port, name, sizeof name);
    CHECK(pipe(ends) == 0);
    int qemu = fork();
    CHECK(qemu >= 0);
    if (qemu == 0) {
        alarm(60);
        dup2(ends[1], STDOUT_FILENO);
        close(ends[0]);
        close(ends[1]);
        execlp(argv[2], argv[2], "-machine", "mps2-an385", "-display", "none", "-monitor", "none", "-kernel", argv[3],
               "-serial", "stdio", "-serial", name, (char *)NULL);
        _exit(127);
    }
    close(ends[1]);
    FILE *output = fdopen(ends[0], "r");
    CHECK(output != NULL);
    for (;;) {
        CHECK(fgets(line, sizeof line, output) != NULL);
        printf("%s", line);
        if (strcmp(line, "no answer\n") != 0) {
            break;
        }
    }
    CHECK(sscanf(line, "%u %u %u %u %u %u ticks", &ticks[0], &ticks[1], &ticks[2], &ticks[3], &ticks[4], &ticks[5]) == 6);
    CHECK(ticks[0] == 2048 && ticks[5] == 1500);
    CHECK(fgets(line, sizeof line, output) != NULL && sscanf(line, "%llu bytes out, %llu in", &out, &in) == 2);
    printf("%s", line);
    CHECK(kill(qemu, SIGTERM) == 0 && waitpid(qemu, &status, 0) == qemu);
    fclose(output);
    port.out = out;
    port.in = in;
    arm_end(&port);
    return 0;
}

/* What an FMU can do to its process, in any of its functions: `function:misdeed` stands in the
 * environment. The file named there says that it was done, and when; once is enough. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#define MISDEED misbehave(__func__);
#define DESCRIPTORS 1024

static void everywhere(const char *bytes, size_t size) {
    for (int fd = 3; fd < DESCRIPTORS; fd++) {
        int flags = fcntl(fd, F_GETFL);
        if (flags < 0) continue;
        fcntl(fd, F_SETFL, flags | O_NONBLOCK);
        if (write(fd, bytes, size) < 0) errno = 0;
        fcntl(fd, F_SETFL, flags);
    }
}

static void misbehave(const char *function) {
    const char *wanted = getenv("MISDEED"), *mark = getenv("MISDEED_DONE");
    size_t n = strlen(function);
    if (!wanted || !mark || strncmp(wanted, function, n) || wanted[n] != ':') return;
    const char *what = wanted + n + 1;
    if (!access(mark, F_OK)) return;
    close(creat(mark, 0600));
    char bytes[4096];
    for (size_t k = 0; k < sizeof bytes; k++) bytes[k] = (char)(k * 2654435761u >> 7);
    if (!strcmp(what, "hang")) for (volatile int k = 1; k;) {}
    if (!strcmp(what, "sleep")) for (;;) pause();
    if (!strcmp(what, "stop")) raise(SIGSTOP);
    if (!strcmp(what, "segv")) *(volatile int *)8 = 1;
    if (!strcmp(what, "abort")) abort();
    if (!strcmp(what, "trap")) __builtin_trap();
    if (!strcmp(what, "kill")) raise(SIGKILL);
    if (!strcmp(what, "realtime")) raise(SIGRTMIN + 5);
    if (!strcmp(what, "exit")) exit(0);
    if (!strcmp(what, "_exit")) _exit(3);
    if (!strcmp(what, "garbage")) everywhere(bytes, sizeof bytes);
    if (!strcmp(what, "zeros")) { memset(bytes, 0, sizeof bytes); everywhere(bytes, 16); }
    if (!strcmp(what, "huge")) { memset(bytes, 0x7f, sizeof bytes); everywhere(bytes, 16); }
    if (!strcmp(what, "byte")) everywhere(bytes, 1);
    if (!strcmp(what, "close")) for (int fd = 3; fd < DESCRIPTORS; fd++) close(fd);
    if (!strcmp(what, "close_hang")) { for (int fd = 0; fd < DESCRIPTORS; fd++) close(fd); for (;;) pause(); }
    if (!strcmp(what, "fork")) fork();
    if (!strcmp(what, "fork_hang") && !fork()) for (;;) pause();
    if (!strcmp(what, "daemon") && !fork()) { setsid(); if (fork()) _exit(0); for (;;) pause(); }
    if (!strcmp(what, "daemon_crash")) { if (!fork()) { setsid(); for (;;) pause(); } abort(); }
    if (!strcmp(what, "daemons")) for (int k = 0; k < 20; k++) if (!fork()) { setsid(); for (;;) pause(); }
    if (!strcmp(what, "daemon_exec") && !fork()) { setsid(); execlp("sleep", "sleep", "600", (char *)NULL); }
    if (!strcmp(what, "allocate")) for (;;) { char *p = malloc(1 << 24); if (!p) abort(); memset(p, 1, 1 << 24); }
    if (!strcmp(what, "allocate_quietly")) while (malloc(1 << 24)) {}
    if (!strcmp(what, "flood")) for (int k = 0; k < 5000; k++) if (write(1 + k % 2, bytes, sizeof bytes) < 0) break;
}

__attribute__((constructor)) static void load(void) { misbehave("load"); }

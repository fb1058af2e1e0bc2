// Loaded before a test program that runs short of memory: scripts/c-memory.sh. If the program is ended by a signal, it
// tells whose code that was, by its exit code, as a Vulkan driver may end the process for want of memory: Mesa's does.
// The test programs themselves do not look at what malloc gives them: if they get nothing, they end here, as for any
// other test that cannot be run.

#define _GNU_SOURCE

#include <dlfcn.h>
#include <execinfo.h>
#include <link.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define GIVEN_UP 1
#define IN_LIBRARY 91
#define IN_PROGRAM 92
#define IN_DRIVER 93  // Or in the Vulkan loader, or what they load.
#define IN_NOTHING 94

static const int signals[] = {SIGABRT, SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGTRAP, SIGSYS};

static void say(const char *text) {
    if (write(2, text, strlen(text)) < 0) {
        _exit(IN_NOTHING);
    }
}

// What only passes a fault on: the C library, the runtimes of the compilers, this library.
static int passes_on(const char *name) {
    const char *const names[] = {"libc.so",  "libm.so",   "ld-linux",    "linux-vdso",
                                 "libgcc_s", "libstdc++", "fault_origin"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (strstr(name, names[i]) != NULL) {
            return 1;
        }
    }
    return 0;
}

static uintptr_t program_start, program_end;

static void ended(int signal_number) {
    // Of several threads the first one tells; a fault of its own in here ends it.
    static atomic_int first;
    int none = 0;
    if (!atomic_compare_exchange_strong(&first, &none, gettid())) {
        if (none == gettid()) {
            _exit(IN_NOTHING);
        }
        pause();
    }
    void *frames[128];
    const int count = backtrace(frames, 128);
    for (int i = 0; i < count; i++) {
        Dl_info info;
        const uintptr_t at = (uintptr_t)frames[i];
        if (at >= program_start && at < program_end) {
            say("ended by the program itself\n");
            _exit(IN_PROGRAM);
        }
        if (dladdr(frames[i], &info) == 0 || passes_on(info.dli_fname)) {
            continue;
        }
        say(strsignal(signal_number));
        say(" in ");
        say(info.dli_fname);
        say("\n");
        _exit(strstr(info.dli_fname, "libnvsprior") != NULL ? IN_LIBRARY : IN_DRIVER);
    }
    backtrace_symbols_fd(frames, count, 2);
    _exit(IN_NOTHING);
}

static int find_program(struct dl_phdr_info *info, size_t size, void *unused) {
    (void)size, (void)unused;
    for (int i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &info->dlpi_phdr[i];
        if (header->p_type == PT_LOAD && (header->p_flags & PF_X)) {
            program_start = info->dlpi_addr + header->p_vaddr;
            program_end = program_start + header->p_memsz;
        }
    }
    return 1;  // The first one is the program.
}

__attribute__((constructor)) static void listen(void) {
    static char stack[1 << 16];
    const stack_t alternative = {.ss_sp = stack, .ss_size = sizeof stack};
    void *frame;
    backtrace(&frame, 1);  // It takes memory when it is called first.
    dl_iterate_phdr(find_program, NULL);
    sigaltstack(&alternative, NULL);
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        const struct sigaction action = {.sa_handler = ended, .sa_flags = SA_ONSTACK};
        sigaction(signals[i], &action, NULL);
    }
}

// The most address space that the process had, KiB, for the limits to try.
__attribute__((destructor)) static void tell_peak(void) {
    const char *path = getenv("NVSP_TEST_PEAK");
    char line[256];
    FILE *from = path == NULL ? NULL : fopen("/proc/self/status", "r");
    FILE *to = from == NULL ? NULL : fopen(path, "w");
    while (to != NULL && fgets(line, sizeof line, from) != NULL) {
        if (strncmp(line, "VmPeak:", 7) == 0) {
            fprintf(to, "%ld\n", strtol(line + 7, NULL, 10));
        }
    }
    if (to != NULL) {
        fclose(to);
    }
    if (from != NULL) {
        fclose(from);
    }
}

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *block, size_t size);

static void *checked(void *block, const void *caller) {
    if (block == NULL && (uintptr_t)caller >= program_start && (uintptr_t)caller < program_end) {
        say("no memory for the test itself\n");
        _exit(GIVEN_UP);
    }
    return block;
}

void *malloc(size_t size) { return checked(__libc_malloc(size), __builtin_return_address(0)); }

void *calloc(size_t number, size_t size) { return checked(__libc_calloc(number, size), __builtin_return_address(0)); }

void *realloc(void *block, size_t size) {
    return checked(__libc_realloc(block, size), __builtin_return_address(0));
}

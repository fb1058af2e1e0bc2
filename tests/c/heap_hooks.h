// The program's own malloc, calloc and so on in the place of the C library's. Each first calls `heap_refused`, which
// the program defines, with the place that calls. If that is not 0, there is no memory.
//
// For one source file of a program; it defines functions.

#ifndef HEAP_HOOKS_H
#define HEAP_HOOKS_H

#include <errno.h>
#include <link.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *block, size_t size);
void *__libc_memalign(size_t alignment, size_t size);
void __libc_free(void *block);

static int heap_refused(const void *caller);

#define HEAP_CALL(call) (heap_refused(__builtin_return_address(0)) ? NULL : (call))

void *malloc(size_t size) { return HEAP_CALL(__libc_malloc(size)); }

void *calloc(size_t count, size_t size) { return HEAP_CALL(__libc_calloc(count, size)); }

void *realloc(void *block, size_t size) { return HEAP_CALL(__libc_realloc(block, size)); }

void *memalign(size_t alignment, size_t size) {
    return HEAP_CALL(__libc_memalign(alignment, size));
}

void *aligned_alloc(size_t alignment, size_t size) {
    return HEAP_CALL(__libc_memalign(alignment, size));
}

int posix_memalign(void **block, size_t alignment, size_t size) {
    void *made = HEAP_CALL(__libc_memalign(alignment, size));
    if (made == NULL) {
        return ENOMEM;
    }
    *block = made;
    return 0;
}

void free(void *block) { __libc_free(block); }

// Where libnvsprior's file and code lie, once `find_library` was called.
static char library_path[1024];
static uintptr_t code_start, code_end;

static int find_code(struct dl_phdr_info *info, size_t size, void *unused) {
    (void)size, (void)unused;
    const char *slash = info->dlpi_name == NULL ? NULL : strrchr(info->dlpi_name, '/');
    if (slash == NULL || strncmp(slash + 1, "libnvsprior", 11) != 0) {
        return 0;
    }
    snprintf(library_path, sizeof library_path, "%s", info->dlpi_name);
    for (int i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &info->dlpi_phdr[i];
        if (header->p_type == PT_LOAD && (header->p_flags & PF_X)) {
            code_start = info->dlpi_addr + header->p_vaddr;
            code_end = code_start + header->p_memsz;
        }
    }
    return 1;
}

static inline void find_library(void) { dl_iterate_phdr(find_code, NULL); }

static inline int in_library(const void *address) {
    return (uintptr_t)address >= code_start && (uintptr_t)address < code_end;
}

#endif

// A host whose floating-point environment is another one: rounding, small numbers flushed to zero, traps.

#define _GNU_SOURCE
#include "common.h"

#include <fenv.h>

static void flush_to_zero(void) {
#if defined(__x86_64__)
    const unsigned wanted = __builtin_ia32_stmxcsr() | 0x8040;
    __builtin_ia32_ldmxcsr(wanted);
#elif defined(__aarch64__)
    unsigned long control;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    __asm__ volatile("msr fpcr, %0" : : "r"(control | 1ul << 24));
#endif
}

static void upward(void) { fesetround(FE_UPWARD); }
static void downward(void) { fesetround(FE_DOWNWARD); }
static void towards_zero(void) { fesetround(FE_TOWARDZERO); }
static void traps(void) { feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW); }

// Bits that the processor computes by, without flags of what has happened.
static unsigned long control(void) {
#if defined(__x86_64__)
    return __builtin_ia32_stmxcsr() & ~0x3ful;
#elif defined(__aarch64__)
    unsigned long control;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return control;
#else
    return (unsigned long)fegetround();
#endif
}

// What both ends make of the scene's first frame.
typedef struct outcome {
    uint32_t prior;
    uint8_t bytes[8192];
    size_t size;
    uint8_t *shown;
} outcome;

// Sets the environment once everything is made, or before.
static outcome both_ends(void (*set)(void), int late) {
    fenv_t usual;
    fegetenv(&usual);
    if (set && !late) set();
    rig rig = {0};
    rig_open(&rig, &dive);
    rig_add(&rig, &dive.camera, NULL);
    if (set && late) set();
    const unsigned long before = control();
    outcome found = {.shown = malloc(dive.size)};
    nvsp_prior_info info = NVSP_INITIALIZER(nvsp_prior_info);
    MUST(nvsp_prior_get_info(rig.prior, &info));
    found.prior = info.id;
    const nvsp_image image = scene_image(&dive, 0);
    MUST(nvsp_encode(rig.encoder, &image, with_hint(&dive.poses[0]), found.bytes, sizeof found.bytes, &found.size,
                     NULL));
    nvsp_picture place = place_of(found.shown, dive.camera.width, dive.camera.height);
    MUST(nvsp_decode(rig.decoder, found.bytes, found.size, 0, &place, NULL));
    CHECK(control() == before);
    rig_close(&rig);
    CHECK(control() == before);
    fesetenv(&usual);
    return found;
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    outcome usual = both_ends(NULL, 0);
    void (*const environments[])(void) = {upward, downward, towards_zero, flush_to_zero, traps};
    for (size_t i = 0; i < sizeof environments / sizeof *environments; i++) {
        for (int late = 0; late <= !few(); late++) {
            outcome found = both_ends(environments[i], late);
            CHECK(found.prior == usual.prior);
            CHECK(found.size == usual.size && memcmp(found.bytes, usual.bytes, usual.size) == 0);
            CHECK(memcmp(found.shown, usual.shown, dive.size) == 0);
            free(found.shown);
        }
    }
    free(usual.shown);
    return tear_down();
}

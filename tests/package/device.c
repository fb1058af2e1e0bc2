/* Prints the library's version, and the device that it opens or why there is none. */
#include <inttypes.h>
#include <stdio.h>

#include <nvsprior.h>

static void log_line(void *user, int32_t level, const char *message) {
    (void)user;
    printf("log %" PRId32 ": %s\n", level, message);
}

int main(void) {
    struct nvsp_engine_options options;
    struct nvsp_engine *engine = NULL;
    nvsp_status status = NVSP_INIT(&options);
    printf("version %s\n", nvsp_version(NULL, NULL));
    if (status == NVSP_OK) {
        options.log = log_line;
        status = nvsp_engine_create(&options, &engine);
    }
    printf("engine: %s\n", nvsp_status_text(status));
    nvsp_destroy(engine);
    return status == NVSP_OK || status == NVSP_ERR_NO_DEVICE ? 0 : 1;
}

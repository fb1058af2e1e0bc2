// What c-examples/firmware_loop.c stands on, to check that it compiles.

#ifndef MOCK_BOARD_H
#define MOCK_BOARD_H

#include <nvsprior.h>

int board_runs(void);
void board_steer(void);
double board_seconds(void);
int board_frame(nvsp_image *image, double *exposed);
size_t board_received(uint8_t *bytes, size_t room);
int board_modem_is_free(void);
void board_send(const uint8_t *bytes, size_t size);
size_t board_load(uint8_t *state, size_t room);
void board_store(const uint8_t *state, size_t size);
void board_log(const char *status, const char *text);

#endif

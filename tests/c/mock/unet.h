// What c-examples/unet_link.c relies on of UnetStack's unet.h and fjage.h, to check that it compiles
// if those are not installed.

#ifndef MOCK_UNET_H
#define MOCK_UNET_H

#include <stdint.h>

#define USER 32

typedef void *fjage_msg_t;
typedef void *unetsocket_t;

unetsocket_t unetsocket_open(const char *hostname, int port);
int unetsocket_bind(unetsocket_t sock, int protocol);
void unetsocket_set_timeout(unetsocket_t sock, long ms);
int unetsocket_send(unetsocket_t sock, uint8_t *data, int len, int to, int protocol);
fjage_msg_t unetsocket_receive(unetsocket_t sock);
int fjage_msg_get_byte_array(fjage_msg_t msg, const char *key, uint8_t *value, int maxlen);
void fjage_msg_destroy(fjage_msg_t msg);
int unetsocket_close(unetsocket_t sock);

#endif

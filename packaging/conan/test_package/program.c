#include <nvsprior.h>
#include <stdio.h>

int main(void) {
    uint32_t abi_version = 0;
    printf("nvsprior %s", nvsp_version(NULL, &abi_version));
    return printf(", ABI %u\n", (unsigned)abi_version) < 0 || abi_version != NVSP_ABI_VERSION;
}

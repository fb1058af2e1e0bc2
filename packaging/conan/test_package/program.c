#include <nvsprior.h>
#include <stdio.h>

int main(void) {
    printf("nvsprior %s, ABI %u\n", nvsp_version(), (unsigned)nvsp_abi_version());
    return nvsp_abi_version() != NVSP_ABI_VERSION;
}

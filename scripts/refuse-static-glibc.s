/* In libnvsprior.a for glibc. A program that is linked statically to glibc cannot load a Vulkan driver: the driver
 * brings its own glibc along, and the two crash each other. So the program is refused when it is linked: a static glibc
 * defines this symbol too. The shared glibc does not, and neither does musl. GNU ld shows the text; other linkers name
 * the symbol. */
    .globl _dl_non_dynamic_init
    .hidden _dl_non_dynamic_init
    .data
_dl_non_dynamic_init:
    .long 0
    .section .gnu.warning._dl_non_dynamic_init, "", %progbits
    .ascii "libnvsprior.a loads Vulkan drivers, which a program linked statically to glibc cannot. "
    .asciz "Link without -static and -static-pie: docs/packaging.md"
    .section .note.GNU-stack, "", %progbits

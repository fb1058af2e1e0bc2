# vcpkg's port. `make dist` fills in the archive's address and checksum: target/dist/vcpkg. The archive has all crates;
# Rust and cargo-c must be on PATH.
vcpkg_download_distfile(ARCHIVE
  URLS "@URL@"
  FILENAME "nvsprior-@VERSION@.tar.xz"
  SHA512 @SHA512@)
vcpkg_extract_source_archive(SOURCE_PATH ARCHIVE "${ARCHIVE}")

set(_target x86_64-unknown-linux-gnu)
if(VCPKG_TARGET_ARCHITECTURE STREQUAL "arm64")
  set(_target aarch64-unknown-linux-gnu)
endif()
# One build: Cargo's release profile is also what a debug build of the program links.
vcpkg_execute_required_process(
  COMMAND "${CMAKE_COMMAND}" -E env "PREFIX=${CURRENT_PACKAGES_DIR}" LIBDIR= INCLUDEDIR= DESTDIR= GLIBC=
    "CARGO_TARGET_DIR=${CURRENT_BUILDTREES_DIR}/cargo" CARGO_NET_OFFLINE=true
    "${SOURCE_PATH}/scripts/install.sh" release ${_target}
  WORKING_DIRECTORY "${SOURCE_PATH}"
  LOGNAME "build-${TARGET_TRIPLET}")
set(VCPKG_BUILD_TYPE release)
set(VCPKG_POLICY_MISMATCHED_NUMBER_OF_BINARIES enabled)

# The files for CMake find the libraries relative to themselves, so they stay where they are.
set(VCPKG_POLICY_SKIP_MISPLACED_CMAKE_FILES_CHECK enabled)
set(VCPKG_POLICY_SKIP_LIB_CMAKE_MERGE_CHECK enabled)

if(VCPKG_LIBRARY_LINKAGE STREQUAL "static")
  file(GLOB _others "${CURRENT_PACKAGES_DIR}/lib/libnvsprior.so*")
else()
  set(_others "${CURRENT_PACKAGES_DIR}/lib/libnvsprior.a")
endif()
file(REMOVE ${_others})
vcpkg_fixup_pkgconfig()
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE-MIT" "${SOURCE_PATH}/LICENSE-APACHE"
  "${SOURCE_PATH}/packaging/licences/library.copyright")

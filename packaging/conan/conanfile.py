"""Conan's recipe. `make dist` writes conandata.yml beside a copy of it: target/dist/conan.

The source archive has all crates. Rust and cargo-c must be on PATH; there is no package of them in Conan.
"""
import os

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.files import copy, get

TARGETS = {"x86_64": "x86_64-unknown-linux-gnu", "armv8": "aarch64-unknown-linux-gnu"}


class Nvsprior(ConanFile):
    name = "nvsprior"
    license = "MIT OR Apache-2.0"
    description = "Pictures through an acoustic modem: image compression against a 3D Gaussian Splatting prior"
    topics = ("gaussian-splatting", "compression", "vulkan", "underwater", "robotics")
    package_type = "library"
    settings = "os", "arch", "compiler", "build_type"
    # profile: Cargo's. glibc: the oldest to load with, such as 2.31, by Zig; "host" is that of the C compiler.
    options = {"shared": [True, False], "profile": ["release", "firmware"], "glibc": ["host", "ANY"]}
    default_options = {"shared": True, "profile": "release", "glibc": "host"}

    def set_version(self):
        # The version of the archive that conandata.yml names.
        self.version = self.version or next(iter(self.conan_data["sources"]))

    def configure(self):
        self.settings.rm_safe("compiler.cppstd")
        self.settings.rm_safe("compiler.libcxx")

    def validate(self):
        if self.settings.os != "Linux" or str(self.settings.arch) not in TARGETS:
            raise ConanInvalidConfiguration("nvsprior is built for Linux on x86-64 and 64-bit ARM")

    def source(self):
        get(self, **self.conan_data["sources"][self.version], strip_root=True)

    def build(self):
        glibc = "" if self.options.glibc == "host" else str(self.options.glibc)
        tree = os.path.join(self.build_folder, "tree")
        variables = {"PREFIX": tree, "LIBDIR": "", "INCLUDEDIR": "", "DESTDIR": "", "GLIBC": glibc,
                     "CARGO_TARGET_DIR": os.path.join(self.build_folder, "cargo"), "CARGO_NET_OFFLINE": "true"}
        words = " ".join(f'{name}="{value}"' for name, value in variables.items())
        target = TARGETS[str(self.settings.arch)]
        self.run(f"{words} scripts/install.sh {self.options.profile} {target}", cwd=self.source_folder)

    def package(self):
        tree = os.path.join(self.build_folder, "tree")
        copy(self, "*.h", os.path.join(tree, "include"), os.path.join(self.package_folder, "include"))
        pattern = "libnvsprior.so*" if self.options.shared else "libnvsprior.a"
        copy(self, pattern, os.path.join(tree, "lib"), os.path.join(self.package_folder, "lib"))
        copy(self, "LICENSE-*", self.source_folder, os.path.join(self.package_folder, "licenses"))
        copy(self, "library.copyright", os.path.join(self.source_folder, "packaging", "licences"),
             os.path.join(self.package_folder, "licenses"))

    def package_info(self):
        self.cpp_info.libs = ["nvsprior"]
        self.cpp_info.set_property("pkg_config_name", "nvsprior")
        self.cpp_info.set_property("cmake_target_name", "nvsprior::nvsprior")
        if not self.options.shared:
            self.cpp_info.set_property("cmake_target_aliases", ["nvsprior::static"])
            self.cpp_info.system_libs = ["gcc_s", "rt", "pthread", "m", "dl", "c"]

//! The C library, by programs in C.

#[path = "../common/mod.rs"]
mod common;
mod scene;
#[path = "../scene/mod.rs"]
mod wall;

#[test]
fn scene_is_written() {
    scene::write();
}

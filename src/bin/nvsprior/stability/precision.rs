//! Where f32 loses what.
use super::case::{Bench, Case, Group};
pub const GROUP: Group = Group { name: "precision", about: "", cases };
fn cases(_: &Bench) -> Vec<Case> {
    Vec::new()
}

//! The pixels of an invocation: some rows of one column. Operations take all of them at once, so that neighbouring
//! instructions do not wait for each other.

use crate::memory::at;
use crate::shared::max;
use core::ops::{Add, Mul, Neg, Sub};
use spirv_std::glam::{Vec2, Vec4};

/// One number per pixel.
pub trait Rows:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// The same number for each.
    fn all(value: f32) -> Self;

    /// `y` for the first, and one more for each further one.
    fn down(y: f32) -> Self;

    /// `f` of each.
    fn each(self, f: impl Fn(f32) -> f32) -> Self;

    /// `f` of each pair.
    fn both(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self;

    /// The largest.
    fn largest(self) -> f32;

    /// The sum.
    fn sum(self) -> f32;

    /// Those of a buffer at the first of these places, which must exist.
    fn load(buffer: &[f32], places: [u32; 4]) -> Self;

    /// The number of pixel `k`.
    fn of(self, k: u32) -> f32;
}

impl Rows for f32 {
    fn all(value: f32) -> f32 {
        value
    }

    fn down(y: f32) -> f32 {
        y
    }

    fn each(self, f: impl Fn(f32) -> f32) -> f32 {
        f(self)
    }

    fn both(self, other: f32, f: impl Fn(f32, f32) -> f32) -> f32 {
        f(self, other)
    }

    fn largest(self) -> f32 {
        self
    }

    fn sum(self) -> f32 {
        self
    }

    fn load(buffer: &[f32], places: [u32; 4]) -> f32 {
        at(buffer, places[0])
    }

    fn of(self, _k: u32) -> f32 {
        self
    }
}

impl Rows for Vec2 {
    fn all(value: f32) -> Vec2 {
        Vec2::splat(value)
    }

    fn down(y: f32) -> Vec2 {
        Vec2::new(y, y + 1.0)
    }

    fn each(self, f: impl Fn(f32) -> f32) -> Vec2 {
        Vec2::new(f(self.x), f(self.y))
    }

    fn both(self, other: Vec2, f: impl Fn(f32, f32) -> f32) -> Vec2 {
        Vec2::new(f(self.x, other.x), f(self.y, other.y))
    }

    fn largest(self) -> f32 {
        max(self.x, self.y)
    }

    fn sum(self) -> f32 {
        self.x + self.y
    }

    fn load(buffer: &[f32], places: [u32; 4]) -> Vec2 {
        Vec2::new(at(buffer, places[0]), at(buffer, places[1]))
    }

    fn of(self, k: u32) -> f32 {
        if k == 0 { self.x } else { self.y }
    }
}

impl Rows for Vec4 {
    fn all(value: f32) -> Vec4 {
        Vec4::splat(value)
    }

    fn down(y: f32) -> Vec4 {
        Vec4::new(y, y + 1.0, y + 2.0, y + 3.0)
    }

    fn each(self, f: impl Fn(f32) -> f32) -> Vec4 {
        Vec4::new(f(self.x), f(self.y), f(self.z), f(self.w))
    }

    fn both(self, other: Vec4, f: impl Fn(f32, f32) -> f32) -> Vec4 {
        Vec4::new(f(self.x, other.x), f(self.y, other.y), f(self.z, other.z), f(self.w, other.w))
    }

    fn largest(self) -> f32 {
        max(max(self.x, self.y), max(self.z, self.w))
    }

    fn sum(self) -> f32 {
        self.x + self.y + (self.z + self.w)
    }

    fn load(buffer: &[f32], places: [u32; 4]) -> Vec4 {
        Vec4::from_array([
            at(buffer, places[0]),
            at(buffer, places[1]),
            at(buffer, places[2]),
            at(buffer, places[3]),
        ])
    }

    fn of(self, k: u32) -> f32 {
        if k == 0 {
            self.x
        } else if k == 1 {
            self.y
        } else if k == 2 {
            self.z
        } else {
            self.w
        }
    }
}

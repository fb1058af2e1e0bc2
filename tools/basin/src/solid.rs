//! Solids of the scene: ray hits and signed distances of cylinders, blocks and ellipsoids.

use glam::{Mat3, Vec3};

/// A half-line.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

impl Ray {
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// What a solid is painted as; see `material`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Material {
    /// The basin's tiled floor.
    Floor,
    /// The basin's panelled walls.
    Wall,
    /// The water's surface from below.
    WaterSurface,
    Barrel,
    /// Galvanised pipe.
    Pipe,
    /// Foot and cap of a pile.
    Concrete,
    /// The bare metal of the object that only T2 has.
    Steel,
    SafetyLine,
    /// Steel of the quay's wall.
    SheetPile,
    /// Sand with shells.
    Seabed,
    /// A stone at the wall's foot.
    Stone,
    /// A fender.
    Rubber,
    /// Iron: chains and fittings.
    Chain,
    /// A wooden pile.
    Timber,
    /// Rails and rungs.
    Ladder,
    /// An anode.
    Zinc,
    /// Bars and line of the crab pot, which only T3 has.
    Pot,
    Buoy,
    /// A bump of what has grown: barnacle, mussel or tuft.
    Growth,
    /// Steel of the tower under an old coating.
    Coated,
    /// What lives on the tower, where no light comes: a bump.
    Fouling,
    /// Welds of the tower that were cleaned to the metal.
    BareSteel,
}

/// A shape about the origin of its own axes, in metres.
#[derive(Clone, Copy)]
pub enum Shape {
    /// Along the local z axis.
    Cylinder { radius: f32, half_length: f32 },
    /// Half sides along the local axes.
    Block { half: Vec3 },
    /// Half axes along the local ones.
    Ellipsoid { half: Vec3 },
}

/// A shape placed in the world.
#[derive(Clone)]
pub struct Solid {
    pub shape: Shape,
    pub material: Material,
    pub centre: Vec3,
    /// Columns: the local axes in the world.
    pub axes: Mat3,
    /// Tells solids of one material apart.
    pub seed: u32,
}

/// Where a ray meets a solid: distance along the ray and outward normal in the solid's axes.
pub struct SolidHit {
    pub t: f32,
    pub local_normal: Vec3,
}

impl Solid {
    /// A cylinder between the centres of its two ends.
    pub fn cylinder(from: Vec3, to: Vec3, radius: f32, material: Material, seed: u32) -> Solid {
        let along = to - from;
        let z = along.normalize();
        let x = z.any_orthonormal_vector();
        Solid {
            shape: Shape::Cylinder { radius, half_length: along.length() / 2.0 },
            material,
            centre: (from + to) / 2.0,
            axes: Mat3::from_cols(x, z.cross(x), z),
            seed,
        }
    }

    /// A block turned by `yaw` radians about the vertical.
    pub fn block(centre: Vec3, half: Vec3, yaw: f32, material: Material, seed: u32) -> Solid {
        let axes = Mat3::from_rotation_z(yaw);
        Solid { shape: Shape::Block { half }, material, centre, axes, seed }
    }

    /// A world point in the solid's axes.
    pub fn to_local(&self, p: Vec3) -> Vec3 {
        self.axes.transpose() * (p - self.centre)
    }

    /// Signed distance of a world point, negative inside. Of an ellipsoid an estimate, which is right near its surface.
    pub fn distance(&self, p: Vec3) -> f32 {
        let q = self.to_local(p).abs();
        let beyond = match self.shape {
            Shape::Block { half } => q - half,
            Shape::Cylinder { radius, half_length } => {
                Vec3::new(q.truncate().length() - radius, q.z - half_length, f32::MIN)
            }
            Shape::Ellipsoid { half } => {
                let (scaled, slope) = ((q / half).length(), (q / (half * half)).length());
                // At the centre the slope says nothing.
                let estimate = scaled * (scaled - 1.0) / slope.max(1e-6);
                return if scaled > 0.0 { estimate } else { -half.min_element() };
            }
        };
        beyond.max(Vec3::ZERO).length() + beyond.max_element().min(0.0)
    }

    /// The nearest hit from outside, within `0 < t < limit`.
    pub fn hit(&self, ray: &Ray, limit: f32) -> Option<SolidHit> {
        let o = self.to_local(ray.origin);
        let d = self.axes.transpose() * ray.direction;
        let hit = match self.shape {
            Shape::Block { half } => hit_block(o, d, half),
            Shape::Cylinder { radius, half_length } => hit_cylinder(o, d, radius, half_length),
            Shape::Ellipsoid { half } => hit_ellipsoid(o, d, half),
        }?;
        (hit.t > 0.0 && hit.t < limit).then_some(hit)
    }

    /// Corners of the axis-aligned box around the solid.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let half = match self.shape {
            Shape::Block { half } | Shape::Ellipsoid { half } => half,
            Shape::Cylinder { radius, half_length } => Vec3::new(radius, radius, half_length),
        };
        let axes = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let reach = axes[0].abs() * half.x + axes[1].abs() * half.y + axes[2].abs() * half.z;
        (self.centre - reach, self.centre + reach)
    }
}

fn hit_block(o: Vec3, d: Vec3, half: Vec3) -> Option<SolidHit> {
    let (enter, leave, axis) = slab(o, d, half);
    let mut local_normal = Vec3::ZERO;
    local_normal[axis] = -d[axis].signum();
    (enter <= leave).then_some(SolidHit { t: enter, local_normal })
}

/// Where a line enters and leaves a box of half sides `half`, and the axis by which it enters.
fn slab(o: Vec3, d: Vec3, half: Vec3) -> (f32, f32, usize) {
    let inverse = d.recip();
    let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
    let (near, far) = (a.min(b), a.max(b));
    (near.max_element(), far.min_element(), near.max_position())
}

fn hit_cylinder(o: Vec3, d: Vec3, radius: f32, half_length: f32) -> Option<SolidHit> {
    let (o2, d2) = (o.truncate(), d.truncate());
    let (a, b, c) = (d2.length_squared(), o2.dot(d2), o2.length_squared() - radius * radius);
    let discriminant = b * b - a * c;
    if a > 0.0 && discriminant >= 0.0 {
        let t = (-b - discriminant.sqrt()) / a;
        if (o.z + t * d.z).abs() <= half_length {
            let local_normal = ((o2 + d2 * t) / radius).extend(0.0);
            return Some(SolidHit { t, local_normal });
        }
    }
    let side = -d.z.signum();
    let t = (side * half_length - o.z) / d.z;
    ((o2 + d2 * t).length_squared() <= radius * radius)
        .then_some(SolidHit { t, local_normal: Vec3::Z * side })
}

fn hit_ellipsoid(o: Vec3, d: Vec3, half: Vec3) -> Option<SolidHit> {
    let (o1, d1) = (o / half, d / half);
    let (a, b, c) = (d1.length_squared(), o1.dot(d1), o1.length_squared() - 1.0);
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    let local_normal = ((o + d * t) / (half * half)).normalize();
    Some(SolidHit { t, local_normal })
}

/// Solids inside one axis-aligned bounding box.
#[derive(Clone)]
pub struct Group {
    pub solids: Vec<Solid>,
    centre: Vec3,
    half: Vec3,
}

impl Group {
    pub fn new(solids: Vec<Solid>) -> Group {
        let (low, high) = solids
            .iter()
            .map(Solid::bounds)
            .reduce(|(a, b), (low, high)| (a.min(low), b.max(high)))
            .unwrap_or_default();
        Group { solids, centre: (low + high) / 2.0, half: (high - low) / 2.0 }
    }

    /// Whether the ray meets the bounding box within `0..limit`.
    pub fn may_hit(&self, ray: &Ray, limit: f32) -> bool {
        let (enter, leave, _) = slab(ray.origin - self.centre, ray.direction, self.half);
        enter <= leave && leave > 0.0 && enter < limit
    }

    /// Distance of a point to the bounding box, zero inside.
    pub fn distance_to_bounds(&self, p: Vec3) -> f32 {
        ((p - self.centre).abs() - self.half).max(Vec3::ZERO).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solids() -> [Solid; 3] {
        let (from, to) = (Vec3::new(0.1, -0.2, 0.4), Vec3::new(1.0, 0.5, 1.2));
        [
            Solid::cylinder(from, to, 0.3, Material::Pipe, 0),
            Solid::block(Vec3::splat(0.5), Vec3::new(0.4, 0.2, 0.6), 0.7, Material::Steel, 0),
            Solid {
                shape: Shape::Ellipsoid { half: Vec3::new(0.5, 0.3, 0.4) },
                material: Material::Stone,
                centre: Vec3::new(0.2, 0.1, 0.3),
                axes: Mat3::from_rotation_x(0.4),
                seed: 0,
            },
        ]
    }

    #[test]
    fn rays_stop_where_the_distance_is_zero() {
        let mut hits = 0;
        for solid in &solids() {
            for i in 0..400 {
                let angle = i as f32 * 0.7;
                let origin = Vec3::new(4.0 * angle.cos(), 4.0 * angle.sin(), (i % 7) as f32 - 2.0);
                let aim = solid.centre + Vec3::new(0.3, -0.2, 0.2) * ((i % 5) as f32 / 2.0 - 1.0);
                let ray = Ray { origin, direction: (aim - origin).normalize() };
                let Some(hit) = solid.hit(&ray, f32::INFINITY) else { continue };
                let p = ray.at(hit.t);
                assert!(solid.distance(p).abs() < 1e-4, "{} at {p}", solid.distance(p));
                let outside = p + solid.axes * hit.local_normal * 0.01;
                assert!((solid.distance(outside) - 0.01).abs() < 1e-3);
                hits += 1;
            }
        }
        assert!(hits > 900, "{hits}");
    }

    #[test]
    fn known_depths() {
        let down = Ray { origin: Vec3::new(0.0, 0.0, 5.0), direction: -Vec3::Z };
        let barrel = Solid::cylinder(Vec3::ZERO, Vec3::Z * 3.0, 0.5, Material::Barrel, 0);
        assert!((barrel.hit(&down, 9.0).unwrap().t - 2.0).abs() < 1e-6);
        assert!(barrel.hit(&down, 1.5).is_none());
        let level = Ray { origin: Vec3::new(-4.0, 0.3, 1.0), direction: Vec3::X };
        assert!((barrel.hit(&level, 9.0).unwrap().t - 3.6).abs() < 1e-5);
    }

    #[test]
    fn bounds_hold_the_solid() {
        for solid in solids() {
            let centre = solid.centre;
            let group = Group::new(vec![solid]);
            let ray = Ray { origin: centre + Vec3::X * 5.0, direction: -Vec3::X };
            assert!(group.may_hit(&ray, 9.0) && !group.may_hit(&ray, 1.0));
            assert_eq!(group.distance_to_bounds(centre), 0.0);
        }
    }
}

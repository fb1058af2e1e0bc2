//! A scene: solids, and the water that they are seen through.

use glam::Vec3;

use super::solid::{Group, Ray, Solid};
use super::water::Water;

/// Everything that stands still in the picture.
#[derive(Clone)]
pub struct Scene {
    /// What may cast shadows, in groups that rays can pass by.
    pub groups: Vec<Group>,
    /// Floor, water surface and walls. They cast no shadows.
    pub enclosure: Group,
    pub water: Water,
    /// Weeks in which the basin's surfaces have grown over. 0: as mapped.
    pub weeks: f32,
}

/// Where a ray ends.
pub struct Hit<'a> {
    pub t: f32,
    pub position: Vec3,
    /// Unit, world axes, towards the ray's origin.
    pub normal: Vec3,
    pub solid: &'a Solid,
}

impl Scene {
    /// The scene with a group of solids more.
    pub fn with(mut self, solids: Vec<Solid>) -> Scene {
        self.groups.push(Group::new(solids));
        self
    }

    /// The part of the scene that is within a distance of a place.
    pub fn near(&self, place: Vec3, reach: f32) -> Scene {
        let near = self.groups.iter().filter(|group| group.distance_to_bounds(place) < reach);
        Scene { groups: near.cloned().collect(), ..self.clone() }
    }

    /// All solids, the enclosure's last.
    #[cfg(test)]
    pub fn solids(&self) -> impl Iterator<Item = &Solid> {
        self.groups.iter().flat_map(|g| &g.solids).chain(&self.enclosure.solids)
    }

    /// The nearest surface along a ray. `None` if the ray ends in open water.
    pub fn hit(&self, ray: &Ray) -> Option<Hit<'_>> {
        let mut nearest = f32::INFINITY;
        let mut found = None;
        let groups = self.groups.iter().chain([&self.enclosure]);
        for group in groups {
            if !group.may_hit(ray, nearest) {
                continue;
            }
            for solid in &group.solids {
                if let Some(hit) = solid.hit(ray, nearest) {
                    nearest = hit.t;
                    found = Some((solid, hit.local_normal));
                }
            }
        }
        found.map(|(solid, local_normal)| Hit {
            t: nearest,
            position: ray.at(nearest),
            normal: solid.axes * local_normal,
            solid,
        })
    }

    /// Whether something casts a shadow along the ray.
    pub fn shadowed(&self, ray: &Ray) -> bool {
        self.shadowed_within(ray, f32::INFINITY)
    }

    /// Whether something casts a shadow along the ray's first `limit` metres.
    pub fn shadowed_within(&self, ray: &Ray, limit: f32) -> bool {
        let mut near = self.groups.iter().filter(|g| g.may_hit(ray, limit));
        near.any(|g| g.solids.iter().any(|s| s.hit(ray, limit).is_some()))
    }

    /// Distance to the nearest surface, at most `reach`; negative inside a solid.
    pub fn distance(&self, p: Vec3, reach: f32) -> f32 {
        let near = self.groups.iter().filter(|g| g.distance_to_bounds(p) < reach);
        near.flat_map(|g| &g.solids)
            .chain(&self.enclosure.solids)
            .fold(reach, |d, s| d.min(s.distance(p)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::basin;
    use super::*;

    #[test]
    fn rays_meet_floor_barrel_and_wall_where_they_stand() {
        let scene = basin::mapped();
        let depth = |origin, direction| scene.hit(&Ray { origin, direction }).unwrap().t;
        assert!((depth(Vec3::new(3.5, 0.0, 2.0), -Vec3::Z) - 2.0).abs() < 1e-5);
        // Onto the outermost point of the middle pile of the side x > 0.
        assert!((depth(Vec3::new(4.5, 0.0, 2.0), -Vec3::X) - 2.55).abs() < 1e-5);
        assert!((depth(Vec3::new(4.5, 0.0, 2.0), Vec3::X) - 1.7).abs() < 1e-5);
    }

    #[test]
    fn distance_sees_solids_and_walls_within_reach() {
        let scene = basin::mapped();
        assert!((scene.distance(Vec3::new(2.45, 0.0, 1.0), 2.0) - 0.5).abs() < 1e-5);
        assert!(scene.distance(Vec3::new(1.66, 0.0, 1.5), 2.0) < -0.2);
        assert_eq!(scene.distance(Vec3::new(4.0, 0.0, 2.8), 1.0), 1.0);
        let object = Vec3::new(2.4, 0.35, 0.5);
        assert!(basin::with_new_object().distance(object, 1.0) < 0.0);
        assert!(scene.distance(object, 1.0) > 0.0);
    }
}

//! Where a glTF scene puts the splats of a primitive.

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::container::refusal;
use super::document::{Document, Node, Primitive};
use crate::sh_rotation::ShRotation;
use nvsprior::prior::PriorError;

/// Deepest tree of nodes.
const MAX_DEPTH: usize = 64;

/// Most that a node's axes may differ from right angles of one length, as a part of that length.
const ROUNDING: f64 = 1e-4;

/// A primitive with splats, and its transform to the world.
pub struct Placement<'a> {
    pub primitive: &'a Primitive,
    translation: DVec3,
    rotation: DQuat,
    scale: f64,
    /// `None` if nothing is turned.
    sh_rotation: Option<ShRotation>,
}

/// All primitives with splats in the scene that the file shows: the one that it names, or else the first one.
pub fn of_splats(document: &Document) -> Result<Vec<Placement<'_>>, PriorError> {
    let scene = document.scene.unwrap_or(0);
    let scene = document.scenes.get(scene);
    let scene = scene.ok_or_else(|| refusal("the scene to show is not there".into()))?;
    let mut walk = Walk { document, seen: vec![false; document.nodes.len()], found: Vec::new() };
    for node in &scene.nodes {
        walk.node(*node, DMat4::IDENTITY, 0)?;
    }
    Ok(walk.found)
}

struct Walk<'a> {
    document: &'a Document,
    seen: Vec<bool>,
    found: Vec<Placement<'a>>,
}

impl<'a> Walk<'a> {
    fn node(&mut self, index: usize, parent: DMat4, depth: usize) -> Result<(), PriorError> {
        let node = self.document.nodes.get(index);
        let node = node.ok_or_else(|| refusal(format!("node {index} is not there")))?;
        if std::mem::replace(&mut self.seen[index], true) || depth > MAX_DEPTH {
            return Err(refusal(format!(
                "node {index}: the nodes are no tree of {MAX_DEPTH} levels"
            )));
        }
        let world = parent * local(node);
        if let Some(mesh) = node.mesh {
            let mesh = self.document.meshes.get(mesh);
            let mesh =
                mesh.ok_or_else(|| refusal(format!("the mesh of node {index} is not there")))?;
            for primitive in &mesh.primitives {
                let Some(splats) = &primitive.extensions.splats else { continue };
                splats.check()?;
                self.found.push(Placement::new(primitive, world, index)?);
            }
        }
        node.children.iter().try_for_each(|child| self.node(*child, world, depth + 1))
    }
}

/// Node to parent.
fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    DMat4::from_scale_rotation_translation(
        node.scale.unwrap_or([1.0; 3]).into(),
        DQuat::from_xyzw(x, y, z, w),
        node.translation.unwrap_or([0.0; 3]).into(),
    )
}

impl Placement<'_> {
    fn new(primitive: &Primitive, world: DMat4, node: usize) -> Result<Placement<'_>, PriorError> {
        let axes = DMat3::from_mat4(world);
        let scale = axes.x_axis.length();
        let turn = axes * (1.0 / scale);
        let off = turn.transpose() * turn - DMat3::IDENTITY;
        let is_rotation = off.to_cols_array().into_iter().all(|v| v.abs() <= ROUNDING)
            && turn.determinant() > 0.0
            && world.w_axis.is_finite();
        if !is_rotation {
            return Err(refusal(format!(
                "node {node} does not only turn, move and scale by one factor: apply its transform first"
            )));
        }
        let rotation = DQuat::from_mat3(&turn).normalize();
        let turns = axes != DMat3::from_diagonal(DVec3::splat(scale));
        Ok(Placement {
            primitive,
            translation: world.w_axis.truncate(),
            rotation,
            scale,
            sh_rotation: turns.then(|| ShRotation::new(rotation)),
        })
    }

    /// The world's coordinates of a position.
    pub fn position(&self, position: [f64; 3]) -> [f64; 3] {
        let turned = match self.sh_rotation {
            Some(_) => self.rotation * DVec3::from(position),
            None => position.into(),
        };
        (self.translation + self.scale * turned).into()
    }

    /// Splat to world, (w, x, y, z), of a rotation (x, y, z, w).
    pub fn rotation(&self, [x, y, z, w]: [f64; 4]) -> [f32; 4] {
        let q = match self.sh_rotation {
            Some(_) => self.rotation * DQuat::from_xyzw(x, y, z, w),
            None => DQuat::from_xyzw(x, y, z, w),
        };
        [q.w, q.x, q.y, q.z].map(|v| v as f32)
    }

    /// Logarithms of the standard deviations, in the world's unit.
    pub fn log_scales(&self, scales: [f64; 3]) -> [f32; 3] {
        scales.map(|scale| libm::log(self.scale * scale) as f32)
    }

    /// Spherical harmonics for directions in the world.
    pub fn sh(&self, sh: [[f64; 3]; 16]) -> [[f32; 3]; 16] {
        let sh = self.sh_rotation.as_ref().map_or(sh, |rotation| rotation.turn(&sh));
        sh.map(|rgb| rgb.map(|v| v as f32))
    }
}

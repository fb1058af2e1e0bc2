//! Evaluations that draw only some rows of tiles, against whole ones in which the other rows are masked.

use nvsprior::image::Mask;
use nvsprior::render::{Jacobian, NormalEquations, Plan, Renderer, to_byte};
use nvsprior::tracking::GaussNewtonOptions;
use nvsprior::{Camera, Picture};
use nvsprior_kernels::search::{COMPACT, Placement, Program};
use nvsprior_kernels::shared::TILE;

use crate::common::{self, assert_silent, random_pose, random_prior};
use crate::frame::placement;

/// What a search sees at a pose, evaluating all rows of tiles or some.
fn evaluated(renderer: &mut Renderer, start: Placement, sparse: u32) -> NormalEquations {
    let cold = GaussNewtonOptions::default().cold.program(1, [start], 1e-3, COMPACT);
    let program = Program { renders: 1, leap: 0.0, tolerance: 0.0, sparse, ..cold };
    let searched = renderer.search(&program).unwrap();
    assert_eq!(searched.search.evaluations, 1);
    let sums = searched.search.place_sums.map(f64::from);
    NormalEquations::from_sums(&sums, 3 * renderer.counted(0)[sparse as usize])
}

fn compare(seed: u64, camera: Camera, jacobian: Jacobian, step: u32) {
    let engine = common::engine();
    let prior = random_prior(seed, 3_000, 1);
    let scene = engine.upload(&prior).unwrap();
    let plan = Plan { search: Some(jacobian), ..Plan::picture() };
    let mut renderer = engine.renderer(&scene, &camera, plan).unwrap();
    let data = common::random_frame(seed, &camera).iter().map(|v| to_byte(*v)).collect();
    renderer.set_picture(&Picture { width: camera.width, height: camera.height, data });

    let rows: Vec<u32> =
        (0..camera.height).filter(|y| renderer.draws_sparsely(0, *y)).map(|y| y / TILE).collect();
    let all = camera.height.div_ceil(TILE);
    let mut tiles = rows.clone();
    tiles.dedup();
    assert!(tiles.windows(2).all(|pair| pair[1] - pair[0] == step), "{tiles:?}");
    assert!(tiles[0] < step && tiles[tiles.len() - 1] + step >= all, "{tiles:?} of {all}");

    let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let start = placement(&random_pose(seed), centre);
    let whole = evaluated(&mut renderer, start, 0);
    let sparse = evaluated(&mut renderer, start, 1);
    let mut mask = Mask::none(camera.width, camera.height);
    for (i, counts) in mask.data.iter_mut().enumerate() {
        *counts = tiles.contains(&(i as u32 / camera.width / TILE));
    }
    renderer.set_mask(Some(&mask));
    let masked = evaluated(&mut renderer, start, 0);
    assert_eq!(renderer.counted(0), [mask.count(); 2]);
    assert!(sparse.square < 0.7 * whole.square, "rows are left out");
    assert_eq!(sparse.residuals, masked.residuals);
    let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-5 * scale;
    assert!(close(sparse.square, masked.square, masked.square));
    for i in 0..6 {
        let own = masked.jtj[i][i].sqrt();
        let scale = own * masked.square.sqrt();
        assert!(close(sparse.jtr[i], masked.jtr[i], scale), "{sparse:?}\n{masked:?}");
        for j in 0..6 {
            let scale = own * masked.jtj[j][j].sqrt();
            assert!(close(sparse.jtj[i][j], masked.jtj[i][j], scale), "{sparse:?}\n{masked:?}");
        }
    }
    assert_silent(&engine);
}

#[test]
fn every_second_row_of_tiles_counts() {
    let camera = Camera { width: 320, height: 180, fx: 250.0, fy: 248.0, cx: 157.0, cy: 93.0 };
    compare(71, camera, Jacobian::Flow, 2);
}

/// The picture has more than one band of tiles on a GPU, and an odd number of rows in its last tile.
#[test]
fn every_fourth_row_of_a_large_picture_counts() {
    let camera = Camera { width: 648, height: 363, fx: 500.0, fy: 503.0, cx: 322.0, cy: 180.0 };
    compare(72, camera, Jacobian::Flow, 4);
}

#[test]
fn the_exact_jacobian_leaves_the_same_rows_out() {
    let camera = Camera { width: 320, height: 180, fx: 250.0, fy: 248.0, cx: 157.0, cy: 93.0 };
    compare(73, camera, Jacobian::Exact, 2);
}

/// A sparse search ends with the whole picture, to the same bytes as its packet's pose yields on the topside.
#[test]
fn the_final_picture_is_whole() {
    let engine = common::engine();
    let prior = random_prior(74, 3_000, 1);
    let scene = engine.upload(&prior).unwrap();
    let camera = Camera { width: 648, height: 363, fx: 500.0, fy: 503.0, cx: 322.0, cy: 180.0 };
    let plan = Plan { search: Some(Jacobian::Flow), ..Plan::picture() };
    let mut renderer = engine.renderer(&scene, &camera, plan).unwrap();
    let data = common::random_frame(74, &camera).iter().map(|v| to_byte(*v)).collect();
    renderer.set_picture(&Picture { width: camera.width, height: camera.height, data });
    let centre = glam::DVec3::from(prior.coordinate_frame().centre.map(f64::from));
    let start = placement(&random_pose(74), centre);
    let cold = GaussNewtonOptions::default().cold.program(1, [start], 1e-3, COMPACT);
    let code = renderer.search(&Program { sparse: 1, ..cold }).unwrap().code;
    let (found, difference) = (renderer.rendered().to_vec(), renderer.difference().to_vec());
    renderer.draw_coded(&code).unwrap();
    assert!(found == renderer.rendered(), "the same picture");
    assert!(difference == renderer.difference(), "the same difference");
    assert_silent(&engine);
}

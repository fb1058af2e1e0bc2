//! The depth order and the lists of tiles in all forms, against the twin.

use nvsprior::{Camera, Pose, Prior, RenderOptions};
use nvsprior_kernels::shared::{BIN_TABLE, CULLED};
use nvsprior_reference::{Twin, bin, radix};

use crate::chain::{Chain, FORMS, Form, Settings, UNSET, View};
use crate::common::{camera, random_pose, random_prior, random_splats};

/// The order is that of the keys.
fn assert_order(chain: &Chain) {
    let keys = &chain.buffers["keys"][..chain.buffers["counters"][3] as usize];
    let bits = chain.settings.first_digit * chain.buffers["counters"][2];
    let coarse = |key: &u32| if *key == CULLED { CULLED } else { key >> bits };
    let keys: Vec<u32> = keys.iter().map(coarse).collect();
    let splats: Vec<u32> = (0..keys.len() as u32).collect();
    assert!(chain.order() == radix::sort_visible(&keys, &splats).1, "the order is the keys'");
}

/// Each tile's list. They follow each other without a gap.
fn lists_of<'a>(chain: &'a Chain) -> Vec<&'a [u32]> {
    let pairs = &chain.buffers["pair splats"];
    let mut end = 0;
    let list = |range: &[u32; 2]| {
        assert_eq!(range[0], end, "a list begins where the one before ends");
        end = range[1];
        &pairs[range[0] as usize..range[1] as usize]
    };
    let lists: Vec<&[u32]> = chain.get::<[u32; 2]>("ranges").iter().map(list).collect();
    assert_eq!(end, chain.buffers["counters"][0].min(chain.settings.room), "the lists hold all");
    lists
}

/// Lists are in depth order; every drawn tile that shows a splat has it, no tile has it twice, few have it in vain.
fn assert_lists(view: &View, chain: &Chain) {
    assert_order(chain);
    let mut place = vec![usize::MAX; chain.params.splats as usize];
    chain.order().iter().enumerate().for_each(|(i, splat)| place[*splat as usize] = i);
    let lists = lists_of(chain);
    for list in &lists {
        let sorted = list.is_sorted_by(|a, b| place[*a as usize] < place[*b as usize]);
        assert!(sorted, "in depth order, each once");
    }
    assert_eq!(view.analysis.splats.len(), view.prior.len(), "splats have their numbers");
    let twin = Twin::new(view.prior);
    let viewpoint = twin.view(&view.camera, &view.pose);
    let (mut needed, across) = (0, chain.params.tiles_x);
    for s in twin.project(&viewpoint) {
        for tile in bin::tiles(&viewpoint, &s, 1e-3) {
            let row = tile / across;
            if chain.params.draws(row) {
                let drawn = chain.params.drawn_before(row) * across + tile % across;
                assert!(lists[drawn as usize].contains(&s.index), "{} in {tile}", s.index);
                needed += 1;
            }
        }
    }
    let all: usize = lists.iter().map(|list| list.len()).sum();
    assert!(needed > 100 && (all - needed) * 8 <= needed, "{all} pairs, {needed} needed");
}

fn listed<'a>(view: &'a View, settings: Settings) -> Chain<'a> {
    let mut chain = Chain::new(view, settings);
    chain.tile_lists();
    chain
}

/// Checks all forms, and that their lists are the same.
fn assert_forms(prior: &Prior, camera: Camera, pose: Pose, with: impl Fn(Form) -> Settings) {
    let view = View::new(prior, camera, pose);
    let chains: Vec<Chain> = FORMS.map(|form| listed(&view, with(form))).into();
    for chain in &chains {
        assert_lists(&view, chain);
        let same = lists_of(chain) == lists_of(&chains[0]);
        assert!(same, "{:?}: other lists than {:?}", chain.settings.form, FORMS[0]);
    }
}

#[test]
fn random_scenes() {
    for seed in 0..4 {
        let prior = random_prior(110 + seed, 700, 0);
        let log_bin_blocks = 2 + seed as u32 % 3;
        for scheduler in [seed, 10 + seed] {
            assert_forms(&prior, camera(61, 43), random_pose(110 + seed), |form| Settings {
                log_bin_blocks,
                ..Settings::new(form, scheduler)
            });
        }
    }
}

#[test]
fn coarse_depths() {
    let prior = random_prior(115, 900, 0);
    assert_forms(&prior, camera(40, 33), random_pose(115), |form| Settings {
        first_digit: 1,
        ..Settings::new(form, 3)
    });
}

#[test]
fn some_rows_of_tiles() {
    for row_shift in [1, 2] {
        let prior = random_prior(116, 800, 0);
        assert_forms(&prior, camera(52, 71), random_pose(116), |form| Settings {
            row_shift,
            ..Settings::new(form, u64::from(row_shift))
        });
    }
}

#[test]
fn several_bands() {
    let camera = Camera { height: 52, cy: 26.0, ..camera(4_000, 52) };
    assert!(camera.height.div_ceil(8) > BIN_TABLE / camera.width.div_ceil(8), "a border of bands");
    let prior = random_prior(117, 30, 0);
    assert_forms(&prior, camera, random_pose(117), |form| Settings {
        room: 1 << 17,
        ..Settings::new(form, 5)
    });
}

#[test]
fn equal_depths_go_by_index() {
    let mut splats = random_splats(118, 400, 0);
    splats.positions.iter_mut().for_each(|p| p[2] = if p[0] > 0.0 { 3.0 } else { 4.0 });
    let prior = Prior::from_splats(splats, RenderOptions::GSPLAT).unwrap();
    assert_forms(&prior, camera(48, 48), Pose::IDENTITY, |form| Settings::new(form, 6));
}

#[test]
fn too_little_room_is_told_and_not_overrun() {
    let prior = random_prior(119, 500, 0);
    let view = View::new(&prior, camera(48, 40), random_pose(119));
    for form in FORMS {
        let settings = Settings::new(form, 7);
        let whole = listed(&view, settings);
        let needed = whole.buffers["counters"][0];
        let part = listed(&view, Settings { room: needed / 3, ..settings });
        assert_eq!(part.buffers["counters"][0], needed, "{form:?}");
        let cut = &whole.buffers["pair splats"][..needed as usize / 3];
        assert!(part.buffers["pair splats"] == cut, "{form:?}");
        let cut: Vec<u32> = whole.buffers["ranges"].iter().map(|v| *v.min(&(needed / 3))).collect();
        assert!(part.buffers["ranges"] == cut, "{form:?}");
    }
}

/// Splats that lie behind the last one that is held are in no list.
#[test]
fn places_without_a_splat_are_left_out() {
    let prior = random_prior(121, 500, 1);
    let view = View::new(&prior, camera(47, 38), random_pose(121));
    for (form, first_digit) in FORMS.into_iter().zip([0, 1, 0, 1]) {
        let settings = Settings { first_digit, ..Settings::new(form, 9) };
        let tight = listed(&view, settings);
        for spare in [1, 139, 4_000] {
            let mut chain = listed(&view, Settings { spare, ..settings });
            let what = format!("{form:?}, {spare} to spare");
            let (held, beyond) = chain.buffers["keys"].split_at(500);
            assert!(held == tight.buffers["keys"], "{what}");
            assert_eq!(beyond, vec![UNSET; spare as usize], "{what}: no key is made for them");
            assert_lists(&view, &chain);
            assert!(chain.order() == tight.order(), "{what}");
            assert!(lists_of(&chain) == lists_of(&tight), "{what}");
            chain.splat();
            let drawn = view.drawn.image.iter().map(|v| v.to_bits());
            assert!(first_digit > 0 || drawn.eq(chain.buffers["image"].iter().copied()), "{what}");
        }
    }
}

#[test]
fn nothing_in_view() {
    let prior = random_prior(120, 300, 0);
    let away = Pose::exp(&[0.0, 0.0, -100.0, 0.0, 0.0, 0.0]);
    let view = View::new(&prior, camera(30, 20), away);
    for form in FORMS {
        let chain = listed(&view, Settings::new(form, 8));
        assert_eq!(chain.buffers["counters"][..2], [0, 0], "{form:?}");
        assert!(lists_of(&chain).iter().all(|list| list.is_empty()), "{form:?}");
    }
}

//! The stages of a frame, one dispatch after another, as `src/render/stages.rs` records them.

use std::collections::HashMap;

use bytemuck::Pod;
use glam::{DMat3, DQuat, DVec3};

use nvsprior::prior::Splats;
use nvsprior::prior::analysis::PriorAnalysis;
use nvsprior::render::definition::{Definition, Drawn};
use nvsprior::{Camera, Pose, Prior};
use nvsprior_emulator::{Dispatch, Error, Module};
use nvsprior_kernels::block_table::BlockTable;
use nvsprior_kernels::modules;
use nvsprior_kernels::shared::{
    BIN_TABLE, CULLED, DIGITS, GEOMETRY_PLANES, Groups, PIXEL, Params, RECORD, SUMS, TABLE,
    digit_bits, sh_coefficients, sh_planes, tiles_per_group,
};

/// What nobody has written yet.
pub const UNSET: u32 = 0xdead_beef;

/// A form of the stages, at a subgroup size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form {
    /// Lanes of a subgroup.
    pub subgroup: u32,
    pub wave: bool,
}

/// The forms for waves, and the plain one at 32.
pub const FORMS: [Form; 4] = [
    Form { subgroup: 16, wave: true },
    Form { subgroup: 32, wave: true },
    Form { subgroup: 64, wave: true },
    Form { subgroup: 32, wave: false },
];

/// The modules that differ between forms.
pub struct FormModules {
    pub radix_scatter: modules::Module,
    pub bin_count: modules::Module,
    pub bin_scan: modules::Module,
    pub bin_emit: modules::Module,
    pub splat: modules::Module,
    pub splat_flow: modules::Module,
}

macro_rules! form_modules {
    ($scatter:ident $bin_count:ident $bin_scan:ident $bin_emit:ident $splat:ident $splat_flow:ident) => {
        FormModules {
            radix_scatter: modules::$scatter,
            bin_count: modules::$bin_count,
            bin_scan: modules::$bin_scan,
            bin_emit: modules::$bin_emit,
            splat: modules::$splat,
            splat_flow: modules::$splat_flow,
        }
    };
}

impl Form {
    pub fn modules(self) -> FormModules {
        match (self.wave, self.subgroup) {
            (true, 16) => form_modules!(radix_scatter_wave16 bin_count_wave16
                bin_scan_wave16 bin_emit_wave16 splat_wave16 splat_flow_wave16),
            (true, 32) => form_modules!(radix_scatter_wave32 bin_count_wave32
                bin_scan_wave32 bin_emit_wave32 splat_wave32 splat_flow_wave32),
            (true, 64) => form_modules!(radix_scatter_wave64 bin_count_wave64
                bin_scan_wave64 bin_emit_wave64 splat_wave64 splat_flow_wave64),
            _ => form_modules!(radix_scatter bin_count bin_scan bin_emit splat
                splat_flow),
        }
    }

    fn tiles_per_group(self) -> u32 {
        if self.wave { tiles_per_group(self.subgroup) } else { 1 }
    }
}

/// How a chain is run.
#[derive(Clone, Copy)]
pub struct Settings {
    pub form: Form,
    /// Of the emulator's scheduler.
    pub seed: u64,
    /// Logarithms of the numbers of workgroups that share the sort and the binning.
    pub log_sort_blocks: u32,
    pub log_bin_blocks: u32,
    /// The digit that is sorted by first.
    pub first_digit: u32,
    /// Of 2^`row_shift` rows of tiles one is drawn.
    pub row_shift: u32,
    /// Room for pairs.
    pub room: u32,
    /// Places for more splats in the planes of splats. Splats lie there, but are not held.
    pub spare: u32,
    pub depth: bool,
}

impl Settings {
    pub fn new(form: Form, seed: u64) -> Settings {
        Settings {
            form,
            seed,
            log_sort_blocks: 3,
            log_bin_blocks: 2,
            first_digit: 0,
            row_shift: 0,
            room: 1 << 15,
            spare: 0,
            depth: true,
        }
    }
}

/// A prior from a pose.
pub struct View<'a> {
    pub prior: &'a Prior,
    pub camera: Camera,
    pub pose: Pose,
    pub analysis: PriorAnalysis,
    /// What the definition draws.
    pub drawn: Drawn,
}

impl<'a> View<'a> {
    pub fn new(prior: &'a Prior, camera: Camera, pose: Pose) -> View<'a> {
        let drawn = Definition::new(prior).draw(&camera, &pose);
        View { prior, camera, pose, analysis: PriorAnalysis::of(prior), drawn }
    }

    /// Specialisation constants.
    fn constants(&self, depth: bool) -> [(u32, u32); 3] {
        let clamp = self.analysis.clamps_alpha.into();
        [(0, self.analysis.sh_degree), (1, clamp), (2, depth.into())]
    }

    /// Planes of position, opacity and axes: as `src/render/scene.rs`.
    fn geometry(&self, stride: u32) -> Vec<u32> {
        let centre = DVec3::from(self.prior.coordinate_frame().centre.map(f64::from));
        let splats = self.prior.splats();
        self.planes(GEOMETRY_PLANES, stride, |i| {
            let position = DVec3::from(splats.positions[i].map(f64::from)) - centre;
            let axes = scaled_axes(splats, i).to_cols_array();
            position.to_array().into_iter().chain([splats.opacity(i)]).chain(axes).collect()
        })
    }

    /// Planes of colours' coefficients.
    fn sh(&self, stride: u32) -> Vec<u32> {
        let (splats, degree) = (self.prior.splats(), self.analysis.sh_degree);
        let needed = 3 * sh_coefficients(degree) as usize;
        self.planes(sh_planes(degree), stride, |i| {
            let of_splat = &splats.sh[i * splats.sh_stride()..][..needed];
            of_splat.iter().map(|v| f64::from(*v)).collect()
        })
    }

    /// Two values of each splat in each plane; 0 after the last value. After the last splat they come again, up to
    /// `stride`.
    fn planes(&self, planes: u32, stride: u32, values: impl Fn(usize) -> Vec<f64>) -> Vec<u32> {
        let (which, stride) = (&self.analysis.splats, stride as usize);
        let mut words = vec![0; stride * 2 * planes as usize];
        for (place, i) in which.iter().cycle().take(stride).enumerate() {
            for (k, value) in values(*i as usize).into_iter().enumerate() {
                words[(k / 2 * stride + place) * 2 + k % 2] = (value as f32).to_bits();
            }
        }
        words
    }
}

fn scaled_axes(splats: &Splats, i: usize) -> DMat3 {
    let [w, x, y, z] = splats.unit_rotation(i).map(f64::from);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scale = splats.log_scales[i].map(|s| libm::exp(f64::from(s)));
    let axes = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
    DMat3::from_cols(axes[0] * scale[0], axes[1] * scale[1], axes[2] * scale[2])
}

/// The buffers of a frame, by name, and how its stages are run.
pub struct Chain<'a> {
    pub view: &'a View<'a>,
    pub settings: Settings,
    pub params: Params,
    pub buffers: HashMap<&'static str, Vec<u32>>,
    pub instructions: u64,
    /// What is run in place of the module with this entry point; and what was wrong with it.
    pub broken: Option<(&'static str, Vec<u8>)>,
    pub faults: Vec<Error>,
}

impl<'a> Chain<'a> {
    pub fn new(view: &'a View<'a>, settings: Settings) -> Chain<'a> {
        let params = Params {
            stride: view.drawn.params.splats + settings.spare,
            pair_capacity: settings.room,
            sort_blocks: 1 << settings.log_sort_blocks,
            bin_blocks: 1 << settings.log_bin_blocks,
            band_rows: BIN_TABLE / view.drawn.params.tiles_x,
            tiles_per_group: settings.form.tiles_per_group(),
            ..view.drawn.params.with_rows(settings.row_shift)
        };
        let mut chain = Chain {
            view,
            settings,
            params,
            buffers: HashMap::new(),
            instructions: 0,
            broken: None,
            faults: Vec::new(),
        };
        let (splats, tiles) = (params.stride, params.tiles_x * params.tiles_y);
        let table = BlockTable::new(TABLE, settings.log_sort_blocks, 0, DIGITS);
        for (name, words) in [
            ("records", (splats + 1) * 4 * RECORD),
            ("keys", splats),
            ("counters", 4),
            ("histogram", table.words()),
            ("coded", 64),
            ("keys 0", splats),
            ("splats 0", splats),
            ("keys 1", splats),
            ("splats 1", splats),
            ("none", 1),
            ("order", splats),
            ("starts", (tiles << settings.log_bin_blocks) + tiles),
            ("bands", params.tiles_y.div_ceil(params.band_rows)),
            ("ranges", 2 * tiles),
            ("pair splats", settings.room),
            ("image", params.width * params.height * PIXEL),
            ("partials", tiles * SUMS),
            ("sums", SUMS),
        ] {
            chain.buffers.insert(name, vec![UNSET; words as usize]);
        }
        chain.set("params", &[params]);
        chain.set("geometry", &view.geometry(params.stride));
        chain.set("sh", &view.sh(params.stride));
        let sums = &mut chain.buffers.get_mut("histogram").unwrap()[..table.rows as usize];
        sums.fill(0);
        chain
    }

    pub fn set<T: Pod>(&mut self, name: &'static str, content: &[T]) {
        self.buffers.insert(name, bytemuck::pod_collect_to_vec(content));
    }

    /// What a buffer holds.
    pub fn get<T: Pod>(&self, name: &str) -> &[T] {
        bytemuck::cast_slice(&self.buffers[name])
    }

    fn groups(&self) -> Groups {
        Groups::of(&self.params)
    }

    /// Replaces what stage `project` leaves by keys alone.
    pub fn set_keys(&mut self, keys: &[u32]) {
        for name in ["keys", "keys 0", "splats 0", "keys 1", "splats 1", "order"] {
            self.set(name, &vec![UNSET; keys.len()]);
        }
        self.set("keys", keys);
        let largest = keys.iter().copied().filter(|key| *key != CULLED).max().unwrap_or(0);
        self.set("counters", &[UNSET, UNSET, digit_bits(largest), UNSET]);
    }

    /// Runs a module on these buffers.
    pub fn run(
        &mut self,
        module: &modules::Module,
        groups: [u32; 3],
        push: &[u32],
        names: &[&'static str],
    ) {
        let mut buffers: Vec<Vec<u32>> =
            names.iter().map(|name| self.buffers.remove(name).expect(name)).collect();
        let dispatch = Dispatch {
            groups,
            push,
            constants: &self.view.constants(self.settings.depth),
            subgroup: self.settings.form.subgroup,
            seed: self.settings.seed,
        };
        let broken = self.broken.as_ref().filter(|(entry, _)| *entry == module.entry);
        let spirv = broken.map_or(module.spirv, |(_, spirv)| spirv);
        let run = Module::new(spirv).and_then(|module| module.run(&dispatch, &mut buffers));
        match run {
            Ok(counts) => self.instructions += counts.instructions,
            Err(fault) if self.broken.is_some() => self.faults.push(fault),
            Err(fault) => panic!("{fault}"),
        }
        self.buffers.extend(std::iter::zip(names.iter().copied(), buffers));
    }

    pub fn project(&mut self) {
        let push = [0, self.settings.first_digit, self.settings.log_sort_blocks];
        let names =
            ["params", "geometry", "sh", "records", "keys", "counters", "histogram", "coded"];
        self.run(&modules::project, self.groups().sort_blocks, &push, &names);
    }

    /// Sorts the keys. `counted`: stage `project` has counted their first digits.
    pub fn sort(&mut self, counted: bool) {
        let form = self.settings.form.modules();
        let Settings { first_digit, log_sort_blocks, .. } = self.settings;
        let groups = [1 << log_sort_blocks, 1, 1];
        let count = if counted { 0 } else { self.buffers["keys"].len() as u32 };
        let (mut keys, mut values) = ("keys", "none");
        for digit in first_digit..DIGITS {
            let out = [["keys 0", "splats 0"], ["keys 1", "splats 1"]][digit as usize % 2];
            let values_out = if digit + 1 < DIGITS { out[1] } else { "order" };
            let push = [digit, (digit == first_digit).into(), log_sort_blocks, count];
            if digit > first_digit || !counted {
                self.run(&modules::radix_count, groups, &push, &["counters", keys, "histogram"]);
            }
            let names = ["counters", "histogram", keys, values, out[0], values_out];
            self.run(&form.radix_scatter, groups, &push, &names);
            (keys, values) = (out[0], values_out);
        }
    }

    pub fn bin(&mut self) {
        let form = self.settings.form.modules();
        let push = [self.settings.log_bin_blocks];
        let Groups { bin_blocks, bands, .. } = self.groups();
        let names = ["params", "counters", "order", "records", "starts"];
        self.run(&form.bin_count, bin_blocks, &push, &names);
        self.run(&form.bin_scan, bands, &push, &["params", "starts", "bands"]);
        let names =
            ["params", "counters", "order", "records", "starts", "bands", "ranges", "pair splats"];
        self.run(&form.bin_emit, bin_blocks, &push, &names);
    }

    /// The lists of each tile's splats.
    pub fn tile_lists(&mut self) {
        self.project();
        self.sort(true);
        self.bin();
    }

    pub fn splat(&mut self) {
        let names = ["params", "ranges", "pair splats", "records", "image", "counters"];
        let module = self.settings.form.modules().splat;
        self.run(&module, self.groups().tile_groups, &[], &names);
    }

    /// The sums of the normal equations against the buffer `frame`.
    pub fn equations(&mut self) -> [f64; SUMS as usize] {
        let names = ["params", "ranges", "pair splats", "records", "frame", "partials", "counters"];
        let module = self.settings.form.modules().splat_flow;
        self.run(&module, self.groups().tile_groups, &[], &names);
        self.reduced()
    }

    /// The sums over the tiles.
    pub fn reduced(&mut self) -> [f64; SUMS as usize] {
        self.run(&modules::reduce, [1, 1, 1], &[], &["params", "partials", "sums"]);
        std::array::from_fn(|k| f64::from(self.get::<f32>("sums")[k]))
    }

    /// The visible splats in depth order.
    pub fn order(&self) -> &[u32] {
        &self.buffers["order"][..self.buffers["counters"][1] as usize]
    }
}
